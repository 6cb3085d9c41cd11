"""The witness of docs/witness.md that can be checked on paper, with all kinds of solids."""

from copy import deepcopy
from typing import Any

_HERE = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]


def placed(x: float, y: float, z: float) -> list[float]:
    """A frame that is only shifted."""
    return [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, y, 0.0, 0.0, 1.0, z]


_DOCUMENT: dict[str, Any] = {
    "format": "armwright-witness",
    "version": 2,
    "hashes": {"robot": None, "scene": None, "trajectory": None},
    "joints": [{"name": "turn", "kind": "revolute", "parent": -1, "transform": _HERE}],
    "solids": [
        {"name": "arm", "body": 0, "kind": "hull", "transform": _HERE,
         "vertices": [[1.0, 0.0, 0.0]], "rounding": 0.1},
        {"name": "post", "body": -1, "kind": "hull", "transform": placed(0.8, 0.9, 0.0),
         "vertices": [[0.0, 0.0, 0.0]], "rounding": 0.1, "margin": 0.05},
        {"name": "can", "body": -1, "kind": "cylinder", "transform": placed(0.8, 0.9, 0.0),
         "radius": 0.1, "half_height": 0.2, "rounding": 0.0, "margin": 0.05},
        {"name": "hat", "body": -1, "kind": "cone", "transform": placed(0.8, 0.9, 0.0),
         "radius": 0.1, "half_height": 0.2, "rounding": 0.0, "margin": 0.05},
        {"name": "wall", "body": -1, "kind": "half-space", "rounding": 0.0, "margin": 0.05,
         "transform": [0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.5]},
        {"name": "touched", "body": -1, "kind": "hull", "transform": placed(1.0, 0.0, 0.0),
         "vertices": [[0.0, 0.0, 0.0]], "rounding": 0.1, "margin": 0.05},
    ],
    "may_touch": [["arm", "touched", "scene"]],
    "limits": {"position": [[-1.0, 1.0]], "velocity": [0.61], "acceleration": [2.5],
               "jerk": [4.9]},
    "knots": [0.0, 1.0],
    "polynomials": [[[0.0, 0.0, 1.2, -0.8]]],
    "start": [0.0],
    "goal": [0.4],
    "cells": [[0.0, 1.0]],
    "facts": {
        "plane": [[0, k, 0, 0.0, 1.0, 0.0] for k in (1, 2, 3)],
        "half-space": [[0, 4, 0]],
    },
    "unwitnessed": [],
}  # fmt: skip


def document() -> dict[str, Any]:
    """A copy of it."""
    return deepcopy(_DOCUMENT)

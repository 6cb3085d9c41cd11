"""A witness written by hand is accepted, and a false one of each kind is not."""

from collections.abc import Callable
from math import cos, sin
from typing import Any

import pytest

from tests.planning.witness.by_hand import document, placed
from tests.planning.witness.problems import checker, rejected

Change = Callable[[dict[str, Any]], object]


def test_the_witness_on_paper_has_the_gap_that_paper_says() -> None:
    """As in docs/witness.md: supports at the ends of d, and a rest of d^2 / 2."""
    paper = 0.9 - 0.1 - (sin(0.2) + 0.2 * cos(0.2) + 0.1 + 0.5 * 0.2**2)
    report = checker().check(document())
    assert report.clearance == pytest.approx(paper, abs=1e-6)
    assert (report.pairs, report.facts, report.cells) == (4, 4, 1)
    # In truth it ends at sin 0.4.
    assert report.clearance < 0.8 - 0.1 - sin(0.4)


def solid(k: int, **fields: Any) -> Change:
    return lambda d: d["solids"][k].update(fields)


def fact(*row: float) -> Change:
    return lambda d: d["facts"]["plane"][0].__setitem__(slice(2, 6), row)


def field(name: str, value: Any) -> Change:
    return lambda d: d.__setitem__(name, value)


def limit(name: str, value: Any) -> Change:
    return lambda d: d["limits"].__setitem__(name, value)


def joint(**fields: Any) -> Change:
    return lambda d: d["joints"][0].update(fields)


def split(jump: list[float]) -> Change:
    """Two pieces, the second one with an addition."""
    second = [0.2, 0.6, 0.0, -0.8]
    added = [c + e for c, e in zip(second, [*jump, 0.0, 0.0, 0.0, 0.0], strict=False)]

    def change(d: dict[str, Any]) -> None:
        d["knots"], d["polynomials"] = [0.0, 0.5, 1.0], [[[0.0, 0.0, 1.2, -0.8]], [added]]

    return change


FALSE = {
    "another format": (field("format", "witness"), "version 2"),
    "an earlier version": (field("version", 1), "version 2"),
    "a field is missing": (lambda d: d.pop("cells"), "malformed"),
    "no number": (fact(0, float("nan"), 1.0, 0.0), "no finite number"),
    "the direction is 0": (fact(0, 0.0, 0.0, 0.0), "direction is 0"),
    "the plane is turned over": (fact(0, 0.0, -1.0, 0.0), "not proved apart"),
    "the plane is turned": (fact(0, 1.0, 0.0, 0.0), "not proved apart"),
    "no such cell": (fact(1, 0.0, 1.0, 0.0), "no cell"),
    "no fact": (lambda d: d["facts"]["plane"].pop(), "nothing parts solids"),
    "no fact of the wall": (lambda d: d["facts"].pop("half-space"), "nothing parts solids"),
    "a fact of another kind": (lambda d: d["facts"].update(oracle=[]), "not known"),
    "solids swapped": (
        lambda d: d["facts"]["plane"][0].__setitem__(slice(0, 2), [1, 0]), "not proved"),
    "no such solid": (lambda d: d["facts"]["plane"][0].__setitem__(1, 9), "no solid"),
    "no half-space": (lambda d: d["facts"]["half-space"].append([0, 1, 0]), "no half-space"),
    "a plane for a half-space": (
        lambda d: d["facts"]["plane"].append([0, 4, 0, 0.0, 1.0, 0.0]), "normal"),
    "a cell that ends early": (field("cells", [[0.0, 0.999]]), "nothing parts solids"),
    "a cell that begins late": (field("cells", [[0.001, 1.0]]), "nothing parts solids"),
    "a cell beyond the end": (field("cells", [[0.0, 1.001]]), "not within"),
    "a post that is larger": (solid(1, rounding=0.4), "not proved apart"),
    "a post that is nearer": (solid(1, transform=placed(0.8, 0.6, 0.0)), "not proved apart"),
    "a can that is wider": (solid(2, radius=0.4), "not proved apart"),
    "a hat that is wider": (solid(3, radius=0.4), "not proved apart"),
    "a negative size": (solid(1, rounding=-0.1), "negative size"),
    "a negative margin": (solid(1, margin=-0.1), "negative size"),
    "a margin that is not kept": (solid(1, margin=0.3), "not proved apart"),
    "a wall that is nearer": (
        solid(4, transform=[0.0, 0.0, 1.0, 0.9, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]),
        "not proved apart",
    ),
    "a solid of no kind": (solid(1, kind="fog"), "not known"),
    "a solid without corners": (solid(1, vertices=[]), "no corners|malformed"),
    "a solid on no body": (solid(0, body=1), "no body"),
    "a wall that moves": (solid(4, body=0), "moves"),
    "the arm is longer": (solid(0, vertices=[[1.8, 0.0, 0.0]]), "not proved apart"),
    "another pair may touch": (field("may_touch", []), "nothing parts solids"),
    "a frame that is no rotation": (
        joint(transform=[1.001, *placed(0.0, 0.0, 0.0)[1:]]), "no rotation"),
    "a solid's frame that is no rotation": (
        solid(0, transform=[1.001, *placed(0.0, 0.0, 0.0)[1:]]), "no rotation"),
    "a joint of no kind": (joint(kind="ball"), "neither"),
    "a joint on itself": (joint(parent=0), "no body before"),
    "a joint that follows none": (joint(follows=[0, 1.0, 0.0]), "no joint to follow"),
    "lower position": (limit("position", [[-1.0, 0.399]]), "position of joint 0"),
    "higher position": (limit("position", [[0.001, 1.0]]), "position of joint 0"),
    "lower velocity": (limit("velocity", [0.599]), "velocity of joint 0"),
    "lower acceleration": (limit("acceleration", [2.39]), "acceleration of joint 0"),
    "lower jerk": (limit("jerk", [4.79]), "jerk of joint 0"),
    "limits of no joint": (limit("velocity", []), "not those of 1 joints"),
    "another start": (field("start", [0.001]), "start"),
    "another goal": (field("goal", [0.399]), "goal"),
    "knots turned round": (field("knots", [1.0, 0.0]), "knots"),
    "knots from elsewhere": (field("knots", [0.1, 1.1]), "knots"),
    "a piece is missing": (field("polynomials", []), "knots"),
    "the position jumps": (split([1e-6]), "derivative 0"),
    "the velocity jumps": (split([0.0, 1e-6]), "derivative 1"),
    "the acceleration jumps": (split([0.0, 0.0, 1e-5]), "derivative 2"),
    "another coefficient": (
        field("polynomials", [[[0.0, 0.0, 1.2, -0.79]]]), "position of joint 0|goal"),
}  # fmt: skip


@pytest.mark.parametrize("name", FALSE)
def test_a_false_witness_is_rejected(name: str) -> None:
    """For the reason that it is false."""
    change, reason = FALSE[name]
    false = document()
    change(false)
    said = rejected(false)
    assert said is not None
    assert any(part in said for part in reason.split("|")), said


def test_pieces_that_join_are_accepted() -> None:
    """So that the jumps above are rejected for being jumps; the cell covers both pieces."""
    true = document()
    split([])(true)
    assert rejected(true) is None
    false = document()
    split([])(false)
    false["polynomials"][1][0][3] = -0.7
    assert "goal" in str(rejected(false))


def test_what_the_file_leaves_open_is_reported() -> None:
    """A pair that it can't part is exempt in the cells that it names, and nowhere else."""
    told = document()
    told["facts"]["plane"].pop()
    told["unwitnessed"] = [{"what": "pair", "count": 1, "pair": [0, 3], "cells": [0]}]
    assert checker().check(told).unwitnessed == told["unwitnessed"]
    told["unwitnessed"][0]["cells"] = []
    assert "nothing parts solids" in str(rejected(told))

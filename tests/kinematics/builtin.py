"""The built-in robots, and the same in Pinocchio."""

from typing import Any

import numpy as np
import pinocchio as pin

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_names, builtin_urdf

NAMES = builtin_names()


def configurations(chain: Chain, count: int) -> Array:
    low, high = chain.sampling_bounds()
    return np.random.default_rng(7).uniform(low, high, (count, chain.n))


def model(name: str) -> Any:
    return pin.buildModelFromXML(builtin_urdf(name))


def pin_configuration(chain: Chain, q: Array) -> Array:
    """Pinocchio writes a joint without end as (cos, sin)."""
    parts = [
        [np.cos(value), np.sin(value)] if endless else [value]
        for value, endless in zip(q, chain.continuous, strict=True)
    ]
    return np.concatenate(parts)

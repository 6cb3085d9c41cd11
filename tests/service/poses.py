"""Poses and configurations in requests."""

from typing import Any

import numpy as np

from kinematics.pose import to_quaternion
from kinematics.robots import builtin_chain


def draws(name: str, count: int, seed: int = 0) -> Any:
    chain = builtin_chain(name)
    lower, upper = chain.sampling_bounds()
    return np.random.default_rng(seed).uniform(lower, upper, (count, chain.n))


def as_pose(T: Any) -> dict[str, Any]:
    return {
        "position": T[:3, 3].tolist(),
        "quaternion_xyzw": to_quaternion(T[:3, :3]).tolist(),
    }

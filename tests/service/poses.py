"""Poses and configurations in requests."""

from typing import Any

import numpy as np

from kinematics.pose import from_quaternion, to_quaternion, transform
from kinematics.robots import builtin_chain


def draws(name: str, count: int, seed: int = 0) -> Any:
    chain = builtin_chain(name)
    lower, upper = chain.sampling_bounds()
    return np.random.default_rng(seed).uniform(lower, upper, (count, chain.n))


def matrix(pose: dict[str, Any]) -> Any:
    return transform(from_quaternion(pose["quaternion_xyzw"]), pose["position"])


def as_pose(T: Any, **more: Any) -> dict[str, Any]:
    turn = to_quaternion(T[:3, :3]).tolist()
    return {"position": T[:3, 3].tolist(), "quaternion_xyzw": turn, **more}

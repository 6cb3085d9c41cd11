"""Poses that inverse kinematics is measured on: random ones, and the edges of an arm."""

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain

#: What one joint alone makes singular: the elbow for "stretched", the wrist for "singular".
_SINGULAR: dict[str, dict[str, dict[int, float | None]]] = {
    "panda": {"stretched": {3: -0.0698}, "singular": {1: 0.0, 2: 0.0}},
    "ur5e": {"stretched": {2: 0.0}, "singular": {4: 0.0}},
    "kr6_sixx": {"stretched": {2: None}, "singular": {4: 0.0}},
    "puma560": {"stretched": {2: None}, "singular": {4: 0.0}},
    "iiwa14": {"stretched": {3: 0.0}, "singular": {5: 0.0, 4: 0.0}},
    "scara": {"stretched": {1: 0.0}, "singular": {1: 0.0}},
}


def random_configurations(chain: Chain, count: int, seed: int) -> Array:
    """Evenly drawn inside the limits."""
    lower, upper = chain.sampling_bounds()
    return np.random.default_rng(seed).uniform(lower, upper, (count, chain.n))


def edge_configurations(chain: Chain, count: int, seed: int) -> Array:
    """A quarter each: rounded to 45 degrees, joints at limits, wrist singular, arm stretched."""
    rng = np.random.default_rng(seed)
    lower, upper = chain.sampling_bounds()
    q = rng.uniform(lower, upper, (count, chain.n))
    kind = np.arange(count) % 4
    turning = chain.joint_types == 0
    rounded = np.where(turning, np.round(q / (np.pi / 4)) * (np.pi / 4), q)
    limits = np.where(rng.random(q.shape) < 0.5, lower, upper)
    at_limits = np.where(rng.random(q.shape) < 0.4, limits, q)
    q = np.where((kind == 0)[:, None], rounded, q)
    q = np.where((kind == 1)[:, None], at_limits, q)
    for name, which in (("singular", 2), ("stretched", 3)):
        for joint, value in _SINGULAR[chain.name][name].items():
            q[kind == which, joint] = _straight(chain) if value is None else value
    return np.array(np.clip(q, lower, upper))


def _straight(chain: Chain) -> float:
    """The value of joint 3 at which shoulder, elbow and wrist are in line."""
    A3, A4 = chain.offsets[2], chain.offsets[3]
    a, b = A3[:2, 3], A3[:2, :2] @ A4[:2, 3]
    return float(
        np.remainder(np.arctan2(a[1], a[0]) - np.arctan2(b[1], b[0]) + np.pi, 2 * np.pi) - np.pi
    )

"""Times from rest to rest beside ruckig's."""

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig
from ruckig import Trajectory as Phases

from kinematics.arrays import Array
from planning.tours.rest_to_rest import rest_to_rest_kernel


def ruckig_time(way: Array, limits: Array, synchronized: bool) -> float:
    """Least time of a motion along a line, or of its slowest joint [s]."""
    if synchronized:
        share = (np.abs(way) / limits).max(axis=1)
        limits = np.array([[1.0 / one if one > 0.0 else np.inf] for one in share])
        way = np.array([1.0])
    wanted = InputParameter(len(way))
    wanted.current_position = [0.0] * len(way)
    wanted.target_position = way.tolist()
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = limits.tolist()
    motion = Phases(len(way))
    Ruckig(len(way)).calculate(wanted, motion)
    return float(motion.duration)


@pytest.mark.parametrize("jerk", [np.inf, 500.0, 20.0, 3.0])
@pytest.mark.parametrize("straight", [True, False])
def test_times_are_those_of_ruckig(jerk: float, straight: bool) -> None:
    random = np.random.default_rng(3)
    q = random.uniform(-2.0, 2.0, (12, 3)) * random.choice([0.01, 1.0], (12, 1))
    limits = random.uniform(0.5, 4.0, (3, 3)) * [[1.0], [3.0], [1.0]]
    limits[2] *= jerk
    out = np.empty((12, 12), dtype=np.float32)
    rest_to_rest_kernel(q, limits[0], limits[1], limits[2], straight, np.array([0, 12]), out)
    assert (out == out.T).all()
    assert (np.diag(out) == 0.0).all()
    for a in range(12):
        for b in range(a):
            assert out[a, b] == pytest.approx(ruckig_time(q[a] - q[b], limits, straight), rel=1e-5)


def test_joints_that_keep_still_and_have_no_limit_take_no_time() -> None:
    q = np.array([[0.0, 1.0], [2.0, 1.0]])
    out = np.empty((2, 2), dtype=np.float32)
    fast = np.array([1.0, np.inf])
    rest_to_rest_kernel(
        q, fast, np.array([1.0, np.inf]), np.full(2, np.inf), True, np.array([0, 2]), out
    )
    assert out[0, 1] == pytest.approx(3.0)

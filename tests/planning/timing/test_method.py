"""Timing methods: what each is asked, and what it tells."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.method import (
    JerkLimited,
    JerkUse,
    PathLimits,
    SplineInTime,
    TimeOptimal,
    timing_method,
)
from planning.timing.options import METHODS
from planning.timing.path.blend import blend
from planning.timing.time_scaling import ScaledTime

LIMITS = PathLimits(np.ones(2), np.full(2, 4.0), np.full(2, 40.0))
PATH = blend([[0.0, 0.0], [1.0, 0.5]], [])


def still(duration: float, factor: float) -> ScaledTime:
    return ScaledTime(Trajectory(("a",), np.array([0.0, duration]), np.zeros((1, 1, 2))), factor)


def test_names_choose_methods() -> None:
    assert [timing_method(name).name for name in METHODS] == list(METHODS)
    assert timing_method("toppra") == TimeOptimal("reachability")
    assert timing_method("toppra", "toppra") == TimeOptimal("toppra")


def test_properties_say_what_each_method_needs() -> None:
    assert [timing_method(name).jerk for name in METHODS] == [
        JerkUse.UNUSED,
        JerkUse.WHERE_KNOWN,
        JerkUse.REQUIRED,
    ]
    assert [timing_method(name).smooth for name in METHODS] == [False, False, True]
    assert [timing_method(name).follows_path for name in METHODS] == [True, False, True]


def test_paths_are_timed_by_the_closed_forms() -> None:
    optimal = TimeOptimal().time(PATH, ("a", "b"), LIMITS, (0.0, 0.0)).trajectory
    assert optimal.duration == pytest.approx(1.0 / 1.0 + 1.0 / 4.0, rel=1e-11)
    limited = JerkLimited().time(PATH, ("a", "b"), LIMITS, (0.0, 0.0)).trajectory
    # Seven phases: T = s / v + v / a + a / j.
    assert limited.duration == pytest.approx(1.0 + 1.0 / 4.0 + 4.0 / 40.0, rel=1e-9)
    with pytest.raises(InvalidOption, match="does not follow paths"):
        SplineInTime().time(PATH, ("a", "b"), LIMITS, (0.0, 0.0))


def test_only_the_package_tells_what_its_answer_cost() -> None:
    parts = (still(1.1, 1.1), still(2.0, 1.0))
    for method in (TimeOptimal(), JerkLimited(), SplineInTime()):
        assert method.notes(parts) == ()
    (note,) = TimeOptimal("toppra").notes(parts)
    # 3.1 s in place of 3.0 s.
    assert note == (
        "toppra's answer was slowed down by 3.33 % (0.1 s) to bring it inside the limits between "
        "its grid points."
    )
    (note,) = TimeOptimal("toppra").notes((still(1.0, 1.0),))
    assert note == "toppra's answer keeps all limits between its grid points too."
    assert TimeOptimal("toppra").notes(()) == ()

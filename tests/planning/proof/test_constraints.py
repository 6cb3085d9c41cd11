"""Constraints of whole motions: reports, the first violation, planners' verdicts not believed."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics.forward import forward
from kinematics.robots import builtin_chain
from kinematics.trajectory import Trajectory
from planning.constraints import edge_bounds
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.joint import JointConstraint
from planning.constraints.limit import ClearanceConstraint
from planning.constraints.position import PositionConstraint
from planning.constraints.region import SphereRegion
from planning.proof.constraints import check_motion

CHAIN = builtin_chain("planar_rr")
FIRST, SECOND = CHAIN.joint_names


def turn(rate: float = 1.0) -> Trajectory:
    """Both joints turn from 0, at ``rate`` and half of it, for a second."""
    c = np.zeros((1, 2, 2))
    c[0, :, 1] = [rate, 0.5 * rate]
    return Trajectory(CHAIN.joint_names, np.array([0.0, 1.0]), c)


def test_what_is_kept_is_reported_with_what_is_to_spare() -> None:
    asked = (JointConstraint(FIRST, 0.0, 1.1, 1.1), JointConstraint(SECOND, 0.0, 0.6, 0.6))
    reports, violation = check_motion(ConstraintSet(CHAIN, asked), turn())
    assert violation is None
    assert [report.constraint for report in reports] == [0, 1]
    for report, spare, width in zip(reports, (0.1, 0.1), (2.2, 1.2), strict=True):
        assert report.hard
        assert report.unit == "rad"
        assert -spare - 1e-9 <= report.residual <= -spare + 0.02 * width
    assert reports[0].time > 0.9


def test_the_earliest_of_several_violations_is_the_one_told() -> None:
    # The first joint leaves 0.8 at 0.8 s, the second one 0.3 at 0.6 s.
    asked = (JointConstraint(FIRST, 0.0, 0.8, 0.8), JointConstraint(SECOND, 0.0, 0.3, 0.3))
    reports, violation = check_motion(ConstraintSet(CHAIN, asked), turn())
    assert violation is not None
    assert violation.kind == "path_constraint"
    assert violation.details["constraint"] == 1
    assert violation.time == pytest.approx(0.6, abs=1e-4)
    for report in reports:
        assert 0.2 <= report.residual <= 0.2 * 1.01


@pytest.mark.parametrize("second", [0.0, 0.01])
def test_a_slow_motion_is_told_the_millisecond_in_which_it_leaves_its_constraint(
    second: float,
) -> None:
    """q_1 = t / 20 for ten seconds, 0.3 at most: left at 6 s, and 0.2 beyond at the end."""
    c = np.zeros((1, 2, 2))
    c[0, :, 1] = [0.05, second]
    motion = Trajectory(CHAIN.joint_names, np.array([0.0, 10.0]), c)
    asked = ConstraintSet(CHAIN, (JointConstraint(FIRST, 0.0, 0.3, 0.3),))
    (report,), violation = check_motion(asked, motion)
    assert violation is not None
    assert violation.time == pytest.approx(6.0, abs=1e-3)
    assert 0.2 <= report.residual <= 0.2 * 1.01


def test_soft_constraints_are_reported_and_refuse_nothing() -> None:
    asked = (JointConstraint(FIRST, 0.0, 0.5, 0.5, weight=3.0), ClearanceConstraint(0.1))
    reports, violation = check_motion(ConstraintSet(CHAIN, asked), turn())
    assert violation is None
    (report,) = reports
    assert not report.hard
    assert 0.5 <= report.residual <= 0.5 * 1.01


@pytest.mark.parametrize("seed", range(12))
def test_violations_begin_when_they_do_and_get_no_worse_than_told(seed: int) -> None:
    """Cubics of both joints, against residuals at twenty thousand samples."""
    random = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.2, 5.0, 3))])
    curve = CubicSpline(breaks, random.uniform(-2.0, 2.0, (4, 2)))
    coefficients = np.ascontiguousarray(curve.c[::-1].transpose(1, 2, 0))
    motion = Trajectory(CHAIN.joint_names, breaks, coefficients)
    start = motion.start
    asked = (
        JointConstraint(FIRST, float(start[0]), 0.3, 0.3),
        PositionConstraint(SphereRegion(forward(CHAIN, start)[:3, 3], 0.2)),
    )
    times = np.linspace(0.0, motion.duration, 20_001)
    for constraint in asked:
        wanted = ConstraintSet(CHAIN, (constraint,))
        residuals = wanted.residuals(motion.sample(times)).max(axis=1)
        (report,), violation = check_motion(wanted, motion)
        assert (violation is None) is bool(residuals.max() <= 1e-6)
        assert residuals.max() <= report.residual + 1e-12
        if violation is not None:
            assert report.residual <= 1.02 * residuals.max() + 1e-5
            first = times[int(np.argmax(residuals > 1e-6))]
            assert first - 2.0 * times[1] <= violation.time <= first + 1e-3


def test_what_planners_say_of_their_edges_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edge_bounds, "edge_holds", lambda *_: True)
    monkeypatch.setattr(edge_bounds, "edge_kernel", lambda *_: (edge_bounds.HOLDS, 1.0))
    asked = (JointConstraint(FIRST, 0.0, 0.9, 0.9),)
    assert check_motion(ConstraintSet(CHAIN, asked), turn())[1] is not None

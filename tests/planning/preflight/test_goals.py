"""Goal configurations, limits hardly missed, and failures of starts and goals."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

from kinematics.forward import forward
from kinematics.pose import from_rpy, transform
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.planner import ENOUGH, Ready
from planning.preflight.failures import (
    collision_failure,
)
from planning.preflight.goals import find_goals
from planning.preflight.limits import (
    goal_onto_limits,
    moved_note,
    rates_onto_limits,
    snap_to_limits,
)
from planning.preflight.preflight import preflight, start_only
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, box, builtin
from tests.planning.slider import slider

CRATE = Scene((box("crate", (0.2, 0.2, 0.2), (0.0, 0.0, 0.0)),))
START = np.array([-0.5, 0.0])


def at(x: float) -> JointGoal:
    """A ball of 5 cm whose clearance from the crate's face is x - 0.15 m."""
    return JointGoal(np.array([x, 0.0]))


def found(*goals: JointGoal, seconds: float = 10.0) -> list[tuple[float, float]] | Failure:
    problem = Problem(slider(), CRATE, START, goals)
    checker = Checker.of(slider(), CRATE)
    answer = find_goals(problem, checker, START, 0, Deadline.after(seconds))
    if isinstance(answer, Failure):
        return answer
    return [(candidate.clearance, float(candidate.joints[0])) for candidate in answer]


def test_goals_come_with_their_clearance_and_those_that_touch_are_left_out() -> None:
    """As far as anybody asks how much it is."""
    answer = found(at(0.1), at(0.4), at(0.15), at(0.1515), at(0.2))
    assert not isinstance(answer, Failure)
    (first, x), (second, y), (third, z) = answer
    assert (x, y, z) == (0.4, 0.1515, 0.2)
    assert (first, third) == (ENOUGH, ENOUGH)
    assert second == pytest.approx(0.0015, abs=1e-6)


def test_slack_is_half_of_what_the_narrowest_end_has_to_spare() -> None:
    def slack(start: float, *goals: float) -> float:
        ends = tuple(at(x) for x in goals)
        ready = preflight(Problem(slider(), CRATE, np.array([start, 0.0]), ends), 0)
        assert isinstance(ready, Ready)
        return ready.checkers[-1].slack

    assert slack(-0.5, 0.5) == pytest.approx(1e-3)
    assert slack(-0.1502, 0.5) == pytest.approx(1e-4, abs=1e-6)
    assert slack(-0.5, 0.1502) == pytest.approx(1e-4, abs=1e-6)
    # The goal with most to spare counts: the others are left out where they have less.
    ready = preflight(Problem(slider(), CRATE, START, (at(0.1502), at(0.4))), 0)
    assert isinstance(ready, Ready)
    assert [float(q[0]) for q in ready.goals] == [0.4]


def test_goals_are_sorted_by_their_distance_from_the_start() -> None:
    goals = (at(0.9), at(-0.9), at(0.4))
    ready = preflight(Problem(slider(), CRATE, START, goals), 0)
    assert isinstance(ready, Ready)
    assert [float(q[0]) for q in ready.goals] == [-0.9, 0.4, 0.9]


def test_the_start_alone() -> None:
    ready = start_only(Problem(slider(), CRATE, START, (at(0.0),)))
    assert isinstance(ready, Ready)
    assert ready.goals == []
    assert ready.checkers[0].slack == pytest.approx(1e-4)
    near = start_only(Problem(slider(), CRATE, np.array([-0.15 - 1e-5, 0.0]), (at(0.0),)))
    assert isinstance(near, Ready)
    assert near.checkers[0].slack == pytest.approx(5e-6, abs=2e-7)
    inside = start_only(Problem(slider(), CRATE, np.array([-0.1, 0.0]), (at(0.0),)))
    assert isinstance(inside, Failure)
    assert inside.code == "START_STATE_IN_COLLISION"


def test_a_robot_of_convex_solids_has_no_hulls_beside_it_though_an_equal_one_was_asked_about() -> (
    None
):
    robot = builtin("panda")
    for one in (robot, pickle.loads(pickle.dumps(robot))):
        answer = preflight(Problem(one, Scene(), HOME, (JointGoal(HOME),)), 0)
        assert isinstance(answer, Ready)
        assert len(answer.checkers) == 1


@pytest.mark.parametrize(("tilt", "tolerance", "reached"), [
    (0.0, 0.2, True), (0.05, 0.2, True), (0.05, 0.04, False), (0.05, 1e-3, False),
])  # fmt: skip
def test_a_pose_that_no_configuration_has_is_reached_within_its_tolerances(
    tilt: float, tolerance: float, reached: bool
) -> None:
    """The tool of a SCARA stands upright: it is turned by the tilt at least."""
    robot = builtin("scara")
    T = forward(robot.chain, np.array([0.3, 0.6, 0.05, 0.2])) @ transform(
        from_rpy([tilt, 0.0, 0.0]), [0.0, 0.0, 0.0]
    )
    start = np.zeros(4)
    problem = Problem(robot, Scene(), start, (PoseGoal(T, 1e-3, tolerance),))
    answer = find_goals(problem, Checker.of(robot, Scene()), start, 0, None)
    if not reached:
        assert isinstance(answer, Failure)
        assert answer.code == "NO_IK_SOLUTION"
        assert answer.details["orientation_error"] == pytest.approx(tilt, abs=1e-3)
        return
    assert not isinstance(answer, Failure)
    for candidate in answer:
        end = pin.SE3(T).actInv(pin.SE3(forward(robot.chain, candidate.joints)))
        assert np.linalg.norm(end.translation) <= (1e-3 if tilt else 1e-6)
        assert np.linalg.norm(pin.log3(end.rotation)) <= (tolerance if tilt else 1e-6)


ROBOT = slider()
AT, TO = np.array([-0.5, 0.0]), np.array([0.5, 0.0])
SCENE = Scene(
    (
        box("near", (0.1, 0.1, 0.4), (-0.5, 0.08, 0.0)),
        box("nearer", (0.1, 0.1, 0.4), (-0.5, -0.06, 0.0)),
    )
)


def test_of_two_overlaps_both_are_told_and_the_deeper_first() -> None:
    """The ball is 0.02 m inside one box and 0.04 m inside the other."""
    problem = Problem(ROBOT, SCENE, AT, (JointGoal(TO),))
    told = collision_failure(problem, "start", AT, ("ball", "near"), -1.0)
    assert told.code == "START_STATE_IN_COLLISION"
    pairs = {tuple(item["pair"]): item["depth"] for item in told.details["collisions"]}
    assert pairs[("ball", "nearer")] == pytest.approx(0.04, abs=1e-6)
    assert pairs[("ball", "near")] == pytest.approx(0.02, abs=1e-6)
    assert told.details["pair"] == ["ball", "nearer"]
    assert told.details["depth"] == pytest.approx(0.04, abs=1e-6)
    assert "overlap by 0.04 m" in told.message
    nearest = told.details["nearest_valid"]
    assert Checker.of(ROBOT, SCENE).valid(np.array(nearest["joints"]))
    assert nearest["distance"] >= 0.0399


PANDA = builtin("panda").chain
LOWER, UPPER = PANDA.limits.lower, PANDA.limits.upper


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_farther_outside_is_left_and_the_worst_joint_is_named(sign: float) -> None:
    limits = LOWER if sign < 0.0 else UPPER
    q = HOME.copy()
    q[1], q[4] = limits[1] + sign * 1e-3, limits[4] + sign * 0.25
    left, violation = snap_to_limits(PANDA, q, 1e-6)
    np.testing.assert_array_equal(left, q)
    assert violation is not None
    assert violation.joint == PANDA.joint_names[4]
    assert violation.limit == limits[4]
    assert violation.value == q[4]
    assert violation.excess == pytest.approx(0.25)
    assert violation.details["excess"] == violation.excess


@pytest.mark.parametrize("seed", range(20))
def test_a_measured_start_may_miss_a_limit_by_a_ten_thousandth_of_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    joint, limits = int(random.integers(7)), (LOWER, UPPER)[seed % 2]
    larger = max(abs(LOWER[joint]), abs(UPPER[joint]))
    for share, taken in ((1e-4, True), (1.2e-4, False)):
        q = HOME.copy()
        q[joint] = limits[joint] + (-1.0, 1.0)[seed % 2] * share * larger
        snapped, violation = snap_to_limits(PANDA, q, None)
        assert (violation is None) == taken
        assert snapped[joint] == (limits[joint] if taken else q[joint])
        # Nobody measures a goal, and a tolerance that is given is kept.
        assert goal_onto_limits(PANDA, q, None)[1] is not None
        assert snap_to_limits(PANDA, q, 1e-6)[1] is not None


def test_measured_rates_may_miss_a_limit_by_a_ten_thousandth_of_it() -> None:
    limits = np.array([2.0, 1.0, np.inf, 0.5])
    rates = np.array([2.0002, -1.0001, 9.0, 0.501])
    moved = rates_onto_limits(rates, limits)
    assert moved.tolist() == [2.0, -1.0, 9.0, 0.501]
    assert moved_note("velocity", rates, moved) == (
        "The velocity was outside a limit by 0.0002 and was moved onto it.",
    )
    assert moved_note("velocity", moved, moved) == ()

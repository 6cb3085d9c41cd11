"""Starts and goals before a search: configurations, limits, contact, free ones near them."""

import itertools
import pickle
import re

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain
from kinematics.pose import from_rpy, transform
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Sphere
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.planner import ENOUGH, TOUCHING, Ready
from planning.preflight import goals as failures
from planning.preflight.goals import (
    find_goals,
    nearest_free,
)
from planning.preflight.limits import (
    goal_onto_limits,
    moved_note,
    rates_onto_limits,
    snap_to_limits,
)
from planning.preflight.pose_configurations import pose_configurations, turned_copies
from planning.preflight.preflight import preflight, start_only
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure, Plan
from planning.timing.rest_to_rest import motion_times
from planning.values.deadline import Deadline
from planning.values.preferences import GoalCosts
from tests.planning.goal_judge import least_time, limit_share
from tests.planning.scenes import HOME, box, builtin, planned_motion, planning_failure, shelf
from tests.planning.slider import slider

AWAY = HOME + np.array([0.6, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0])


def with_ball(gap: float, margin: float = 0.0) -> tuple[RobotGeometry, Scene]:
    """A ball in the hand, and a box whose face it is ``gap`` away from at the start."""
    robot = builtin("panda").attach(
        Obstacle("ball", Sphere(0.05), transform(None, [0.0, 0.0, 0.4])), "panda_hand"
    )
    center = (forward(robot.chain, HOME, "panda_hand") @ transform(None, [0, 0, 0.4]))[:3, 3]
    top = center[2] - 0.05 - gap
    plate = Obstacle("plate", Box(np.array([0.2, 0.2, 0.02])), transform(
        None, [center[0], center[1], top - 0.01]), margin)  # fmt: skip
    return robot, Scene((plate,))


@pytest.mark.parametrize("gap", [-1e-2, -1e-5, -1e-7, 0.0, 1e-7])
@pytest.mark.parametrize("backwards", [False, True])
def test_contact_is_told_with_pair_and_depth(gap: float, backwards: bool) -> None:
    robot, scene = with_ball(gap)
    start, goal = (AWAY, HOME) if backwards else (HOME, AWAY)
    answer = planning_failure(
        Problem(robot, scene, start, (JointGoal(goal),)), Options(timeout=10.0)
    )
    which = "goal" if backwards else "start"
    assert answer.code == ("GOAL_IN_COLLISION" if backwards else "START_STATE_IN_COLLISION")
    assert answer.stage == which
    assert answer.details["pair"] == ["ball", "plate"]
    assert answer.details["depth"] == pytest.approx(max(-gap, 0.0), abs=2e-7)
    assert "'ball'" in answer.message
    assert which in answer.message
    if gap > 0.0:
        assert answer.details["clearance"] == pytest.approx(gap, abs=2e-7)


def test_just_clear_is_planned_and_proved() -> None:
    robot, scene = with_ball(1e-6)
    upward = HOME + np.array([0.0, -0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    answer = planned_motion(
        Problem(robot, scene, HOME, (JointGoal(upward),)), Options(timeout=10.0)
    )
    assert 0.0 < answer.certificate.min_clearance <= 1e-6 + 1e-9


def test_a_margin_has_no_depth() -> None:
    robot, scene = with_ball(0.004, margin=0.003)
    answer = planning_failure(
        Problem(robot, scene, HOME, (JointGoal(AWAY),), margin=0.002), Options()
    )
    assert answer.code == "START_STATE_IN_COLLISION"
    assert answer.details["depth"] == 0.0
    assert answer.details["collisions"] == []
    assert answer.details["clearance"] == pytest.approx(0.004, abs=1e-6)
    assert answer.details["margin"] == pytest.approx(0.005, abs=1e-6)
    assert TOUCHING < 1e-6


def test_many_goals_that_collide_cost_little_and_are_counted() -> None:
    """Only the first is looked into: each takes a search for what is valid nearby."""
    robot, scene = with_ball(-1e-3)
    random = np.random.default_rng(0)
    goals = [JointGoal(HOME + 1e-5 * random.normal(size=7)) for _ in range(300)]
    goals.append(JointGoal(HOME + 10.0))
    searches: list[Array] = []

    def nearby(checker: Checker, q: Array) -> None:
        searches.append(q)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(failures, "nearest_free", nearby)
        refused = plan(Problem(robot, scene, AWAY, tuple(goals)), Options(timeout=10.0))
        assert len(searches) == 1
        found = plan(Problem(robot, scene, AWAY, (*goals, JointGoal(AWAY + 0.1))), Options())
    assert isinstance(refused, Failure)
    assert refused.code == "GOAL_IN_COLLISION"
    assert refused.details["goals"] == {"GOAL_IN_COLLISION": 300, "GOAL_STATE_INVALID": 1}
    assert refused.message.startswith("none of 301 goals is valid; the first: at the goal, ")
    assert len(searches) == 1
    assert isinstance(found, Plan)
    np.testing.assert_allclose(found.trajectory.end, AWAY + 0.1, rtol=0.0, atol=1e-12)


def test_goals_are_looked_at_until_time_is_up() -> None:
    """Poses inside an obstacle, each of which takes inverse kinematics and a search."""
    robot = builtin("panda")
    crate = Obstacle("crate", Box(np.array([0.3, 0.3, 0.3])), transform(None, [0.5, 0.4, 0.4]))
    goals = tuple(
        PoseGoal(transform(np.diag([1.0, -1.0, -1.0]), [0.5 + 1e-4 * k, 0.4, 0.4]))
        for k in range(1000)
    )
    answer = planning_failure(Problem(robot, Scene((crate,)), HOME, goals), Options(timeout=0.5))
    assert (answer.code, answer.stage) == ("TIMED_OUT", "goal")
    looked_at = re.search(r"when (\d+) of 1000 goals", answer.message)
    assert looked_at is not None
    assert int(looked_at[1]) < 1000


@pytest.mark.parametrize("case", range(12))
def test_the_nearest_free_place_of_a_ball_in_a_box(case: int) -> None:
    """Out of a box by its nearest face: 5 cm and what is asked for beyond it."""
    random = np.random.default_rng(case)
    half = random.uniform(0.05, 0.2, 2)
    center = random.uniform(-0.3, 0.3, 2)
    crate = box("crate", (2 * half[0], 2 * half[1], 0.4), (center[0], center[1], 0.0))
    q = center + random.uniform(-0.9, 0.9, 2) * half
    checker = Checker.of(slider(), Scene((crate,)))
    found = nearest_free(checker, q, seed=case)
    assert found is not None
    out = float((half - np.abs(q - center)).min()) + 0.05
    assert found.distance == pytest.approx(out, abs=4e-3)
    assert found.distance >= out
    assert found.tip_distance == pytest.approx(found.distance)
    assert found.clearance > 0.0
    np.testing.assert_allclose(found.distance, np.linalg.norm(found.joints - q))


@pytest.mark.parametrize("case", range(12))
def test_free_configurations_of_an_arm(case: int) -> None:
    robot, scene = builtin("panda"), shelf()
    checker = Checker.of(robot, scene, 0.005)
    low, high = robot.chain.sampling_bounds()
    random = np.random.default_rng(case)
    q = next(q for q in random.uniform(low, high, (200, 7)) if not checker.valid(q))
    found = nearest_free(checker, q, seed=3)
    assert found is not None
    assert ((found.joints >= low) & (found.joints <= high)).all()
    clearance = FclWorld(robot, scene).clearance(found.joints)
    assert clearance.distance > 0.0
    again = nearest_free(checker, q, seed=3)
    assert again is not None
    np.testing.assert_array_equal(again.joints, found.joints)


def test_a_start_in_collision_tells_where_it_would_be_free() -> None:
    robot, scene = slider(), Scene((box("crate", (0.2, 0.2, 0.2), (0.0, 0.0, 0.0)),))
    away = JointGoal(np.array([0.5, 0.5]))
    problem = Problem(robot, scene, np.array([0.09, 0.0]), (away,))
    answer = planning_failure(problem, Options())
    nearest = answer.details["nearest_valid"]
    assert nearest["joints"] == pytest.approx([0.151, 0.0], abs=2e-3)
    assert nearest["distance"] == pytest.approx(0.061, abs=2e-3)
    mended = Problem(robot, scene, np.array(nearest["joints"]), (away,))
    assert isinstance(plan(mended, Options()), Plan)


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


ONLY_TIME = GoalCosts(1.0, 0.0, 0.0, 0.0, 0.0)
TURN = 2.0 * np.pi


def configurations(chain: Chain, T: Array, start: Array, costs: GoalCosts = ONLY_TIME) -> Array:
    return pose_configurations(chain, T, start, numeric.SearchOptions(), costs).joints


def every_turn(chain: Chain, q: Array) -> list[Array]:
    """All copies of a configuration by whole turns inside the limits."""
    low, high = chain.limits.lower, chain.limits.upper
    values = [
        [q[j] + TURN * k for k in range(-3, 4) if low[j] <= q[j] + TURN * k <= high[j]]
        for j in range(chain.n)
    ]
    return [np.array(copy) for copy in itertools.product(*values)]


@pytest.mark.parametrize("seed", range(6))
def test_the_soonest_of_all_turns_of_all_branches_is_the_first(seed: int) -> None:
    chain, random = builtin("ur5e").chain, np.random.default_rng(seed)
    low, high = chain.sampling_bounds()
    start, goal = random.uniform(low, high, (2, chain.n))
    T = forward(chain, goal)
    # Branches from random starts, not from the closed form.
    search = numeric.SearchOptions(seed=5, starts=2000)
    found = numeric.solve(chain, T, search, seed_joints=goal, solutions=40).solutions
    copies = [copy for solution in found for copy in every_turn(chain, solution.joints)]
    soonest = min(least_time(chain, start, q) for q in copies)
    joints = configurations(chain, T, start)
    times = motion_times(chain, start, joints)
    assert times[0] == pytest.approx(soonest, rel=1e-4)
    assert (np.diff(times) >= 0.0).all()
    inside = min(
        (least_time(chain, start, q) for q in copies if limit_share(chain, q) >= 0.02),
        default=np.inf,
    )
    shares = np.array([limit_share(chain, q) for q in joints])
    assert times[shares >= 0.02].min(initial=np.inf) == pytest.approx(inside, rel=1e-4)


@pytest.mark.parametrize("name", ["ur5e", "panda", "iiwa14", "stanford", "scara"])
def test_all_are_of_the_pose_and_inside_the_limits(name: str) -> None:
    chain, random = builtin(name).chain, np.random.default_rng(2)
    low, high = chain.sampling_bounds()
    for _ in range(5):
        start, goal = random.uniform(low, high, (2, chain.n))
        T = forward(chain, goal)
        joints = configurations(chain, T, start, GoalCosts())
        assert len(joints)
        for q in (*joints, *turned_copies(chain, joints, start)[0]):
            assert ((q >= chain.limits.lower) & (q <= chain.limits.upper)).all()
            np.testing.assert_allclose(forward(chain, q), T, atol=1e-5)


def test_a_joint_at_its_limit_is_turned_away_from_it_where_it_can_be() -> None:
    chain = builtin("ur5e").chain
    goal = np.array([0.3, -1.2, 1.3, -0.9, 1.1, 0.99 * TURN])
    start = goal - np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.4])
    joints = configurations(chain, forward(chain, goal), start)
    nearest = np.abs(joints - goal).max(axis=1).argmin()
    np.testing.assert_allclose(joints[nearest], goal, atol=1e-6)
    turned = goal - np.array([0.0, 0.0, 0.0, 0.0, 0.0, TURN])
    assert np.abs(joints - turned).max(axis=1).min() < 1e-6


def test_copies_go_round_the_other_side() -> None:
    chain = builtin("ur5e").chain
    start = np.array([0.2, -1.0, 1.0, -1.0, 1.0, -4.0])
    q = np.array([0.1, -1.0, 1.5, -1.0, 1.0, -3.0])
    copies, origins = turned_copies(chain, q[None], start)
    # The elbow turns once; joints 0, 4 and 5 have no room on the other side.
    steps = {(int(np.abs(c - q).argmax()), round(float((c - q).sum()) / TURN)) for c in copies}
    assert steps == {(1, 1), (3, 1)}
    assert list(origins) == [0, 0]

"""From a problem to a certified trajectory: real arms, planners by name, and the cascade."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from kinematics.caches import preparation_limit
from kinematics.caches.preparation_limit import PreparationTimedOut
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.forward import forward
from kinematics.ik.numeric.numeric import solve
from kinematics.pose import from_rpy, rotation_error, transform
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Mesh
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.projected_rrt import ProjectedRrt
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import JointConstraint
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.pipeline import pipeline
from planning.pipeline.path_search import CASCADE, PLANNERS, choose_planners
from planning.pipeline.pipeline import plan
from planning.planner import Query, Ready
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Attempt, Failure, Plan
from planning.sampling.planners import PLANNERS as OMPL_PLANNERS
from planning.search.rrt_connect import RrtConnect
from planning.timing.options import TimingOptions
from planning.tool_paths.planner import Cartesian
from planning.values.deadline import Deadline
from tests.planning.dense import least_clearance, worst_ratio
from tests.planning.scenes import (
    HOME,
    box,
    builtin,
    pillar,
    planned_motion,
    planning_failure,
    shelf,
)
from tests.planning.slider import slider
from tests.times import quickest


def solved(problem: Problem, options: Options | None = None) -> Plan:
    answer = planned_motion(problem, options or Options(timeout=20.0))
    check(problem, answer)
    return answer


def check(problem: Problem, answer: Plan) -> None:
    trajectory, certificate = answer.trajectory, answer.certificate
    assert certificate.verified
    assert np.abs(trajectory.start - problem.start).max() < 2e-6
    assert np.abs(trajectory.end - answer.path.waypoints[-1]).max() < 1e-9
    assert np.abs(trajectory.sample([0.0, trajectory.duration], 1)).max() < 1e-9
    assert worst_ratio(trajectory, problem.robot) <= 1.0 + 1e-9
    dense = least_clearance(trajectory, problem.robot, problem.scene)
    assert dense >= certificate.min_clearance - 1e-7
    assert dense > 0.0
    assert least_clearance(trajectory, problem.robot, problem.scene, problem.margin) > 0.0
    assert trajectory.continuity().velocity < 1e-9
    for quantity in ("position", "velocity", "acceleration"):
        assert certificate.limits[quantity].worst_ratio <= 1.0 + 1e-9


def test_free_space_goes_straight() -> None:
    answer = solved(Problem(builtin("panda"), Scene(), HOME, (JointGoal(HOME + 0.3),)))
    assert answer.planner == "straight_line"
    assert [stage.name for stage in answer.stages][:2] == ["preflight", "straight_line"]
    assert len(answer.path.waypoints) == 2
    assert answer.path.length == pytest.approx(0.3 * np.sqrt(7))


def test_standing_still_is_a_motion() -> None:
    answer = solved(Problem(builtin("panda"), Scene(), HOME, (JointGoal(HOME),)))
    assert answer.trajectory.duration < 0.01
    assert answer.path.length == 0.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_into_a_shelf_to_a_pose(seed: int) -> None:
    robot = builtin("panda")
    target = transform(from_rpy([np.pi, -np.pi / 2, 0.0]), [0.6, 0.1, 0.3])
    problem = Problem(robot, shelf(), HOME, (PoseGoal(target),))
    answer = solved(problem, Options(timeout=30.0, seed=seed))
    reached = forward(robot.chain, answer.trajectory.end)
    assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) < 1e-4
    assert np.linalg.norm(rotation_error(reached[:3, :3], target[:3, :3])) < 1e-3


def test_from_one_board_to_another() -> None:
    robot, scene = builtin("panda"), shelf()
    checker = Checker.of(robot, scene, 2e-3)
    ends = []
    for height, side in ((0.3, 0.1), (0.7, -0.1)):
        target = transform(from_rpy([np.pi, -np.pi / 2, 0.0]), [0.6, side, height])
        found = solve(robot.chain, target, solutions=12, seed_joints=HOME).solutions
        ends.append(next(s.joints for s in found if checker.valid(s.joints)))
    answer = solved(Problem(robot, scene, ends[0], (JointGoal(ends[1]),)), Options(timeout=30.0))
    assert answer.planner != "straight_line"


@pytest.mark.parametrize("name", ["panda", "ur5e", "iiwa14", "kr6_sixx"])
def test_around_a_post_with_a_margin(name: str) -> None:
    robot = builtin(name)
    random = np.random.default_rng(5)
    lower, upper = robot.chain.sampling_bounds()
    checker = Checker.of(robot, pillar(), 0.03)
    found = 0
    while found < 2:
        share = random.uniform(0.25, 0.75, (2, robot.chain.n))
        start, goal = lower + share * (upper - lower)
        if not (checker.valid(start) and checker.valid(goal)) or checker.free(start, goal):
            continue
        found += 1
        solved(
            Problem(robot, pillar(), start, (JointGoal(goal),), margin=0.02), Options(timeout=30)
        )


def test_slide_and_few_joints() -> None:
    stanford = builtin("stanford")
    lower, upper = stanford.chain.sampling_bounds()
    random = np.random.default_rng(2)
    checker = Checker.of(stanford, Scene())
    ends: list[np.ndarray] = []
    while len(ends) < 2:
        q = random.uniform(lower, upper)
        ends += [q] if checker.valid(q) else []
    solved(Problem(stanford, Scene(), ends[0], (JointGoal(ends[1]),)))
    arm = builtin("planar_rr")
    scene = Scene((box("block", (0.3, 0.3, 0.3), (1.2, 0.0, 0.9)),))
    solved(Problem(arm, scene, np.array([-0.3, 0.2]), (JointGoal(np.array([2.0, 0.3])),)))


@pytest.mark.parametrize("planner", ["potential_field", "rrt_connect"])
def test_one_planner_alone(planner: str) -> None:
    robot = builtin("panda")
    scene = Scene((box("post", (0.05, 0.05, 0.1), (0.5, 0.25, 0.45)),))
    start, goal = HOME.copy(), HOME.copy()
    goal[0] = 0.9
    answer = solved(
        Problem(robot, scene, start, (JointGoal(goal),)), Options(planner=planner, timeout=20.0)
    )
    assert answer.planner == planner
    assert planner in [stage.name for stage in answer.stages]


def failed(problem: Problem, options: Options | None = None) -> Failure:
    answer = planning_failure(problem, options or Options(timeout=5.0))
    assert answer.hint
    assert answer.stages
    return answer


def test_limits_of_start_and_goal() -> None:
    robot = builtin("panda")
    outside = HOME.copy()
    outside[3] = 0.5
    answer = failed(Problem(robot, Scene(), outside, (JointGoal(HOME),)))
    assert answer.code == "START_STATE_INVALID"
    assert answer.details["joint"] == "panda_joint4"
    assert answer.details["value"] == 0.5
    assert answer.details["excess"] == pytest.approx(0.5698)
    assert "0.57 above its upper limit -0.0698" in answer.message
    outside[3] = -3.5
    answer = failed(Problem(robot, Scene(), outside, (JointGoal(HOME),)))
    assert "joint 'panda_joint4' is at -3.5, 0.428 below its lower limit -3.07" in answer.message
    assert failed(Problem(robot, Scene(), HOME, (JointGoal(outside),))).code == "GOAL_STATE_INVALID"
    barely = HOME.copy()
    barely[3] = robot.chain.limits.upper[3] + 1e-7
    goal = HOME.copy()
    snapped = planned_motion(Problem(robot, Scene(), barely, (JointGoal(goal),)), Options())
    assert "moved onto it" in snapped.notes[0]


def test_unreachable_pose_says_how_far() -> None:
    answer = failed(
        Problem(builtin("panda"), Scene(), HOME, (PoseGoal(transform(None, [2, 0, 0.5])),))
    )
    assert answer.code == "NO_IK_SOLUTION"
    assert answer.details["position_error"] > 0.9
    assert "beyond the longest" in answer.hint


def test_no_way_times_out_in_time() -> None:
    robot = builtin("planar_rr")
    # A wall from the first joint outwards: the arm can't get from one side to the other.
    walls = Scene(
        (
            box("up", (0.1, 0.5, 3.0), (0.0, 0.0, 1.8)),
            box("down", (0.1, 0.5, 3.0), (0.0, 0.0, -1.8)),
        )
    )
    goal = JointGoal(np.array([np.pi - 0.3, 0.0]))

    def attempt() -> float:
        began = time.monotonic()
        answer = failed(Problem(robot, walls, np.array([0.3, 0.0]), (goal,)), Options(timeout=1.0))
        took = time.monotonic() - began
        assert answer.code == "TIMED_OUT"
        assert answer.stage == "rrt_connect"
        return took

    assert quickest(attempt, 1.5) < 1.5


def test_a_mesh_that_takes_too_long_to_prepare_is_told_at_the_deadline(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    body = trimesh.creation.torus(0.1, 0.0321, major_sections=12, minor_sections=8)
    ring = Mesh(np.asarray(body.vertices), np.asarray(body.faces, dtype=np.int64))
    scene = Scene((Obstacle("ring", ring, transform(np.eye(3), [2.0, 0.0, 0.5])),))
    goal = HOME.copy()
    goal[0] += 0.3
    problem = Problem(builtin("panda"), scene, HOME, (JointGoal(goal),))
    # Nobody knows how fast the machine is: time is up at the fifth look.
    looks = iter([0.0] * 4)
    clock = SimpleNamespace(monotonic=lambda: next(looks, np.inf))
    with monkeypatch.context() as late:
        late.setattr(preparation_limit, "time", clock)
        answer = plan(problem, Options(timeout=20.0))
    assert isinstance(answer, Failure)
    assert (answer.code, answer.stage) == ("TIMED_OUT", "preparation")
    assert "while meshes were being prepared" in answer.message
    assert "more time" in answer.hint
    assert "what was prepared so far is kept" in answer.hint
    solved(problem)


def test_what_is_proved_is_answered_where_there_is_no_time_for_the_report(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    goal = HOME.copy()
    goal[0] += 0.3
    problem = Problem(builtin("panda"), Scene(), HOME, (JointGoal(goal),))
    assert solved(problem).clearance is not None

    def late(*_: object) -> None:
        raise PreparationTimedOut("time was up")

    monkeypatch.setattr(pipeline, "clearance_report", late)
    answer = solved(problem)
    assert answer.clearance is None
    assert not answer.deterministic
    assert any("no time" in note for note in answer.notes)


START, GOAL = np.array([-0.6, 0.0]), np.array([0.6, 0.1])
WALL = Scene((box("wall", (0.1, 1.0, 0.4), (0.0, 0.0, 0.0)),))
SHUT = Scene((box("wall", (0.1, 3.0, 0.4), (0.0, 0.0, 0.0)),))


def problem(scene: Scene) -> Problem:
    return Problem(slider(), scene, START, (JointGoal(GOAL),))


def query(scene: Scene, *, constrained: bool = False, seconds: float = 20.0) -> Query:
    checker = Checker.of(slider(), scene)
    if constrained:
        rows = ConstraintSet(slider().chain, (JointConstraint("jy", 0.0, 1.0, 1.0),))
        spare = np.zeros(len(rows.rows))
        checker = ConstrainedChecker(checker.model, 0.0, constraints=rows, spare=spare)
    ready = Ready(START, [GOAL], (checker,), ())
    return Query(problem(scene), ready, checker, 3, Deadline.after(seconds), np.ones((3, 2)))


def chosen(planner: str, options: Mapping[str, Any] | None = None) -> list[str]:
    given = Options(planner=planner, planner_options=options or {})
    return [planner.name for planner in choose_planners(problem(WALL), given)]


def test_every_name_has_its_planner() -> None:
    assert set(PLANNERS) == {
        "auto", "straight_line", "potential_field", "cartesian", "optimize", *OMPL_PLANNERS,
    }  # fmt: skip
    for name in set(PLANNERS) - {"auto", "optimize"}:
        assert chosen(name) == [name]
    assert chosen("auto") == ["straight_line", "rrt_connect"]
    assert chosen("optimize") == chosen("auto")


def test_only_the_cartesian_planner_needs_no_goal_configurations() -> None:
    for name in PLANNERS:
        needs = {p.needs_goals for p in choose_planners(problem(WALL), Options(planner=name))}
        assert needs == {name != "cartesian"}


def test_the_cascade_finds_a_way_round_a_wall_with_its_trees_at_the_latest() -> None:
    straight, trees = (planner.plan(query(WALL)) for planner in CASCADE)
    assert straight.waypoints is None
    assert straight.detail == "Blocked: ball and wall."
    assert trees.waypoints is not None
    assert np.array_equal(trees.waypoints[[0, -1]], [START, GOAL])
    assert Checker.of(slider(), WALL).polyline(trees.waypoints)[0].free


def test_a_path_under_constraints_is_not_left_to_forces_or_free_trees() -> None:
    constrained = query(Scene(), constrained=True)
    _, trees = (planner.plan(constrained) for planner in CASCADE)
    assert trees.waypoints is not None
    assert "along the constraints" in trees.detail
    (named,) = choose_planners(constrained.problem, Options(planner="rrt_connect"))
    assert "along the constraints" in named.plan(constrained).detail


def test_the_fallback_has_its_turn_with_the_exact_robot_only() -> None:
    class Fallback:
        name = "fallback"
        needs_goals = True
        queries = 0

        def plan(self, query: Query) -> Attempt:
            self.queries += 1
            return Attempt(None, "Nothing.")

    fallback = Fallback()
    trees = RrtConnect(fallback, max_edges=300, max_edges_in_hulls=200)
    exact = query(SHUT)
    assert trees.plan(exact).detail == "300 edges checked. OMPL: Nothing."
    ready = Ready(START, [GOAL], (exact.checker, Checker.of(slider(), SHUT)), ())
    in_hulls = Query(exact.problem, ready, exact.checker, 3, exact.deadline, exact.limits)
    assert trees.plan(in_hulls).detail == "200 edges checked."
    assert fallback.queries == 1


@pytest.mark.parametrize("name", ["auto", *sorted(OMPL_PLANNERS)])
def test_a_bound_ends_a_planner_where_there_is_no_path(name: str) -> None:
    """No clock does: a minute is left."""
    asked = replace(query(SHUT, seconds=60.0), bound=400)
    for planner in choose_planners(problem(SHUT), Options(planner=name)):
        assert planner.plan(asked).waypoints is None
    assert not asked.deadline.interruptions.occurred


def test_a_bound_ends_trees_along_constraints() -> None:
    asked = replace(query(SHUT, constrained=True, seconds=60.0), bound=400)
    attempt = ProjectedRrt("rrt_connect").plan(asked)
    assert attempt.waypoints is None
    assert attempt.detail == "20 extensions along the constraints."
    assert not asked.deadline.interruptions.occurred


def test_a_bounded_search_is_not_diagnosed() -> None:
    failure = planning_failure(problem(SHUT), Options(max_edges=400))
    assert failure.code == "PLANNING_FAILED"
    assert "diagnosis" not in [stage.name for stage in failure.stages]


def cartesian(goals: tuple[PoseGoal, ...], **options: Any) -> Cartesian:
    whole = Problem(builtin("panda"), Scene(), HOME, goals)
    return Cartesian.of(whole, Options(planner="cartesian", **options))


def test_requests_that_the_cartesian_planner_refuses() -> None:
    T = forward(builtin("panda").chain, HOME)
    assert cartesian((PoseGoal(T),)).name == "cartesian"
    with pytest.raises(InvalidGoal, match="one goal"):
        cartesian((PoseGoal(T), PoseGoal(T)))
    with pytest.raises(InvalidOption, match=r"timing\.times"):
        cartesian((PoseGoal(T),), timing=TimingOptions("spline", times=[0.0, 1.0]))
    with pytest.raises(InvalidOption, match="blend_tolerance"):
        cartesian((PoseGoal(T),), timing=TimingOptions(blend_tolerance=0.1))
    away = T.copy()
    away[2, 3] += 0.01
    motions = CartesianOptions(motions=(ToolMotionOptions("lin", away),))
    with pytest.raises(InvalidGoal, match=r"0\.01 m"):
        cartesian((PoseGoal(T),), cartesian=motions)
    assert cartesian((PoseGoal(away),), cartesian=motions).options is motions
    free = cartesian((PoseGoal(T),), cartesian=CartesianOptions(orientation="free"))
    assert free.tolerances.orientation is None


def test_a_fallback_begins_where_the_field_is_stuck_and_both_tell_of_their_failures() -> None:
    for scene, planner in ((WALL, "bfmt"), (SHUT, None)):
        options = Options(
            planner="potential_field", planner_options={"fallback": "bfmt"}, timeout=1.5
        )
        answer = plan(problem(scene), options)
        names = [stage.name for stage in answer.stages]
        assert names[1:3] == ["potential_field", "bfmt"]
        assert answer.stages[1].outcome == "failed"
        assert answer.stages[1].detail.startswith(("Blocked", "A kink", "A local minimum"))
        if planner is None:
            assert isinstance(answer, Failure)
            assert answer.stage == "bfmt"
            assert answer.details["ending"] in ("blocked", "kink", "local_minimum")
            assert answer.details["motions"] > 0
        else:
            assert isinstance(answer, Plan)
            assert answer.planner == planner


MIDDLE = np.array([0.0, 0.8])


@dataclass
class Given:
    """A planner that answers what it is given."""

    attempt: Attempt
    name: str = "given"
    needs_goals: bool = True
    queries: int = 0

    def plan(self, query: Query) -> Attempt:
        self.queries += 1
        return self.attempt


def run(
    monkeypatch: pytest.MonkeyPatch, scene: Scene, *planners: Given, timing: str = "toppra"
) -> Plan | Failure:
    monkeypatch.setattr(pipeline, "choose_planners", lambda problem, options: planners)
    problem = Problem(slider(), scene, START, (JointGoal(GOAL),))
    options = Options(timeout=20.0, timing=TimingOptions(timing))  # type: ignore[arg-type]
    return pipeline.plan(problem, options)


def names(answer: Plan | Failure) -> list[str]:
    return [stage.name for stage in answer.stages]


def path(*waypoints: Array) -> Attempt:
    return Attempt(np.array(waypoints), "Given.", notes=("a note",))


def test_planners_are_tried_in_turn_until_one_has_a_path(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = Given(Attempt(None, "Nothing."), "first"), Given(path(START, MIDDLE, GOAL))
    third = Given(path(START, GOAL), "third")
    answer = run(monkeypatch, WALL, first, second, third)
    assert isinstance(answer, Plan)
    assert answer.planner == "given"
    assert (first.queries, second.queries, third.queries) == (1, 1, 0)
    expected = ["preflight", "first", "given", "shortcut", "clearance", "timing"]
    assert names(answer)[:6] == expected
    outcomes = {stage.name: stage.outcome for stage in answer.stages}
    assert (outcomes["first"], outcomes["given"]) == ("failed", "succeeded")
    assert "a note" in answer.notes


def test_a_path_that_is_not_free_is_not_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = run(monkeypatch, WALL, Given(path(START, GOAL)))
    assert isinstance(answer, Failure)
    assert answer.code == "INVALID_MOTION_PLAN"
    assert answer.stage == "certificate"
    assert answer.details["pair"] == ["ball", "wall"]


def test_a_search_without_a_path_is_diagnosed(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = run(monkeypatch, WALL, Given(Attempt(None, "Nothing.", details={"tries": 3})))
    assert isinstance(answer, Failure)
    assert answer.code == "PLANNING_FAILED"
    assert answer.stage == "given"
    assert names(answer)[-1] == "diagnosis"
    assert answer.details["tries"] == 3
    assert answer.details["blocked_by"]


def test_a_failure_that_explains_itself_is_answered_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    failure = Failure("CODE", "message", "hint", "given", details={"a": 1})
    answer = run(monkeypatch, WALL, Given(Attempt(None, "Nothing.", failure=failure)))
    assert isinstance(answer, Failure)
    assert (answer.code, answer.message, answer.hint) == ("CODE", "message", "hint")
    assert answer.details == {"a": 1}
    assert set(names(answer)) == {"preflight", "given"}, "no diagnosis"


def test_goals_are_looked_for_only_where_a_planner_needs_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    blocked = Scene((box("crate", (0.3, 0.3, 0.3), (0.6, 0.1, 0.0)),))
    needing = run(monkeypatch, blocked, Given(path(START, MIDDLE)))
    assert isinstance(needing, Failure)
    assert needing.code == "GOAL_IN_COLLISION"
    other = run(monkeypatch, blocked, Given(path(START, MIDDLE), needs_goals=False))
    assert isinstance(other, Plan)
    np.testing.assert_allclose(other.trajectory.end, MIDDLE, atol=1e-9)

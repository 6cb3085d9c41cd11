"""Descent on the potential in both engines: steps, proof of each, ends and the reasons told."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from kinematics.model.dh import DhRow, DhTable
from kinematics.pose import transform
from obstacles.collision.checker import Checker
from obstacles.projection.projection import Projector
from obstacles.robots.dh_geometry import dh_robot_geometry
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.field import planner as planner_module
from planning.field.control_points import along_links, control_points, origin_points
from planning.field.options import PRESETS, QUICK, FieldOptions
from planning.field.planner import FieldResult, potential_field
from planning.field.potential import Field
from planning.field.weights import FieldWeights
from planning.result import Explanation
from planning.values.deadline import Deadline
from tests.mimic_joints import configurations, mimic_robot
from tests.planning.field.test_potential import near_a_kink, slope
from tests.planning.scenes import HOME, box, builtin, shelf
from tests.planning.slider import slider

POST = Scene((box("post", (0.05, 0.05, 0.1), (0.5, 0.25, 0.45)),))


def asked(
    robot: RobotGeometry,
    scene: Scene,
    start: np.ndarray,
    goal: np.ndarray,
    options: FieldOptions,
    seed: int = 0,
    seconds: float = 60.0,
) -> FieldResult:
    checker, deadline = Checker.of(robot, scene), Deadline.after(seconds)
    return potential_field(robot, checker, scene, start, [goal], options, seed, deadline)


def descend(
    scene: Scene, options: FieldOptions, goal: np.ndarray, name: str = "panda"
) -> tuple[FieldResult, Checker]:
    robot = builtin(name)
    start = HOME if name == "panda" else np.zeros(robot.chain.n)
    return asked(robot, scene, start, goal, options), Checker.of(robot, scene)


def turned(angle: float = 0.9) -> np.ndarray:
    goal = HOME.copy()
    goal[0] = angle
    return goal


@pytest.mark.parametrize("engine", ["exact", "fcl"])
@pytest.mark.parametrize("preset", list(PRESETS))
def test_every_step_is_proved_and_ends_at_the_goal(preset: str, engine: Any) -> None:
    goal = turned()
    found, checker = descend(POST, replace(PRESETS[preset], engine=engine), goal)
    assert found.waypoints is not None, found.detail
    assert np.array_equal(found.waypoints[0], HOME)
    assert np.array_equal(found.waypoints[-1], goal)
    assert checker.polyline(found.waypoints)[0].free
    assert len(found.potentials) == len(found.waypoints)


def test_steps_follow_the_rule() -> None:
    sizes = [0.02, 0.01, 0.03]
    options = FieldOptions(step_sizes=sizes, longest_step=10.0, max_iterations=6, connect=False)
    found, _ = descend(POST, options, turned())
    chain = builtin("panda").chain
    field = Field(chain, origin_points(chain), Projector(POST), turned(), FieldWeights())
    q = HOME
    for k, (visited, potential) in enumerate(zip(found.visited, found.potentials, strict=True)):
        assert visited == pytest.approx(q, abs=1e-12)
        assert potential == pytest.approx(field.at(q).potential)
        q = q + sizes[min(k, 2)] * field.at(q).joint_force
    assert found.iterations == 6
    assert "used up" in found.detail
    # Small enough steps lower the potential.
    assert (np.diff(found.potentials) < 0.0).all()


def test_without_connecting_it_ends_within_its_tolerance() -> None:
    goal = np.array([0.6, -0.4])
    options = FieldOptions(connect=False, tolerance=1e-3, max_iterations=2000)
    found, _ = descend(Scene(), options, goal, name="planar_rr")
    assert found.waypoints is not None, found.detail
    assert np.linalg.norm(found.waypoints[-2] - goal) < 1e-3
    assert found.iterations > 5


def check_ending(
    robot: RobotGeometry,
    scene: Scene,
    goal: np.ndarray,
    options: FieldOptions,
    found: FieldResult,
) -> None:
    """A local minimum is where the terms of the force cancel, and nothing else is called one."""
    field = Field(robot.chain, origin_points(robot.chain), Projector(scene), goal, options.weights)
    value = field.at(found.visited[-1])
    _, jacobians = control_points(robot.chain, origin_points(robot.chain), found.visited[-1])
    pulls = np.einsum("mij,mi->mj", jacobians, value.attractive_forces)
    pushes = np.einsum("mij,mi->mj", jacobians, value.repulsive_forces)
    terms = (np.abs(pulls) + np.abs(pushes)).sum(axis=0).max()
    share = np.abs((pulls + pushes).sum(axis=0)).max() / terms
    assert found.joint_force == pytest.approx((pulls + pushes).sum(axis=0), abs=1e-9)
    assert (share <= options.force_tolerance) == (found.ending == "local_minimum"), found.detail
    assert ("A local minimum" in found.detail) == (found.ending == "local_minimum")


def test_a_local_minimum_is_where_the_force_vanishes() -> None:
    robot, scene = builtin("panda"), shelf(0.5)
    checker = Checker.of(robot, scene)
    random = np.random.default_rng(3)
    lower, upper = robot.chain.sampling_bounds()
    given_up = 0
    for _ in range(300):
        goal = random.uniform(lower, upper)
        if not checker.valid(goal) or checker.free(HOME, goal):
            continue
        options = FieldOptions(max_iterations=2000)
        found = asked(robot, scene, HOME, goal, options)
        if found.waypoints is None:
            given_up += 1
            check_ending(robot, scene, goal, options, found)
        if given_up == 5:
            return
    pytest.fail("the field never got stuck")


def test_a_slow_descent_is_no_local_minimum() -> None:
    """Beside a ball many steps gain less than a hundredth, and the goal is reached."""
    rows = tuple(DhRow("revolute", a=a, lower=-3.0, upper=3.0) for a in (0.6, 0.4))
    robot = dh_robot_geometry("rr", DhTable("standard", rows))
    scene = Scene((Obstacle("ball", Sphere(0.12), transform(None, [0.75, 0.55, 0.0])),))
    start, goal = np.array([0.0, 0.3]), np.array([1.4, -0.3])
    adaptive = FieldOptions(connect=False)
    notes = FieldOptions(connect=False, step_sizes=0.2, longest_step=10.0)
    for options, iterations in ((adaptive, 439), (notes, 706)):
        found = asked(robot, scene, start, goal, options)
        assert found.ending == "arrived", found.detail
        assert abs(found.iterations - iterations) <= 5
    # The notes' iteration, without proofs and limits.
    field = Field(robot.chain, origin_points(robot.chain), Projector(scene), goal, notes.weights)
    q, k = start, 0
    while np.linalg.norm(q - goal) >= notes.tolerance:
        # A long step beside the ball at the 43rd amplifies rounding.
        assert k > 40 or found.visited[k] == pytest.approx(q, abs=1e-12)
        q, k = q + 0.2 * field.at(q).joint_force, k + 1
    assert k == found.iterations


@pytest.mark.parametrize(
    ("options", "ending", "words"),
    [
        ({"max_iterations": 5}, "steps_used_up", "5 steps were used up"),
        (
            {"patience": 3, "progress": 0.01, "halvings": 30},
            "no_progress",
            "3 steps in a row did not lower the potential by 1 %",
        ),
        (
            {"halvings": 0, "step_sizes": 100.0, "longest_step": 0.3},
            "blocked",
            "no step along the force is proved",
        ),
    ],
)
def test_what_ended_a_descent_is_told_for_what_it_is(
    options: dict[str, Any], ending: str, words: str
) -> None:
    """A ball before a wall that its pull drives it against."""
    robot, scene = slider(), Scene((box("wall", (0.1, 0.4, 0.4), (0.5, 0.0, 0.0)),))
    how = FieldOptions(
        **{"connect": False, "longest_step": 0.01, "repulsive_weights": 0.0} | options
    )
    result = asked(robot, scene, np.array([0.3, 0.0]), np.array([0.9, 0.0]), how)
    assert result.waypoints is None
    assert result.ending == ending, result.detail
    assert words in result.detail
    assert "It is no local minimum." in result.detail
    assert np.abs(result.joint_force).max() > 1e-3


def test_slack_is_kept_from_what_a_descent_is_driven_against() -> None:
    """The ball of 5 cm comes as near to a wall at 0.45 m as the slack lets it, and no nearer."""
    robot, scene = slider(), Scene((box("wall", (0.1, 0.4, 0.4), (0.5, 0.0, 0.0)),))
    options = FieldOptions(connect=False, longest_step=0.01, repulsive_weights=0.0)
    start, goals = np.array([0.3, 0.0]), [np.array([0.9, 0.0])]
    for slack in (0.0, 0.02):
        checker = Checker(Checker.of(robot, scene).model, slack)
        how = options, 0, Deadline.after(60.0)
        found = potential_field(robot, checker, scene, start, goals, *how)
        assert found.ending in ("blocked", "kink")
        gaps = 0.4 - np.array(found.visited)[:, 0]
        assert slack <= gaps.min() < slack + 1e-3


def test_escapes_leave_minima_and_repeat_for_a_seed() -> None:
    robot, scene = builtin("panda"), shelf(0.5)
    checker = Checker.of(robot, scene)
    random = np.random.default_rng(5)
    lower, upper = robot.chain.sampling_bounds()
    quick = thorough = tried = 0
    while tried < 12:
        goal = random.uniform(lower, upper)
        if not checker.valid(goal) or checker.free(HOME, goal):
            continue
        tried += 1
        ways = (QUICK, replace(QUICK, escapes=10, max_iterations=400))
        found = [asked(robot, scene, HOME, goal, options, 1) for options in ways]
        quick += found[0].waypoints is not None
        thorough += found[1].waypoints is not None
        if found[1].waypoints is not None:
            assert checker.polyline(found[1].waypoints)[0].free
        again = asked(robot, scene, HOME, goal, QUICK, 1)
        assert np.array_equal(again.visited, found[0].visited)
    assert thorough > quick


def test_the_next_goal_is_tried_where_one_is_not_reached() -> None:
    robot = builtin("panda")
    checker = Checker.of(robot, POST)
    unreachable = np.array([0.0, 0.5, 0.0, -0.1, 0.0, 0.5, 2.0])
    options = FieldOptions(max_iterations=1, connect=False)
    goals = [unreachable, HOME]
    found = potential_field(robot, checker, POST, HOME, goals, options, 0, Deadline.after(5.0))
    assert found.waypoints is not None
    assert np.array_equal(found.waypoints[-1], HOME)
    assert len(found.waypoints) == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"longest_step": -1.0}, "planner_options.longest_step"),
        ({"patience": True}, "patience"),
        ({"patience": 0}, "patience"),
        ({"max_iterations": 10**9}, "max_iterations"),
        ({"max_iterations": 1.5}, "max_iterations"),
        ({"step_sizes": []}, "step_sizes"),
        ({"step_sizes": [0.1, 0.0]}, "step_sizes"),
        ({"step_sizes": "fast"}, "step_sizes"),
        ({"control_points": "everywhere"}, "everywhere"),
        ({"control_points": ["links"]}, "links"),
        ({"connect": 1}, "connect"),
        ({"joint_weight": -1.0}, "joint_weight"),
        ({"preset": "fast"}, "fast"),
        ({"preset": ["notes"]}, "notes"),
        ({"attractive_weights": {}}, "attractive_weights"),
        ({"tolerance": None}, "tolerance"),
    ],
)
def test_options_are_checked(options: dict[str, object], words: str) -> None:
    with pytest.raises(InvalidOption, match=words) as caught:
        FieldOptions.of(options)
    assert caught.value.hint


def test_an_unknown_option_is_told_with_those_there_are() -> None:
    with pytest.raises(InvalidOption, match="no option 'speed'") as caught:
        FieldOptions.of({"speed": 1.0})
    assert "influence_distance (0.1)" in str(caught.value.hint)


WALL = Scene((box("wall", (0.2, 0.05, 0.4), (0.5, 0.2, 0.4)),))
CASES = {
    "notes": replace(PRESETS["notes"], max_iterations=40),
    "steps": FieldOptions(step_sizes=[0.02, 0.01], longest_step=1.0, max_iterations=12),
    "exact end": FieldOptions(connect=False, max_iterations=30),
    "escapes": replace(PRESETS["thorough"], escapes=3, max_iterations=60),
}


@pytest.mark.parametrize("scene", [POST, WALL], ids=["post", "wall"])
@pytest.mark.parametrize("case", list(CASES))
def test_with_the_same_projections_it_takes_the_steps_of_the_kernel(
    case: str, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = builtin("panda"), scene, HOME, turned()
    kernel = asked(*arguments, CASES[case])
    monkeypatch.setattr(planner_module, "FclProjector", Projector)
    python = asked(*arguments, replace(CASES[case], engine="fcl"))
    assert python.iterations == kernel.iterations
    assert python.detail == kernel.detail
    np.testing.assert_allclose(python.visited, kernel.visited, atol=1e-9)
    np.testing.assert_allclose(python.potentials, kernel.potentials, rtol=1e-9)
    assert (python.waypoints is None) == (kernel.waypoints is None)


def test_it_stops_in_time() -> None:
    options = FieldOptions(engine="fcl", max_iterations=100_000, connect=False, tolerance=1e-9)
    descent = asked(builtin("panda"), POST, HOME, turned(), options, seconds=0.002)
    assert descent.waypoints is None
    assert descent.detail == "The time was up."


def arm() -> RobotGeometry:
    """Two links of 0.6 m and 0.4 m in one plane, capsules of 2 cm radius around them."""
    limits = {"lower": -1.0, "upper": 3.0, "velocity": 3.0, "acceleration": 20.0}
    rows = (DhRow("revolute", a=0.6, **limits), DhRow("revolute", a=0.4, **limits))
    return dh_robot_geometry("arm", DhTable("standard", rows), [[], []], 0.02)


def ball(radius: float, x: float, y: float) -> Scene:
    return Scene((Obstacle("ball", Sphere(radius), transform(position=[x, y, 0.0])),))


def stopped(scene: Scene, start: Any, goal: Any, **options: Any) -> tuple[FieldResult, Explanation]:
    settings = FieldOptions(connect=False, **options)
    result = asked(arm(), scene, np.array(start), np.array(goal), settings)
    assert result.waypoints is None, result.detail
    assert result.explain is not None
    return result, result.explain()


def test_a_local_minimum_names_the_obstacle_the_point_and_the_force() -> None:
    result, why = stopped(
        ball(0.2, 0.9, 0.0), [-0.9, 0.0], [0.9, 0.0], repulsive_weights=5e-3,
        influence_distance=0.4,
    )  # fmt: skip
    assert result.ending == "local_minimum"
    point = why.details["repelled"]
    assert (point["obstacle"], point["joint"]) == ("ball", "joint_1")
    gap = np.linalg.norm(np.array(point["origin"]) - [0.9, 0.0, 0.0]) - 0.2
    assert point["distance"] == pytest.approx(gap, abs=1e-12)
    expected = 5e-3 * (1.0 / gap - 1.0 / 0.4) / gap**2
    assert point["repulsive_force"] == pytest.approx(expected, rel=1e-9)
    assert why.details["force"] == pytest.approx(np.abs(result.joint_force).max())
    for words in ("'ball' pushes point 1", "'joint_1'", "escapes (0)", "repulsive_weights (0.005)"):
        assert words in why.hint, why.hint


def test_a_step_into_an_obstacle_names_the_pair() -> None:
    """A bare origin slides past a ball that the link does not."""
    scene = ball(0.1, 0.45, 0.0)
    result, why = stopped(scene, [-0.9, 0.0], [0.9, 0.0], repulsive_weights=1e-12)
    assert result.ending in ("blocked", "kink")
    assert why.details["next_contact"] == ["link_1", "ball"]
    assert "'link_1' against 'ball'" in why.hint
    if result.ending == "blocked":
        assert 'control_points "links"' in why.hint


REACH = 0.3


@pytest.fixture
def robot() -> RobotGeometry:
    return mimic_robot()


def test_force_is_minus_the_slope_where_only_a_mimic_joint_is_near(robot: RobotGeometry) -> None:
    chain, where = robot.chain, along_links(robot)
    carried = np.flatnonzero(where.joints >= chain.n)
    assert set(where.joints[carried]) == set(range(chain.n, chain.n + len(chain.mimic_joints)))
    random = np.random.default_rng(3)
    felt = set()
    states, goals = configurations(200, 1), configurations(200, 2)
    for q, goal in zip(states, goals, strict=True):
        near = random.choice(carried)
        center = control_points(chain, where, q)[0][near] + random.normal(0.0, 0.12, 3)
        ball = Obstacle("ball", Sphere(0.02), transform(None, center))
        weights = FieldWeights(attractive_cap=0.3, influence_distance=REACH)
        field = Field(chain, where, Projector((ball,)), goal, weights, 0.2)
        value = field.at(q)
        if near_a_kink(field, q, REACH) or value.distances.min() < 0.01:
            continue
        if value.distances[near] < REACH:
            felt.add(int(where.joints[near]))
        expected = -slope(field, q)
        assert value.joint_force == pytest.approx(expected, rel=1e-5, abs=1e-5)
        felt_alone = field.slope(q)
        assert felt_alone.potential == pytest.approx(value.potential)
        assert felt_alone.joint_force == pytest.approx(value.joint_force, abs=1e-10)
    # Every mimic joint was pushed at.
    assert felt == set(range(chain.n, chain.n + len(chain.mimic_joints)))


def test_the_descent_stops_before_what_a_mimic_joint_would_hit(robot: RobotGeometry) -> None:
    # j1 turns the drum behind the base by twice its angle; at -pi / 2 it points at the ball.
    start, goal = np.zeros(6), np.zeros(6)
    start[0], goal[0] = -1.2, -1.95
    ball = Obstacle("ball", Sphere(0.04), transform(None, [-0.7, 0.0, 0.3]))
    for obstacles, is_free in (((), True), ((ball,), False)):
        scene = Scene(obstacles)
        checker = Checker.of(robot, scene)
        assert checker.valid(start)
        assert checker.valid(goal)
        assert checker.valid(0.5 * (start + goal)) == is_free
        result = asked(robot, scene, start, goal, FieldOptions())
        assert (result.waypoints is not None) == is_free
        assert checker.each_valid(result.visited).all()


@pytest.mark.parametrize("engine", ["exact", "fcl"])
@pytest.mark.parametrize("sizes", [None, 0.05])
def test_a_minimum_at_a_joint_limit_is_no_kink(engine: str, sizes: float | None) -> None:
    # The ball beside the goal pushes joint 2 against its limit, where joint 1 balances alone.
    rows = (
        DhRow("revolute", 0.5, lower=-3.0, upper=3.0, velocity=1.0),
        DhRow("revolute", 0.4, lower=-0.1, upper=3.0, velocity=1.0),
    )
    robot = dh_robot_geometry("planar", DhTable("standard", rows))
    ball = Obstacle("ball", Sphere(0.1), transform(None, [0.85, 0.15, 0.0]))
    scene = Scene((ball,))
    options = FieldOptions(
        engine=engine, step_sizes=sizes, connect=False, repulsive_weights=1e-3,
        influence_distance=0.3, max_iterations=5000, fallback=None,
    )  # fmt: skip
    found = asked(robot, scene, np.array([-0.6, 0.0]), np.array([0.9, 0.3]), options)
    q, force = found.visited[-1], found.joint_force
    assert q[1] == -0.1
    assert force[1] < -1e-3
    assert abs(force[0]) < 0.02 * abs(force[1])
    assert found.ending == "local_minimum", found.detail
    assert found.explain is not None
    why = found.explain()
    assert why.details["at_limit"] == ["joint_2"]
    assert "'joint_2'" in why.hint
    assert "against a limit" in why.hint

"""Descent on the potential: the rule of its steps, proof of each, minima noticed and left."""

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
from planning.field.control_points import control_points, origin_points
from planning.field.options import PRESETS, QUICK, FieldOptions
from planning.field.planner import FieldResult, potential_field
from planning.field.potential import Field
from planning.field.weights import FieldWeights
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, box, builtin, shelf
from tests.planning.slider import slider

POST = Scene((box("post", (0.05, 0.05, 0.1), (0.5, 0.25, 0.45)),))


def descend(
    scene: Scene, options: FieldOptions, goal: np.ndarray, seed: int = 0, name: str = "panda"
) -> tuple[FieldResult, Checker]:
    robot = builtin(name)
    checker = Checker.of(robot, scene)
    start = HOME if name == "panda" else np.zeros(robot.chain.n)
    found = potential_field(
        robot, checker, scene, start, [goal], options, seed, Deadline.after(20.0)
    )
    return found, checker


def turned(angle: float = 0.9) -> np.ndarray:
    goal = HOME.copy()
    goal[0] = angle
    return goal


@pytest.mark.parametrize("preset", list(PRESETS))
def test_every_step_is_proved_and_ends_at_the_goal(preset: str) -> None:
    goal = turned()
    found, checker = descend(POST, PRESETS[preset], goal)
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


def test_no_joint_moves_farther_than_the_longest_step() -> None:
    options = FieldOptions(step_sizes=100.0, longest_step=0.03, connect=False, max_iterations=40)
    found, _ = descend(POST, options, turned())
    assert np.abs(np.diff(found.visited, axis=0)).max() <= 0.03 + 1e-12


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
        found = potential_field(
            robot, checker, scene, HOME, [goal], options, 0, Deadline.after(20.0)
        )
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
        found = potential_field(
            robot, Checker.of(robot, scene), scene, start, [goal], options, 0, Deadline.after(20.0)
        )
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
    result = potential_field(
        robot, Checker.of(robot, scene), scene, np.array([0.3, 0.0]), [np.array([0.9, 0.0])],
        how, 0, Deadline.after(20.0),
    )  # fmt: skip
    assert result.waypoints is None
    assert result.ending == ending, result.detail
    assert words in result.detail
    assert "It is no local minimum." in result.detail
    assert np.abs(result.joint_force).max() > 1e-3


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
        found = [
            potential_field(
                robot, checker, scene, HOME, [goal], options, 1, Deadline.after(20.0)
            )
            for options in (QUICK, replace(QUICK, escapes=10, max_iterations=400))
        ]  # fmt: skip
        quick += found[0].waypoints is not None
        thorough += found[1].waypoints is not None
        if found[1].waypoints is not None:
            assert checker.polyline(found[1].waypoints)[0].free
        again = potential_field(
            robot, checker, scene, HOME, [goal], QUICK, 1, Deadline.after(20.0)
        )  # fmt: skip
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


def test_the_deadline_ends_it() -> None:
    robot = builtin("panda")
    checker = Checker.of(robot, POST)
    found = potential_field(
        robot, checker, POST, HOME, [turned()], FieldOptions(), 0, Deadline.after(0.0)
    )
    assert found.waypoints is None
    assert "time" in found.detail


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


def test_presets_can_be_changed_by_name() -> None:
    made = FieldOptions.of({"preset": "quick", "escapes": 2})
    assert made.control_points == "links"
    assert made.escapes == 2
    assert FieldOptions.of({}) is not None
    none = np.zeros(2)
    assert FieldOptions.of({"step_sizes": None}).rules(none, none).sizes.shape == (0,)

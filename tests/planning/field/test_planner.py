"""Descent on the potential: the rule of its steps, proof of each, minima noticed and left."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from obstacles.checker import Checker
from obstacles.projection import Projector
from obstacles.scene import Scene
from planning.deadline import Deadline
from planning.field.control_points import origin_points
from planning.field.options import PRESETS, QUICK, FieldOptions
from planning.field.planner import FieldResult, potential_field
from planning.field.potential import Field
from planning.field.weights import FieldWeights
from tests.planning.scenes import HOME, box, builtin, shelf

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


def test_a_local_minimum_is_noticed_early() -> None:
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
            assert found.iterations < options.max_iterations
            assert "local minimum" in found.detail or "Blocked" in found.detail
        if given_up == 5:
            return
    pytest.fail("the field never got stuck")


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

"""The artificial potential: forces are gradients, steps are proved, minima are noticed."""

import numpy as np
import pytest

from kinematics.chain import Array
from kinematics.errors import InvalidOption
from obstacles.checker import Checker
from obstacles.projection import Projector
from obstacles.scene import Scene
from planning.deadline import Deadline
from planning.potential_field import (
    FieldOptions,
    attractive_forces,
    control_points,
    potential_field,
    repulsive_forces,
)
from tests.planning.scenes import HOME, box, builtin, pillar, shelf


def attractive_potential(points: Array, goals: Array, options: FieldOptions) -> float:
    c, d = options.attractive_weight, options.attractive_cap
    length = np.linalg.norm(points - goals, axis=1)
    return float(np.where(length <= d, c * length**2 / 2, c * d * length - c * d**2 / 2).sum())


def repulsive_potential(points: Array, projector: Projector, options: FieldOptions) -> float:
    _, rho = projector(points)
    inverse = 1.0 / rho - 1.0 / options.influence_distance
    near = rho <= options.influence_distance
    return float(np.where(near, options.repulsive_weight / 2 * inverse**2, 0.0).sum())


def gradient(function: "object", points: Array, step: float = 1e-6) -> Array:
    assert callable(function)
    slopes = np.zeros_like(points)
    for index in np.ndindex(*points.shape):
        ahead, behind = points.copy(), points.copy()
        ahead[index] += step
        behind[index] -= step
        slopes[index] = (function(ahead) - function(behind)) / (2.0 * step)
    return slopes


def test_attraction_is_the_gradient_of_its_potential() -> None:
    random = np.random.default_rng(0)
    options = FieldOptions(attractive_weight=1.7, attractive_cap=0.4)
    for spread in (0.1, 1.0):
        points, goals = random.normal(size=(2, 5, 3)) * spread
        forces = attractive_forces(points, goals, options)
        slopes = gradient(lambda p, g=goals: attractive_potential(p, g, options), points)
        assert forces == pytest.approx(-slopes, abs=1e-8)


def test_repulsion_is_the_gradient_of_its_potential() -> None:
    random = np.random.default_rng(1)
    options = FieldOptions(repulsive_weight=0.01, influence_distance=0.3)
    projector = Projector(Scene((*pillar().obstacles, box("crate", (0.2, 0.3, 0.1), (0, 0, 0)))))
    tried = 0
    while tried < 40:
        points = random.uniform(-0.6, 0.6, (4, 3))
        _, rho = projector(points)
        # At the rim of its reach the potential's second derivative jumps.
        if rho.min() < 0.02 or (np.abs(rho - options.influence_distance) < 1e-3).any():
            continue
        tried += 1
        forces = repulsive_forces(points, projector, options)
        slopes = gradient(lambda p: repulsive_potential(p, projector, options), points)
        assert forces == pytest.approx(-slopes, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("name", ["panda", "stanford", "kr6_sixx"])
def test_jacobians_of_the_control_points(name: str) -> None:
    chain = builtin(name).chain
    random = np.random.default_rng(2)
    lower, upper = chain.sampling_bounds()
    for _ in range(10):
        q = random.uniform(lower, upper)
        _, jacobians = control_points(chain, q)
        for j in range(chain.n):
            step = np.zeros(chain.n)
            step[j] = 1e-6
            slope = (control_points(chain, q + step)[0] - control_points(chain, q - step)[0]) / 2e-6
            assert jacobians[:, :, j] == pytest.approx(slope, abs=1e-8)
            # What joint j moves lies beyond it.
            assert not jacobians[:j, :, j].any()


def test_every_step_is_proved_and_ends_at_the_goal() -> None:
    robot = builtin("panda")
    scene = Scene((box("post", (0.05, 0.05, 0.1), (0.5, 0.25, 0.45)),))
    checker = Checker.of(robot, scene)
    goal = HOME.copy()
    goal[0] = 0.9
    result = potential_field(
        robot.chain, checker, scene, HOME, goal, FieldOptions(), Deadline.after(20.0)
    )
    assert result.waypoints is not None, result.detail
    assert np.array_equal(result.waypoints[0], HOME)
    assert np.array_equal(result.waypoints[-1], goal)
    assert checker.polyline(result.waypoints)[0].free


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
        options = FieldOptions(max_iterations=400)
        result = potential_field(
            robot.chain, checker, scene, HOME, goal, options, Deadline.after(20.0)
        )
        if result.waypoints is None:
            given_up += 1
            assert result.iterations < options.max_iterations
            assert result.detail
        if given_up == 5:
            return
    pytest.fail("the field never got stuck")


def test_options_are_checked() -> None:
    with pytest.raises(InvalidOption, match="step"):
        FieldOptions.of({"step": -1.0})
    with pytest.raises(InvalidOption, match="no option 'speed'") as caught:
        FieldOptions.of({"speed": 1.0})
    assert "influence_distance" in str(caught.value.hint)
    with pytest.raises(InvalidOption):
        FieldOptions.of({"patience": True})

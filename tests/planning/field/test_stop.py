"""The reason that a descent gives for its end away from the goal."""

from typing import Any

import numpy as np
import pytest

from kinematics.model.dh import DhRow, DhTable
from kinematics.pose import transform
from obstacles.collision.checker import Checker
from obstacles.robots.dh_geometry import dh_robot_geometry
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.field.options import FieldOptions
from planning.field.planner import FieldResult, potential_field
from planning.result import Explanation
from planning.values.deadline import Deadline


def arm() -> RobotGeometry:
    """Two links of 0.6 m and 0.4 m in one plane, capsules of 2 cm radius around them."""
    limits = {"lower": -1.0, "upper": 3.0, "velocity": 3.0, "acceleration": 20.0}
    rows = (DhRow("revolute", a=0.6, **limits), DhRow("revolute", a=0.4, **limits))
    return dh_robot_geometry("arm", DhTable("standard", rows), [[], []], 0.02)


def ball(radius: float, x: float, y: float) -> Scene:
    return Scene((Obstacle("ball", Sphere(radius), transform(position=[x, y, 0.0])),))


def stopped(scene: Scene, start: Any, goal: Any, **options: Any) -> tuple[FieldResult, Explanation]:
    robot, settings = arm(), FieldOptions(connect=False, **options)
    checker = Checker.of(robot, scene)
    deadline = Deadline.after(20.0)
    result = potential_field(
        robot, checker, scene, np.array(start), [np.array(goal)], settings, 0, deadline
    )
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


def test_too_few_steps_and_too_little_patience_are_named_with_their_values() -> None:
    scene = ball(0.12, 0.75, 0.55)
    result, why = stopped(scene, [0.0, 0.3], [1.4, -0.3], max_iterations=7)
    assert result.ending == "steps_used_up"
    assert "max_iterations (7)" in why.hint
    result, why = stopped(scene, [0.0, 0.3], [1.4, -0.3], patience=1, progress=0.1)
    assert result.ending == "no_progress"
    assert "patience (1)" in why.hint


def test_a_step_into_an_obstacle_names_the_pair() -> None:
    """A bare origin slides past a ball that the link does not."""
    scene = ball(0.1, 0.45, 0.0)
    result, why = stopped(scene, [-0.9, 0.0], [0.9, 0.0], repulsive_weights=1e-12)
    assert result.ending in ("blocked", "kink")
    assert why.details["next_contact"] == ["link_1", "ball"]
    assert "'link_1' against 'ball'" in why.hint
    if result.ending == "blocked":
        assert 'control_points "links"' in why.hint


def test_a_limit_in_the_way_names_the_joint() -> None:
    """The pull over the top leads past the lower limit."""
    result, why = stopped(Scene(()), [-0.99, 0.0], [3.0, 0.0], attractive_cap=10.0)
    assert result.ending in ("blocked", "kink")
    assert "joint_1" in why.details["next_contact"]
    end = dict(zip(("joint_1", "joint_2"), result.visited[-1], strict=True))
    assert all(end[joint] in (-1.0, 3.0) for joint in why.details["next_contact"])
    assert "'joint_1'" in why.hint
    assert "against a limit" in why.hint
    assert "repelled" not in why.details

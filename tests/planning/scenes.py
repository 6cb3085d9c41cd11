"""Robots and scenes of our own that the planning tests share."""

import numpy as np

from kinematics.pose import transform
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Cylinder
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import Problem
from planning.result import Failure, Plan
from tests.obstacles import arms

builtin = arms.builtin
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def box(name: str, size: tuple[float, float, float], at: tuple[float, float, float]) -> Obstacle:
    """A box by its size and centre."""
    return Obstacle(name, Box(np.array(size)), transform(None, at))


def shelf(x: float = 0.62) -> Scene:
    """A shelf of three boards between two sides, open towards the robot."""
    return Scene(
        (
            box("bottom", (0.36, 0.9, 0.02), (x, 0.0, 0.1)),
            box("middle", (0.36, 0.9, 0.02), (x, 0.0, 0.5)),
            box("top", (0.36, 0.9, 0.02), (x, 0.0, 0.9)),
            box("left", (0.36, 0.02, 0.82), (x, 0.45, 0.5)),
            box("right", (0.36, 0.02, 0.82), (x, -0.45, 0.5)),
            box("back", (0.02, 0.9, 0.82), (x + 0.18, 0.0, 0.5)),
        )
    )


def pillar(angle: float = 0.4, distance: float = 0.5) -> Scene:
    """A post in the way of an arm that turns its base."""
    at = transform(None, [distance * np.cos(angle), distance * np.sin(angle), 0.5])
    return Scene((Obstacle("post", Cylinder(0.05, 1.2), at),))


def planned_motion(problem: Problem, options: Options | None = None) -> Plan:
    """A plan where one is expected."""
    answer = plan(problem, options or Options())
    assert isinstance(answer, Plan), answer
    return answer


def planning_failure(problem: Problem, options: Options | None = None) -> Failure:
    """A failure where one is expected."""
    answer = plan(problem, options or Options())
    assert isinstance(answer, Failure)
    return answer

"""Random scenes in which a motion with the preferred clearance exists."""

from collections.abc import Callable

import numpy as np

from kinematics.pose import transform
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Cylinder, Sphere
from planning.problem import JointGoal, Problem
from planning.values.preferences import PreferredClearance


def _post(random: np.random.Generator, reach: float) -> list[Obstacle]:
    angle, distance = random.uniform(-0.6, 0.6), random.uniform(0.5, 0.8) * reach
    place = distance * np.cos(angle), distance * np.sin(angle), 0.5
    shape = Box((0.1, 0.1, 1.0)) if random.random() < 0.5 else Cylinder(0.05, 1.0)
    return [Obstacle("post", shape, transform(None, place))]


def _shelf(random: np.random.Generator, reach: float) -> list[Obstacle]:
    x, width, depth = random.uniform(0.65, 0.8) * reach, 0.8 * reach, 0.3 * reach
    heights = random.uniform(0.25, 0.45) + np.array([0.0, random.uniform(0.3, 0.4)])
    boards = [
        Obstacle(f"board{k}", Box((depth, width, 0.02)), transform(None, (x, 0.0, z)))
        for k, z in enumerate(heights)
    ]
    sides = [
        Obstacle(f"side{k}", Box((depth, 0.02, 0.8)), transform(None, (x, y, 0.4)))
        for k, y in enumerate((-0.5 * width, 0.5 * width))
    ]
    return boards + sides


def _table(random: np.random.Generator, reach: float) -> list[Obstacle]:
    z = random.uniform(0.05, 0.25)
    top = Obstacle("table", Box((0.7 * reach, 1.4 * reach, 0.04)),
                   transform(None, (0.7 * reach, 0.0, z)))  # fmt: skip
    things = []
    for k in range(3):
        size = random.uniform(0.06, 0.18, 2)
        height = random.uniform(0.1, 0.3)
        place = random.uniform([0.45, -0.5], [0.85, 0.5]) * reach
        things.append(
            Obstacle(f"thing{k}", Box((*size, height)),
                     transform(None, (*place, z + 0.02 + 0.5 * height)))
        )  # fmt: skip
    return [top, *things]


def _clutter(random: np.random.Generator, reach: float) -> list[Obstacle]:
    things = []
    for k in range(8):
        place = random.uniform([-0.8, -0.8, 0.1], [0.8, 0.8, 1.0]) * reach
        if np.hypot(*place[:2]) < 0.3 * reach:
            continue
        shape = Sphere(random.uniform(0.04, 0.1)) if k % 2 else Box(random.uniform(0.06, 0.2, 3))
        things.append(Obstacle(f"thing{k}", shape, transform(None, place)))
    return things


KINDS: dict[str, Callable[[np.random.Generator, float], list[Obstacle]]] = {
    "post": _post, "shelf": _shelf, "table": _table, "clutter": _clutter,
}  # fmt: skip


def with_room(
    robot: RobotGeometry, kind: str, preferred: float, random: np.random.Generator
) -> Problem:
    """A problem whose ends keep the preferred clearance and whose straight line does not."""
    low, high = robot.chain.sampling_bounds()
    low, high = np.maximum(low, -2.6), np.minimum(high, 2.6)
    reach = 0.85
    while True:
        scene = Scene(tuple(KINDS[kind](random, reach)))
        model = Checker.of(robot, scene).model
        own = PreferredClearance(preferred).own_links
        spacious = Checker(model.with_margins(preferred + 5e-3, own + 5e-4))
        ends = [q for q in random.uniform(low, high, (60, robot.chain.n)) if spacious.valid(q)]
        for start, goal in zip(ends[::2], ends[1::2], strict=False):
            a, b = start, goal
            if kind == "post":
                # Past the post: the first joint turns from one side to the other.
                a, b = np.array(start), np.array(start)
                a[0], b[0] = random.uniform(0.7, 1.3), -random.uniform(0.7, 1.3)
            if spacious.valid(a) and spacious.valid(b) and not spacious.free(a, b):
                return Problem(robot, scene, a, (JointGoal(b),))

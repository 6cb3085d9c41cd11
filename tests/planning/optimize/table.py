"""A ball on a table with a block in the middle: tasks whose answers have closed forms."""

import numpy as np

from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.optimize.iterate import Iterate
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from planning.values.limits import EffortLimits
from tests.planning.scenes import box
from tests.planning.slider import slider

#: Radius of the ball and half the width of the block [m].
RADIUS, HALF = 0.05, 0.1
BLOCK = Scene((box("block", (2.0 * HALF, 2.0 * HALF, 0.3), (0.0, 0.0, 0.0)),))
ROBOT = slider()
#: Limits of speed and acceleration of either slide.
BOUNDS = {"velocity": np.ones(2), "acceleration": np.full(2, 2.0)}
START, GOAL = np.array([-0.6, 0.02]), np.array([0.6, 0.02])


def task(scene: Scene = BLOCK, loads: EffortLimits | None = None, margin: float = 0.0) -> Task:
    """From START to GOAL at rest."""
    checker = Checker.of(ROBOT, scene, margin)
    start, end = (End.at_rest(q, smooth=False) for q in (START, GOAL))
    return Task(checker, start, end, BOUNDS, loads)


def line(height: float = 0.02, count: int = 12, duration: float = 3.0) -> Iterate:
    """A straight motion past or through the block, at rest at its ends."""
    share = np.clip((np.arange(count) - 1.0) / (count - 3.0), 0.0, 1.0)[:, None]
    points = START + share * (GOAL - START)
    points[2:-2, 1] = height
    return Iterate(SplineSpace.uniform(3, count), points, duration)

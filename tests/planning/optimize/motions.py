"""Motions of the Panda and tasks that the tests of the optimisation share."""

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.optimize.iterate import Iterate
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from planning.values.limits import EffortLimits
from tests.planning.scenes import HOME, builtin

SPACE = SplineSpace.uniform(4, 11)
PANDA = builtin("panda").chain


def iterate(seed: int, spread: float = 0.1) -> Iterate:
    """A motion of 0.8 rad of every joint, its control points scattered."""
    rng = np.random.default_rng(seed)
    ramp = np.linspace(0.0, 0.8, SPACE.count)[:, None]
    return Iterate(SPACE, HOME + ramp + spread * rng.normal(size=(SPACE.count, 7)), 1.3)


def task(loads: EffortLimits | None = None, scene: Scene | None = None) -> Task:
    """A motion from rest to rest within the Panda's own limits."""
    at = iterate(0)
    return Task(
        Checker.of(builtin("panda"), scene or Scene()),
        End.at_rest(at.points[0], smooth=False),
        End.at_rest(at.points[-1], smooth=False),
        {"velocity": PANDA.limits.velocity, "acceleration": PANDA.limits.acceleration},
        loads,
        loaded_chain=PANDA,
    )


def unpacked(z: Array) -> Iterate:
    """The motion that unknowns (control points, duration, slack) describe."""
    return Iterate(SPACE, z[:-2].reshape(SPACE.count, -1), float(z[-2]))


def packed(at: Iterate) -> Array:
    """The unknowns of a motion."""
    return np.append(at.points.ravel(), [at.duration, 0.0])

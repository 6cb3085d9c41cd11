"""Paths timed within the limits of the Panda, by this code and by the toppra package."""

import logging

import numpy as np
import toppra
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.options import Solver
from planning.timing.path.blend import blend, largest_reaches
from planning.timing.path.path import JointPath
from planning.timing.speed.minimum_time import time_path

PANDA_VELOCITY = np.array([2.175] * 4 + [2.61] * 3)


PANDA_ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])


def names(n: int) -> tuple[str, ...]:
    return tuple(f"joint{i}" for i in range(n))


def timed(
    path: JointPath, v: ArrayLike, a: ArrayLike, solver: Solver = "reachability"
) -> Trajectory:
    return time_path(path, names(path.n), v, a, solver=solver).trajectory


def random_path(rng: np.random.Generator, n: int, size: float = 1.0) -> JointPath:
    waypoints = rng.uniform(-2.0, 2.0, (int(rng.integers(2, 8)), n)) * size
    reaches = largest_reaches(waypoints)
    return blend(waypoints, rng.choice([0.0, 0.02, 0.3, 1.0], len(reaches)) * reaches)


class ToppraPath:
    """What the toppra package needs to know of a path."""

    def __init__(self, path: JointPath) -> None:
        self._path = path
        self.dof = path.n
        self.path_interval = np.array([0.0, path.breaks[-1]])

    def __call__(self, places: Array, order: int = 0) -> Array:
        return self._path.sample(places, order)

    def get_duration(self) -> float:
        return float(self.path_interval[1])


def package_duration(path: JointPath, v: Array, a: Array, points: int) -> float:
    """Duration by the toppra package as its own documentation uses it, on a fine uniform grid."""
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    constraints = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-v, v])),
        toppra.constraint.JointAccelerationConstraint(np.column_stack([-a, a])),
    ]
    grid = np.linspace(0.0, path.breaks[-1], points)
    solver = toppra.algorithm.TOPPRA(
        constraints, ToppraPath(path), gridpoints=grid, solver_wrapper="seidel"
    )
    _, speeds, _ = solver.compute_parameterization(0.0, 0.0)
    return float((2.0 * np.diff(grid) / (speeds[1:] + speeds[:-1])).sum())

"""Motions that an optimisation offers for proof."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.optimize.iterate import Iterate


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A motion within its limits that was found free by the planner's checker.

    Args:
        iterate: The spline.
        trajectory: The motion in time.
        value: Value of the objective.
    """

    iterate: Iterate
    trajectory: Trajectory
    value: float


def blocked_places(checker: Checker, iterate: Iterate) -> list[float]:
    """Places u where a spline is not proved free, one in each stretch that is not.

    A spline of a higher degree than the third is looked at as two cubics a piece that have its
    positions and velocities at their ends: the proof proper is still to come.
    """
    found = []
    breaks = np.asarray(iterate.space.breaks)
    parts = 1 if iterate.space.degree <= 3 else 2
    edges = np.unique(
        np.concatenate(
            [
                breaks[:-1, None] + np.diff(breaks)[:, None] * np.arange(parts) / parts,
                breaks[1:, None],
            ],
            axis=1,
        )
    )
    for low, high, c in zip(edges, edges[1:], _cubics(iterate, edges), strict=False):
        motion = checker.curve(*c)
        if not motion.free:
            found.append(float(low + motion.at * (high - low)))
    return found


def _cubics(iterate: Iterate, edges: Array) -> Array:
    """Coefficients in s = 0 ... 1 of the cubic over each stretch, shape (stretches, 4, n)."""
    q, v = iterate.sample(edges), iterate.sample(edges, 1)
    h = np.diff(edges)[:, None]
    q0, q1, v0, v1 = q[:-1], q[1:], h * v[:-1], h * v[1:]
    way = q1 - q0
    return np.stack([q0, v0, 3.0 * way - 2.0 * v0 - v1, v0 + v1 - 2.0 * way], axis=1)

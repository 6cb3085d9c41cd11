"""Motions while they are optimised: the first guess, control points and a duration, offers."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from planning.timing.time_scaling import fitting_factor

#: A motion takes at least this long [s], were it ever so short.
_LEAST = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Iterate:
    """A spline of normalised time run through in a duration.

    Args:
        space: Degree and knots.
        points: Control points, shape (N, n).
        duration: T [s].
    """

    space: SplineSpace
    points: Array
    duration: float

    def sample(self, places: Array, derivative: int = 0) -> Array:
        """q, or a derivative with respect to u = t / T, at places u (K,), shape (K, n)."""
        first, basis = self.space.basis(places, derivative)
        rows = first[:, None] + np.arange(self.space.degree + 1)
        return np.asarray(np.einsum("ki,kin->kn", basis, self.points[rows]))

    def trajectory(self, joint_names: tuple[str, ...]) -> Trajectory:
        """The motion in time."""
        return self.space.trajectory(joint_names, self.points, self.duration)

    def with_ends(self, start: End, end: End) -> "Iterate":
        """With the control points at both ends moved so that they are exactly as given."""
        points = self.points.copy()
        set_ends(self.space, points, self.duration, start, end)
        return Iterate(self.space, points, self.duration)


def set_ends(space: SplineSpace, points: Array, duration: float, start: End, end: End) -> None:
    """Write the control points (N, n) that position and derivatives at the ends decide."""
    for place, given, inwards in ((0, start, 1), (-1, end, -1)):
        points[place] = given.position
        for order, value in enumerate(given.derivatives[1:], start=1):
            row = space.differences[order - 1][place]
            at = place + inwards * order
            rest = row @ points - row[at] * points[at]
            points[at] = (value * duration**order - rest) / row[at]


def fit_spline(task: Task, space: SplineSpace, motion: Trajectory) -> Iterate:
    """The spline nearest to a motion (least squares), as fast as the limits allow.

    Args:
        task: Requirements on the motion. Ends and limits are kept; limits not, where no duration
            was found that does with the velocities at the ends.
        space: The splines to choose from.
        motion: Motion from the task's start to its end.
    """
    duration = max(motion.duration, _LEAST)
    points = _nearest(task, space, motion, duration)
    if task.still:
        return Iterate(space, points, least_duration(task, space, points))
    # The ends bend the spline the more the longer it takes: all there is to do is to try.
    # Durations that are tried where the ends are not at rest, each 1.5 times as long as the one
    # before: up to 300 times the known one.
    durations = duration * 1.5 ** np.arange(14)
    over = []
    for T in durations:
        over.append(least_duration(task, space, _nearest(task, space, motion, T)) / T)
        if over[-1] <= 1.0:
            break
    duration = float(durations[int(np.argmin(over))])
    return Iterate(space, _nearest(task, space, motion, duration), duration)


def least_duration(task: Task, space: SplineSpace, points: Array) -> float:
    """The least duration in which a spline keeps its limits [s]."""
    motion = space.trajectory(task.chain.joint_names, points, 1.0)
    return max(fitting_factor(motion, **task.bounds), _LEAST)


def _nearest(task: Task, space: SplineSpace, motion: Trajectory, duration: float) -> Array:
    # Samples of the motion for each control point.
    u = np.linspace(0.0, 1.0, 4 * space.count + 1)
    Q, B = motion.sample(u * motion.duration), space.matrix(u)
    head, tail = task.start.order + 1, task.end.order + 1
    points = np.zeros((space.count, motion.n))
    set_ends(space, points, duration, task.start, task.end)
    inner = slice(head, space.count - tail)
    rest = Q - B[:, :head] @ points[:head] - B[:, space.count - tail :] @ points[-tail:]
    points[inner] = np.linalg.lstsq(B[:, inner], rest, rcond=None)[0]
    limits = task.chain.limits
    points[inner] = np.clip(points[inner], limits.lower, limits.upper)
    return points


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

"""The spline that an optimisation starts from: nearest to a motion that is known."""

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.optimize.iterate import Iterate, set_ends
from planning.optimize.spline import SplineSpace
from planning.optimize.task import Task
from planning.timing.time_scaling import fitting_factor

#: A motion takes at least this long [s], were it ever so short.
_LEAST = 1e-3


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

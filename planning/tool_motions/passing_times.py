"""Times at which a motion in time passes the ends of the tool motions that it carries out."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_path import RunPart

#: Samples of each piece of a motion for the instant at which it passes a place.
_LOOKS = 4


def passing_times(
    chain: Chain, path: JointPath, motion: Trajectory, parts: tuple[RunPart, ...]
) -> list[float]:
    """Times at which each part of a run ends [s].

    Of a part with a tolerance that is when the tool passes the plane across the path at the part's
    end, of others when the joints are nearest to where they are there.

    Args:
        chain: The robot; its tip is the tool.
        path: The joint path of the run.
        motion: Motion along it, from its start to its end, past every place once and in order.
        parts: Parts of the run, up to the one that the motion ends in.
    """
    if len(parts) < 2:
        return [motion.duration]
    if parts[0].tolerance is not None:
        return [*_crossings(chain, motion, parts), motion.duration]
    return [*_approaches(path, motion, parts), motion.duration]


def instants(motion: Trajectory, looks: int) -> Array:
    """Times at which a motion is checked, shape (pieces * looks + 1,) [s]."""
    steps = np.linspace(0.0, 1.0, looks, endpoint=False)
    grid = (motion.breaks[:-1, None] + np.outer(np.diff(motion.breaks), steps)).ravel()
    return np.append(grid, motion.duration)


def _crossings(chain: Chain, motion: Trajectory, parts: tuple[RunPart, ...]) -> list[float]:
    """Times at which the tool passes planes across the path at the ends of parts but the last."""
    grid = instants(motion, _LOOKS)
    points = forward(chain, motion.sample(grid))[:, :3, 3]
    ends = np.array([part.motion.T_end[:3, 3] for part in parts[:-1]])
    along = np.array(
        [one.motion.direction(1.0) + other.motion.direction(0.0) for one, other in pairwise(parts)]
    )
    near, now = [], 0
    for end, direction in zip(ends, along, strict=True):
        ahead = (points[now:] - end) @ direction
        passed = np.flatnonzero((ahead[:-1] < 0.0) & (ahead[1:] >= 0.0))
        now += int(passed[0]) if passed.size else 0
        near.append(now)
    low = grid[near]
    high = grid[np.minimum(np.array(near) + 1, len(grid) - 1)]

    def off(times: Array) -> Array:
        p = forward(chain, motion.sample(times))[:, :3, 3]
        return np.asarray(((p - ends) * along).sum(axis=1))

    return times_of_passing(off, low, high)


def _approaches(path: JointPath, motion: Trajectory, parts: tuple[RunPart, ...]) -> list[float]:
    """Times at which the joints are nearest to where they are at the ends of parts but the last."""
    grid = instants(motion, _LOOKS)
    joints, wanted = motion.sample(grid), np.array([part.end for part in parts[:-1]])
    places = path.breaks[1:-1]
    corners, tangents = path.sample(places), path.sample(places, 1)
    near, chosen, now = [], [], 0
    for k, place in enumerate(places):
        now = first_approach(joints, corners[k], now)
        # Places of a path that differ by less are the same.
        if np.abs(wanted - place).min() <= 1e-9:
            near.append(now)
            chosen.append(k)
    low = grid[np.maximum(np.array(near) - 1, 0)]
    high = grid[np.minimum(np.array(near) + 1, len(grid) - 1)]

    def off(times: Array) -> Array:
        away = motion.sample(times) - corners[chosen]
        return np.asarray((away * tangents[chosen]).sum(axis=1))

    return times_of_passing(off, low, high)


def times_of_passing(off: Callable[[Array], Array], low: Array, high: Array) -> list[float]:
    """Times within brackets at which distances (k,) become positive, not descending [s]."""
    # Halvings of the stretch in which it does.
    for _ in range(45):
        middle = 0.5 * (low + high)
        is_before = off(middle) < 0.0
        low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
    times = np.maximum.accumulate(0.5 * (low + high))
    return [float(time) for time in times]


def first_approach(joints: Array, q: Array, first: int) -> int:
    """Index from ``first`` on at which the distance of joints (k, n) from q (n,) stops falling."""
    distance = np.linalg.norm(joints[first:] - q, axis=1)
    rises = np.flatnonzero(np.diff(distance) > 0.0)
    return first + (int(rises[0]) if rises.size else len(distance) - 1)

"""Rounded polylines timed with bounded jerk in few pieces, each corner at a speed of its own."""

from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory import Trajectory
from planning.timing.blend import largest_reaches
from planning.timing.double_s import (
    CONVERGED,
    MAX_PHASES,
    CornerLimits,
    Legs,
    fastest_reaches_kernel,
    lower_speeds_kernel,
    polyline_phases_kernel,
)
from planning.timing.jerk_profile import compose_pieces_kernel
from planning.timing.path import JointPath
from planning.timing.time_scaling import ScaledTime, dilate

# Degree of q(t): straight pieces in phases of constant jerk, cubics at constant speed.
_DEGREE = 3


def fastest_reaches(waypoints: Array, limits: Array, largest: Array) -> Array:
    """Reaches of a polyline's corners with which ``time_even_corners`` is fastest, nearly.

    Args:
        waypoints: Merged, shape (k, n), k >= 3.
        limits: Of velocity, acceleration and jerk, shape (3, n).
        largest: Reaches at most, shape (k - 2,).

    Returns:
        Reaches for ``blend``, shape (k - 2,).
    """
    steps = np.diff(waypoints, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / lengths[:, None]
    turns = np.abs(np.diff(directions, axis=0))
    steepest = np.maximum(np.abs(directions[1:]), np.abs(directions[:-1]))
    with np.errstate(divide="ignore"):
        legs = Legs(lengths, (limits / np.abs(directions)[:, None]).min(axis=2))
        corners = CornerLimits(
            (limits[0] / steepest).min(axis=1),
            (limits[1] / turns).min(axis=1),
            (limits[2] / turns).min(axis=1),
        )
    reaches = np.zeros(len(largest))
    fastest_reaches_kernel(legs, corners, np.minimum(largest, largest_reaches(waypoints)), reaches)
    return reaches


def time_even_corners(path: JointPath, joint_names: Sequence[str], limits: Array) -> ScaledTime:
    """The rounded polyline run through with bounded jerk, each corner at a constant speed.

    Legs take the least time between the speeds of their ends. The motion stops at sharp corners.
    The pieces are cubics of time with continuous acceleration.

    Args:
        path: Of ``blend(..., smooth=True)``.
        joint_names: n names.
        limits: Of velocity (inf where there is none), acceleration and jerk, shape (3, n).

    Returns:
        The motion, and the factor by which time was stretched for rounding.
    """
    straight = ~(path.coefficients[:, :, 2:] != 0.0).any(axis=(1, 2))
    with np.errstate(divide="ignore"):
        along = (limits / np.abs(path.coefficients[:, None, :, 1])).min(axis=2)
    speeds = _speeds(path, straight, along, limits)
    room = MAX_PHASES * len(path.lengths)
    phases, owners = np.empty((room, 5)), np.empty(room, dtype=np.int64)
    used = polyline_phases_kernel(path.lengths, straight, along, speeds, phases, owners)
    phases, owners = phases[:used], owners[:used]
    powers = path.coefficients.shape[2]
    pieces = np.zeros((used, path.n, 3 * powers - 2))
    work = np.empty((2, 3 * powers - 2))
    compose_pieces_kernel(path.coefficients, owners, phases, work, pieces)
    breaks = np.concatenate([[0.0], np.cumsum(phases[:, 4])])
    motion = Trajectory(tuple(joint_names), breaks, pieces[:, :, : _DEGREE + 1])
    return dilate(motion, *limits)._replace(solver="double_s")


def _speeds(
    path: JointPath, straight: "np.ndarray[tuple[int], np.dtype[np.bool_]]", along: Array,
    limits: Array,
) -> Array:  # fmt: skip
    """Speeds at the start, between the pieces of a path and at its end, shape (p + 1,)."""
    count = len(path.lengths)
    # Curves that meet share a speed: each piece that is straight begins a leg after such a run.
    runs = np.cumsum(straight)
    caps = np.full(int(runs[-1]) + 1, np.inf)
    curved = np.flatnonzero(~straight)
    np.minimum.at(caps, runs[curved], _curve_speeds(path, curved, limits))
    bare = np.setdiff1d(np.arange(len(caps)), runs[curved])
    caps[bare] = 0.0
    caps[[0, -1]] = 0.0
    lower_speeds_kernel(Legs(path.lengths[straight], along[straight]), caps, CONVERGED)
    speeds = np.zeros(count + 1)
    speeds[1:] = caps[runs]
    return speeds


def _curve_speeds(
    path: JointPath, curved: "np.ndarray[tuple[int], np.dtype[np.int64]]", limits: Array
) -> Array:
    """Largest constant speed through each cubic piece of a rounded corner, shape (c,)."""
    c, length = path.coefficients[curved], path.lengths[curved, None]
    begins, ends = c[:, :, 1], c[:, :, 1] + (2.0 * c[:, :, 2] + 3.0 * c[:, :, 3] * length) * length
    first = np.maximum(np.abs(begins), np.abs(ends))
    bends = 2.0 * c[:, :, 2] + 6.0 * c[:, :, 3] * length
    second = np.maximum(np.abs(2.0 * c[:, :, 2]), np.abs(bends))
    with np.errstate(divide="ignore"):
        by_speed = (limits[0] / first).min(axis=1)
        by_bend = (limits[1] / second).min(axis=1)
        by_jerk = (limits[2] / np.abs(6.0 * c[:, :, 3])).min(axis=1)
    return np.asarray(np.minimum(by_speed, np.minimum(np.sqrt(by_bend), np.cbrt(by_jerk))))

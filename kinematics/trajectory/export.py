"""Trajectories in other people's shapes: trajectory_msgs/JointTrajectory as JSON, and CSV."""

import csv
import io
from typing import Any

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.trajectory.trajectory import Trajectory

#: A message counts time in these [1/s].
NANOSECONDS = 1_000_000_000
#: Ends that are slower than this share of the largest speed are at rest: last digits alone keep
#: them from it. joint_trajectory_controller refuses last velocities above 1.19e-7.
_REST = 1e-7
_COLUMNS = ("position", "velocity", "acceleration")


def joint_trajectory(trajectory: Trajectory, period: float, frame_id: str = "") -> dict[str, Any]:
    """The message trajectory_msgs/JointTrajectory of ROS 2, as JSON has it.

    The points come at 0, period, 2 period, ... and at the very end; their times, in whole
    nanoseconds, are strictly increasing.

    Args:
        trajectory: The motion.
        period: Period of the points [s].
        frame_id: Frame id of the header.

    Raises:
        InvalidOption: The period is not positive, or gives too many points.
    """
    times = trajectory.uniform_samples(period)
    rows = [row.tolist() for row in rows_at(trajectory, times, 3)]
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame_id},
        "joint_names": list(trajectory.joint_names),
        "points": [
            {
                "positions": q,
                "velocities": v,
                "accelerations": a,
                "effort": [],
                "time_from_start": {"sec": tick // NANOSECONDS, "nanosec": tick % NANOSECONDS},
            }
            for q, v, a, tick in zip(*rows, nanoseconds(times).tolist(), strict=True)
        ],
    }


def csv_text(trajectory: Trajectory, period: float) -> str:
    """A table with a header: time, then position, velocity and acceleration of each joint.

    Numbers have all their digits, so that reading them gives the very same values.

    Args:
        trajectory: The motion.
        period: Period of the rows [s]; the last one is at the very end.

    Raises:
        InvalidOption: The period is not positive, or gives too many rows.
    """
    times = trajectory.uniform_samples(period)
    table = np.concatenate([times[:, None], *rows_at(trajectory, times, 3)], axis=1)
    stream = io.StringIO()
    writer = csv.writer(stream)
    names = trajectory.joint_names
    writer.writerow(["time", *(f"{kind}.{name}" for kind in _COLUMNS for name in names)])
    writer.writerows([[repr(value) for value in row] for row in table.tolist()])
    return stream.getvalue()


def rows_at(trajectory: Trajectory, times: Array, count: int) -> tuple[Array, ...]:
    """Positions, velocities, ... of a motion, each (p, n); an end at rest to rounding is at rest.

    Args:
        trajectory: The motion.
        times: Times of the rows, from its start to its end, shape (p,) [s].
        count: Number of quantities, in the order position, velocity and acceleration.
    """
    rows = tuple(trajectory.sample(times, order) for order in range(count))
    if count > 1:
        ends, peak = rows[1][[0, -1]], trajectory.peaks(1).value.max(initial=0.0)
        rows[1][[0, -1]] = np.where(np.abs(ends) <= _REST * peak, 0.0, ends)
    return rows


def nanoseconds(times: Array) -> Indices:
    """Times (p,) [s] in whole nanoseconds, each after the one before."""
    ticks = np.floor(times * NANOSECONDS + 0.5).astype(np.int64)
    numbers = np.arange(len(ticks))
    return np.asarray(np.maximum.accumulate(ticks - numbers) + numbers, dtype=np.int64)

"""Trajectories in other people's shapes: trajectory_msgs/JointTrajectory as JSON, and CSV."""

import csv
import io
import math
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory import Trajectory

#: What ROS counts durations in beside seconds.
_NANOSECONDS = 1_000_000_000
_COLUMNS = ("position", "velocity", "acceleration")


def joint_trajectory(trajectory: Trajectory, period: float, frame_id: str = "") -> dict[str, Any]:
    """The message trajectory_msgs/JointTrajectory of ROS 2, as JSON has it.

    The points come at 0, period, 2 period, ... and at the very end; their times, in whole
    nanoseconds, are strictly increasing.

    Args:
        trajectory: The motion.
        period: Of the points [s].
        frame_id: Of the header.

    Raises:
        InvalidOption: The period is not positive, or gives too many points.
    """
    times = trajectory.uniform_samples(period)
    ticks = _ticks(times)
    rows = [trajectory.sample(times, order).tolist() for order in range(3)]
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame_id},
        "joint_names": list(trajectory.joint_names),
        "points": [
            {
                "positions": q,
                "velocities": v,
                "accelerations": a,
                "effort": [],
                "time_from_start": {"sec": tick // _NANOSECONDS, "nanosec": tick % _NANOSECONDS},
            }
            for q, v, a, tick in zip(*rows, ticks, strict=True)
        ],
    }


def csv_text(trajectory: Trajectory, period: float) -> str:
    """A table with a header: time, then position, velocity and acceleration of each joint.

    Numbers have all their digits, so that reading them gives the very same values.

    Args:
        trajectory: The motion.
        period: Of the rows [s]; the last one is at the very end.

    Raises:
        InvalidOption: The period is not positive, or gives too many rows.
    """
    times = trajectory.uniform_samples(period)
    table = np.concatenate(
        [times[:, None], *(trajectory.sample(times, order) for order in range(3))], axis=1
    )
    stream = io.StringIO()
    writer = csv.writer(stream)
    names = trajectory.joint_names
    writer.writerow(["time", *(f"{kind}.{name}" for kind in _COLUMNS for name in names)])
    writer.writerows([[repr(value) for value in row] for row in table.tolist()])
    return stream.getvalue()


def _ticks(times: Array) -> list[int]:
    """Times in whole nanoseconds, each after the one before."""
    ticks: list[int] = []
    for time in times.tolist():
        tick = math.floor(time * _NANOSECONDS + 0.5)
        ticks.append(tick if not ticks else max(tick, ticks[-1] + 1))
    return ticks

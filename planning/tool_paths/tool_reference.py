"""Reference of tool motions: the poses that the tool is held to, at drawn instants of a trajectory.

At an instant the tool is at some place of its motion, the nearest one; the reference is the pose
of the motion at that place. Deviations and tolerances are measured from it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.pose import rotation_error
from kinematics.trajectory.trajectory import Trajectory
from planning.result import ToolMotionReport
from planning.tool_motions.tool_corner import ToolCorner, ToolCurve

#: Instants that are drawn over all motions together.
INSTANTS = 64
#: Places of a corner that are looked at in each round, and rounds of ever nearer ones.
_LOOKS, _ROUNDS = 65, 5
#: A motion that is shorter is a turn on the spot [m].
_SHORTEST = 1e-9


class ReferencePose(NamedTuple):
    """The pose that the tool is held to at an instant.

    Args:
        time: The instant [s].
        motion: Index among the tool motions.
        T: T_base_tool, shape (4, 4).
    """

    time: float
    motion: int
    T: Array


def tool_reference(
    chain: Chain, trajectory: Trajectory, reports: Sequence[ToolMotionReport], seed: int
) -> tuple[ReferencePose, ...]:
    """The reference at instants drawn uniformly over the times of tool motions, in their order.

    Args:
        chain: The robot; its tip is the tool.
        trajectory: Of all its joints, in its order.
        reports: The motions with their times; none gives no instants.
        seed: Of the draw.
    """
    spans = np.array([max(report.ends - report.begins, 0.0) for report in reports])
    if not spans.sum() > 0.0:
        return ()
    drawn = np.sort(np.random.default_rng(seed).uniform(0.0, float(spans.sum()), INSTANTS))
    sums = np.cumsum(spans)
    owners = np.minimum(np.searchsorted(sums, drawn, side="right"), len(reports) - 1)
    begins = np.array([report.begins for report in reports])
    times = np.minimum(begins[owners] + drawn - (sums - spans)[owners], trajectory.duration)
    poses = forward(chain, trajectory.sample(times))
    return tuple(
        ReferencePose(time, k, reports[k].motion.pose(place_at(reports[k].motion, T)))
        for time, k, T in zip(times.tolist(), owners.tolist(), poses, strict=True)
    )


def place_at(motion: ToolCurve, T: Array) -> float:
    """The place from 0 to 1 on a motion that the tool is at with its pose T (4, 4)."""
    if isinstance(motion, ToolCorner):
        return _place_on_corner(motion, T[:3, 3])
    if motion.length < _SHORTEST:
        angle = motion.angle
        turned = rotation_error(motion.T_start[:3, :3], T[:3, :3])
        share = float(turned @ motion.turn) / angle**2 if angle > 0.0 else 0.0
        return min(max(share, 0.0), 1.0)
    return float(motion.places(T[None, :3, 3])[0])


def _place_on_corner(corner: ToolCorner, point: Array) -> float:
    low, high = 0.0, 1.0
    for _ in range(_ROUNDS):
        places = np.linspace(low, high, _LOOKS)
        apart = np.linalg.norm(corner.poses(places)[:, :3, 3] - point, axis=1)
        k = int(apart.argmin())
        low, high = places[max(k - 1, 0)], places[min(k + 1, _LOOKS - 1)]
    return float(places[k])

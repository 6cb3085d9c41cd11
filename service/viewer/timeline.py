"""Motions that follow each other, as stages of tasks and legs of tours do, on one timeline."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.pose import inverse
from kinematics.trajectory.trajectory import Trajectory, concatenate, stay
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from service.viewer.curves import (
    clearance_at,
    clearance_curve,
    tool_speed_curve,
    torque_curve,
)

#: Clearance of all parts together may be measured for so long, but for the fewest instants [s].
_CLEARANCE_TIME = 6.0
#: Instants of all parts together at which torque and tool speed are drawn, and the fewest of one.
_SAMPLES, _FEWEST = 600, 5
#: Most instants of all parts together at which clearance is measured, beside the fewest of each.
_CLEARANCES = 200
#: Instants of a motion of the fingers at which they are placed; the page goes between them.
_FINGER_SAMPLES = 21
#: Shorter breaks between parts are rounded off times [s].
_GAP = 1e-6


class Part(NamedTuple):
    """A part of a timeline.

    Args:
        label: Label of the part.
        begins: Time of the part's beginning [s].
        motion: Motion from its own time 0.
        robot: Robot with what it holds in this part, its fingers where they stand at the beginning.
        scene: The obstacles in this part, and what may touch.
        fingers: Motion of the gripper's joints beside it; None where they stand still.
        last: The robot with its fingers where they stand at the end.
    """

    label: str
    begins: float
    motion: Trajectory
    robot: RobotGeometry
    scene: Scene
    fingers: Trajectory | None
    last: RobotGeometry


def joined(parts: Sequence[Part], duration: float) -> Trajectory:
    """The motion of all parts in turn; between them, before and behind the arm stands still.

    Args:
        parts: Parts in order.
        duration: Duration of the whole timeline [s].
    """
    motions: list[Trajectory] = []
    time = 0.0
    for part in parts:
        if part.begins - time > _GAP:
            motions.append(stay(part.motion.joint_names, part.motion.start, part.begins - time))
        motions.append(part.motion)
        time = part.begins + part.motion.duration
    if duration - time > _GAP:
        motions.append(stay(parts[-1].motion.joint_names, parts[-1].motion.end, duration - time))
    return concatenate(motions)


def marks(parts: Sequence[Part]) -> list[dict[str, Any]]:
    """Labels of parts with the times of their beginnings, as JSON.

    Args:
        parts: Parts in order.
    """
    return [{"label": part.label, "begins": part.begins} for part in parts]


def joined_curves(parts: Sequence[Part], tool_speed: float | None) -> dict[str, Any]:
    """Torque, tool speed and clearance of all parts in turn, each with what is held in it.

    Args:
        parts: Parts in order.
        tool_speed: The limit of the tip's speed, if there is one [m/s].
    """
    whole = sum(part.motion.duration for part in parts)
    torque: dict[str, Any] | None = {"times": [], "values": []}
    speed: dict[str, Any] = {"times": [], "values": [], "limit": tool_speed}
    clearance: dict[str, Any] = {"times": [], "values": [], "pairs": [], "points": []}
    for part in parts:
        chain, motion = part.robot.chain, part.motion
        share = motion.duration / whole
        count = max(round(share * _SAMPLES), _FEWEST)
        own = torque_curve(chain, motion, samples=count)
        torque = None if own is None or torque is None else _shifted(torque, own, part.begins)
        speed = _shifted(speed, tool_speed_curve(chain, motion, samples=count), part.begins)
        near = _clearance(part, share)
        clearance = _shifted(clearance, near, part.begins)
    return {"torque": torque, "tool_speed": speed, "clearance": clearance}


def finger_tracks(robot: RobotGeometry, parts: Sequence[Part]) -> dict[str, dict[str, Any]]:
    """Motions of links of the gripper over time, by their names.

    Each has ``times`` [s] and ``frames``: the motion of its solids in the frame of the joint that
    carries the gripper, 16 numbers by columns. Links that stay where the robot holds them are left
    out.

    Args:
        robot: Robot as the page draws it.
        parts: Parts in order.
    """
    chain = robot.chain
    times: list[float] = []
    rows: dict[str, list[Array]] = {}
    for part in parts:
        fingers, motion = part.robot.fingers, part.fingers
        names = () if motion is None else motion.joint_names
        for time, row in _finger_samples(motion):
            given = dict(zip(names, row, strict=True))
            positions = {name: given.get(name, at) for name, at in fingers.positions.items()}
            times.append(part.begins + time)
            for name, T in fingers.link_poses(chain, positions).items():
                rows.setdefault(name, []).append(T @ inverse(chain.link(name).T_joint_link))
    return {
        name: {"times": times, "frames": [np.asarray(T).T.reshape(-1).tolist() for T in frames]}
        for name, frames in rows.items()
        if not np.allclose(frames, np.eye(4), atol=1e-9)
    }


def _finger_samples(motion: Trajectory | None) -> list[tuple[float, list[float]]]:
    """Times and positions of a motion of the fingers; one time where they stand still."""
    if motion is None:
        return [(0.0, [])]
    times = np.linspace(0.0, motion.duration, _FINGER_SAMPLES)
    return list(zip(times.tolist(), motion.sample(times).tolist(), strict=True))


def _clearance(part: Part, share: float) -> dict[str, Any]:
    """Clearance of one part; where the fingers move at its ends, since the arm stands still then.

    Args:
        part: The part.
        share: Share of the whole time.
    """
    if part.fingers is None:
        counts = _FEWEST, max(round(share * _CLEARANCES), _FEWEST)
        budget = share * _CLEARANCE_TIME
        return clearance_curve(part.robot, part.scene, part.motion, budget=budget, counts=counts)
    motion = part.motion
    first = clearance_at(part.robot, part.scene, motion, np.zeros(1))
    last = clearance_at(part.last, part.scene, motion, np.array([motion.duration]))
    return _shifted(first, last, 0.0)


def _shifted(curve: dict[str, Any], own: dict[str, Any], begin: float) -> dict[str, Any]:
    """A curve with another behind it."""
    own = own | {"times": [begin + time for time in own["times"]]}
    return {k: [*v, *own[k]] if isinstance(v, list) else v for k, v in curve.items()}

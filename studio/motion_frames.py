"""A motion as frames to be played: link poses at even times."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from armwright_client import Obstacle, Pose
from studio.pose import rotation, wxyz
from studio.state import Planned, StudioState, TaskPlanned, TourPlanned
from studio.workbench import Workbench

#: Frames each second: what browsers draw without falling behind.
_RATE = 30.0
#: Frames of one motion at most: forward kinematics answers them at once.
_MAX_FRAMES = 600


class LinkPoses(NamedTuple):
    """Poses of one body over the frames.

    Args:
        positions: Shape (m, 3) [m].
        wxyz: Unit quaternions, w first, shape (m, 4).
    """

    positions: NDArray[np.float64]
    wxyz: NDArray[np.float64]


class MotionFrames(NamedTuple):
    """A motion as frames.

    Args:
        times: Times of the frames, from 0 to the duration, shape (m,) [s].
        joints: Shape (m, n) [rad or m].
        links: Poses of each link.
        carried: Poses of each attached obstacle.
    """

    times: NDArray[np.float64]
    joints: list[list[float]]
    links: Mapping[str, LinkPoses]
    carried: Mapping[str, LinkPoses]

    def at(self, time: float) -> int:
        """The number of the frame nearest to a time [s]."""
        return int(np.argmin(np.abs(self.times - time)))


def motion_frames(workbench: Workbench, planned: Planned) -> MotionFrames:
    """The frames of a planned motion.

    Args:
        workbench: Workbench that asks for the poses.
        planned: The motion.
    """
    trajectory = planned.plan.trajectory
    count = min(_MAX_FRAMES, max(2, int(trajectory.duration * _RATE) + 1))
    times = np.linspace(0.0, trajectory.duration, count)
    return _frames(workbench, planned.state, times, trajectory.sample(times))


def task_frames(workbench: Workbench, planned: TaskPlanned) -> MotionFrames:
    """The frames of all stages of a task, with every object that it moves.

    Args:
        workbench: Workbench that asks for the poses.
        planned: The task.
    """
    stages, duration = planned.plan.stages, planned.plan.duration
    begins = np.array([stage.begins for stage in stages])
    times = np.linspace(0.0, duration, min(_MAX_FRAMES, max(2, int(duration * _RATE) + 1)))
    # Of stages that begin together all but the last take no time.
    numbers = np.searchsorted(begins, times, side="right") - 1
    joints: list[list[float]] = []
    fingers: dict[str, list[float]] = {}
    for number in range(len(stages)):
        own = times[numbers == number] - begins[number]
        trajectory = stages[number].trajectory
        joints += trajectory.sample(np.minimum(own, trajectory.duration)) if len(own) else []
        for name, row in _finger_rows(planned, number, own).items():
            fingers.setdefault(name, []).extend(row)
    asked = workbench.link_poses_of(joints, fingers)
    links = {name: link_poses(poses) for name, poses in asked.items()}
    carried = {}
    for item in planned.state.obstacles:
        rows = [_where(item, planned, int(n), links, k) for k, n in enumerate(numbers)]
        if any(row is not None for row in rows):
            still = (np.array(item.pose.position, dtype=float), wxyz(item.pose))
            places = [still if row is None else row for row in rows]
            carried[item.id] = LinkPoses(
                np.array([place[0] for place in places]), np.array([place[1] for place in places])
            )
    return MotionFrames(times, joints, links, carried)


def tour_frames(workbench: Workbench, planned: TourPlanned) -> MotionFrames:
    """The frames of all legs of a tour, with the stays at its goals between them.

    Args:
        workbench: Workbench that asks for the poses.
        planned: The tour.
    """
    legs, duration = planned.plan.legs, planned.plan.time
    begins = np.array([leg.begins for leg in legs])
    times = np.linspace(0.0, duration, min(_MAX_FRAMES, max(2, int(duration * _RATE) + 1)))
    # Before its first leg the arm stands where that begins.
    numbers = np.maximum(np.searchsorted(begins, times, side="right") - 1, 0)
    joints: list[list[float]] = []
    for number, leg in enumerate(legs):
        own = np.clip(times[numbers == number] - begins[number], 0.0, leg.trajectory.duration)
        joints += leg.trajectory.sample(own) if len(own) else []
    return _frames(workbench, planned.state, times, joints)


def _frames(
    workbench: Workbench, state: StudioState, times: NDArray[np.float64], joints: list[list[float]]
) -> MotionFrames:
    """Frames in which the fingers stand still, and the robot carries what it does at the start."""
    asked = workbench.link_poses_of(joints, dict(state.fingers))
    links = {name: link_poses(poses) for name, poses in asked.items()}
    obstacles = {item.id: item for item in state.obstacles}
    carried = {
        name: _carried(links[link], obstacles[name].pose) for name, link in state.attached.items()
    }
    return MotionFrames(times, joints, links, carried)


def _finger_rows(
    planned: TaskPlanned, number: int, times: NDArray[np.float64]
) -> dict[str, list[float]]:
    """Positions of the gripper's joints during a stage, at times from its beginning."""
    stages = planned.plan.stages
    before = planned.state.fingers if number == 0 else stages[number - 1].after.fingers
    rows = {
        name: [before.get(name, at)] * len(times)
        for name, at in stages[number].after.fingers.items()
    }
    motion = stages[number].fingers
    if motion is not None and len(times):
        sampled = np.array(motion.sample(np.minimum(times, motion.duration)))
        # Those that follow others are in the motion, too.
        columns = {name: sampled[:, i].tolist() for i, name in enumerate(motion.joint_names)}
        rows = {name: columns.get(name, row) for name, row in rows.items()}
    return rows


def _where(
    obstacle: Obstacle,
    planned: TaskPlanned,
    number: int,
    links: Mapping[str, LinkPoses],
    frame: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Position and quaternion of an obstacle during a stage; None where it still stands."""
    if number == 0:
        link = planned.state.attached.get(obstacle.id)
        if link is None:
            return None
        held = _carried(links[link], obstacle.pose)
        return held.positions[frame], held.wxyz[frame]
    world = planned.plan.stages[number - 1].after
    for item in world.attached:
        if item.id == obstacle.id:
            turn = Rotation.from_quat(np.roll(links[item.link].wxyz[frame], -1))
            position = turn.apply(np.array(item.pose.position)) + links[item.link].positions[frame]
            return position, np.roll((turn * rotation(item.pose)).as_quat(), 1)
    for placed in world.objects:
        if placed.id == obstacle.id:
            return np.array(placed.pose.position, dtype=float), wxyz(placed.pose)
    return None


def link_poses(poses: Sequence[Pose]) -> LinkPoses:
    """Poses as arrays.

    Args:
        poses: Poses as the service answers them.
    """
    positions = np.array([pose.position for pose in poses], dtype=float)
    return LinkPoses(positions, np.array([wxyz(pose) for pose in poses]))


def _carried(link: LinkPoses, obstacle: Pose) -> LinkPoses:
    """Poses of an object that a link has closed on at the first frame: T(t) T(0)⁻¹ T_obstacle."""
    rotations = Rotation.from_quat(np.roll(link.wxyz, -1, axis=1))
    start = rotations[0].inv()
    position = start.apply(np.array(obstacle.position) - link.positions[0])
    turned = rotations * (start * rotation(obstacle))
    return LinkPoses(
        rotations.apply(position) + link.positions, np.roll(turned.as_quat(), 1, axis=1)
    )

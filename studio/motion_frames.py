"""A motion as frames to be played: link poses at even times."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from armwright_client import Pose
from studio.pose import rotation, wxyz
from studio.result import Planned
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
        times: Of the frames, from 0 to the duration, shape (m,) [s].
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
        workbench: That asks for the poses.
        planned: The motion.
    """
    trajectory = planned.plan.trajectory
    count = min(_MAX_FRAMES, max(2, int(trajectory.duration * _RATE) + 1))
    times = np.linspace(0.0, trajectory.duration, count)
    joints = trajectory.sample(times)
    links = {name: link_poses(poses) for name, poses in workbench.link_poses_of(joints).items()}
    obstacles = {item.id: item for item in planned.state.obstacles}
    carried = {
        name: _carried(links[link], obstacles[name].pose)
        for name, link in planned.state.attached.items()
    }
    return MotionFrames(times, joints, links, carried)


def link_poses(poses: Sequence[Pose]) -> LinkPoses:
    """Poses as arrays.

    Args:
        poses: As the service answers them.
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

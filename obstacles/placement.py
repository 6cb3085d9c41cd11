"""Scenes put into the root frame of a robot: obstacles may be given in other frames."""

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.errors import InvalidScene
from kinematics.root_frame import frame_pose
from obstacles.scene import Obstacle, Scene, meant_in

#: In Python's own numbers: to compare two of numpy's matrices takes ten times as long.
_IDENTITY = np.eye(4).tolist()


def place(scene: Scene, chain: Chain, joints: ArrayLike | None = None) -> Scene:
    """The scene with every obstacle in the root frame of a robot.

    T_root_obstacle = T_root_frame T_frame_obstacle. A scene that is there already is answered as
    it is.

    Args:
        scene: Obstacles in frames of links that stand still, or of the tool.
        chain: The robot.
        joints: Where the tool is meant, shape (n,) [rad or m].

    Raises:
        InvalidLinkName: The robot has no such frame, it moves, or nothing says where the tool is.
    """
    if not scene.frames:
        return scene
    q = None if joints is None else np.asarray(joints, dtype=np.float64)
    poses = {frame: _frame_pose(scene, frame, chain, q) for frame in scene.frames}
    obstacles = (_placed(obstacle, poses) for obstacle in scene.obstacles)
    return Scene(tuple(obstacles), scene.allowed_collisions)


def in_frame(scene: Scene, frame: str) -> Scene:
    """The scene whose obstacles are in a frame where they name none.

    Args:
        scene: The scene.
        frame: A link that stands still, or "tool".
    """
    obstacles = (o if o.frame is not None else meant_in(o, frame) for o in scene.obstacles)
    return Scene(tuple(obstacles), scene.allowed_collisions)


def only_frame(scene: Scene) -> str | None:
    """The frame that all obstacles are in; None for the root frame.

    Raises:
        InvalidScene: They are in several.
    """
    frames = {obstacle.frame for obstacle in scene.obstacles}
    if len(frames) > 1:
        names = sorted(frame or "root" for frame in frames)
        raise InvalidScene(
            f"the obstacles are in several frames: {', '.join(names)}",
            hint="Without a robot only scenes in one frame can be looked at.",
        )
    return next(iter(frames), None)


def _frame_pose(scene: Scene, frame: str, chain: Chain, joints: Array | None) -> Array | None:
    """The pose of a frame in the root frame; None where it is the same."""
    first = next(obstacle.id for obstacle in scene.obstacles if obstacle.frame == frame)
    T = frame_pose(chain, frame, joints, f"frame of obstacle {first!r}")
    return None if T.tolist() == _IDENTITY else T


def _placed(obstacle: Obstacle, poses: dict[str, Array | None]) -> Obstacle:
    if obstacle.frame is None:
        return obstacle
    T_root_frame = poses[obstacle.frame]
    if T_root_frame is None:
        return obstacle.in_root()
    T = T_root_frame @ obstacle.T_world_obstacle
    return Obstacle(obstacle.id, obstacle.shape, T, obstacle.margin)

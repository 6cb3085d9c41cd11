"""Scenes put into the root frame of a robot: obstacles may be given in other frames."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidLinkName, InvalidScene
from kinematics.model.chain import Chain
from kinematics.pose import inverse
from kinematics.root_frame import frame_pose, root_names
from obstacles.scenes.scene import Obstacle, Scene, meant_in
from obstacles.shapes.shape import Compound

#: In Python's own numbers: to compare two of numpy's matrices takes ten times as long.
_IDENTITY = np.eye(4).tolist()
_MEANING = (
    "MoveIt's fixed_frame_transforms give the pose of header.frame_id in child_frame_id, which is "
    "the planning frame, and not the other way round as tf does"
)


@typed
def place(scene: Scene, chain: Chain, joints: ArrayLike | None = None) -> Scene:
    """The scene with every obstacle in the root frame of a robot.

    T_root_obstacle = T_root_frame T_frame_obstacle. A scene that is there already is answered as
    it is. Names that may touch everything become pairs with all links and obstacles.

    Args:
        scene: Obstacles in frames of links that stand still, of its file, or of the tool.
        chain: The robot.
        joints: Configuration at which the tool is meant, shape (n,) [rad or m].

    Raises:
        InvalidLinkName: The robot has no such frame, it moves, or nothing says where the tool is.
        InvalidScene: The file gives a frame in another one than the robot's root.
    """
    if not scene.frames and not scene.free:
        return scene
    q = None if joints is None else np.asarray(joints, dtype=np.float64)
    poses = {frame: _frame_pose(scene, frame, chain, q) for frame in scene.frames}
    obstacles = (_placed(obstacle, poses) for obstacle in scene.obstacles)
    allowed = scene.allowed_collisions | _free_pairs(scene, chain)
    return replace(
        scene, obstacles=tuple(obstacles), allowed_collisions=allowed, fixed_frames={}, free={}
    )


def in_frame(scene: Scene, frame: str) -> Scene:
    """The scene whose obstacles are in a frame where they name none.

    Args:
        scene: The scene.
        frame: A link that stands still, or "tool".
    """
    obstacles = (o if o.frame is not None else meant_in(o, frame) for o in scene.obstacles)
    return replace(scene, obstacles=tuple(obstacles))


def with_objects(scene: Scene, names: Iterable[str]) -> Scene:
    """The scene in which solids are one obstacle where a request names them as one.

    Solids called ``mug/0``, ``mug/1``, ... make up the object ``mug``, whose pose is that of the
    first of them. A name of which there is an obstacle is left as it is.

    Args:
        scene: The scene.
        names: Names that a request uses; not read where there are no such solids.
    """
    firsts = [name.removesuffix("/0") for name in scene.ids if name.endswith("/0")]
    if not firsts:
        return scene
    for name in set(firsts).intersection(names) - set(scene.ids):
        own = [o for o in scene.obstacles if o.id.startswith(f"{name}/")]
        numbered = {f"{name}/{k}": k for k in range(len(own))}
        frames = {o.frame for o in own}
        if len(frames) == 1 and {o.id for o in own} == numbered.keys():
            own.sort(key=lambda obstacle: numbered[obstacle.id])
            T = own[0].T_world_obstacle
            parts = [(o.shape, inverse(T) @ o.T_world_obstacle) for o in own]
            margin = max(o.margin for o in own)
            shape = Compound(*zip(*parts, strict=True))
            whole = Obstacle(name, shape, T, margin, own[0].frame)
            left = (o for o in scene.obstacles if o.id not in numbered)
            scene = replace(scene, obstacles=(*left, whole))
    return scene


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
    """The pose of a frame in the root frame; None where it is the same.

    As in MoveIt a link goes before a frame of the file (``PlanningScene::getFrameTransform``).
    """
    if frame in scene.fixed_frames and frame not in chain.index:
        T = _fixed_frame(scene, frame, chain)
    else:
        T = _robot_frame(scene, frame, chain, joints)
    return T if _moves(T) else None


def _moves(T: Array) -> bool:
    return bool(T.tolist() != _IDENTITY)


def _robot_frame(scene: Scene, frame: str, chain: Chain, joints: Array | None) -> Array:
    """T_root_frame of a frame that the robot has."""
    first = next(obstacle.id for obstacle in scene.obstacles if obstacle.frame == frame)
    where, given = f"frame of obstacle {first!r}", list[str]()
    if frame not in chain.index:
        given = [name for name, (child, _) in scene.fixed_frames.items() if child == frame]
    if any(name in chain.index and _moves(scene.fixed_frames[name][1]) for name in given):
        raise InvalidScene(
            f"{where}: fixed_frame_transforms give the pose of a link in {frame!r}, as tf does: "
            "MoveIt leaves that out",
            hint=f"{_MEANING}. That is {chain.root_link!r}.",
            frame=frame,
        )
    try:
        return frame_pose(chain, frame, joints, where)
    except InvalidLinkName as error:
        if not given:
            raise
        told = f"{error.message}; fixed_frame_transforms have it as child_frame_id: {_MEANING}"
        raise InvalidLinkName(told, hint=error.hint, **error.details) from None


def _fixed_frame(scene: Scene, frame: str, chain: Chain) -> Array:
    """T_root_frame of a frame that a file gives.

    MoveIt records transforms whose child frame is its planning frame, the robot's root, and leaves
    others out (``Transforms::setTransform``): what is in their frames has no place there.
    """
    parent, T = scene.fixed_frames[frame]
    if parent == chain.root_link or parent in root_names(chain):
        return T
    raise InvalidScene(
        f"fixed_frame_transforms: frame {frame!r} (header.frame_id) is given by its pose in "
        f"{parent!r} (child_frame_id), which is not the planning frame of robot {chain.name!r}: "
        "MoveIt leaves it out, and refuses what is in it",
        hint=f"{_MEANING}. That is {chain.root_link!r}.",
        frame=frame,
    )


def _free_pairs(scene: Scene, chain: Chain) -> set[tuple[str, str]]:
    """Names that may touch everything, with all links and obstacles but those that they may not."""
    everything = {*chain.index, *scene.ids}
    return {
        (name, other) for name, apart in scene.free.items() for other in everything - apart - {name}
    }


def _placed(obstacle: Obstacle, poses: dict[str, Array | None]) -> Obstacle:
    if obstacle.frame is None:
        return obstacle
    T_root_frame = poses[obstacle.frame]
    if T_root_frame is None:
        return obstacle.in_root()
    T = T_root_frame @ obstacle.T_world_obstacle
    return Obstacle(obstacle.id, obstacle.shape, T, obstacle.margin)

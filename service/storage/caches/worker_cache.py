"""Robots and scenes loaded in this process, so that a request does not build them again."""

import hashlib
from dataclasses import replace

from armwright_wire.scenes import scene as scene_schema
from dynamics.model.payload import Motor
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.root_frame import TOOL
from obstacles.kept_files import keep_files_in
from obstacles.robots.link_margins import with_margins
from obstacles.robots.visual_geometry import VisualGeometry, built_in_looks
from obstacles.scenes.placement import in_frame, place
from obstacles.scenes.scene import Scene
from service.storage.caches import disk_cache, prepared_files
from service.storage.caches.cache_key import Mount, Reference
from service.storage.caches.disk_cache import PreparedRobot
from service.storage.caches.recent import Recent
from service.translate import poses
from service.translate.robots import robots, tools
from service.translate.robots.motors import answered_motors

_MEBIBYTE = 2**20
#: Values take up to this many times the bytes of their pickles: kernels want copies in their order.
_UNPACKED = 4


def _robot_bytes(prepared: PreparedRobot) -> int:
    packed = len(prepared.packed_chain) + len(prepared.packed_geometry)
    return len(prepared.answer) + (1 + _UNPACKED) * packed


def _scene_bytes(prepared: tuple[Scene, int]) -> int:
    return _UNPACKED * prepared[1]


#: A robot is a few hundred kilobytes, with fine meshes megabytes.
_ROBOTS = Recent(64, 128 * _MEBIBYTE, _robot_bytes)
#: What is around a robot where a request names no scene: what planning prepares for it is kept.
_NOTHING = (Scene(), 0)
#: Scenes with the bytes of their pickles, which are a few kilobytes as a rule.
_SCENES = Recent(256, 256 * _MEBIBYTE, _scene_bytes)


def robot(reference: Reference) -> PreparedRobot:
    """The robot of a reference, with its solids and the tool that is mounted.

    Raises:
        NotPrepared: Its document has to be prepared first.
        ArmwrightError: The tool is malformed, or can't be mounted on the robot.
    """
    _keep_decompositions(reference)
    if reference.mount is not None:
        key = reference.hash, reference.built_in, reference.mount
        return _ROBOTS.get(key, lambda: _mounted(reference, reference.mount))
    if reference.built_in:
        return _ROBOTS.get(("built-in", reference.name), lambda: _built_in(reference.name))
    return _ROBOTS.get(reference.hash, lambda: disk_cache.read_robot(reference))


def _mounted(reference: Reference, mount: Mount | None) -> PreparedRobot:
    """The robot of a reference with a tool or a tip."""
    assert mount is not None
    alone = robot(replace(reference, mount=None))
    arm = tools.mounted(alone.geometry, mount.tool, mount.tcp, mount.held)
    return PreparedRobot.of(with_margins(arm, dict(mount.margins), mount.own_margin), alone.answer)


def visuals(reference: Reference) -> VisualGeometry:
    """The visual geometry of a robot; of built-in ones the looks that are drawn for them.

    Raises:
        NotPrepared: Its document has to be prepared first.
    """
    if reference.built_in:
        return built_in_looks(chain(reference))
    return disk_cache.read_visuals(reference)


def chain(reference: Reference) -> Chain:
    """The chain of a reference alone.

    Raises:
        NotPrepared: Its document has to be prepared first.
    """
    return robot(reference).chain


def motors(reference: Reference) -> tuple[Motor, ...] | None:
    """The motors of a robot, one for each joint; None where it has none.

    Raises:
        NotPrepared: Its document has to be prepared first.
    """
    return answered_motors(robot(reference).answer)


def scene(source: Reference | scene_schema.Scene | None) -> Scene:
    """A stored scene, an inline one, or none: an empty one.

    Raises:
        NotPrepared: The document of a stored scene has to be prepared first.
        InvalidScene: An inline scene is not valid.
    """
    return _scene(source)[0]


def placed_scene(
    source: Reference | scene_schema.Scene | None,
    frame: str | None,
    chain: Chain,
    joints: Array | None,
) -> Scene:
    """A scene in the root frame of a robot.

    One that is kept is kept placed as well: with new obstacles all that planning prepares for a
    scene would be made anew for each request.

    Args:
        source: The scene.
        frame: Frame of obstacles that name none; None for the root frame.
        chain: The robot.
        joints: Configuration of the frame "tool", shape (n,) [rad or m]; None where nothing names
            one.

    Raises:
        NotPrepared: As `scene`.
        InvalidScene: As `scene`.
        InvalidLinkName: A frame is unknown, or moves.
    """
    found, size = _scene(source)
    named = found if frame is None else in_frame(found, frame)
    if not (named.frames or named.free):
        return named
    if not named.frames or TOOL in named.frames:
        return place(named, chain, joints)
    key = "placed", named.content_hash, chain
    return _SCENES.get(key, lambda: (place(named, chain), size))[0]


def _scene(source: Reference | scene_schema.Scene | None) -> tuple[Scene, int]:
    """A scene with its bytes."""
    if source is None:
        return _NOTHING
    if isinstance(source, Reference):
        _keep_decompositions(source)
        return _SCENES.get(source.hash, lambda: disk_cache.read_scene_and_size(source))
    # To make a scene takes as long as to plan in it; many requests bring the same one.
    content = source.model_dump_json(exclude_none=True).encode()
    key = "inline", hashlib.sha256(content).hexdigest()
    return _SCENES.get(key, lambda: _new_scene(source, len(content)))


def _new_scene(source: scene_schema.Scene, size: int) -> tuple[Scene, int]:
    """An inline scene with its bytes; one with the same obstacles, if there is one already.

    MoveIt writes the state of the robot into the text of a scene: each time it is another text.
    """
    scene = poses.scene(source)
    return _SCENES.get(("content", scene.content_hash, scene.notes), lambda: (scene, size))


def _keep_decompositions(reference: Reference) -> None:
    if reference.folder:
        keep_files_in(prepared_files.decompositions(reference.folder))


def _built_in(name: str) -> PreparedRobot:
    geometry, lint = robots.built_in(name)
    answer = robots.robot_answer(geometry, lint, name, is_built_in=True)
    return PreparedRobot.of(geometry, answer.model_dump_json().encode())

"""Cells of the stages of a task, made of the numbers that its request and its answer tell.

A request that repeats these numbers has the same robot and the same scene to the last bit, and so
the same hashes: a stage can be proved or exported alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from armwright_wire.plans.stages import DetachStage, SingleStage
from armwright_wire.plans.task import TaskRequest
from armwright_wire.pose import Pose
from armwright_wire.scenes.check import TOUCH_DEPTH, Attached
from armwright_wire.scenes.scene import AllowedItem, LimitedPair
from armwright_wire.scenes.tool import HeldTip
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.robots.tool import PART
from obstacles.scenes.scene import Scene
from planning.proof.premises import Premises
from service.endpoints.attached_objects import RobotInScene, attach, attachment, requested_scene
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Mount, Reference
from service.translate import poses
from service.translate.frames import configuration
from service.translate.robots.tools import with_object_tip


class StageCell(NamedTuple):
    """The robot and its surroundings in one stage.

    Args:
        first: Cell with the fingers as they stand at the stage's beginning.
        last: Cell with the fingers as they stand at the stage's end.
    """

    first: RobotInScene
    last: RobotInScene

    def premises(self, margin: float) -> Premises:
        """Premises of the proof of the stage, with its margin [m]."""
        return Premises.of_cell(self.first.robot, self.first.scene, margin)


def stage_cells(
    stages: Sequence[Mapping[str, Any]],
    reference: Reference,
    around: Scene,
    fingers: Mapping[str, float],
) -> list[StageCell]:
    """The cells of answered stages; what is held in a stage is what is held after it.

    Args:
        stages: Stages as the answer tells them.
        reference: The robot as the task begins.
        around: The scene with all objects, see ``task_objects``.
        fingers: Positions of the fingers at the task's beginning [rad or m].
    """
    cells, tip = [], None
    for stage in stages:
        after = stage["after"]
        places = {item["id"]: told_transform(item["pose"]) for item in after["objects"]}
        held = [
            Attached.model_validate({name: x for name, x in item.items() if x is not None})
            for item in after["attached"]
        ]
        scene = _with_places(around, places)
        allowed = [_told_pair(item) for item in stage["certificate"]["allowed_collisions"]]
        led = stage.get("tip")
        if led is None:
            tip = stage["certificate"]["premises"]["tool"]
        robot = robot_with_tip(reference, tip)
        if led is not None:
            item = next(item for item in after["attached"] if item["id"] == led["object"])
            robot = with_object_tip(robot, HeldTip.model_validate(led), item["link"], item["pose"])
        own = robot.fingers.positions
        fingers = {name: fingers.get(name, at) for name, at in own.items()}
        first = last = attach(with_fingers(robot, fingers), scene, held, allowed)
        if after["fingers"] != fingers:
            fingers = after["fingers"]
            last = attach(with_fingers(robot, fingers), scene, held, allowed)
        cells.append(StageCell(first, last))
    return cells


def _told_pair(item: Mapping[str, Any]) -> AllowedItem:
    """A pair that may touch, hardly deeper than it does in the answer."""
    if item["overlap"] is None:
        return (item["pair"][0], item["pair"][1])
    return LimitedPair(pair=item["pair"], touch_depth=item["overlap"] + TOUCH_DEPTH)


def task_ground(
    robot: Reference, scene: Reference | None, body: TaskRequest
) -> tuple[RobotGeometry, Array, Scene]:
    """The robot of a task alone, the configuration that it begins at, and the scene as it came.

    Args:
        robot: The robot.
        scene: The stored scene, where the request names one.
        body: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    alone = worker_cache.robot(robot).geometry
    start = configuration(body.start, alone.chain, alone.states, "start")
    return alone, start, requested_scene(scene, body, alone.chain, start)


def moved(around: Scene, body: TaskRequest) -> Scene:
    """The scene with the objects that a request says stand elsewhere.

    Raises:
        InvalidObjectName: The scene has no such obstacle.
    """
    places = {item.id: poses.transform(item.pose) for item in body.objects or ()}
    for name in places:
        around.obstacle(name)
    return _with_places(around, places)


def task_objects(robot: RobotGeometry, around: Scene, body: TaskRequest) -> Scene:
    """The scene with all objects of a task, those with a shape of their own among them.

    Args:
        robot: The robot alone.
        around: The scene of the request.
        body: The request.
    """
    scene = moved(around, body)
    own = {
        item.id: attachment(robot, scene, item).held
        for item in body.attached or ()
        if item.shape is not None
    }
    left = tuple(item for item in scene.obstacles if item.id not in own)
    return replace(scene, obstacles=(*left, *own.values()))


def told_transform(pose: Mapping[str, Any]) -> Array:
    """The transform of a pose of an answer, shape (4, 4)."""
    return poses.transform(Pose.model_validate(pose))


def _with_places(around: Scene, places: Mapping[str, Array]) -> Scene:
    if not places:
        return around
    obstacles = tuple(
        replace(item, T_world_obstacle=places[item.id]) if item.id in places else item
        for item in around.obstacles
    )
    return replace(around, obstacles=obstacles)


def stage_robots(
    robot: Reference, stages: Sequence[SingleStage]
) -> Iterator[tuple[RobotGeometry, HeldTip | None]]:
    """The robot with the tool that it has in each stage, and a tip of what it holds.

    Both hold for the stages after, the tip until the object is detached.

    Args:
        robot: The robot as the task begins.
        stages: Stages in order.

    Raises:
        ArmwrightError: A tool can't be mounted; or a tip is named, and there is no tool.
    """
    others = () if robot.mount is None else robot.mount.others
    documents, current, led = dict(others), robot, None
    for k, stage in enumerate(stages):
        mount, tcp = current.mount or Mount(None), stage.tcp
        if stage.tool is not None or tcp is not None:
            led = tcp if isinstance(tcp, HeldTip) else None
        elif isinstance(stage, DetachStage) and led is not None:
            led = None if stage.object in (None, led.object) else led
        if stage.tool is not None:
            name = stage.tool if isinstance(stage.tool, str) else stage.tool.name
            own = tcp if isinstance(tcp, str) else None
            mount = replace(mount, tool=documents[name], tcp=own, held=None)
        elif isinstance(tcp, str):
            if mount.tool is None:
                raise InvalidOption(
                    f"stages[{k}] ({stage.kind}): tcp {tcp!r} is the tip of a tool, and the "
                    "robot has none by then",
                    hint="Give tool in the request or in this stage.",
                )
            mount = replace(mount, tcp=tcp, held=None)
        if mount != current.mount and (stage.tool, tcp) != (None, None):
            current = replace(current, mount=mount)
        yield worker_cache.robot(current).geometry, led


def robot_with_tip(robot: Reference, tip: str | None) -> RobotGeometry:
    """The robot of a task with the tool of one of its stages.

    Args:
        robot: The robot as the task begins.
        tip: Tip that a stage's answer tells; None for that of the beginning.
    """
    own = worker_cache.robot(robot).geometry
    if tip is None or tip == own.chain.tip_link or robot.mount is None:
        return own
    name, _, tcp = tip.partition(PART)
    documents = dict(robot.mount.others)
    if name not in documents and robot.mount.tool is not None:
        documents[name] = robot.mount.tool
    if name not in documents:
        return own
    mount = replace(robot.mount, tool=documents[name], tcp=tcp, held=None)
    return worker_cache.robot(replace(robot, mount=mount)).geometry

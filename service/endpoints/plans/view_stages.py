"""Stages of kept tasks and legs of kept tours on one timeline, for their pages."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from armwright_wire.plans.task import TaskRequest
from armwright_wire.plans.tour import TourRequest
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from service.endpoints.attached_objects import RobotInScene, attach
from service.endpoints.tasks.stage_cells import (
    StageCell,
    moved,
    robot_with_tip,
    stage_cells,
    task_ground,
    task_objects,
    told_transform,
)
from service.endpoints.tours.task import tour_cell
from service.storage.caches.cache_key import Reference
from service.translate import trajectories
from service.viewer.document import Carrier, Configuration, carrier_document
from service.viewer.timeline import Part, finger_tracks, joined, joined_curves, marks
from service.viewer.words import proof_words, stage_label, task_sentences


class Kept(NamedTuple):
    """A kept plan, task, tour or proof with what it is about.

    Args:
        request: The body.
        answer: The answer; empty where there is a problem.
        problem: The problem document; empty where there is an answer.
        robot: Reference of the robot.
        scene: Reference of the stored scene, if the request names one.
    """

    request: Mapping[str, Any]
    answer: Mapping[str, Any]
    problem: Mapping[str, Any]
    robot: Reference
    scene: Reference | None


class Shown(NamedTuple):
    """Parts of a page that depend on the operation.

    Args:
        cell: Robot and scene.
        motion: If there is one.
        configurations: Shown by themselves.
        sentences: The certificate, or what else is to be said.
        extra: More fields of the document.
        moved: Objects that are carried from one place to another.
        curves: Curves of the motion, where it is not that of one robot in one scene.
    """

    cell: RobotInScene
    motion: Trajectory | None
    configurations: list[Configuration]
    sentences: list[str]
    extra: dict[str, Any]
    moved: tuple[Obstacle, ...] = ()
    curves: dict[str, Any] | None = None


def task_shown(kept: Kept) -> Shown:
    """The stages of an answered task.

    Args:
        kept: The kept task.
    """
    body, geometry, around = _task_world(kept)
    stages = kept.answer["stages"]
    names = {item["id"] for s in stages for item in _things(s["after"])}
    moved = tuple(item for item in around.obstacles if item.id in names)
    still = tuple(item for item in around.obstacles if item.id not in names)
    alone = with_fingers(geometry, body.fingers or {})
    parts = _parts(kept, body, around)
    extra = {
        "stages": marks(parts),
        "carriers": {item.id: [*_carriers(item, kept.robot, stages)] for item in moved},
        "fingers": finger_tracks(alone, parts),
    }
    return Shown(
        RobotInScene(alone, Scene(still)),
        joined(parts, kept.answer["duration"]),
        [],
        [*task_sentences(kept.answer)],
        extra,
        moved,
        joined_curves(parts, body.timing.tool_speed),
    )


def task_parts(kept: Kept) -> list[Part]:
    """The stages of an answered task, each with what is held in it.

    Args:
        kept: The kept task.
    """
    body, _, around = _task_world(kept)
    return _parts(kept, body, around)


def _task_world(kept: Kept) -> tuple[TaskRequest, RobotGeometry, Scene]:
    """The request of a task, its robot, and its scene with what stands elsewhere by now."""
    body = TaskRequest.model_validate(kept.request)
    geometry, _, around = task_ground(kept.robot, kept.scene, body)
    return body, geometry, task_objects(geometry, around, body)


def _parts(kept: Kept, body: TaskRequest, around: Scene) -> list[Part]:
    """The stages, each with the fingers where the one before left them."""
    stages = kept.answer["stages"]
    cells = stage_cells(stages, kept.robot, around, body.fingers or {})
    return [_stage_part(stage, cell) for stage, cell in zip(stages, cells, strict=True)]


def tour_shown(kept: Kept) -> Shown:
    """The legs of an answered tour, with the stays at its goals between them.

    Args:
        kept: The kept tour.
    """
    body = TourRequest.model_validate(kept.request)
    cell, _ = tour_cell(kept.robot, kept.scene, body)
    parts = _legs(cell, kept.answer)
    return Shown(
        cell,
        joined(parts, kept.answer["time"]),
        [],
        [*_tour_sentences(kept.answer, parts)],
        {"stages": marks(parts)},
        curves=joined_curves(parts, body.timing.tool_speed),
    )


def tour_parts(kept: Kept) -> list[Part]:
    """The legs of an answered tour.

    Args:
        kept: The kept tour.
    """
    cell, _ = tour_cell(kept.robot, kept.scene, TourRequest.model_validate(kept.request))
    return _legs(cell, kept.answer)


def _legs(cell: RobotInScene, answer: Mapping[str, Any]) -> list[Part]:
    return [
        Part(
            f"{number}: {leg['origin'] or 'start'} to {leg['target'] or 'end'}",
            float(leg["begins"]),
            trajectories.answered_trajectory(leg["trajectory"], cell.robot.chain)[0],
            cell.robot,
            cell.scene,
            None,
            cell.robot,
        )
        for number, leg in enumerate(answer["legs"])
    ]


def task_cell(kept: Kept, body: TaskRequest) -> tuple[RobotInScene, list[float]]:
    """The robot of a task in its scene at the start, and its configuration then [rad or m].

    Args:
        kept: The kept task.
        body: Its request.
    """
    geometry, start, around = task_ground(kept.robot, kept.scene, body)
    arm = with_fingers(geometry, body.fingers or {})
    cell = attach(arm, moved(around, body), body.attached, body.allowed_collisions)
    return cell, start.tolist()


# --------------------------------------------------------------------------------- the objects


def _stage_part(stage: Mapping[str, Any], cell: StageCell) -> Part:
    """A stage with what is held in it, which is what is held after it."""
    moved = stage.get("fingers")
    return Part(
        stage_label(stage),
        float(stage["begins"]),
        trajectories.answered_trajectory(stage["trajectory"], cell.last.robot.chain)[0],
        cell.first.robot,
        cell.first.scene,
        None if moved is None else trajectories.named_trajectory(trajectories.answered_body(moved)),
        cell.last.robot,
    )


def _things(world: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    yield from world["objects"]
    yield from world["attached"]


def _carriers(
    item: Obstacle, robot: Reference, stages: Sequence[Mapping[str, Any]]
) -> Iterator[dict[str, Any]]:
    """Carriers of an object from the beginning of each stage on: a link, or the ground."""
    tip = None
    for stage in stages:
        tip = stage["certificate"]["premises"]["tool"] if stage.get("tip") is None else tip
        chain = robot_with_tip(robot, tip).chain
        joint, T = -1, item.T_world_obstacle
        for placed in stage["after"]["objects"]:
            if placed["id"] == item.id:
                T = told_transform(placed["pose"])
        for held in stage["after"]["attached"]:
            if held["id"] == item.id:
                link = chain.link(held["link"])
                joint, T = link.joint, link.T_joint_link @ told_transform(held["pose"])
        yield carrier_document(Carrier(float(stage["begins"]), joint, T))


def _tour_sentences(answer: Mapping[str, Any], parts: Sequence[Part]) -> Iterator[str]:
    legs = answer["legs"]
    proved = sum(leg["certificate"]["verified"] for leg in legs)
    yield f"{answer['time']:.3f} s; legs proved: {proved} of {len(legs)}."
    yield f"Stays take {answer['dwell_time']:.3f} s of that."
    if answer["gap"] is not None:
        yield f"No order found could take more than {100.0 * answer['gap']:.1f} % less."
    for one in answer["unvisited"]:
        yield f"Goal {one['id']} is left out: {one['message']}."
    for leg, part in zip(legs, parts, strict=True):
        yield "; ".join([f"Leg {part.label}", *proof_words(leg["certificate"])]) + "."

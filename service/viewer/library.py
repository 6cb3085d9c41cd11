"""Pages of motions, tours and tasks that the library planned in this process."""

from collections.abc import Sequence
from typing import Any

from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.exports.program import program_parts
from planning.proof.certificate import Certificate
from planning.sequence.result import SequencePlan
from planning.sequence.world import World
from planning.tours.result import Tour
from service.fields import picked
from service.translate.certificates import certificate_answer
from service.version import VERSION
from service.viewer.document import (
    Carrier,
    carrier_document,
    motion_document,
    robot_document,
)
from service.viewer.page import page
from service.viewer.timeline import Part, finger_tracks, joined, joined_curves, marks
from service.viewer.words import certificate_sentences, stage_label, task_sentences


def motion_page(
    motion: Trajectory | Tour, certificate: Certificate, robot: RobotGeometry, scene: Scene
) -> bytes:
    """The HTML page of a motion, UTF-8.

    Args:
        motion: The motion, or a tour with its legs.
        certificate: Certificate of it, made here.
        robot: The robot with what it holds.
        scene: The obstacles.
    """
    whole = motion.trajectory if isinstance(motion, Tour) else motion
    return _page(
        motion_document(whole, robot, scene, None),
        robot_document(robot, scene),
        certificate_sentences(certificate_answer(certificate)),
        proved=certificate.verified,
        stages=_tour_marks(motion) if isinstance(motion, Tour) else [],
    )


def _tour_marks(tour: Tour) -> list[dict[str, Any]]:
    """Legs of a tour with the times of their beginnings, as JSON."""
    begins = [visit.departure for visit in tour.visits]
    goals = [f"goal {visit.index}" for visit in tour.visits]
    if len(begins) > len(tour.legs):  # the first leg begins at a goal
        goals = goals[1:]
    else:
        begins = [0.0, *begins]
    legs = zip([*goals, "the end"], begins, range(len(tour.legs)), strict=False)
    return [{"label": f"{k}: to {goal}", "begins": time} for goal, time, k in legs]


def task_page(plan: SequencePlan) -> bytes:
    """The HTML page of a task that was planned in this process, UTF-8.

    Args:
        plan: The task.
    """
    parts, told, begins = list[Part](), list[dict[str, Any]](), 0.0
    for stage, part in zip(plan.stages, program_parts(plan), strict=True):
        arm, moving = part.place.robot, part.fingers
        last = arm if moving is None else with_fingers(arm, moving.last)
        tells = {
            **picked(stage, "index", "kind"),
            "name": stage.name or None,
            "choice": stage.target,
            "certificate": certificate_answer(stage.certificate),
            "after": {"attached": [{"id": item.name} for item in stage.after.held]},
        }
        track = None if moving is None else moving.trajectory
        parts.append(
            Part(stage_label(tells), begins, part.motion, arm, part.place.scene, track, last)
        )
        told.append(tells)
        begins += part.motion.duration
    first, world = plan.stages[0], plan.stages[0].after
    arm = world.robot if first.fingers is None else with_fingers(world.robot, first.fingers.first)
    moved = {item.name: item.attachment.held for one in plan.stages for item in one.after.held}
    still = Scene(tuple(item for item in world.scene.obstacles if item.id not in moved))
    answer = {
        "duration": plan.duration,
        "status": "success" if plan.complete else "partial",
        "stages": told,
    }
    curves = joined_curves(parts, None)
    return _page(
        motion_document(joined(parts, begins), arm, still, None, curves),
        robot_document(arm, still, tuple(moved.values())),
        [*task_sentences(answer)],
        proved=all(stage.certificate.verified for stage in plan.stages),
        operation="POST /v1/tasks",
        stages=marks(parts),
        carriers={
            name: [
                carrier_document(_carrier(stage.after, name, part.begins))
                for stage, part in zip(plan.stages, parts, strict=True)
            ]
            for name in moved
        },
        fingers=finger_tracks(arm, parts),
    )


def _carrier(world: World, name: str, begins: float) -> Carrier:
    """The link that carries an object from a time [s] on, or the ground."""
    if all(item.name != name for item in world.held):
        return Carrier(begins, -1, world.scene.obstacle(name).T_world_obstacle)
    held = world.holds(name).attachment
    link = world.robot.chain.link(held.link)
    return Carrier(begins, link.joint, link.T_joint_link @ held.held.T_world_obstacle)


def _page(
    motion: dict[str, Any],
    robot: dict[str, Any],
    sentences: Sequence[str],
    *,
    proved: bool,
    operation: str = "POST /v1/validate",
    **more: Any,
) -> bytes:
    """The HTML page of documents of a motion and a robot, with the proof in words."""
    return page(
        {
            "title": robot["robot"],
            "operation": operation,
            "failed": False,
            **dict.fromkeys(("id", "created", "seed", "digest", "tree")),
            "version": VERSION,
            **robot,
            "motion": motion,
            "configurations": [],
            "proved_here": proved,
            "sentences": sentences,
            "request": {},
            **more,
        }
    )

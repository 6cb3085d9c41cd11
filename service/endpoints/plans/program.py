"""Kept plans, tasks and tours as the parts of one program."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, get_args

from armwright_wire.motions.export import KeptMotion
from armwright_wire.plans.plan import PlanRequest, ValidateRequest
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory, stay
from obstacles.convex.triangles import join
from obstacles.meshes.writer import glb, stl
from obstacles.robots.finger_geometry import swept_cover
from obstacles.robots.robot_geometry import RobotGeometry
from planning.exports.export import Place
from planning.exports.options import Event
from planning.exports.program import ProgramPart
from planning.exports.swept_volume import swept_volume
from planning.proof.premises import Premises
from planning.values.finger_motion import FingerMotion
from service.endpoints.attached_objects import robot_in_scene
from service.endpoints.plans.view_stages import task_parts, tour_parts
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import trajectories
from service.translate.frames import first_configuration
from service.translate.states import with_states
from service.viewer.timeline import Part
from service.workers.task import task

_OPERATIONS = get_args(KeptMotion.model_fields["operation"].annotation)


@task
def swept(
    robot: Reference, scene: Reference | None, content: bytes, form: str, tolerance: float
) -> bytes:
    """A mesh that holds every point of the moving arm, and of what it holds, at every instant.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The kept plan as ``GET /v1/plans/{id}`` answers it.
        form: "glb" or "stl".
        tolerance: Largest growth of the hulls [m].

    Raises:
        InvalidOption: The plan has no motion, or the tolerance asks for too many hulls.
    """
    whole = json.loads(content)
    fields = {name: whole.get(name) or {} for name in ("operation", "request", "answer")}
    if not fields["answer"] or fields["operation"] not in _OPERATIONS:
        raise InvalidOption(
            "this kept plan has no motion, so that nothing is swept",
            hint="Ask for a plan, task, tour or proof that was answered.",
        )
    parts = program_parts(robot, scene, KeptMotion.model_validate(fields))
    moves = [_covered(part) for part in parts]
    volumes = [swept_volume(motion, arm, tolerance=tolerance) for motion, arm in moves]
    surface = join(volume.surface() for volume in volumes)
    return glb(surface, "swept volume") if form == "glb" else stl(surface)


def _covered(part: ProgramPart) -> tuple[Trajectory, RobotGeometry]:
    """The motion of a part, with fingers that hold all that they sweep in it."""
    arm, fingers = part.place.robot, part.fingers
    if fingers is not None:
        arm, _ = swept_cover(arm, fingers.first, fingers.last, (0.0, 1.0))
    return part.motion, arm


#: Shorter stays between legs are rounded off times [s].
_GAP = 1e-6


def program_parts(robot: Reference, scene: Reference | None, kept: KeptMotion) -> list[ProgramPart]:
    """The parts of a program that does what was planned.

    Args:
        robot: The robot.
        scene: The stored scene, where the kept request names one.
        kept: Request and answer.

    Raises:
        InvalidOption: Request and answer do not belong together.
        ArmwrightError: The kept request is at fault.
    """
    request, answer = kept.request, kept.answer
    try:
        if kept.operation == "POST /v1/tasks":
            parts = task_parts(robot, scene, request, answer)
            return [_stage(*one) for one in zip(parts, answer["stages"], strict=True)]
        if kept.operation == "POST /v1/tours":
            return [*_legs(tour_parts(robot, scene, request, answer), answer["legs"])]
        return [_motion(robot, scene, kept)]
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise InvalidOption(
            "plan: request and answer do not belong together: there is no motion",
            hint="Give both as GET /v1/plans/{id} answers them.",
        ) from error


def _stage(part: Part, stage: Mapping[str, Any]) -> ProgramPart:
    certificate, event = stage["certificate"], stage.get("event")
    fingers = None
    if part.fingers is not None:
        first, last = part.robot.fingers, part.last.fingers
        duration = part.fingers.duration
        fingers = FingerMotion(first, first.positions, last.positions, duration)
    item = "" if stage.get("item") is None else f", {stage['item']}"
    return ProgramPart(
        f"{part.label}{item}",
        stage["kind"],
        part.motion,
        Place(part.robot, part.scene, certificate["premises"]["margin"]),
        fingers,
        None if event is None else Event(stage["kind"], event["port"], event["value"]),
        Premises.of_fields(certificate["premises"]),
    )


def _legs(parts: Sequence[Part], legs: Sequence[Mapping[str, Any]]) -> Iterator[ProgramPart]:
    """Legs of a tour, and the stays at its goals between them."""
    time = 0.0
    for part, leg in zip(parts, legs, strict=True):
        told = leg["certificate"]["premises"]
        place = Place(part.robot, part.scene, told["margin"])
        if part.begins - time > _GAP:
            still = stay(part.motion.joint_names, part.motion.start, part.begins - time)
            yield ProgramPart(f"stay before {part.label}", "wait", still, place)
        yield ProgramPart(part.label, "leg", part.motion, place, premises=Premises.of_fields(told))
        time = part.begins + part.motion.duration


def _motion(robot: Reference, scene: Reference | None, kept: KeptMotion) -> ProgramPart:
    """The motion of a plan or proof."""
    geometry = worker_cache.robot(robot).geometry
    body: PlanRequest | ValidateRequest
    if kept.operation == "POST /v1/plan":
        body = with_states(PlanRequest.model_validate(kept.request), geometry.states)
        start = first_configuration(geometry.chain, body.start.joints)
        motion, _ = trajectories.answered_trajectory(kept.answer["trajectory"], geometry.chain)
        premises = Premises.of_fields(kept.answer["certificate"]["premises"])
    else:
        body = ValidateRequest.model_validate(kept.request)
        motion, _ = trajectories.trajectory(body.trajectory, geometry.chain)
        start, premises = motion.start, Premises.of_fields(kept.answer["premises"])
    cell = robot_in_scene(robot, scene, body, start)
    place = Place(cell.robot, cell.scene, premises.margin)
    return ProgramPart("motion", "plan", motion, place, premises=premises)

"""The space that the motion of a kept plan takes up, in a worker."""

import json
from collections.abc import Iterator
from typing import Any

from armwright_wire.plans.plan import PlanRequest, ValidateRequest
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from obstacles.convex.triangles import join
from obstacles.meshes.writer import glb, stl
from obstacles.robots.finger_geometry import swept_cover
from obstacles.robots.robot_geometry import RobotGeometry
from planning.exports.swept_volume import swept_volume
from service.endpoints.attached_objects import robot_in_scene
from service.endpoints.plans.view_stages import task_parts, tour_parts
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import trajectories
from service.translate.frames import first_configuration
from service.translate.states import with_states
from service.viewer.timeline import Part
from service.workers.task import task


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
    answer = whole.get("answer") or {}
    try:
        moves = [*_moves(robot, scene, whole["operation"], whole["request"], answer)]
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InvalidOption(
            "the kept request and its answer do not belong together: there is no motion",
            hint="Replay the plan, and ask for the answer to that.",
        ) from error
    volumes = [swept_volume(motion, arm, tolerance=tolerance) for motion, arm in moves]
    surface = join(volume.surface() for volume in volumes)
    return glb(surface, "swept volume") if form == "glb" else stl(surface)


def _moves(
    robot: Reference,
    scene: Reference | None,
    operation: str,
    request: dict[str, Any],
    answer: dict[str, Any],
) -> Iterator[tuple[Trajectory, RobotGeometry]]:
    """Motions in turn, each with the robot and what it holds."""
    geometry = worker_cache.robot(robot).geometry
    if operation == "POST /v1/validate":
        proof = ValidateRequest.model_validate(request)
        motion, _ = trajectories.trajectory(proof.trajectory, geometry.chain)
        yield motion, robot_in_scene(robot, scene, proof, motion.start).robot
    elif operation == "POST /v1/plan" and answer:
        body = with_states(PlanRequest.model_validate(request), geometry.states)
        start = first_configuration(geometry.chain, body.start.joints)
        motion, _ = trajectories.answered_trajectory(answer["trajectory"], geometry.chain)
        yield motion, robot_in_scene(robot, scene, body, start).robot
    elif operation == "POST /v1/tasks" and answer:
        yield from map(_covered, task_parts(robot, scene, request, answer))
    elif operation == "POST /v1/tours" and answer:
        yield from map(_covered, tour_parts(robot, scene, request, answer))
    else:
        raise InvalidOption(
            "this kept plan has no motion, so that nothing is swept",
            hint="Ask for a plan, task, tour or proof that was answered.",
        )


def _covered(part: Part) -> tuple[Trajectory, RobotGeometry]:
    """The motion of a part, with fingers that hold all that they sweep in it."""
    if part.fingers is None:
        return part.motion, part.robot
    ends = part.robot.fingers.positions, part.last.fingers.positions
    arm, _ = swept_cover(part.robot, *ends, (0.0, 1.0))
    return part.motion, arm

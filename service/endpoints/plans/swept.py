"""The space that the motion of a kept plan takes up, in a worker."""

import json
from typing import get_args

from armwright_wire.motions.export import KeptMotion
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from obstacles.convex.triangles import join
from obstacles.meshes.writer import glb, stl
from obstacles.robots.finger_geometry import swept_cover
from obstacles.robots.robot_geometry import RobotGeometry
from planning.exports.program import ProgramPart
from planning.exports.swept_volume import swept_volume
from service.endpoints.plans.program import program_parts
from service.storage.caches.cache_key import Reference
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

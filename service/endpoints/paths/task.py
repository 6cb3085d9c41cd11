"""Paths of fewer waypoints as requests ask for them, in workers."""

from pydantic_core import to_json

from armwright_wire.motions.paths import SimplifyRequest
from planning.retiming.simplify import simplify as simplified
from service.endpoints.attached_objects import robot_in_scene
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import certificates, timings
from service.translate.poses import rounding_notes
from service.workers import current
from service.workers.result import TaskProblem, timed_out
from service.workers.task import GRACE, task


@task(grace=GRACE)
def simplify(
    robot: Reference | None, scene: Reference | None, content: bytes
) -> bytes | TaskProblem:
    """Answer a request to simplify a path.

    Args:
        robot: The robot, if one is named.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = SimplifyRequest.model_validate_json(content)
    chain = None if robot is None else worker_cache.chain(robot)
    _, points = timings.joint_path(body.path, chain)
    cell = None if robot is None else robot_in_scene(robot, scene, body, points[0])
    found = simplified(
        points,
        body.tolerance,
        None if cell is None else cell.robot,
        None if cell is None else cell.scene,
        margin=body.margin,
        deadline=current.deadline(),
    )
    proof = found.certificate
    if proof is not None and proof.violation is not None and proof.violation.kind == "time":
        return timed_out("the work was done", "certificate")
    notes = [] if cell is None else [*rounding_notes(body), *cell.notes]
    answer = {
        "status": "success" if proof is None or proof.verified else "unverified",
        "joints": found.waypoints.tolist(),
        "waypoints": found.numbers.tolist(),
        "left_out": len(points) - len(found.numbers),
        "deviation": found.deviation,
        "certificate": None
        if proof is None
        else certificates.certificate_answer(proof, scene=body.scene),
        "notes": [*notes, *found.notes],
    }
    return to_json(answer, inf_nan_mode="null")

"""Exports of motions as requests ask for them, in workers."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic_core import to_json

from armwright_wire.motions.export import ExportRequest, KeptMotion
from planning.exports.export import Export, Place
from planning.exports.export import export as write_motion
from planning.exports.options import ExportFormat, ExportOptions
from planning.exports.program import Program, ProgramPart, export_program, prove_part
from planning.exports.recording import record_parts
from planning.proof.certificate import Certificate
from planning.proof.premises import Premises
from service.endpoints.attached_objects import robot_in_scene
from service.endpoints.plans.view import program_parts
from service.fields import shared
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import certificates, trajectories
from service.workers import current
from service.workers.result import TaskProblem, overdue
from service.workers.task import GRACE, task

#: Format that is written beside those of controllers.
_RECORDING = "mcap"


@task(grace=GRACE)
def export(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a request to write a motion for a controller.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = ExportRequest.model_validate_json(content)
    if isinstance(body.plan, KeptMotion):
        return _program(robot, scene, body, body.plan)
    assert body.trajectory is not None
    chain = worker_cache.chain(robot)
    motion, begins = trajectories.trajectory(body.trajectory, chain)
    cell = robot_in_scene(robot, scene, body, motion.start)
    written = write_motion(
        motion,
        cell.robot,
        cell.scene,
        _options(body),
        margin=body.margin,
        premises=None if body.premises is None else Premises.of_fields(dict(body.premises)),
        different_scene=body.different_scene,
        deadline=current.deadline(),
    )
    deviation = written.joint_deviation
    certificate = certificates.certificate_answer(written.certificate, begins, body.scene)
    more = {
        "joint_deviation": None if deviation is None else deviation.tolist(),
        "certificate": certificate,
    }
    if body.format == _RECORDING:
        part = ProgramPart("motion", "motion", written.motion, Place(cell.robot, cell.scene, 0.0))
        more |= _recording(body, [part], [written.certificate])
    return _answer(body, written, (written.certificate,), more)


def _program(
    robot: Reference, scene: Reference | None, body: ExportRequest, kept: KeptMotion
) -> bytes | TaskProblem:
    """The answer of a program."""
    parts = program_parts(robot, scene, kept)
    written = export_program(
        parts,
        _options(body),
        different_scene=body.different_scene,
        deadline=current.deadline(),
    )
    named = kept.request.get("scene")
    own = named if isinstance(named, str) else None
    told = [
        {
            "label": part.label,
            "kind": part.kind,
            "certificate": certificates.certificate_answer(part.certificate, 0.0, own),
        }
        for part in written.parts
    ]
    more: dict[str, Any] = {"joint_deviation": None, "certificate": None, "parts": told}
    proofs = [part.certificate for part in written.parts]
    if body.format == _RECORDING:
        proofs = [prove_part(part, current.deadline()) for part in parts]
        more |= _recording(body, parts, proofs)
    return _answer(body, written, proofs, more)


def _recording(
    body: ExportRequest, parts: Sequence[ProgramPart], proofs: Sequence[Certificate]
) -> dict[str, Any]:
    """Fields of an answer that holds a recording."""
    period = 0.01 if body.sample_period is None else body.sample_period
    reasons = [reason for proof in proofs for reason in proof.proved.reasons]
    return {
        "file_name": f"{body.name}.mcap",
        "content": b64encode(record_parts(parts, proofs, sample_period=period)).decode(),
        "unproved": [*dict.fromkeys(reasons)],
    }


def _answer(
    body: ExportRequest, written: Export | Program, proofs: Sequence[Certificate],
    more: Mapping[str, Any],
) -> bytes | TaskProblem:  # fmt: skip
    if (late := overdue(*proofs, work="the export was proved")) is not None:
        return late
    answer = {
        "format": body.format,
        "file_name": written.file_name,
        "content": written.text,
        "point_count": written.point_count,
        "interpolation": written.rule.value,
        "proved": written.proved,
        "unproved": list(written.unproved),
        "joint_tolerance": written.tolerance,
        "blends": written.blends.tolist(),
        "parts": None,
        **more,
    }
    return to_json(answer, inf_nan_mode="null")


def _options(body: ExportRequest) -> ExportOptions:
    given = shared(body, ExportOptions, without=("format", "ports"))
    # A recording shows points of a motion as a message of ROS has them.
    named = "joint_trajectory_json" if body.format == _RECORDING else body.format
    return ExportOptions(ExportFormat(named), **given, ports=dict(body.ports or {}))

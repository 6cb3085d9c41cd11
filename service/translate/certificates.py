"""Certificates as answers give them."""

import base64
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import armwright_wire.scenes.scene as schema
from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import Certificate
from planning.proof.premises import Premises
from planning.proof.tool.tool_speed_band import SpeedUse
from planning.stops.certificate import StopCertificate
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits
from planning.witness.compact import Witness
from planning.witness.witness import witness
from service.fields import picked
from service.translate.contacts import allowed_answer
from service.translate.problems import plain


def witness_answer(found: Witness) -> dict[str, Any]:
    """A witness as answers give it: its compact form, and what it does not show."""
    told = found.document_of("unwitnessed")
    return {"compact": base64.b64encode(found.compact).decode(), "unwitnessed": told}


def part_witness(
    motion: Trajectory, cell: tuple[RobotGeometry, Scene], proof: Certificate,
    bounds: Mapping[str, Array], deadline: Deadline, fingers: int = 0,
) -> dict[str, Any]:  # fmt: skip
    """Witness of the motion of one stage or leg.

    Args:
        motion: The motion.
        cell: Robot with what it holds, and its surroundings.
        proof: Its certificate.
        bounds: Limits in place of the robot's.
        deadline: Instant from which on no more directions are looked for.
        fingers: Motions of the gripper in it.
    """
    untold = {
        "constraints": len(proof.path_constraints),
        "tool_motions": int(proof.path_deviation is not None),
        "torque": int("torque" in proof.limits),
        "tool_speed": int("tool_speed" in proof.limits),
        "fingers": fingers,
    }
    return witness_answer(
        witness(
            motion, *cell, margin=proof.premises.margin, limits=MotionLimits(bounds),
            untold=untold, deadline=deadline,
        )
    )  # fmt: skip


def certificate_answer(
    certificate: Certificate, begins: float = 0.0, scene: str | schema.Scene | None = None
) -> dict[str, Any]:
    """A certificate as answers give it.

    Args:
        certificate: The certificate.
        begins: Time of the trajectory's beginning [s].
        scene: Scene as the request names it.
    """
    answer: dict[str, Any] = {
        "verified": certificate.verified,
        "proved": asdict(certificate.proved) | {"reasons": list(certificate.proved.reasons)},
        "premises": premises_answer(certificate.premises, scene),
        "min_clearance": certificate.min_clearance,
        "clearance_pair": certificate.clearance_pair,
        "min_obstacle_clearance": certificate.min_obstacle_clearance,
        "min_self_clearance": certificate.min_self_clearance,
        "method": certificate.method,
        "limits": {
            name: {"worst_ratio": use.worst_ratio, "joint": use.joint, "time": use.time + begins}
            for name, use in certificate.limits.items()
        },
        "continuity": dict(certificate.continuity),
        "cells": certificate.cells,
        "allowed_collisions": allowed_answer(certificate.allowed_collisions),
        "violation": None,
    }
    answer["path_constraint_residual"] = certificate.path_constraint_residual
    answer["path_constraints"] = [
        _timed(report, begins, "constraint", "name", "residual", "unit", "hard", "time")
        for report in certificate.path_constraints
    ]
    deviation = certificate.path_deviation
    if deviation is not None:
        names = ("position", "orientation", "time", "max_position", "max_orientation")
        answer["path_deviation"] = _timed(deviation, begins, *names)
    if certificate.path is not None:
        answer["path"] = asdict(certificate.path)
    box, speed = certificate.tool_box, certificate.tool_speed
    if box is not None:
        answer["tool_tolerance"] = _timed(box, begins, "share", "time")
    if speed is not None:
        bands = [_speed_answer(band) for band in speed.bands] or None
        answer["tool_speed"] = _speed_answer(speed) | {"bands": bands}
    violation = certificate.violation
    if violation is not None:
        told = _timed(violation, begins, "kind", "time", "message")
        answer["violation"] = told | plain(violation.details)
    return answer


def stops_answer(stops: StopCertificate | None, begins: float = 0.0) -> dict[str, Any]:
    """Field of a certificate for the proof of stops; none where there is none.

    Args:
        stops: The proof.
        begins: Time of the trajectory's beginning [s].
    """
    if stops is None:
        return {}
    worst = stops.worst._asdict() | {"time": stops.worst.time + begins}
    answer = picked(stops, "kind", "proved", "longest", "slowed")
    return {"stops": answer | {"worst": worst, "message": stops.message or None}}


def premises_answer(premises: Premises, scene: str | schema.Scene | None) -> dict[str, Any]:
    """Premises as answers give them, with the name of a stored scene."""
    attached, open_meshes = list(premises.attached), list(premises.open_meshes)
    changed = {"scene": scene if isinstance(scene, str) else None, "attached": attached}
    return asdict(premises) | changed | {"open_meshes": open_meshes}


def _timed(report: Any, begins: float, *names: str) -> dict[str, Any]:
    """Fields of a report whose time is counted from another instant on."""
    return picked(report, *names) | {"time": report.time + begins}


def _speed_answer(use: SpeedUse) -> dict[str, Any]:
    return picked(use, "share", "least", "most", "low", "high")

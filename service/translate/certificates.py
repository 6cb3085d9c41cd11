"""Certificates as answers give them."""

from dataclasses import asdict
from typing import Any

from armwright_wire.scenes.scene import Scene
from planning.proof.certificate import Certificate
from planning.proof.premises import Premises
from planning.proof.tool.tool_speed_band import SpeedUse
from planning.stops.certificate import StopCertificate
from service.translate.contacts import allowed_answer
from service.translate.problems import plain


def certificate_answer(
    certificate: Certificate, begins: float = 0.0, scene: str | Scene | None = None
) -> dict[str, Any]:
    """A certificate as answers give it.

    Args:
        certificate: The certificate.
        begins: Time of the trajectory's beginning [s].
        scene: Scene as the request names it.
    """
    answer: dict[str, Any] = {
        "verified": certificate.verified,
        "proved": {
            "limits": certificate.proved.limits,
            "collisions": certificate.proved.collisions,
            "reasons": list(certificate.proved.reasons),
        },
        "premises": premises_answer(certificate.premises, scene),
        "min_clearance": certificate.min_clearance,
        "clearance_pair": certificate.clearance_pair,
        "min_obstacle_clearance": certificate.min_obstacle_clearance,
        "min_self_clearance": certificate.min_self_clearance,
        "method": certificate.method,
        "limits": {
            name: {
                "worst_ratio": report.worst_ratio,
                "joint": report.joint,
                "time": report.time + begins,
            }
            for name, report in certificate.limits.items()
        },
        "continuity": dict(certificate.continuity),
        "cells": certificate.cells,
        "allowed_collisions": allowed_answer(certificate.allowed_collisions),
        "violation": None,
    }
    answer["path_constraint_residual"] = certificate.path_constraint_residual
    answer["path_constraints"] = [
        {
            "constraint": report.constraint,
            "name": report.name,
            "residual": report.residual,
            "unit": report.unit,
            "hard": report.hard,
            "time": report.time + begins,
        }
        for report in certificate.path_constraints
    ]
    deviation = certificate.path_deviation
    if deviation is not None:
        answer["path_deviation"] = {
            "position": deviation.position,
            "orientation": deviation.orientation,
            "time": deviation.time + begins,
            "max_position": deviation.max_position,
            "max_orientation": deviation.max_orientation,
        }
    box, speed = certificate.tool_box, certificate.tool_speed
    if box is not None:
        answer["tool_tolerance"] = {"share": box.share, "time": box.time + begins}
    if speed is not None:
        bands = [_speed_answer(band) for band in speed.bands] or None
        answer["tool_speed"] = _speed_answer(speed) | {"bands": bands}
    violation = certificate.violation
    if violation is not None:
        answer["violation"] = {
            "kind": violation.kind,
            "time": violation.time + begins,
            "message": violation.message,
            **plain(violation.details),
        }
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
    answer = {name: getattr(stops, name) for name in ("kind", "proved", "longest", "slowed")}
    return {"stops": answer | {"worst": worst, "message": stops.message or None}}


def premises_answer(premises: Premises, scene: str | Scene | None) -> dict[str, Any]:
    """Premises as answers give them, with the name of a stored scene."""
    answer = asdict(premises) | {"scene": scene if isinstance(scene, str) else None}
    return answer | {name: list(answer[name]) for name in ("attached", "open_meshes")}


def _speed_answer(use: SpeedUse) -> dict[str, float]:
    return {name: getattr(use, name) for name in ("share", "least", "most", "low", "high")}

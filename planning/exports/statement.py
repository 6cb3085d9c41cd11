"""The statement at the head of an exported file: what is proved of it, and what is not."""

import math
import re

from planning.exports.options import ExportFormat, ExportOptions, Rule
from planning.proof.certificate import Certificate

#: Sign that begins a comment; JSON has none.
_SIGNS = {ExportFormat.RAPID: "!", ExportFormat.KRL: ";"}
RULES = {
    Rule.QUINTIC: "quintic polynomials through positions, velocities and accelerations",
    Rule.CUBIC: "cubic polynomials through positions and velocities",
    Rule.LINEAR: "straight lines in joint space at constant rates",
    Rule.STRAIGHT_LEGS: "straight lines in joint space from point to point",
}
_STAND = "The arm stands at the first point, within the tolerance, when the motion begins."
_TRACKING = "Tracking errors of the drives, beyond the joint tolerance named here."
_ROS = "Other settings of joint_trajectory_controller than interpolation_method: splines."
_TABLE = "A reader of the table that interpolates in another way."
_SERVOJ = (
    "The smoothing of servoj by lookahead_time and gain, which is not published: only the "
    "setpoints and the lines between them are proved."
)
_PROPORTION = "Axes that do not keep step between two points, so that the leg is not straight."
_BLEND = "The corners that the controller cuts by blending: their shape is not published."
_PARTS = {
    ExportFormat.CSV: (_TABLE,),
    ExportFormat.URSCRIPT_SERVOJ: (_SERVOJ,),
    ExportFormat.URSCRIPT_MOVEJ: (),
    ExportFormat.RAPID: (_PROPORTION,),
    ExportFormat.KRL: (_PROPORTION,),
}


def unproved_parts(options: ExportOptions, certificate: Certificate) -> tuple[str, ...]:
    """Sentences on what the proof of an export does not cover.

    Args:
        options: Options of the export.
        certificate: Certificate of the controller's motion.
    """
    parts = (*_PARTS.get(options.format, (_ROS,)), _TRACKING)
    if options.blend:
        parts = (_BLEND, *parts)
    if options.is_path:
        parts = (*parts, "Speeds and accelerations, which the controller chooses.")
    return (*certificate.proved.reasons, *parts)


def comments(
    options: ExportOptions,
    rule: Rule,
    certificate: Certificate,
    proved: bool,
    unproved: tuple[str, ...],
    tolerance: float | None,
) -> list[str]:
    """Comment lines for the head of a file, in ASCII.

    Args:
        options: Options of the export.
        rule: The interpolation between the points.
        certificate: Certificate of the controller's motion.
        proved: The rule covers the whole file, and nothing collides.
        unproved: Sentences on what the proof does not cover.
        tolerance: Tracking error that the clearance covers [rad or m].
    """
    lines = [f"Written by Armwright: {options.format.value}."]
    lines.append(f"Between the points: {RULES[rule]}.")
    against = certificate.premises.against()
    if proved:
        lines.append(f"PROVED free of collisions by that rule, {against}. {_STAND}")
    else:
        lines.append(f"NOT PROVED free of collisions. It was looked at {against}.")
    if certificate.proved.collisions and math.isfinite(certificate.min_clearance):
        subject = "" if options.blend == 0.0 else " of the legs"
        lines.append(f"Proved clearance{subject}: {certificate.min_clearance:.6g} m.")
    if tolerance is not None:
        lines.append(f"Joint tolerance covered by it: {tolerance:.3g} rad (m of slides).")
    lines += [f"Not covered: {sentence}" for sentence in unproved]
    lines += [
        f"Not kept apart ({item.reason}): {' and '.join(item.pair)}, "
        + ("joined or touching as built." if item.overlap is None else
           f"at most {item.overlap:.6g} m deep.")
        for item in certificate.allowed_collisions
    ]  # fmt: skip
    sign = _SIGNS.get(options.format, "#")
    return [f"{sign} {_plain(line)}" for line in lines]


def _plain(text: str) -> str:
    """Text on one line in printable ASCII: names of robots and obstacles are anybody's."""
    return re.sub(r"[^ -~]", "?", text)

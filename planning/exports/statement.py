"""The statement at the head of an exported file: what is proved of it, and what is not."""

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from planning.exports.options import ExportFormat, ExportOptions, Rule
from planning.proof.certificate import Certificate

if TYPE_CHECKING:
    from planning.exports.export import ProvedRun

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
_BLEND = (
    "Corners that are cut outside of the triangle, in joint space, of where the controller leaves "
    "the leg, the point, and where it meets the next leg: their shape is not published."
)
_CELL = "What the cell's own procedures do: gripper_to, take_... and its inputs and outputs."
_PARTS = {
    ExportFormat.CSV: (_TABLE,),
    ExportFormat.URSCRIPT_SERVOJ: (_SERVOJ,),
    ExportFormat.URSCRIPT_MOVEJ: (),
    ExportFormat.RAPID: (_PROPORTION,),
    ExportFormat.KRL: (_PROPORTION,),
}


def unproved_parts(
    options: ExportOptions, certificates: Sequence[Certificate], *, program: bool = False
) -> tuple[str, ...]:
    """Sentences on what the proof of an export does not cover.

    Args:
        options: Options of the export.
        certificates: Certificates of the controller's motions.
        program: Whether the file has stages in which the cell does something.
    """
    parts = (*_PARTS.get(options.format, (_ROS,)), _TRACKING)
    if options.blend:
        parts = (_BLEND, *parts)
    if options.is_path:
        parts = (*parts, "Speeds and accelerations, which the controller chooses.")
    reasons = [reason for one in certificates for reason in one.proved.reasons]
    return (*dict.fromkeys(reasons), *parts, *((_CELL,) if program else ()))


def comments(
    options: ExportOptions, run: "ProvedRun", proved: bool, unproved: Sequence[str]
) -> list[str]:
    """Comment lines for the head of a file of one motion, in ASCII.

    Args:
        options: Options of the export.
        run: The motion as it is proved.
        proved: The rule covers the whole file, and nothing collides.
        unproved: Sentences on what the proof does not cover.
    """
    (certificate,) = run.certificates
    lines = [f"Written by Armwright: {options.format.value}."]
    lines.append(f"Between the points: {RULES[run.points.rule]}.")
    if run.radii.any():
        lines.append(f"Corners are cut within {run.radii.max():.6g} m of the flange.")
    against = certificate.premises.against()
    if proved:
        lines.append(f"PROVED free of collisions by that rule, {against}. {_STAND}")
    else:
        lines.append(f"NOT PROVED free of collisions. It was looked at {against}.")
    if certificate.proved.collisions and math.isfinite(certificate.min_clearance):
        lines.append(f"Proved clearance: {certificate.min_clearance:.6g} m.")
    if run.tolerance is not None:
        lines.append(f"Joint tolerance covered by it: {run.tolerance:.3g} rad (m of slides).")
    lines += [f"Not covered: {sentence}" for sentence in unproved]
    return signed(options, [*lines, *allowed_lines(certificate)])


def allowed_lines(certificate: Certificate) -> list[str]:
    """A sentence for each pair that is not kept apart."""
    return [
        f"Not kept apart ({item.reason}): {' and '.join(item.pair)}, "
        + ("joined or touching as built." if item.overlap is None else
           f"at most {item.overlap:.6g} m deep.")
        for item in certificate.allowed_collisions
    ]  # fmt: skip


def signed(options: ExportOptions, lines: Sequence[str]) -> list[str]:
    """Lines as comments of a format."""
    sign = _SIGNS.get(options.format, "#")
    return [f"{sign} {plain(line)}" for line in lines]


def plain(text: str) -> str:
    """Text on one line in printable ASCII: names of robots and obstacles are anybody's."""
    return re.sub(r"[^ -~]", "?", text)

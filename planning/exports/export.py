"""A motion as a file for a controller, and the proof of what the controller makes of the file."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain, Limits
from kinematics.trajectory.polynomial import composed_pieces
from kinematics.trajectory.trajectory import Trajectory, concatenate, interpolate
from obstacles.robots.robot_geometry import RobotGeometry, lever_arms
from obstacles.scenes.scene import Scene
from planning.exports import formats
from planning.exports.corners import check_flange, fitted_corners
from planning.exports.languages import Krl, Language, Rapid, Stream, URScript, WrittenMotion
from planning.exports.options import ExportFormat, ExportOptions, Rule
from planning.exports.points import ExportPoints, export_points
from planning.proof.certificate import Certificate, certify
from planning.proof.limits.limits import QUANTITIES
from planning.proof.premises import Premises
from planning.values.deadline import Deadline
from planning.values.limits import RATIO_TOLERANCE, MotionLimits

#: The rules in words.
RULES = {
    Rule.QUINTIC: "quintic polynomials through positions, velocities and accelerations",
    Rule.CUBIC: "cubic polynomials through positions and velocities",
    Rule.LINEAR: "straight lines in joint space at constant rates",
    Rule.STRAIGHT_LEGS: "straight lines in joint space from point to point",
}
_STAND = "The arm stands at the first point, within the tolerance, when the motion begins."
_TRACKING = "Tracking errors of the drives, beyond the joint tolerance named here."
_BLEND = (
    "Corners that are cut outside of the triangle, in joint space, of where the controller leaves "
    "the leg, the point, and where it meets the next leg: their shape is not published."
)
_CELL = "What the cell's own procedures do: gripper_to, take_... and its inputs and outputs."


def unproved_parts(
    options: ExportOptions, certificates: Sequence[Certificate], *, program: bool = False
) -> tuple[str, ...]:
    """Sentences on what the proof of an export does not cover.

    Args:
        options: Options of the export.
        certificates: Certificates of the controller's motions.
        program: Whether the file has stages in which the cell does something.
    """
    parts = (*options.traits.gaps, _TRACKING)
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
    return [f"{options.traits.sign} {plain(line)}" for line in lines]


def plain(text: str) -> str:
    """Text on one line in printable ASCII: names of robots and obstacles are anybody's."""
    return re.sub(r"[^ -~]", "?", text)


@dataclass(frozen=True, slots=True)
class Export:
    """A file with what is proved of it.

    Args:
        text: The file.
        file_name: The program's name with the ending of the format.
        rule: The interpolation between its points.
        motion: Motion that the controller makes of the points by that rule; of a path the legs,
            from rest to rest.
        certificate: Certificate of that motion; of a path its positions and collisions.
        proved: Nothing collides wherever the controller keeps to the rule, and the rule covers all
            of the file.
        unproved: Parts that the proof does not cover, a sentence each.
        joint_deviation: Largest difference between the given motion and this one, of each joint,
            shape (n,) [rad or m]; None for a path, which has times of its own.
        tolerance: Tracking error of every joint that the proved clearance covers [rad or m].
        point_count: Number of points in the file.
        blends: How far each point of the file may be cut, as the flange's distance [m].
    """

    text: str
    file_name: str
    rule: Rule
    motion: Trajectory
    certificate: Certificate
    proved: bool
    unproved: tuple[str, ...]
    joint_deviation: Array | None
    tolerance: float | None
    point_count: int
    blends: Array


class Place(NamedTuple):
    """The surroundings that a motion is proved in.

    Args:
        robot: The arm with its geometry; what it holds is part of it.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
    """

    robot: RobotGeometry
    scene: Scene
    margin: float = 0.0


class ProvedRun(NamedTuple):
    """A motion as a file has it, with the proof of what a controller makes of it.

    Args:
        points: Points of the file.
        motion: Motion between them by their rule.
        certificates: Certificate of each part of it.
        tolerance: Tracking error that the clearance of all parts covers [rad or m]; None for none.
        corners: How far the file lets each point be cut, in its own measure, shape (p,).
        radii: The same as the flange's distance [m], shape (p,).
    """

    points: ExportPoints
    motion: Trajectory
    certificates: tuple[Certificate, ...]
    tolerance: float | None
    corners: Array
    radii: Array


@typed
def export(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    options: ExportOptions,
    *,
    margin: float = 0.0,
    premises: Premises | None = None,
    different_scene: bool = False,
    deadline: Deadline | None = None,
) -> Export:
    """Write a motion for a controller, and prove the motion that the controller makes of it.

    The proof checks the points as the file has them, rounded where the format rounds, and at the
    interpolation between them: it does not rely on any proof of the given motion.

    Args:
        trajectory: Trajectory of all joints of the robot, in its order.
        robot: The arm with its geometry.
        scene: The obstacles.
        options: Format, points and program.
        margin: Distance to keep from obstacles beyond their own margins [m].
        premises: Premises of the motion's certificate, where it has one.
        different_scene: Whether robot, scene and what is held may be others than these.
        deadline: Time at which to give up the proof; ``certificate.violation`` then is of kind
            "time".

    Raises:
        InvalidOption: The robot or the number of points does not fit the format, nothing says where
            the flange of a blend is; or the motion was proved for another robot, scene or load.
    """
    formats.check_axes(robot.chain, options)
    if premises is not None and not different_scene:
        check_premises(premises, Premises.of_cell(robot, scene, margin))
    place = Place(robot, scene, margin)
    run = prove_run(((trajectory, place),), options, deadline)
    certificate = run.certificates[0]
    unproved = unproved_parts(options, (certificate,))
    proved = certificate.proved.collisions
    head = comments(options, run, proved, unproved)
    return Export(
        text=file_text(robot, run, options, head),
        file_name=options.file_name,
        rule=run.points.rule,
        motion=run.motion,
        certificate=certificate,
        proved=proved,
        unproved=unproved,
        joint_deviation=None if options.is_path else joint_deviation(trajectory, run.motion),
        tolerance=run.tolerance,
        point_count=len(run.points.ticks),
        blends=run.radii,
    )


def prove_run(
    parts: Sequence[tuple[Trajectory, Place]], options: ExportOptions, deadline: Deadline | None
) -> ProvedRun:
    """The points of a motion in a file, and the proof of what a controller makes of them.

    Args:
        parts: Motions that follow each other without a stop, each with its surroundings.
        options: Format, points and program.
        deadline: Time at which to give up the proof.

    Raises:
        InvalidOption: There are too many points, or a blend and no flange.
    """
    whole = parts[0][0] if len(parts) == 1 else concatenate([motion for motion, _ in parts])
    chain = parts[0][1].robot.chain
    if options.blend and options.format != ExportFormat.KRL:
        check_flange(chain)
    points, motion = _within_limits(whole, chain.limits, options)
    # Cubics pass points at which the acceleration jumps: what jerk they make is reported.
    limits = MotionLimits(holds_jerk=points.rule == Rule.QUINTIC)
    if options.is_path:
        # The controller chooses rates along a path.
        limits = MotionLimits(dict.fromkeys(QUANTITIES[1:], np.full(chain.n, np.inf)))
    rest, certificates, tolerances = motion, list[Certificate](), list[float | None]()
    for k, (own, place) in enumerate(parts):
        piece = rest
        if k + 1 < len(parts):
            piece, rest = rest.split(own.duration * motion.duration / whole.duration)
        certificate = certify(piece, place.robot, place.scene, margin=place.margin, limits=limits,
                              deadline=deadline)  # fmt: skip
        certificates.append(certificate)
        clearance = certificate.min_clearance
        proved = certificate.proved.collisions
        tolerances.append(joint_tolerance(place.robot, clearance) if proved else None)
    corners = radii = np.zeros(len(points.ticks))
    if options.blend and all(one.proved.collisions for one in certificates):
        shares, radii = fitted_corners(points.positions, *parts[0][1], options.blend)
        corners = shares if options.format == ExportFormat.KRL else radii
    known = [one for one in tolerances if one is not None]
    tolerance = min(known) if len(known) == len(parts) else None
    return ProvedRun(points, motion, tuple(certificates), tolerance, corners, radii)


def check_premises(given: Premises, own: Premises) -> None:
    """Check that a motion was proved for what it is exported for.

    Args:
        given: Premises of the proof that the motion has.
        own: Premises of the proof of the export.

    Raises:
        InvalidOption: They differ.
    """
    differences = own.differences(given)
    if differences:
        raise InvalidOption(
            f"the motion was proved under other premises: {'; '.join(differences)}",
            hint="Give the robot, scene, attached objects and fingers that it was planned with, or "
            "say different_scene (--different-scene) to prove it for these.",
            differences=differences,
        )


def _within_limits(
    trajectory: Trajectory, limits: Limits, options: ExportOptions
) -> tuple[ExportPoints, Trajectory]:
    """The points of a motion and what the controller makes of them, slower where rounding asks it.

    Files count time in whole nanoseconds. What that stirs in the acceleration of a point carries
    the jerk beyond its limit by 1e-8 to 1e-5 of it, where the motion uses all of the limit.
    """
    slower = 1.0
    # Excesses of limits that are called rounding, as a share of the duration, and how often a
    # motion is slowed down for them.
    rounding, rounds = 1e-3, 4
    for _ in range(rounds):
        given = trajectory if slower == 1.0 else trajectory.dilate(slower)
        points = export_points(given, options)
        motion = controller_motion(trajectory.joint_names, points)
        excess = 0.0 if options.is_path else _excess(trajectory, motion, limits, points.rule)
        if not 0.0 < excess <= rounding:
            break
        slower *= 1.0 + 2.0 * excess
    return points, motion


def _excess(given: Trajectory, motion: Trajectory, limits: Limits, rule: Rule) -> float:
    """By how much longer a motion has to take to keep the limits that the given one keeps."""
    factor = 1.0
    for order, name in enumerate(QUANTITIES[1:], 1):
        # Cubics are for motions whose acceleration jumps: their jerk has no bound.
        if order <= (3 if rule == Rule.QUINTIC else 2):
            limit = getattr(limits, name)
            before, after = (np.nanmax(m.peaks(order).value / limit, initial=0.0)
                             for m in (given, motion))  # fmt: skip
            if before <= 1.0 + RATIO_TOLERANCE < after:
                factor = max(factor, float(after) ** (1.0 / order))
    return factor - 1.0


def file_text(
    robot: RobotGeometry, run: "ProvedRun", options: ExportOptions, head: Sequence[str]
) -> str:
    """The file of one motion.

    Args:
        robot: The arm.
        run: The motion as it is proved.
        options: Format, points and program.
        head: Comments.
    """
    names, frame, points = robot.chain.joint_names, options.frame_id, run.points
    match options.format:
        case ExportFormat.JOINT_TRAJECTORY_JSON:
            return formats.message_json(names, points, frame)
        case ExportFormat.JOINT_TRAJECTORY_YAML:
            lines = formats.message_yaml(names, points, frame)
        case ExportFormat.ROS2_CONTROL:
            lines = formats.goal_yaml(names, points, frame, run.tolerance)
        case ExportFormat.CSV:
            lines = formats.table(names, points)
        case _:
            language = language_of(robot.chain, options)
            motion = language.motion(WrittenMotion(points, run.corners))
            body = [*language.begin(points.positions[0], run.tolerance), *motion]
            return "\n".join([*language.program(head, body), ""])
    return "\n".join([*head, *lines, ""])


def language_of(chain: Chain, options: ExportOptions) -> Language:
    """The language that programs of a format are in."""
    if options.traits.cycles is not None:
        return Stream(options, chain.n)
    if options.format == ExportFormat.RAPID:
        return Rapid(options)
    return Krl(options) if options.format == ExportFormat.KRL else URScript(options, chain)


def joint_tolerance(robot: RobotGeometry, clearance: float) -> float | None:
    """A tolerance d: where each joint is off by less than d, nothing moves by the clearance.

    With R_k the farthest that any point carried by joint k can be from its axis in any
    configuration, joints that are off by d move no point by more than d sum_k R_k (R_k = 1 for a
    slide). So d = clearance / sum_k R_k. The joints are put off one by one, the base's first: the
    links beyond each then stand as in the motion itself, within their limits.

    Args:
        robot: The arm with its geometry; what it holds is part of it.
        clearance: Least distance of any pair [m].

    Returns:
        The tolerance [rad or m]; None where nothing can collide or a slide has no stops.
    """
    weights = lever_arms(robot)
    total = float(weights.sum())
    if not math.isfinite(clearance) or clearance <= 0.0 or not math.isfinite(total):
        return None
    return clearance / total if total > 0.0 else None


def controller_motion(joint_names: Sequence[str], points: ExportPoints) -> Trajectory:
    """The motion between exported points by their rule.

    Quintics through positions, velocities and accelerations, cubics through positions and
    velocities, and straight lines are what joint_trajectory_controller of ros2_control
    interpolates by, as each point has them. The straight legs of a path go from rest to rest,
    q(u) = a + (3 u^2 - 2 u^3) (b - a); any other timing of a leg passes the same configurations.

    Args:
        joint_names: n names.
        points: Points as the file has them.
    """
    rows = points.derivatives
    if points.rule == Rule.STRAIGHT_LEGS:
        return interpolate(joint_names, points.times, rows[0], "cubic", np.zeros_like(rows[0]))
    return interpolate(joint_names, points.times, rows[0], points.rule.value, *rows[1:])


def joint_deviation(motion: Trajectory, other: Trajectory) -> Array:
    """Largest |q(t) - p(t)| of each joint over all t of both motions, shape (n,) [rad or m].

    The differences are polynomials between the breaks of both; their extrema are exact to rounding.

    Args:
        motion: Motion of n joints.
        other: Motion of the same joints.
    """
    end = min(motion.duration, other.duration)
    breaks = np.unique(np.concatenate([motion.breaks, other.breaks]))
    breaks = breaks[breaks < end]
    # Breaks apart by rounding alone make no piece of their own.
    keep = np.diff(breaks, append=np.inf) > 1e-12 * end
    breaks = breaks[keep]
    first, second = (_coefficients(one, breaks, end) for one in (motion, other))
    size = max(first.shape[2], second.shape[2])
    difference = _padded(first, size) - _padded(second, size)
    ends = Trajectory(motion.joint_names, np.append(breaks, end), difference).extrema()
    return np.asarray(np.maximum(np.abs(ends.minimum), np.abs(ends.maximum)))


def _coefficients(motion: Trajectory, starts: Array, end: float) -> Array:
    """Coefficients of a motion about the starts of pieces that do not cross its breaks."""
    middles = 0.5 * (starts + np.append(starts[1:], end))
    pieces = np.clip(np.searchsorted(motion.breaks, middles, "right") - 1, 0, motion.pieces - 1)
    phases = np.column_stack([starts - motion.breaks[pieces], np.ones(len(starts))])
    return composed_pieces(motion.coefficients, pieces, phases, 1)


def _padded(c: Array, size: int) -> Array:
    return np.pad(c, ((0, 0), (0, 0), (0, size - c.shape[2])))

"""A motion as a file for a controller, and the proof of what the controller makes of the file.

The statement at the head of an exported file: what is proved of it, and what is not.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from kinematics.model.branch import BodyTree
from kinematics.model.chain import Limits
from kinematics.trajectory.interpolation import interpolate
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.exports import formats
from planning.exports.formats import ExportPoints, export_points
from planning.exports.options import ExportFormat, ExportOptions, Rule
from planning.proof.certificate import Certificate, certify
from planning.proof.premises import Premises
from planning.values.deadline import Deadline
from planning.values.limits import RATIO_TOLERANCE, MotionLimits

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


#: Endings of the files.
ENDINGS = {
    ExportFormat.JOINT_TRAJECTORY_JSON: "json",
    ExportFormat.JOINT_TRAJECTORY_YAML: "yaml",
    ExportFormat.ROS2_CONTROL: "yaml",
    ExportFormat.CSV: "csv",
    ExportFormat.URSCRIPT_SERVOJ: "script",
    ExportFormat.URSCRIPT_MOVEJ: "script",
    ExportFormat.RAPID: "mod",
    ExportFormat.KRL: "src",
}


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
        InvalidOption: The robot or the number of points does not fit the format; or the motion was
            proved for another robot, scene or load.
    """
    formats.check_axes(robot.chain, options.format)
    if premises is not None and not different_scene:
        _check_premises(premises, Premises.of_cell(robot, scene, margin))
    points, motion = _within_limits(trajectory, robot.chain.limits, options)
    # Cubics pass points at which the acceleration jumps: what jerk they make is reported.
    limits = MotionLimits(holds_jerk=points.rule == Rule.QUINTIC)
    limits = _no_rates(robot.chain.n) if options.is_path else limits
    certificate = certify(motion, robot, scene, margin=margin, limits=limits, deadline=deadline)
    tolerance = None
    if certificate.proved.collisions:
        tolerance = joint_tolerance(robot, certificate.min_clearance)
    unproved = unproved_parts(options, certificate)
    proved = certificate.proved.collisions and options.blend == 0.0
    head = comments(options, points.rule, certificate, proved, unproved, tolerance)
    return Export(
        text=_text(robot, points, options, head, tolerance),
        file_name=f"{options.name}.{ENDINGS[options.format]}",
        rule=points.rule,
        motion=motion,
        certificate=certificate,
        proved=proved,
        unproved=unproved,
        joint_deviation=None if options.is_path else joint_deviation(trajectory, motion),
        tolerance=tolerance,
        point_count=len(points.ticks),
    )


def _check_premises(given: Premises, own: Premises) -> None:
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
    for order, name in enumerate(("velocity", "acceleration", "jerk"), 1):
        # Cubics are for motions whose acceleration jumps: their jerk has no bound.
        if order <= (3 if rule == Rule.QUINTIC else 2):
            limit = getattr(limits, name)
            before, after = (np.nanmax(m.peaks(order).value / limit, initial=0.0)
                             for m in (given, motion))  # fmt: skip
            if before <= 1.0 + RATIO_TOLERANCE < after:
                factor = max(factor, float(after) ** (1.0 / order))
    return factor - 1.0


def _no_rates(n: int) -> MotionLimits:
    """No limits of rates: the controller chooses them along a path."""
    none = np.full(n, np.inf)
    return MotionLimits(dict.fromkeys(("velocity", "acceleration", "jerk"), none))


def _text(
    robot: RobotGeometry,
    points: ExportPoints,
    options: ExportOptions,
    head: Sequence[str],
    tolerance: float | None,
) -> str:
    names, frame = robot.chain.joint_names, options.frame_id
    match options.format:
        case ExportFormat.JOINT_TRAJECTORY_JSON:
            return formats.message_json(names, points, frame)
        case ExportFormat.JOINT_TRAJECTORY_YAML:
            lines = formats.message_yaml(names, points, frame)
        case ExportFormat.ROS2_CONTROL:
            lines = formats.goal_yaml(names, points, frame, tolerance)
        case ExportFormat.CSV:
            lines = formats.table(names, points)
        case ExportFormat.URSCRIPT_SERVOJ:
            lines = formats.servoj(points, options.name, tolerance)
        case ExportFormat.URSCRIPT_MOVEJ:
            lines = formats.movej(robot.chain, points, options, tolerance)
        case ExportFormat.RAPID:
            lines = formats.rapid(points, options, head, tolerance)
            head = ()
        case ExportFormat.KRL:
            lines = formats.krl(points, options, head, tolerance)
            head = ()
    return "\n".join([*head, *lines, ""])


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


def lever_arms(robot: RobotGeometry) -> Array:
    """R_k of each joint, shape (n,): [m], 1 for a slide; infinite before a slide without stops.

    A joint that others follow has theirs added, times their multipliers.
    """
    chain = robot.chain
    tree = BodyTree.of(chain)
    largest = tree.positions(np.maximum(np.abs(chain.limits.lower), np.abs(chain.limits.upper)))
    beyond = np.zeros(len(tree.parents))
    for piece, body in zip(robot.pieces, robot.joints.tolist(), strict=True):
        if body >= 0:
            center, radius = piece.bounding_sphere()
            beyond[body] = max(beyond[body], float(np.linalg.norm(center)) + radius)
    for body in range(len(beyond) - 1, -1, -1):
        parent = tree.parents[body]
        if parent >= 0:
            stroke = float(largest[body]) if tree.slides[body] else 0.0
            beyond[parent] = max(beyond[parent], beyond[body] + float(tree.lengths[body]) + stroke)
    return tree.of_leaders(np.where(tree.slides, 1.0, beyond))


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
    c: Array = motion.coefficients[pieces].copy()
    shift = (starts - motion.breaks[pieces])[:, None]
    for first in range(c.shape[2] - 1):
        for i in range(c.shape[2] - 2, first - 1, -1):
            c[:, :, i] += shift * c[:, :, i + 1]
    return c


def _padded(c: Array, size: int) -> Array:
    return np.pad(c, ((0, 0), (0, 0), (0, size - c.shape[2])))

"""A motion as a file for a controller, and the proof of what the controller makes of the file."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from kinematics.model.chain import Limits
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.exports import programs, ros, table
from planning.exports.controller_motion import controller_motion, joint_deviation
from planning.exports.joint_tolerance import joint_tolerance
from planning.exports.options import ExportFormat, ExportOptions, Rule
from planning.exports.points import ExportPoints, export_points
from planning.exports.statement import comments, unproved_parts
from planning.proof.certificate import Certificate, certify
from planning.proof.premises import Premises
from planning.values.deadline import Deadline
from planning.values.limits import RATIO_TOLERANCE, MotionLimits

#: Excesses of limits that are called rounding, as a share of the duration, and how often a motion
#: is slowed down for them.
_ROUNDING, _ROUNDS = 1e-3, 4
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

    The proof looks at the points as the file has them, rounded where the format rounds, and at the
    interpolation between them: it does not rely on any proof of the given motion.

    Args:
        trajectory: Trajectory of all joints of the robot, in its order.
        robot: The arm with its geometry.
        scene: The obstacles.
        options: Format, points and program.
        margin: Distance to keep from obstacles beyond their own margins [m].
        premises: Premises of the motion's certificate, where it has one.
        different_scene: Whether robot, scene and what is held may be others than these.
        deadline: Instant at which the proof is given up; ``certificate.violation`` then is of kind
            "time".

    Raises:
        InvalidOption: The robot or the number of points does not fit the format; or the motion was
            proved for another robot, scene or load.
    """
    programs.check_axes(robot.chain, options.format)
    if premises is not None and not different_scene:
        _check_premises(premises, Premises.of_cell(robot, scene, margin))
    points, motion = _within_limits(trajectory, robot.chain.limits, options)
    # Cubics pass points at which the acceleration jumps: what jerk they make is told.
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
    for _ in range(_ROUNDS):
        given = trajectory if slower == 1.0 else trajectory.dilate(slower)
        points = export_points(given, options)
        motion = controller_motion(trajectory.joint_names, points)
        excess = 0.0 if options.is_path else _excess(trajectory, motion, limits, points.rule)
        if not 0.0 < excess <= _ROUNDING:
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
            return ros.message_json(names, points, frame)
        case ExportFormat.JOINT_TRAJECTORY_YAML:
            lines = ros.message_yaml(names, points, frame)
        case ExportFormat.ROS2_CONTROL:
            lines = ros.goal_yaml(names, points, frame, tolerance)
        case ExportFormat.CSV:
            lines = table.table(names, points)
        case ExportFormat.URSCRIPT_SERVOJ:
            lines = programs.servoj(points, options.name, tolerance)
        case ExportFormat.URSCRIPT_MOVEJ:
            lines = programs.movej(robot.chain, points, options, tolerance)
        case ExportFormat.RAPID:
            lines = programs.rapid(points, options, head, tolerance)
            head = ()
        case ExportFormat.KRL:
            lines = programs.krl(points, options, head, tolerance)
            head = ()
    return "\n".join([*head, *lines, ""])

"""A motion as a file for a controller, and the proof of what the controller makes of the file."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.deadline import Deadline
from planning.exports import programs, ros, table
from planning.exports.controller_motion import controller_motion, joint_deviation
from planning.exports.joint_tolerance import joint_tolerance
from planning.exports.options import ExportFormat, ExportOptions, Rule
from planning.exports.points import ExportPoints, export_points
from planning.exports.statement import comments, unproved_parts
from planning.limits import MotionLimits
from planning.proof.certificate import Certificate, certify

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
        motion: What the controller makes of the points by that rule; of a path the legs, from
            rest to rest.
        certificate: Of that motion; of a path its positions and collisions.
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


def export(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    options: ExportOptions,
    *,
    margin: float = 0.0,
    deadline: Deadline | None = None,
) -> Export:
    """Write a motion for a controller, and prove the motion that the controller makes of it.

    The proof looks at the points as the file has them, rounded where the format rounds, and at the
    interpolation between them: it does not rely on any proof of the given motion.

    Args:
        trajectory: Of all joints of the robot, in its order.
        robot: The arm with its geometry.
        scene: The obstacles.
        options: Format, points and program.
        margin: Distance to keep from obstacles beyond their own margins [m].
        deadline: When to give up the proof; ``certificate.violation`` then is of kind "time".

    Raises:
        InvalidOption: The robot or the number of points does not fit the format.
    """
    programs.check_axes(robot.chain, options.format)
    points = export_points(trajectory, options)
    motion = controller_motion(trajectory.joint_names, points)
    limits = _no_rates(robot.chain.n) if options.is_path else MotionLimits()
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
            lines = programs.servoj(points, options.name)
        case ExportFormat.URSCRIPT_MOVEJ:
            lines = programs.movej(robot.chain, points, options)
        case ExportFormat.RAPID:
            lines = programs.rapid(points, options, head)
            head = ()
        case ExportFormat.KRL:
            lines = programs.krl(points, options, head)
            head = ()
    return "\n".join([*head, *lines, ""])

"""Exports of motions for robot controllers."""

from typing import Literal, TypedDict

from armwright_client.base import Answer, NonNegative, Positive, Request
from armwright_client.certificate import Certificate, Premises
from armwright_client.check import AttachedObjects, FingerPositions
from armwright_client.scene import AllowedPairs, SceneReference
from armwright_client.trajectory import Trajectory

ExportFormat = Literal[
    "joint_trajectory_json",
    "joint_trajectory_yaml",
    "ros2_control",
    "csv",
    "urscript_servoj",
    "urscript_movej",
    "rapid",
    "krl",
]
PointInterpolation = Literal["quintic", "cubic", "linear"]


class ExportOptions(TypedDict, total=False):
    """Options of `export`: points, program, scene and attached objects.

    Args:
        scene: What it must not hit.
        frame: Of an inline scene that names none: a link that stands still, or "tool".
        sample_period: Time between points [s].
        interpolation: Of messages and tables.
        path_tolerance: Distance of the motion from the legs of a path at most [rad].
        blend: How far from a point the corner may be cut: [m] URScript, [mm] RAPID, [%] KRL.
        speed: Share of the axes' largest speeds, for paths.
        name: Of the program.
        frame_id: Of the header of a ROS message.
        attached: Objects that move with a link.
        allowed_collisions: More pairs that may touch.
        margin: Distance to be kept [m].
        fingers: Where joints of the gripper stand meanwhile [rad or m].
        premises: Those of the certificate that the motion has; other ones are refused.
        different_scene: Whether to export all the same, proved for what is given here.
        timeout: [s].
    """

    scene: SceneReference
    frame: str
    sample_period: float
    interpolation: PointInterpolation
    path_tolerance: float
    blend: float
    speed: float
    name: str
    frame_id: str
    attached: AttachedObjects
    allowed_collisions: AllowedPairs
    margin: float
    fingers: FingerPositions
    premises: Premises
    different_scene: bool
    timeout: float


class ExportRequest(Request):
    """A motion to be written for a controller; see `ExportOptions`."""

    robot: str
    trajectory: Trajectory
    format: ExportFormat
    scene: SceneReference | None = None
    frame: str | None = None
    sample_period: Positive | None = None
    interpolation: PointInterpolation | None = None
    path_tolerance: Positive | None = None
    blend: NonNegative | None = None
    speed: Positive | None = None
    name: str | None = None
    frame_id: str | None = None
    attached: AttachedObjects | None = None
    allowed_collisions: AllowedPairs | None = None
    margin: NonNegative | None = None
    fingers: FingerPositions | None = None
    premises: Premises | None = None
    different_scene: bool | None = None
    timeout: Positive | None = None


class Export(Answer):
    """A file for a controller, and what is proved of the motion that the controller makes of it.

    Args:
        format: Of the file.
        file_name: A name for it.
        content: Its text.
        point_count: Points in it.
        interpolation: The rule between the points that the proof is about.
        proved: Nothing collides where the controller keeps to the rule, which covers all of the
            file.
        unproved: Parts that the proof does not cover, as the file says.
        joint_deviation: Largest difference from the motion of the request, of each joint [rad or
            m]; None for a path.
        joint_tolerance: Nothing collides while every joint is off by less than this [rad or m].
        certificate: Of the controller's motion.
    """

    format: str
    file_name: str
    content: str
    point_count: int
    interpolation: str
    proved: bool
    unproved: list[str]
    joint_deviation: list[float] | None = None
    joint_tolerance: float | None = None
    certificate: Certificate

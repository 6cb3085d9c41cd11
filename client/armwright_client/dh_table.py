"""Denavit-Hartenberg tables, to upload and as the service answers them."""

from typing import Literal

from armwright_client.base import Answer, Matrix, Matrix3, NonNegative, Positive, Request, Vector3
from armwright_client.motor import Motor
from armwright_client.pose import Pose
from armwright_client.shape import Shape

JointType = Literal["revolute", "prismatic"]
Convention = Literal["standard", "modified"]


class LinkSolid(Request):
    """A shape that a link carries.

    Args:
        shape: The shape.
        pose: In the link's frame, which is frame i of row i; the frame itself if left out.
    """

    shape: Shape
    pose: Pose | None = None


class LinkCapsules(Request):
    """Capsules about the segments a and d of every row.

    Args:
        capsules: Their radius [m].
    """

    capsules: Positive


class DhRow(Request):
    """One joint of a Denavit-Hartenberg table, with what is known of the link behind it.

    For a revolute joint `theta` is the offset of the joint variable, for a prismatic one `d` is.
    Lengths and angles are in [m] and [rad], `inertia` is about the centre of mass in the link
    frame [kg m²]. `beta` turns about y, behind `alpha`; it is 0 but for nearly parallel axes.
    `continuous` joints have neither `lower` nor `upper`. `geometry` are the solids of the link
    behind the joint. `motor` is in place of `motor_inertia` and `viscous_friction`; every row has
    one, or none has.
    """

    type: JointType
    a: float
    alpha: float
    d: float
    theta: float
    lower: float | None = None
    upper: float | None = None
    velocity: Positive | None = None
    acceleration: Positive | None = None
    jerk: Positive | None = None
    effort: Positive | None = None
    mass: NonNegative | None = None
    center_of_mass: Vector3 | None = None
    inertia: Matrix3 | None = None
    motor_inertia: NonNegative | None = None
    viscous_friction: NonNegative | None = None
    coulomb_friction: NonNegative | None = None
    motor: Motor | None = None
    beta: float = 0.0
    continuous: bool = False
    geometry: list[LinkSolid] | None = None


class DhTable(Request):
    """A robot by its Denavit-Hartenberg parameters.

    Args:
        convention: How the rows are read.
        rows: One a joint, base to tip.
        base: Frame 0 in the root frame.
        tool: The tool in the last frame.
        gravity: In the root frame [m/s²].
        geometry: Capsules along all links, beside the solids of the rows.
    """

    convention: Convention
    rows: list[DhRow]
    base: Pose | None = None
    tool: Pose | None = None
    gravity: Vector3 | None = None
    geometry: LinkCapsules | None = None


class DhParameters(Answer):
    """One row of the table derived from the joint axes [m, rad].

    `beta` is about y, behind `alpha`; it is 0 but for nearly parallel axes.
    """

    type: JointType
    a: float
    alpha: float
    d: float
    theta: float
    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    acceleration: float | None = None
    jerk: float | None = None
    effort: float | None = None
    mass: float | None = None
    center_of_mass: list[float] | None = None
    inertia: Matrix | None = None
    motor_inertia: float | None = None
    viscous_friction: float | None = None
    coulomb_friction: float | None = None
    motor: Motor | None = None
    beta: float = 0.0
    continuous: bool = False
    geometry: list[LinkSolid] | None = None


class DerivedDh(Answer):
    """The Denavit-Hartenberg table of a robot: the tip's pose is base H_1 … H_n tool."""

    convention: Convention
    rows: list[DhParameters]
    base: Pose | None = None
    tool: Pose | None = None
    gravity: list[float] | None = None
    geometry: LinkCapsules | None = None

    def table(self) -> DhTable:
        """The table to be sent, say to store the robot under another name."""
        return DhTable.model_validate(self.model_dump(exclude_none=True))

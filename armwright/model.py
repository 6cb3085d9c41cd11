"""Kinematics and dynamics of a robot: frames, their inverse, Jacobians, equations of motion."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dynamics import inverse
from dynamics.equations.formula import Notation
from dynamics.equations.sheet import Sheet, write_page, write_sheet
from dynamics.equations.table import textbook_table
from dynamics.identification import identify as identification
from dynamics.identification.identify import Identification
from dynamics.identification.log import Log
from dynamics.identification.unknowns import DRIVES, Drive
from dynamics.terms import coriolis_matrix, gravity_vector, mass_matrix
from kinematics.arrays import Array, numbers, typed
from kinematics.calibration import calibrate as calibration
from kinematics.calibration.calibrate import Calibration, Measured, Unknown
from kinematics.forward import forward
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.ik.solution import IkResult
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.pose import from_quaternion, transform
from obstacles.robots.robot_geometry import RobotGeometry

Robot = RobotGeometry | Chain


class Dynamics(NamedTuple):
    """The terms of D(q) q_ddot + C(q, q_dot) q_dot + G(q) = tau at one state.

    Args:
        mass_matrix: D(q), shape (n, n) [kg m^2].
        coriolis_matrix: C(q, q_dot) of the Christoffel symbols, shape (n, n).
        gravity: G(q), shape (n,) [N m].
    """

    mass_matrix: Array
    coriolis_matrix: Array
    gravity: Array


@dataclass(frozen=True, slots=True, repr=False)
class Equations(Sheet):
    """All formulas of a robot; notebooks draw those in LaTeX."""

    def __repr__(self) -> str:
        return f"Equations({len(self.joints)} joints, {self.notation.value})"

    def __str__(self) -> str:
        return write_page(self)

    def _repr_latex_(self) -> str | None:
        return write_page(self) if self.notation is Notation.LATEX else None


def chain_of(robot: Robot) -> Chain:
    """The kinematic chain of a robot."""
    return robot if isinstance(robot, Chain) else robot.chain


@typed
def pose(position: ArrayLike, quaternion_xyzw: ArrayLike | None = None) -> Array:
    """The transform T_a_b of a position and an orientation, shape (4, 4).

    Args:
        position: Shape (3,) [m].
        quaternion_xyzw: Shape (4,), x, y, z, w; not turned where none is given.

    Raises:
        InvalidPose: The quaternion is not of unit length within 1e-3.
    """
    rotation = None if quaternion_xyzw is None else from_quaternion(quaternion_xyzw)
    return transform(rotation, numbers(position, "position", (3,)))


@typed
def fk(robot: Robot, joints: ArrayLike, link: str | None = None) -> Array:
    """Forward kinematics: T_base_link, shape (..., 4, 4).

    Args:
        robot: The robot or its chain.
        joints: Shape (..., n) [rad or m].
        link: The link; the tip where none is named.

    Raises:
        InvalidRobotState: ``joints`` has the wrong length or is not finite.
        InvalidLinkName: There is no such link.
    """
    return forward(chain_of(robot), joints, link)


@typed
def jacobian(robot: Robot, joints: ArrayLike, link: str | None = None) -> Array:
    """The geometric Jacobian J(q) of a link's origin, linear rows first, shape (..., 6, n).

    Args:
        robot: The robot or its chain.
        joints: Shape (..., n) [rad or m].
        link: The link; the tip where none is named.

    Raises:
        InvalidRobotState: ``joints`` has the wrong length or is not finite.
        InvalidLinkName: There is no such link.
    """
    return geometric(chain_of(robot), joints, link)


@typed
def dynamics(robot: Robot, joints: ArrayLike, velocities: ArrayLike | None = None) -> Dynamics:
    """Mass matrix, Coriolis matrix and gravity torques at a state.

    Args:
        robot: The robot or its chain.
        joints: q, shape (..., n) [rad or m].
        velocities: q_dot, shape (..., n) [rad/s or m/s]; at rest where none are given.

    Raises:
        MissingInertia: The robot has no inertias.
        InvalidRobotState: A vector has the wrong length or is not finite.
    """
    chain = chain_of(robot)
    q = numbers(joints, "joints")
    rates = np.zeros_like(q) if velocities is None else velocities
    return Dynamics(
        mass_matrix(chain, q),
        coriolis_matrix(chain, q, rates),
        gravity_vector(chain, q),
    )


@typed
def equations(
    robot: Robot, notation: Literal["latex", "text"] = "latex", axes: Sequence[str] = ()
) -> Equations:
    """Kinematics and dynamics of a robot as formulas.

    Args:
        robot: The robot or its chain.
        notation: LaTeX, or text that Python can evaluate.
        axes: Names of rows of the Jacobian, as many as joints, whose determinant is written.

    Raises:
        InvalidRobotDescription: The tip does not move with the last joint.
        InvalidOption: The formulas are too long to be read, or the axes are not as many as joints.
    """
    sheet = write_sheet(textbook_table(chain_of(robot)), Notation(notation), axes)
    return Equations(*(getattr(sheet, item.name) for item in fields(sheet)))


@typed
def inverse_dynamics(
    robot: Robot, joints: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike
) -> Array:
    """Joint torques tau of a motion, shape (..., n) [N m or N].

    Args:
        robot: The robot or its chain.
        joints: q, shape (..., n) [rad or m].
        velocities: q_dot, shape (..., n) [rad/s or m/s].
        accelerations: q_ddot, shape (..., n) [rad/s^2 or m/s^2].

    Raises:
        MissingInertia: The robot has no inertias.
        InvalidRobotState: A vector has the wrong length or is not finite.
    """
    return inverse.inverse_dynamics(chain_of(robot), joints, velocities, accelerations)


@typed
def calibrate(
    robot: Robot,
    joints: ArrayLike,
    measured: Measured,
    *,
    link: str | None = None,
    unknown: Sequence[Unknown] = (),
    tolerance: tuple[float, float] = (1e-3, 1e-3),
) -> Calibration:
    """Calibrate the frames of a robot's joints from measurements of a link.

    Args:
        robot: The robot or its chain as described.
        joints: Configurations, shape (m, n) [rad or m].
        measured: Poses, points, distances or a plane that were measured there.
        link: Link that is measured; the tip where none is named.
        unknown: "frame" where it is not known how the robot stands in the frame of measurement,
            "tip" where it is not known how the point measured is fixed to the link.
        tolerance: Standard deviations of the arm's making [m], [rad].

    Raises:
        InvalidLinkName: No such link.
        InvalidRobotState: Configurations have the wrong length or are not finite.
        InvalidOption: Measurements are malformed, of several kinds, or too few.
    """
    return calibration.calibrate(
        chain_of(robot), joints, measured, link=link, unknown=unknown, tolerance=tolerance
    )


@typed
def identify(
    robot: Robot,
    logs: Log | Sequence[Log],
    *,
    drives: Sequence[Drive] = tuple(DRIVES),
    cutoff: float | None = None,
) -> Identification:
    """Identify the bodies and drives of a robot from logs of motions and torques.

    Args:
        robot: The robot or its chain as it is believed to be; what logs do not determine stays
            near it.
        logs: One log or several.
        drives: Parameters of the drives to be found too; others are those of the robot.
        cutoff: Cutoff of the low-pass filter without delay [Hz]; where none is given 10 Hz, or no
            filter where velocities and accelerations are measured.

    Raises:
        InvalidOption: Logs are malformed, too short, or too few for the parameters.
        InvalidRobotState: Rows have the wrong length or are not finite.
    """
    return identification.identify(chain_of(robot), logs, drives=drives, cutoff=cutoff)


@typed
def identify_payload(
    robot: Robot,
    logs: Log | Sequence[Log],
    *,
    link: str | None = None,
    offsets: bool = False,
    cutoff: float | None = None,
) -> Identification:
    """Identify a load that a robot carries, all else being known.

    Args:
        robot: The robot or its chain, without the load.
        logs: One log or several; poses at rest determine mass and centre of mass.
        link: Link that carries the load; the tip where none is named.
        offsets: Constant torques of the sensors are to be found too.
        cutoff: Cutoff of the low-pass filter without delay [Hz].

    Raises:
        InvalidLinkName: No such link, or it stands still.
        InvalidOption: Logs are malformed, too short, or too few for the parameters.
        MissingInertia: The robot has no inertias.
    """
    return identification.identify_payload(
        chain_of(robot), logs, link=link, offsets=offsets, cutoff=cutoff
    )


@typed
def ik(
    robot: Robot,
    T_base_link: ArrayLike,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    **options: Any,
) -> IkResult:
    """Configurations that bring a link to a pose, best first.

    Args:
        robot: The robot or its chain.
        T_base_link: Pose of the link, shape (4, 4).
        link: The link to bring there; the tip where none is named.
        seed_joints: Configuration to search from and to measure "nearest" from, shape (n,) [rad or
            m]; the middle of the limits where not given.
        options: Fields of ``kinematics.ik.inverse.IkOptions``: ``method``, ``most``, ``ranking``,
            ...

    Raises:
        InvalidPose: The pose is not a finite rigid transform.
        InvalidOption: An option has an invalid value.
    """
    how = IkOptions(**options) if options else None
    return inverse_kinematics(chain_of(robot), T_base_link, how, link=link, seed_joints=seed_joints)

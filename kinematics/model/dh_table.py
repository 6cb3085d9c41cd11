"""Denavit-Hartenberg tables as values, and what makes one valid."""

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidPose, InvalidRobotDescription
from kinematics.model.chain import MAX_JOINTS
from kinematics.pose import from_matrix, transform
from kinematics.rounding import asymmetry, moment_rounding, tensor_rounding

Convention = Literal["standard", "modified"]
JointKind = Literal["revolute", "prismatic"]


@dataclass(frozen=True, slots=True, eq=False)
class DhRow:
    """One joint and the link behind it; None says "not given".

    Args:
        type: Kind of motion of the joint.
        a: Link length, along x [m].
        alpha: Link twist, about x [rad].
        d: Link offset, along z [m]; of a prismatic joint what is added to its position.
        theta: Joint angle, about z [rad]; of a revolute joint what is added to its position.
        lower: Lowest position [rad or m]; -inf or None for none.
        upper: Highest position [rad or m]; inf or None for none.
        velocity: Largest speed [rad/s or m/s].
        acceleration: Largest acceleration [rad/s^2 or m/s^2].
        jerk: Largest jerk [rad/s^3 or m/s^3].
        effort: Largest torque or force [N m or N].
        mass: Mass of the link [kg]; None where nothing is known of it.
        center_of_mass: Centre of mass in frame i, shape (3,) [m]; the origin where only the mass is
            given.
        inertia: Inertia about the centre of mass in the axes of frame i, shape (3, 3) [kg m^2];
            that of a point where only the mass is given.
        motor_inertia: Reflected at the joint [kg m^2 or kg].
        viscous_friction: Viscous friction at the joint [N m s/rad or N s/m].
        coulomb_friction: Dry friction at the joint [N m or N].
        beta: Angle about y, 0 but for nearly parallel axes [rad].
    """

    type: JointKind
    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    acceleration: float | None = None
    jerk: float | None = None
    effort: float | None = None
    mass: float | None = None
    center_of_mass: ArrayLike | None = None
    inertia: ArrayLike | None = None
    motor_inertia: float | None = None
    viscous_friction: float | None = None
    beta: float = 0.0
    coulomb_friction: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DhTable:
    """A robot as a table of rows.

    Args:
        convention: Convention by which the rows are read.
        rows: One a joint, base to tip.
        base: T_base_0, frame 0 in the robot's base frame, shape (4, 4).
        tool: T_n_tool, the tool in the last frame, shape (4, 4).
        gravity: Gravity in the base frame, shape (3,) [m/s^2].
    """

    convention: Convention
    rows: tuple[DhRow, ...]
    base: Array = field(default_factory=lambda: np.eye(4))
    tool: Array = field(default_factory=lambda: np.eye(4))
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))

    def __post_init__(self) -> None:
        object.__setattr__(self, "rows", tuple(self.rows))
        for name in ("base", "tool", "gravity"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def position_range(row: DhRow) -> tuple[float, float]:
    """Lowest and highest position of a row's joint [rad or m], infinite where it has no limit."""
    lower = -math.inf if row.lower is None else row.lower
    return lower, math.inf if row.upper is None else row.upper


def check_table(table: DhTable) -> None:
    """Check that a table can be built.

    Raises:
        InvalidRobotDescription: A number is missing, not finite or out of its range; the
            message names the row.
    """
    if table.convention not in ("standard", "modified"):
        raise InvalidRobotDescription(
            f"the DH convention {table.convention!r} is unknown",
            hint="One of: standard, modified.",
        )
    if not 1 <= len(table.rows) <= MAX_JOINTS:
        raise InvalidRobotDescription(
            f"a DH table has 1 to {MAX_JOINTS} rows, this one has {len(table.rows)}"
        )
    for name in ("base", "tool"):
        _check_pose(getattr(table, name), name)
    if table.gravity.shape != (3,) or not np.isfinite(table.gravity).all():
        raise InvalidRobotDescription("gravity of the DH table must be three finite numbers")
    for i, row in enumerate(table.rows, start=1):
        _check_row(row, f"row {i} of the DH table")


def rigid(table: DhTable) -> DhTable:
    """A checked table whose base and tool are rigid motions to the last bit."""
    base, tool = (transform(from_matrix(T[:3, :3]), T[:3, 3]) for T in (table.base, table.tool))
    return replace(table, base=base, tool=tool)


def _check_pose(T: Array, name: str) -> None:
    if T.shape != (4, 4) or not np.isfinite(T).all() or not np.array_equal(T[3], [0, 0, 0, 1]):
        raise InvalidRobotDescription(f"{name} of the DH table must be a finite 4 x 4 transform")
    try:
        from_matrix(T[:3, :3])
    except InvalidPose as error:
        raise InvalidRobotDescription(f"{name} of the DH table: {error.message}") from None


def _check_row(row: DhRow, where: str) -> None:
    if row.type not in ("revolute", "prismatic"):
        raise InvalidRobotDescription(
            f"{where} has the unknown type {row.type!r}", hint="One of: revolute, prismatic."
        )
    for name in ("a", "alpha", "d", "theta", "beta"):
        if not math.isfinite(getattr(row, name)):
            raise InvalidRobotDescription(f"{name} in {where} is not finite")
    lower, upper = position_range(row)
    if not (lower <= upper and lower < math.inf and upper > -math.inf):
        raise InvalidRobotDescription(
            f"{where} has the lower limit {lower:g} and the upper limit {upper:g}",
            hint="Give the lower limit first, or leave both out where the joint has none.",
        )
    for name in ("velocity", "acceleration", "jerk", "effort"):
        value = getattr(row, name)
        if value is not None and not value > 0.0:
            raise InvalidRobotDescription(f"{name} in {where} is {value:g}, it must be positive")
    for name in ("mass", "motor_inertia", "viscous_friction", "coulomb_friction"):
        value = getattr(row, name)
        if value is not None and not (math.isfinite(value) and value >= 0.0):
            raise InvalidRobotDescription(
                f"{name} in {where} is {value:g}, it must not be negative"
            )
    _check_inertia(row, where)


def _check_inertia(row: DhRow, where: str) -> None:
    for name, shape in (("center_of_mass", (3,)), ("inertia", (3, 3))):
        value = getattr(row, name)
        if value is None:
            continue
        if row.mass is None:
            raise InvalidRobotDescription(f"{where} has {name} but no mass", hint="Give the mass.")
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):  # rows of different lengths, words
            array = np.zeros(0)
        if array.shape != shape or not np.isfinite(array).all():
            raise InvalidRobotDescription(
                f"{name} in {where} must be {' x '.join(map(str, shape))} finite numbers"
            )
    if row.inertia is None:
        return
    tensor = np.asarray(row.inertia, dtype=np.float64)
    if asymmetry(tensor.tolist()) > tensor_rounding(tensor.tolist()):
        raise InvalidRobotDescription(f"inertia in {where} is not symmetric")
    if float(np.linalg.eigvalsh(0.5 * (tensor + tensor.T))[0]) < -moment_rounding(tensor.tolist()):
        raise InvalidRobotDescription(f"inertia in {where} is not positive semi-definite")

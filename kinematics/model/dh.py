"""Denavit-Hartenberg tables: to a chain, and back from the axes of any chain.

Standard rows (frame i sits on axis i+1, course notes lectures 7 to 9):

    H_i = Rz(theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i) Ry(beta_i)

Modified rows ("Introduction to Robotics", 1986, chapter 3; frame i sits on axis i):

    H_i = Tx(a_i) Rx(alpha_i) Ry(beta_i) Rz(theta_i) Tz(d_i)

The joint variable adds to theta_i (revolute) or d_i (prismatic), and the tool's pose is
base H_1 ... H_n tool. beta is 0 in every classical table. Between axes that are parallel but for
rounding, the common normal lies millions of metres away and four numbers can't say where; the
fifth, from "Improving the absolute positioning accuracy of robot manipulators" (1985), can.

Denavit-Hartenberg tables as values, and what makes one valid.
"""

import math
from dataclasses import dataclass, field, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidPose, InvalidRobotDescription
from kinematics.model.chain import MAX_JOINTS, Chain, Inertia, JointType, Limits, Link
from kinematics.pose import from_matrix, inverse, rotation_x, rotation_y, rotation_z, transform
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


__all__ = ["Convention", "DhRow", "DhTable", "chain_from_dh", "dh_from_chain", "frame_origins"]

#: Axes at a smaller angle [rad] are called parallel and get a beta. At an angle e, axes a length L
#: apart have d of about L/e, and a table holds it to 2e-16 L/e: below 1e-7 that would be worse
#: than 1e-9 m. A reader who ignores beta errs by no more than 1e-7 rad here.
PARALLEL_ANGLE = 1e-7
#: Lengths [m] and angles [rad] below this are the rounding of products of rotations.
ROUNDING = 1e-14

_BASE = "base"
_TOOL = "tool"


# ----------------------------------------------------------------------------- table to chain


def chain_from_dh(name: str, table: DhTable) -> Chain:
    """Build the chain that a table describes.

    Its joints are called joint_1 ... joint_n, its links base, link_1 ... link_n (frame i of the
    table) and tool.

    Args:
        name: The robot's name.
        table: The table.

    Raises:
        InvalidRobotDescription: A number is missing, not finite or out of its range; the
            message names the row.
    """
    check_table(table)
    table, n = rigid(table), len(table.rows)
    offsets, frames = _joint_frames(table)
    numbers = range(1, n + 1)
    links = [Link(_BASE, -1, np.eye(4))]
    links += [
        Link(f"link_{i}", i - 1, frames[i - 1], _row_inertia(table.rows[i - 1])) for i in numbers
    ]
    links.append(Link(_TOOL, n - 1, frames[-1] @ table.tool))
    limits = {
        item.name: np.array([_or_nan(getattr(row, item.name)) for row in table.rows])
        for item in fields(Limits)
    }
    ranges = np.array([position_range(row) for row in table.rows])
    limits["lower"], limits["upper"] = ranges[:, 0], ranges[:, 1]
    revolute = np.array([row.type == "revolute" for row in table.rows])
    endless = np.isinf(limits["lower"]) & np.isinf(limits["upper"])
    return Chain(
        name=name,
        joint_names=tuple(f"joint_{i}" for i in numbers),
        joint_types=np.where(revolute, JointType.REVOLUTE, JointType.PRISMATIC),
        offsets=np.array(offsets),
        links=tuple(links),
        base_link=_BASE,
        tip_link=_TOOL,
        limits=Limits(**limits),
        continuous=revolute & endless,
        gravity=table.gravity,
        motor_inertia=np.array([row.motor_inertia or 0.0 for row in table.rows]),
        viscous_friction=np.array([row.viscous_friction or 0.0 for row in table.rows]),
        coulomb_friction=np.array([row.coulomb_friction or 0.0 for row in table.rows]),
        dh_convention=table.convention,
    )


def _joint_frames(table: DhTable) -> tuple[list[Array], list[Array]]:
    """Offsets of the joints, and frame i of the table in the frame of joint i.

    A joint's frame may lie anywhere along its axis: it is put where the axis comes nearest to
    the joint before. So the chain stays at the size of the robot even where the table's own
    frames lie far away, as they do between nearly parallel axes.
    """
    offsets: list[Array] = []
    frames: list[Array] = []
    T_joint_frame = table.base
    for row in table.rows:
        z_part = rotation_z(row.theta)
        if table.convention == "standard":
            before, after = transform(z_part), _along_z(row.d) @ _x_part(row)
        else:
            before, after = _x_part(row) @ transform(z_part, [0.0, 0.0, row.d]), np.eye(4)
        offset = T_joint_frame @ before
        shift = -float(offset[:3, 3] @ offset[:3, 2])
        offsets.append(offset @ _along_z(shift))
        T_joint_frame = _along_z(-shift) @ after
        frames.append(T_joint_frame)
    return offsets, frames


def _along_z(length: float) -> Array:
    return transform(position=[0.0, 0.0, length])


def _x_part(row: DhRow) -> Array:
    return transform(rotation_x(row.alpha) @ rotation_y(row.beta), [row.a, 0.0, 0.0])


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _row_inertia(row: DhRow) -> Inertia | None:
    if row.mass is None:
        return None
    center = np.zeros(3) if row.center_of_mass is None else np.asarray(row.center_of_mass)
    tensor = np.zeros((3, 3)) if row.inertia is None else np.asarray(row.inertia, dtype=np.float64)
    return Inertia(float(row.mass), center, (tensor + tensor.T) / 2.0)


# ----------------------------------------------------------------------------- chain to table


@dataclass(frozen=True, slots=True)
class _Between:
    """Transform between two axes: A = Rz(theta) Tz(d) X Rz(theta_after) Tz(d_after)."""

    theta: float = 0.0
    d: float = 0.0
    a: float = 0.0
    alpha: float = 0.0
    beta: float = 0.0
    theta_after: float = 0.0
    d_after: float = 0.0

    @property
    def z_part(self) -> Array:
        return transform(rotation_z(self.theta), [0.0, 0.0, self.d])

    @property
    def x_part(self) -> Array:
        R = rotation_x(self.alpha) @ rotation_y(self.beta)
        return transform(R, [self.a, 0.0, 0.0])


def dh_from_chain(chain: Chain, convention: Convention = "standard") -> DhTable:
    """Derive the table of a chain from its axes.

    The three cases of the course notes (lecture 7): skew axes have one common normal, on which
    x lies; intersecting axes have x normal to their plane; parallel ones have x through the
    point the chain itself names. What this leaves open goes into base and tool, so the tool's
    pose is that of the chain's tip for every configuration: to rounding, which is 1e-12 m unless
    some |d| passes a kilometre (then 1e-15 |d|).

    Args:
        chain: The robot.
        convention: Convention by which the rows are to be read.

    Returns:
        The table; masses of all links that move with a joint are put together in its row.

    Raises:
        InvalidRobotDescription: The tip does not move with the last joint.
    """
    if chain.tip.joint != chain.n - 1:
        raise InvalidRobotDescription(
            f"tip_link {chain.tip_link!r} does not move with the last joint, so no table ends there"
        )
    base, first = _before_first(chain.offsets[0])
    tip = chain.tip.T_joint_link
    last, tool = _behind_last(tip) if convention == "standard" else (_Between(), tip)
    between = [first, *(_split_fixed_transform(A) for A in chain.offsets[1:]), last]
    rows = (_row(chain, i, between[i], between[i + 1], convention) for i in range(chain.n))
    return DhTable(convention, tuple(rows), base, tool, chain.gravity)


def frame_origins(chain: Chain) -> Array:
    """Origins O_1 ... O_n of the course notes (lecture 18), each in its joint's frame, (n, 3) [m].

    O_i is the origin of frame i of the Denavit-Hartenberg table: it lies on axis i + 1 and joint i
    moves it; O_n is the origin of the tip. A chain that was built from a table has the frames of
    that table; of a modified one, whose frame i + 1 lies on axis i + 1, O_i is the origin of frame
    i + 1 where q_{i+1} = 0. Other chains have those of ``dh_from_chain``. Between nearly parallel
    axes that origin may lie far outside the arm: farther away than all links together are long,
    the place of joint i + 1 stands for it.

    Args:
        chain: The robot.
    """
    following = chain.offsets[1:]
    if chain.dh_convention == "standard":
        origins = [chain.link(f"link_{i}").T_joint_link[:3, 3] for i in range(1, chain.n)]
    elif chain.dh_convention == "modified":
        frames = (chain.link(f"link_{i + 1}").T_joint_link for i in range(1, chain.n))
        origins = [(A @ T)[:3, 3] for A, T in zip(following, frames, strict=True)]
    else:
        tip = float(np.linalg.norm(chain.tip.T_joint_link[:3, 3]))
        length = float(np.linalg.norm(chain.offsets[:, :3, 3], axis=1).sum()) + tip
        origins = []
        for A in following:
            between = _split_fixed_transform(A)
            origin = (between.z_part @ between.x_part)[:3, 3]
            origins.append(origin if float(np.linalg.norm(origin)) <= length else A[:3, 3])
    return np.array([*origins, chain.tip.T_joint_link[:3, 3]])


def _row(chain: Chain, i: int, before: _Between, after: _Between, kind: Convention) -> DhRow:
    x = after if kind == "standard" else before
    T_joint_frame = after.z_part @ after.x_part if kind == "standard" else after.z_part
    mass, center, tensor = _mass_properties(chain, i, T_joint_frame)
    limits = chain.limits
    return DhRow(
        type="revolute" if chain.joint_types[i] == JointType.REVOLUTE else "prismatic",
        a=_tidy(x.a),
        alpha=_tidy(x.alpha),
        d=_tidy(before.d_after + after.d),
        theta=_tidy(math.remainder(before.theta_after + after.theta, 2.0 * math.pi)),
        lower=_or_none(limits.lower[i]),
        upper=_or_none(limits.upper[i]),
        velocity=_or_none(limits.velocity[i]),
        acceleration=_or_none(limits.acceleration[i]),
        jerk=_or_none(limits.jerk[i]),
        effort=_or_none(limits.effort[i]),
        mass=mass,
        center_of_mass=center,
        inertia=tensor,
        motor_inertia=float(chain.motor_inertia[i]),
        viscous_friction=float(chain.viscous_friction[i]),
        coulomb_friction=float(chain.coulomb_friction[i]),
        beta=_tidy(x.beta),
    )


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def _tidy(value: float) -> float:
    return 0.0 if abs(value) < ROUNDING / 10.0 else value


def _before_first(A: Array) -> tuple[Array, _Between]:
    """The base frame, used as frame 0 where the first axis is its z axis (the usual case)."""
    if max(np.hypot(A[0, 2], A[1, 2]), np.hypot(A[0, 3], A[1, 3])) < ROUNDING and A[2, 2] > 0.0:
        theta = math.atan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1])
        return np.eye(4), _Between(theta_after=theta, d_after=float(A[2, 3]))
    return A, _Between()


def _behind_last(T: Array) -> tuple[_Between, Array]:
    """The last frame, whose z stays along the last axis, level with the tip; and the tool."""
    theta = 0.0
    if np.hypot(T[0, 2], T[1, 2]) < ROUNDING and T[2, 2] > 0.0:
        theta = math.atan2(T[1, 0] - T[0, 1], T[0, 0] + T[1, 1])
    last = _Between(theta=theta, d=float(T[2, 3]))
    tool = inverse(last.z_part) @ T
    if np.abs(tool - np.eye(4)).max() < ROUNDING:
        tool = np.eye(4)
    return last, tool


def _split_fixed_transform(A: Array) -> _Between:
    """Split the fixed transform between two axes by the three cases."""
    w, p = A[:3, 2], A[:3, 3]
    if math.hypot(w[0], w[1]) < PARALLEL_ANGLE:
        return _parallel(A)
    # x' along the common normal of z and w, towards the next axis; where the axes meet, the
    # direction that turns x least.
    x = np.array([-w[1], w[0]]) / math.hypot(w[0], w[1])
    a = float(x @ p[:2])
    if a < -ROUNDING or (abs(a) <= ROUNDING and x[0] < 0.0):
        x, a = -x, -a
    y = np.array([-x[1], x[0]])
    d_after = float(y @ p[:2]) / float(y @ w[:2])
    theta = math.atan2(x[1], x[0])
    M = rotation_z(theta).T @ A[:3, :3]
    alpha = math.atan2(-M[1, 2], M[2, 2])
    M = rotation_x(alpha).T @ M
    # From the well-conditioned entries of what is left, so that the angles' sum stays exact.
    theta_after = math.atan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1])
    d = float(p[2] - d_after * w[2])
    return _Between(theta, d, a if a > ROUNDING else 0.0, alpha, 0.0, theta_after, d_after)


def _parallel(A: Array) -> _Between:
    """Let x' pass through the next joint's origin; what misses being parallel is beta."""
    p = A[:3, 3]
    a = math.hypot(p[0], p[1])
    theta = 0.0
    if a > ROUNDING:
        theta = math.atan2(p[1], p[0])
    else:
        a = 0.0
    M = rotation_z(theta).T @ A[:3, :3]
    alpha = math.atan2(-M[1, 2], M[2, 2])
    if abs(M[1, 2]) < ROUNDING:
        alpha = 0.0 if M[2, 2] > 0.0 else math.pi
    beta = math.atan2(M[0, 2], math.hypot(M[1, 2], M[2, 2])) if abs(M[0, 2]) >= ROUNDING else 0.0
    M = (rotation_x(alpha) @ rotation_y(beta)).T @ M
    theta_after = math.atan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1])
    if a == 0.0 and alpha == 0.0 and beta == 0.0:
        theta, theta_after = theta_after, 0.0
    return _Between(theta, float(p[2]), a, alpha, beta, theta_after, 0.0)


def _mass_properties(
    chain: Chain, i: int, T_joint_frame: Array
) -> tuple[float | None, Array | None, Array | None]:
    """Mass properties of everything that joint ``i`` carries, in the table's frame."""
    T_frame_joint = inverse(T_joint_frame)
    bodies = [
        (link.inertia, T_frame_joint @ link.T_joint_link)
        for link in chain.links
        if link.joint == i and link.inertia is not None
    ]
    if not bodies:
        return None, None, None
    whole = Inertia.merged(bodies)
    return whole.mass, whole.center_of_mass, whole.tensor

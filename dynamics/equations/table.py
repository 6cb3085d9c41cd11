"""A Denavit-Hartenberg table with symbols for its numbers, and the numbers of those symbols."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics.equations.polynomial import Polynomial, Polynomials, Variables, constant, matrix
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.model.dh import DhRow, DhTable, dh_from_chain

#: Lengths [m], angles [rad] and entries of rotations below this are rounding of products.
ROUNDING = 1e-10
#: An inertia below this part of the largest of its tensor is rounding.
INERTIA_ROUNDING = 1e-12
#: Row and column of the six entries of a symmetric tensor.
TENSOR_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
AXES = "xyz"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of a table that formulas call by a symbol.

    Args:
        symbol: Name of the parameter, as ``l_c2``.
        value: [unit].
        unit: Unit of the parameter, as ``kg m^2``.
        meaning: Meaning of the parameter in words.
    """

    symbol: str
    value: float
    unit: str
    meaning: str


def textbook_table(chain: Chain) -> DhTable:
    """The table of a chain, with the tool at the end of the last link as far as a row can say that.

    Args:
        chain: The robot.

    Raises:
        InvalidRobotDescription: The tip does not move with the last joint.
    """
    table = dh_from_chain(chain)
    row, (x, y, _) = table.rows[-1], table.tool[:3, 3]
    if x == 0.0 or not (is_zero(float(y)) and is_zero(row.alpha) and is_zero(row.beta)):
        return table
    # Rz(theta) Tz(d) Tx(a) Tx(x) tool': frame n moves along its x axis to the tool.
    tool = table.tool.copy()
    tool[0, 3] = 0.0
    center = None if row.mass is None else center_of_mass(row) - np.array([x, 0.0, 0.0])
    last = replace(row, a=row.a + float(x), center_of_mass=center)
    return replace(table, rows=(*table.rows[:-1], last), tool=tool)


def table_parameters(table: DhTable) -> Iterator[Parameter]:
    """The parameters of a table, its lengths and angles first."""
    for i, row in enumerate(table.rows, start=1):
        yield from _row_geometry(row, i, is_planar(table))
    for letter, T, what in (("b", table.base, "frame 0"), ("t", table.tool, "the tool in frame n")):
        yield from _frame_parameters(letter, T, what)
    for i, row in enumerate(table.rows, start=1):
        yield from _row_body(table, row, i)
    for i, row in enumerate(table.rows, start=1):
        yield from _row_drive(row, i)
    yield from _gravity_parameters(table)


def _row_geometry(row: DhRow, i: int, planar: bool) -> Iterator[Parameter]:
    if not is_zero(row.a):
        name = f"l_{i}" if planar else f"a_{i}"
        yield Parameter(name, row.a, "m", f"length of link {i}")
    if not is_zero(row.d):
        what = "added to the position of joint" if row.type == "prismatic" else "offset of link"
        yield Parameter(f"d_{i}", row.d, "m", f"{what} {i}")
    for name, angle in (("theta", row.theta), ("alpha", row.alpha), ("beta", row.beta)):
        if quarter_turns(angle) is None:
            yield Parameter(f"{name}_{i}", angle, "rad", f"{name} of row {i}")


def _frame_parameters(letter: str, T: Array, what: str) -> Iterator[Parameter]:
    for row in range(3):
        for column in range(4):
            number = float(T[row, column])
            if not is_zero(number) and (column == 3 or exact_value(number) not in (-1.0, 1.0)):
                name = f"{letter}_{row + 1}{column + 1}"
                unit = "m" if column == 3 else "1"
                yield Parameter(name, number, unit, f"entry of the transformation of {what}")


def _row_body(table: DhTable, row: DhRow, i: int) -> Iterator[Parameter]:
    if row.mass is None:
        return
    if row.mass:
        yield Parameter(f"m_{i}", row.mass, "kg", f"mass of link {i}")
        yield from _center_parameters(table, row, i)
    if row.inertia is not None:
        for symbol, (j, k) in inertia_symbols(table, row, i).items():
            number = float(np.asarray(row.inertia)[j, k])
            meaning = f"inertia {AXES[j]}{AXES[k]} of link {i} about its centre of mass"
            yield Parameter(symbol, number, "kg m^2", meaning)


def inertia_symbols(table: DhTable, row: DhRow, i: int) -> dict[str, tuple[int, int]]:
    """Symbols of the entries of an inertia tensor that are not 0, with their row and column.

    Args:
        table: The robot; a planar one has one entry that counts.
        row: The link's row.
        i: Number of the body, from 1.
    """
    if row.inertia is None:
        return {}
    tensor = np.asarray(row.inertia, dtype=np.float64)
    cut = INERTIA_ROUNDING * float(np.abs(tensor).max())
    planar = is_planar(table)
    return {
        f"I_{i}" if planar else f"I_{AXES[j]}{AXES[k]}{i}": (j, k)
        for j, k in TENSOR_ENTRIES
        if abs(tensor[j, k]) > cut and (not planar or j == k == 2)
    }


def _row_drive(row: DhRow, i: int) -> Iterator[Parameter]:
    turns = row.type == "revolute"
    if row.motor_inertia:
        unit = "kg m^2" if turns else "kg"
        yield Parameter(f"J_{i}", row.motor_inertia, unit, f"motor inertia at joint {i}")
    if row.viscous_friction:
        unit = "N m s/rad" if turns else "N s/m"
        yield Parameter(f"B_{i}", row.viscous_friction, unit, f"viscous friction at joint {i}")
    if row.coulomb_friction:
        unit = "N m" if turns else "N"
        yield Parameter(f"F_{i}", row.coulomb_friction, unit, f"dry friction at joint {i}")


def _center_parameters(table: DhTable, row: DhRow, i: int) -> Iterator[Parameter]:
    center = center_of_mass(row)
    along = center_along_link(table, row)
    if along is not None:
        if not is_zero(along):
            yield Parameter(
                f"l_c{i}", along, "m", f"from axis {i} to the centre of mass of link {i}"
            )
        return
    for axis, number in zip(AXES, center, strict=True):
        if not is_zero(number):
            meaning = f"{axis} of the centre of mass of link {i} in its frame"
            yield Parameter(f"{axis}_c{i}", float(number), "m", meaning)


def center_of_mass(row: DhRow) -> Array:
    """Centre of mass in the row's frame, (3,) [m]."""
    return np.zeros(3) if row.center_of_mass is None else np.asarray(row.center_of_mass)


def center_along_link(table: DhTable, row: DhRow) -> float | None:
    """Distance of a centre of mass from the axis before it, if it lies on the link's x axis [m]."""
    center = center_of_mass(row)
    if not (is_zero(center[1]) and is_zero(center[2])):
        return None
    return float(center[0]) + (row.a if table.convention == "standard" else 0.0)


def _gravity_parameters(table: DhTable) -> Iterator[Parameter]:
    gravity = gravity_in_frame_0(table)
    used = np.flatnonzero(gravity)
    if len(used) == 1:
        size = float(np.abs(gravity).max())
        yield Parameter("g", size, "m/s^2", "gravitational acceleration")
        return
    for k in used:
        meaning = f"gravitational acceleration along {AXES[k]} of frame 0"
        yield Parameter(f"g_{AXES[k]}", float(gravity[k]), "m/s^2", meaning)


def gravity_in_frame_0(table: DhTable) -> Array:
    """Gravity in frame 0 of the table, (3,) [m/s^2], rounding taken off."""
    gravity = table.base[:3, :3].T @ table.gravity
    return np.where(np.abs(gravity) <= ROUNDING * np.linalg.norm(gravity), 0.0, gravity)


def is_planar(table: DhTable) -> bool:
    """Whether all links of a standard table turn in one plane, each along its own x axis."""
    return table.convention == "standard" and all(
        row.type == "revolute" and is_zero(row.alpha) and is_zero(row.beta) and is_zero(row.d)
        for row in table.rows
    )


def is_zero(number: float) -> bool:
    """Whether a length [m] or an angle [rad] is 0 but for rounding."""
    return abs(number) <= ROUNDING


def exact_value(number: float) -> float:
    """0, 1 or -1 for a number that is so but for rounding."""
    return float(round(number)) if abs(number - round(number)) <= ROUNDING else number


def quarter_turns(angle: float) -> int | None:
    """Number of quarter turns that an angle is, if it is a whole one."""
    turns = angle / (0.5 * math.pi)
    return round(turns) % 4 if abs(turns - round(turns)) * 0.5 * math.pi <= ROUNDING else None


@dataclass(frozen=True, slots=True, eq=False)
class SymbolicBody:
    """The body that moves with a joint.

    Args:
        mass: [kg].
        center: Centre of mass in the row's frame, shape (3,) [m].
        tensor: Inertia about the centre of mass in the axes of that frame, shape (3, 3) [kg m^2].
    """

    mass: Polynomial
    center: Polynomials
    tensor: Polynomials


@dataclass(frozen=True, slots=True, eq=False)
class SymbolicTable:
    """A table in symbols (n joints).

    Args:
        table: The numbers.
        variables: All symbols and angles.
        parameters: Symbols of the table's numbers, with their values.
        joints: Symbols q_1 ... q_n.
        groups: Number of each joint's group: the axes of a group are parallel whatever
            the joints do, so that their angles add.
        steps: H_i of frame i in frame i-1, each 4 x 4.
        base: Frame 0 in the base frame, 4 x 4.
        tool: The tool in frame n, 4 x 4.
        bodies: Body of each joint; None where the table has no mass for it.
        gravity: Gravity in frame 0, shape (3,) [m/s^2].
    """

    table: DhTable
    variables: Variables
    parameters: tuple[Parameter, ...]
    joints: tuple[str, ...]
    groups: tuple[int, ...]
    steps: tuple[Polynomials, ...]
    base: Polynomials
    tool: Polynomials
    bodies: tuple[SymbolicBody | None, ...]
    gravity: Polynomials

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def frames(self) -> list[Polynomials]:
        """Frames 0 ... n of the table in frame 0, each 4 x 4."""
        frames = [matrix(np.eye(4))]
        for step in self.steps:
            frames.append(frames[-1] @ step)
        return frames


def symbolic_table(table: DhTable) -> SymbolicTable:
    """A table in symbols.

    Args:
        table: The table; what it says of limits is not used.
    """
    parameters = tuple(table_parameters(table))
    joints = tuple(f"q_{i}" for i in range(1, len(table.rows) + 1))
    rates = [f"{name}_{i}" for name in ("qd", "qdd", "f") for i in range(1, len(joints) + 1)]
    turning = [q for q, row in zip(joints, table.rows, strict=True) if row.type == "revolute"]
    constant_angles = [p.symbol for p in parameters if p.unit == "rad"]
    names = (*joints, *rates, *(p.symbol for p in parameters))
    variables = Variables(names, frozenset([*turning, *constant_angles]))
    known = {p.symbol for p in parameters}

    def value(name: str, number: float) -> Polynomial:
        return variables.symbol(name) if name in known else constant(exact_value(number))

    return SymbolicTable(
        table,
        variables,
        parameters,
        joints,
        _groups(table),
        tuple(_step(table, i, variables, known) for i in range(len(joints))),
        _transform("b", table.base, value),
        _transform("t", table.tool, value),
        tuple(_body(table, i, value) for i in range(len(joints))),
        _symbolic_gravity(table, value),
    )


# ------------------------------------------------------------------------------ in symbols


def _groups(table: DhTable) -> tuple[int, ...]:
    groups, group = [], 0
    for i, row in enumerate(table.rows):
        between = row if table.convention == "modified" else table.rows[i - 1]
        parallel = quarter_turns(between.alpha) in (0, 2) and is_zero(between.beta)
        if i > 0 and not parallel:
            group += 1
        groups.append(group)
    return tuple(groups)


def _step(table: DhTable, i: int, variables: Variables, known: set[str]) -> Polynomials:
    row, number = table.rows[i], i + 1

    def turn(name: str, angle: float) -> tuple[Polynomial, Polynomial]:
        if f"{name}_{number}" in known:
            return variables.rotation(f"{name}_{number}")
        c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarter_turns(angle) or 0]
        return constant(c), constant(s)

    def length(name: str) -> Polynomial:
        full = f"{name}_{number}"
        return variables.symbol(full) if full in known else constant(0.0)

    q = f"q_{number}"
    d = length("d")
    if row.type == "prismatic":
        d = d + variables.symbol(q)
        c, s = turn("theta", row.theta)
    else:
        c, s = _joint_rotation(variables, q, row.theta, f"theta_{number}" in known)
    about_z = matrix([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
    ca, sa = turn("alpha", row.alpha)
    cb, sb = turn("beta", row.beta)
    along_x = matrix(
        [[1, 0, 0, length("a") + length("l")], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]]
    )
    about_y = matrix([[cb, 0, sb, 0], [0, 1, 0, 0], [-sb, 0, cb, 0], [0, 0, 0, 1]])
    x_part = along_x @ about_y
    step: Polynomials = about_z @ x_part if table.convention == "standard" else x_part @ about_z
    return step


def _joint_rotation(
    variables: Variables, q: str, theta: float, is_symbol: bool
) -> tuple[Polynomial, Polynomial]:
    """Cosine and sine of the angle q + theta of a revolute joint."""
    if not is_symbol:
        return variables.rotation(q, quarter_turns(theta) or 0)
    c, s = variables.rotation(q)
    c_0, s_0 = variables.rotation(f"theta_{q.removeprefix('q_')}")
    return c * c_0 - s * s_0, s * c_0 + c * s_0


_Value = Callable[[str, float], Polynomial]


def _transform(letter: str, T: Array, value: _Value) -> Polynomials:
    rows = [[value(f"{letter}_{i + 1}{j + 1}", float(T[i, j])) for j in range(4)] for i in range(3)]
    return matrix([*rows, [0, 0, 0, 1]])


def _body(table: DhTable, i: int, value: _Value) -> SymbolicBody | None:
    row, number = table.rows[i], i + 1
    if row.mass is None:
        return None
    return SymbolicBody(
        value(f"m_{number}", row.mass),
        _symbolic_center(table, row, number, value),
        _symbolic_tensor(table, row, number, value),
    )


def _symbolic_center(table: DhTable, row: DhRow, i: int, value: _Value) -> Polynomials:
    along = center_along_link(table, row)
    if along is None:
        center: Sequence[Polynomial | float] = [
            value(f"{axis}_c{i}", float(number))
            for axis, number in zip(AXES, center_of_mass(row), strict=True)
        ]
    else:
        length = "l" if is_planar(table) else "a"
        before = value(f"{length}_{i}", row.a) if table.convention == "standard" else constant(0.0)
        center = [value(f"l_c{i}", along) - before, 0.0, 0.0]
    return matrix([[item] for item in center])[:, 0]


def _symbolic_tensor(table: DhTable, row: DhRow, i: int, value: _Value) -> Polynomials:
    entries = dict.fromkeys(TENSOR_ENTRIES, constant(0.0))
    for symbol, (j, k) in inertia_symbols(table, row, i).items():
        entries[j, k] = value(symbol, float(np.asarray(row.inertia)[j, k]))
    return matrix([[entries[min(j, k), max(j, k)] for k in range(3)] for j in range(3)])


def _symbolic_gravity(table: DhTable, value: _Value) -> Polynomials:
    gravity = gravity_in_frame_0(table)
    used = np.flatnonzero(gravity)
    entries = [constant(0.0)] * 3
    for k in used:
        number = float(gravity[k])
        if len(used) == 1:
            entries[k] = value("g", abs(number)) * math.copysign(1.0, number)
        else:
            entries[k] = value(f"g_{AXES[k]}", number)
    column: Polynomials = matrix([entries])[0]
    return column

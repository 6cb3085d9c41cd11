"""A Denavit-Hartenberg table with symbols for its numbers."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynamics.equations.parameters import (
    AXES,
    TENSOR_ENTRIES,
    Parameter,
    center_along_link,
    center_of_mass,
    exact_value,
    gravity_in_frame_0,
    inertia_symbols,
    is_planar,
    is_zero,
    quarter_turns,
    table_parameters,
)
from dynamics.equations.polynomial import Polynomial, Polynomials, Variables, constant, matrix
from kinematics.arrays import Array
from kinematics.model.dh_table import DhRow, DhTable


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

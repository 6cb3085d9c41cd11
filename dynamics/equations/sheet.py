"""All formulas of a robot, written in one notation.

The equations of motion as Y(q, q_dot, q_ddot) Theta with the fewest parameters, in symbols.

Theta holds combinations of masses, lengths and inertias, as m_2 l_1 l_c2; Y holds what is known of
a state. The products of angles, velocities and accelerations in tau are linearly independent
functions, so each of them has one polynomial in the parameters before it; Theta is a basis of
these polynomials.

A sheet of formulas as one page of LaTeX or plain text.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from dynamics.equations.formula import (
    Angle,
    Collect,
    Notation,
    Powers,
    Product,
    Sum,
    Writer,
    factored,
    formula,
    numeric_value,
    real_terms,
    sum_of_terms,
)
from dynamics.equations.motion import (
    MAX_ENTRY_TERMS,
    MAX_JOINTS,
    SymbolicMotion,
    equations_of_motion,
    tool_frame,
    tool_jacobian,
)
from dynamics.equations.polynomial import Polynomial, Polynomials, TooManyTerms, determinant
from dynamics.equations.table import Parameter, SymbolicTable, symbolic_table
from dynamics.model.body import SMOOTH_SPEED
from kinematics.errors import InvalidOption
from kinematics.model.dh import DhTable

#: Arms with more joints get no Christoffel symbols and no regressor: those fill hundreds of pages.
MAX_REGRESSOR_JOINTS = 4
#: Arms with more joints get no determinant.
MAX_DETERMINANT_JOINTS = 4
#: Names of the rows of the Jacobian.
AXES = ("x", "y", "z", "rx", "ry", "rz")
#: How the symbols of motor inertias and frictions begin.
_DRIVES = ("J_", "B_", "F_")
_NO_MASSES = "the equations of motion are left out: no link has a mass"
_TOO_LONG = (
    f"the equations of motion are left out: beyond {MAX_JOINTS} joints, or {MAX_ENTRY_TERMS} terms "
    "of an entry of D, nobody reads them; the dynamics endpoint answers their values"
)
_NO_REGRESSOR = (
    f"Christoffel symbols and regressor are left out beyond {MAX_REGRESSOR_JOINTS} joints; the "
    "dynamics and regressor endpoints answer their values"
)
_NO_DETERMINANT = (
    f"the determinant is left out: beyond {MAX_DETERMINANT_JOINTS} joints, or thousands of terms, "
    "nobody reads it; the jacobian endpoint answers values"
)

Matrix = tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Regressor:
    """tau = Y Theta.

    Args:
        regressor: Y, n x p.
        parameters: Theta, p.
        values: Values of the parameters, p.
    """

    regressor: Matrix
    parameters: tuple[str, ...]
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Motion:
    """The terms of the equations of motion.

    Args:
        equation: The terms that there are.
        mass_matrix: D, n x n.
        christoffel_symbols: i, j, k from 1 and c_ijk where it is not 0; None for long arms.
        coriolis_matrix: C, n x n.
        potential_energy: U [J].
        gravity: G, n.
        regressor: The equations linear in their parameters; None for long arms.
    """

    equation: str
    mass_matrix: Matrix
    christoffel_symbols: tuple[tuple[int, int, int, str], ...] | None
    coriolis_matrix: Matrix
    potential_energy: str
    gravity: tuple[str, ...]
    regressor: Regressor | None


@dataclass(frozen=True, slots=True)
class Sheet:
    """All formulas of a robot.

    Args:
        notation: Form of all formulas.
        table: The table they are of.
        joints: Written symbols of the joints.
        parameters: The table's numbers that formulas use, their symbols written.
        abbreviations: Written short names with what they stand for.
        transformations: H_1 ... H_n, each 4 x 4.
        frame: Pose of the tool in the base frame, 3 x 4.
        jacobian: 6 x n, linear rows first.
        determinant: Determinant of the rows of the Jacobian that were named; None for none.
        motion: The equations of motion; None where they are left out.
        notes: Notes on what is left out, with the reasons.
    """

    notation: Notation
    table: DhTable
    joints: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    abbreviations: tuple[tuple[str, str], ...]
    transformations: tuple[Matrix, ...]
    frame: Matrix
    jacobian: Matrix
    determinant: str | None
    motion: Motion | None
    notes: tuple[str, ...]


def write_sheet(table: DhTable, notation: Notation, axes: Sequence[str] = ()) -> Sheet:
    """The formulas of a table.

    Args:
        table: The robot.
        notation: Notation of the formulas.
        axes: Names of rows of the Jacobian, as many as joints, for a determinant.

    Raises:
        InvalidOption: The poses have more terms than a reader can use, or the axes make no square
            matrix.
    """
    n, rows = len(table.rows), [AXES.index(axis) for axis in axes if axis in AXES]
    if axes and not len(axes) == len(rows) == len(set(rows)) == n:
        raise InvalidOption(
            f"axes {', '.join(axes)}: a determinant needs as many rows of the Jacobian as there "
            f"are joints, {n}",
            hint=f"Name {n} different ones of {', '.join(AXES)}." if n <= len(AXES) else None,
        )
    try:
        return _write(symbolic_table(table), notation, rows)
    except TooManyTerms:
        raise InvalidOption(
            f"the formulas of this arm of {len(table.rows)} joints are too long to be read",
            hint="Formulas are for arms of up to about seven joints whose axes are parallel or at "
            "right angles; fk, jacobian and dynamics answer values for all.",
            joints=len(table.rows),
        ) from None


def _write(symbols: SymbolicTable, notation: Notation, rows: Sequence[int]) -> Sheet:
    known = {parameter.symbol for parameter in symbols.parameters}
    offsets = {q: f"theta_{i}" for i, q in enumerate(symbols.joints, start=1)}
    writer = Writer(notation, {q: theta for q, theta in offsets.items() if theta in known})
    pen = _Pen(symbols, writer)
    T = tool_frame(symbols)
    transformations = tuple(pen.matrix(step, Collect.ANGLES) for step in symbols.steps)
    frame = pen.matrix(T[:3], Collect.ANGLES)
    jacobian = tool_jacobian(symbols)
    J = pen.matrix(jacobian, Collect.ANGLES)
    det = _determinant(pen, jacobian[rows]) if rows else None
    motion, notes = _motion(pen)
    if rows and det is None:
        notes = (_NO_DETERMINANT, *notes)
    abbreviations = (*writer.abbreviations(), *_friction_functions(symbols, writer))
    return Sheet(
        notation,
        symbols.table,
        tuple(writer.symbol(q) for q in symbols.joints),
        tuple(
            Parameter(writer.symbol(p.symbol), p.value, p.unit, p.meaning)
            for p in symbols.parameters
            if p.symbol in writer.symbols or p.symbol[:2] in _DRIVES
        ),
        abbreviations,
        transformations,
        frame,
        J,
        det,
        motion,
        notes,
    )


@dataclass(frozen=True, slots=True)
class _Pen:
    """Writes polynomials of a table."""

    table: SymbolicTable
    writer: Writer

    def matrix(self, values: Polynomials, collect: Collect) -> Matrix:
        return tuple(self.vector(row, collect) for row in values)

    def vector(self, values: Polynomials, collect: Collect) -> tuple[str, ...]:
        return tuple(self.writer.write(formula(self.table, v, collect)) for v in values)


def _determinant(pen: _Pen, J: Polynomials) -> str | None:
    """The determinant of a square Jacobian; None where nobody could read it."""
    if len(J) > MAX_DETERMINANT_JOINTS:
        return None
    try:
        return pen.writer.write(factored(pen.table, determinant(J)))
    except TooManyTerms:
        return None


def _friction_functions(table: SymbolicTable, writer: Writer) -> Iterator[tuple[str, str]]:
    """The smoothed signs of velocities that dry friction is multiplied with."""
    for i in range(1, table.n + 1):
        if f"F_{i}" in table.variables.names:
            rate = writer.symbol(f"qd_{i}")
            yield writer.symbol(f"f_{i}"), writer.tanh(f"{rate} / {SMOOTH_SPEED:g}")


def _motion(pen: _Pen) -> tuple[Motion | None, tuple[str, ...]]:
    if all(body is None for body in pen.table.bodies):
        return None, (_NO_MASSES,)
    short = pen.table.n <= MAX_REGRESSOR_JOINTS
    try:
        motion = _write_motion(pen, equations_of_motion(pen.table), short)
    except TooManyTerms:
        return None, (_TOO_LONG,)
    return motion, () if short else (_NO_REGRESSOR,)


def _write_motion(pen: _Pen, motion: SymbolicMotion, short: bool) -> Motion:
    """The equations of motion, written; of a short arm with Christoffel symbols and regressor."""
    return Motion(
        _equation(pen),
        pen.matrix(motion.mass_matrix, Collect.MASSES),
        _christoffel(pen, motion) if short else None,
        pen.matrix(motion.coriolis_matrix, Collect.MASSES),
        pen.vector(np.array([motion.potential_energy]), Collect.MASSES)[0],
        pen.vector(motion.gravity, Collect.ANGLES),
        _regressor(pen, motion) if short else None,
    )


def _equation(pen: _Pen) -> str:
    """The equations of motion with the terms that the robot has."""
    names = pen.table.variables.names
    has = {letter: any(name.startswith(f"{letter}_") for name in names) for letter in "JBF"}
    if pen.writer.notation is Notation.TEXT:
        inertia = "(D(q) + J)" if has["J"] else "D(q)"
        text = f"{inertia}*qdd + C(q, qd)*qd"
        text += " + B*qd" if has["B"] else ""
        text += " + F*f(qd)" if has["F"] else ""
        return f"{text} + G(q) = tau"
    inertia = r"\left(D(q) + J\right)" if has["J"] else "D(q)"
    text = rf"{inertia} \ddot{{q}} + C(q, \dot{{q}}) \dot{{q}}"
    text += r" + B \dot{q}" if has["B"] else ""
    text += " + F f" if has["F"] else ""
    return rf"{text} + G(q) = \tau"


def _christoffel(pen: _Pen, motion: SymbolicMotion) -> tuple[tuple[int, int, int, str], ...]:
    n = pen.table.n
    found = []
    for k, i, j in product(range(n), repeat=3):
        symbol = motion.christoffel_symbols[i, j, k]
        if i <= j and symbol:
            text = pen.writer.write(formula(pen.table, symbol, Collect.MASSES))
            found.append((i + 1, j + 1, k + 1, text))
    return tuple(found)


def _regressor(pen: _Pen, motion: SymbolicMotion) -> Regressor:
    symbolic = symbolic_regressor(pen.table, motion.torques)
    values = {parameter.symbol: parameter.value for parameter in pen.table.parameters}
    return Regressor(
        tuple(tuple(pen.writer.write(entry) for entry in row) for row in symbolic.regressor),
        tuple(pen.writer.write(parameter) for parameter in symbolic.parameters),
        tuple(numeric_value(parameter, values) for parameter in symbolic.parameters),
    )


#: Coefficients are integers over small powers of two; what is below is rounding of a solution.
_ZERO = 1e-9
#: Kinds of symbols that are no parameters: joint variables, gravity, and fixed frames.
_KNOWN = ("q", "qd", "qdd", "g", "f", "b", "t")

_Row = dict[Powers, float]


@dataclass(frozen=True, slots=True)
class SymbolicRegressor:
    """The regressor of n joints and its p parameters.

    Args:
        regressor: Y, n rows of p formulas.
        parameters: Theta, p formulas in masses, lengths and inertias.
    """

    regressor: tuple[tuple[Sum, ...], ...]
    parameters: tuple[Sum, ...]


def symbolic_regressor(table: SymbolicTable, torques: Polynomials) -> SymbolicRegressor:
    """The regressor of the equations of motion.

    Args:
        table: The robot.
        torques: tau of symbols q, q_dot and q_ddot, (n,).
    """
    rows = [_by_function(table, torque) for torque in torques]
    polynomials = [_scaled(p) for row in rows for p in row.values()]
    basis = _basis(polynomials)
    regressor = []
    for row in rows:
        columns: list[list[Product]] = [[] for _ in basis]
        for function, polynomial in row.items():
            for k, share in enumerate(_shares(basis, polynomial)):
                if abs(share) > _ZERO:
                    columns[k].append(Product(share, function))
        regressor.append(tuple(sum_of_terms(terms, Collect.ANGLES) for terms in columns))
    parameters = tuple(
        sum_of_terms([Product(value, powers) for powers, value in p.items()], Collect.MASSES)
        for p in basis
    )
    return SymbolicRegressor(tuple(regressor), parameters)


def _by_function(table: SymbolicTable, torque: Polynomial) -> dict[Powers, _Row]:
    """The polynomial in the parameters before each function of the state."""
    found: dict[Powers, _Row] = defaultdict(dict)
    for term in real_terms(table, torque, pair=False):
        known = tuple(item for item in term.powers if _is_known(item[0]))
        parameters = tuple(item for item in term.powers if not _is_known(item[0]))
        found[known][parameters] = term.coefficient
    return found


def _is_known(factor: Angle | str) -> bool:
    return isinstance(factor, Angle) or factor.partition("_")[0] in _KNOWN


def _scaled(polynomial: Mapping[Powers, float]) -> _Row:
    """A polynomial times the number that makes its smallest coefficient 1."""
    size = min(abs(value) for value in polynomial.values())
    first = next(iter(polynomial.values()))
    return {powers: value / np.copysign(size, first) for powers, value in polynomial.items()}


def _basis(polynomials: Sequence[_Row]) -> list[_Row]:
    """Linearly independent polynomials that all are sums of, the shortest of them."""
    order = sorted(range(len(polynomials)), key=lambda i: (len(polynomials[i]), i))
    chosen: list[int] = []
    for i in order:
        basis = [polynomials[k] for k in chosen]
        if not basis or _solved(basis, polynomials[i])[1] > _ZERO:
            chosen.append(i)
    return [polynomials[i] for i in sorted(chosen)]


def _shares(basis: Sequence[_Row], polynomial: _Row) -> list[float]:
    # Shares are whole numbers over small powers of two.
    return [round(float(value) * 64.0) / 64.0 for value in _solved(basis, polynomial)[0]]


def _solved(basis: Sequence[_Row], polynomial: _Row) -> tuple[np.ndarray, float]:
    """Shares of a basis that add up to a polynomial, and the largest coefficient left."""
    monomials = sorted({m for row in (*basis, polynomial) for m in row}, key=repr)
    matrix = np.array([[row.get(m, 0.0) for row in basis] for m in monomials])
    right = np.array([polynomial.get(m, 0.0) for m in monomials])
    shares = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return shares, float(np.abs(matrix @ shares - right).max())


def write_page(sheet: Sheet) -> str:
    """All formulas on one page.

    LaTeX uses ``bmatrix`` of amsmath; plain text has one entry a line.

    Args:
        sheet: The formulas.
    """
    write = _latex if sheet.notation is Notation.LATEX else _text
    lines = (line for parts in _formulas(sheet) for line in write(*parts))
    return "\n".join([*lines, ""])


def _formulas(sheet: Sheet) -> Iterator[tuple[str, str, Matrix | str]]:
    """All formulas in turn: their names in LaTeX and in text, and a matrix or a single formula."""
    for symbol, meaning in sheet.abbreviations:
        yield symbol, symbol, meaning
    for i, step in enumerate(sheet.transformations, start=1):
        yield f"H_{{{i}}}^{{{i - 1}}}", f"H_{i}", step
    yield r"\begin{bmatrix} R & O \end{bmatrix}", "T", sheet.frame
    yield "J(q)", "Jacobian", sheet.jacobian
    if sheet.determinant is not None:
        yield r"\det J", "det_J", sheet.determinant
    if sheet.motion is None:
        return
    motion = sheet.motion
    yield "", "", motion.equation
    yield "D(q)", "D", motion.mass_matrix
    for i, j, k, symbol in motion.christoffel_symbols or ():
        yield f"c_{{{i}{j}{k}}}", f"c_{i}{j}{k}", symbol
    yield r"C(q, \dot{q})", "C", motion.coriolis_matrix
    yield r"\mathcal{U}(q)", "U", motion.potential_energy
    yield "G(q)", "G", _column(motion.gravity)
    if motion.regressor is not None:
        yield r"Y(q, \dot{q}, \ddot{q})", "Y", motion.regressor.regressor
        yield r"\Theta", "Theta", _column(motion.regressor.parameters)


def _column(entries: Iterable[str]) -> Matrix:
    return tuple((entry,) for entry in entries)


def _latex(name: str, _: str, value: Matrix | str) -> Iterator[str]:
    """One displayed formula."""
    if not isinstance(value, str):
        body = r" \\ ".join(" & ".join(row) for row in value)
        value = rf"\begin{{bmatrix}} {body} \end{{bmatrix}}"
    yield rf"\[ {name} = {value} \]" if name else rf"\[ {value} \]"


def _text(_: str, name: str, value: Matrix | str) -> Iterator[str]:
    """One line for a formula, or for each entry of a matrix that is not 0."""
    if isinstance(value, str):
        yield f"{name} = {value}" if name else value
        return
    for i, row in enumerate(value, start=1):
        for j, entry in enumerate(row, start=1):
            if entry != "0":
                index = f"{i}" if len(row) == 1 else f"{i}{j}"
                yield f"{name}_{index} = {entry}"

"""The equations of motion as Y(q, q_dot, q_ddot) Theta with the fewest parameters, in symbols.

Theta holds combinations of masses, lengths and inertias, as m_2 l_1 l_c2; Y holds what is known of
a state. The products of angles, velocities and accelerations in tau are linearly independent
functions, so each of them has one polynomial in the parameters before it; Theta is a basis of
these polynomials.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynamics.equations.formula import Angle, Collect, Powers, Sum, Term, real_terms, sum_of_terms
from dynamics.equations.polynomial import Polynomial, Polynomials
from dynamics.equations.table import SymbolicTable

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
        columns: list[list[Term]] = [[] for _ in basis]
        for function, polynomial in row.items():
            for k, share in enumerate(_shares(basis, polynomial)):
                if abs(share) > _ZERO:
                    columns[k].append(Term(share, function))
        regressor.append(tuple(sum_of_terms(terms, Collect.ANGLES) for terms in columns))
    parameters = tuple(
        sum_of_terms([Term(value, powers) for powers, value in p.items()], Collect.MASSES)
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
        if not basis or _residual(basis, polynomials[i]) > _ZERO:
            chosen.append(i)
    return [polynomials[i] for i in sorted(chosen)]


def _shares(basis: Sequence[_Row], polynomial: _Row) -> list[float]:
    matrix, right = _linear(basis, polynomial)
    solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
    # Shares are whole numbers over small powers of two.
    return [round(float(value) * 64.0) / 64.0 for value in solution]


def _residual(basis: Sequence[_Row], polynomial: _Row) -> float:
    matrix, right = _linear(basis, polynomial)
    solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return float(np.abs(matrix @ solution - right).max())


def _linear(basis: Sequence[_Row], polynomial: _Row) -> tuple[np.ndarray, np.ndarray]:
    monomials = sorted({m for row in (*basis, polynomial) for m in row}, key=repr)
    matrix = np.array([[row.get(m, 0.0) for row in basis] for m in monomials])
    return matrix, np.array([polynomial.get(m, 0.0) for m in monomials])

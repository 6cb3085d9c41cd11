"""Nonlinear Lyapunov functions V(x) of systems x_dot = f(x), by their formulas.

Near x = 0 a function is positive definite where its second derivatives at 0 are, or where it is a
sum of terms of known sign that are 0 together at x = 0 only. A term has a known sign where each of
its factors is not 0 at x = 0, or an even power, or a function of one state whose first derivative
at 0 that is not 0 has an even order.

Lyapunov: x = 0 is asymptotically stable if V is positive and V_dot negative definite, stable if
V_dot <= 0. LaSalle: with V_dot <= 0 it is asymptotically stable if no motion but x = 0 stays where
V_dot = 0. Along such a motion the factors of V_dot stay 0, so their derivatives along f are 0 too:
where the gradients of all of these have rank n at 0, they are 0 together at x = 0 only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import sympy
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from tracking.controllers.quadratic_form import (
    Definiteness,
    Poles,
    SymmetricForm,
    poles_of,
    symmetric_form,
)
from tracking.controllers.state_formulas import Formula, is_known, symbols, values

VerdictName = Literal["asymptotically_stable", "stable", "unstable", "nothing"]

#: Values at x = 0 below this are 0 [-].
_ZERO = 1e-12
#: A number of a formula that is not exactly 0 and below this is of unknown sign.
_UNSURE = 1e-9
#: Highest derivative that decides the sign of a function of one state.
_MAX_ORDER = 8
#: Terms of sums that are multiplied out, and of those that are factored.
_MAX_TERMS, _MAX_FACTORED = 1_000, 60
#: Radii at which a V_dot > 0 is searched [-], directions for each.
_RADII, _DIRECTIONS = np.logspace(-3.0, 0.0, 7), 200
_NEAR = "near x = 0 V is positive definite and V_dot"


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearLyapunov:
    """V of x_dot = f(x) near x = 0.

    Args:
        V: The function.
        V_dot: Its rate grad V . f.
        P: Quadratic part of V at 0.
        Q: Quadratic part of -V_dot at 0.
        poles: Eigenvalues of the linear system at 0, complex, shape (n,).
        verdict: Conclusion of the theorems of Lyapunov and LaSalle.
        reason: The conclusion as a sentence that names the theorem.
        zeros: Functions that are 0 together where V_dot = 0; None where LaSalle's principle is not
            asked.
        invariant: Functions that are 0 too along motions that stay there.
    """

    V: Formula
    V_dot: Formula
    P: SymmetricForm
    Q: SymmetricForm
    poles: Poles
    verdict: VerdictName
    reason: str
    zeros: tuple[Formula, ...] | None = None
    invariant: tuple[Formula, ...] = ()

    def values(self, x: Array) -> tuple[Array, Array]:
        """V and V_dot at states x, shape (..., n); both have the shape (...).

        Raises:
            InvalidOption: V or V_dot is not finite at a state.
        """
        found = []
        for name, formula in (("V", self.V), ("V_dot", self.V_dot)):
            at = _at(formula, x)
            if not np.isfinite(at).all():
                state = np.asarray(x)[~np.isfinite(at)].reshape(-1, np.shape(x)[-1])[0].tolist()
                raise InvalidOption(f"{name} is not a finite number at x = {state}")
            found.append(at)
        return found[0], found[1]


def nonlinear_lyapunov(f: Sequence[Formula], V: Formula) -> NonlinearLyapunov:
    """Examine V as a Lyapunov function of x_dot = f(x) near x = 0.

    Args:
        f: Formulas of x1 ... xn, n of them.
        V: Formula of x1 ... xn.

    Raises:
        InvalidOption: f or V is not 0 at x = 0, or not smooth there.
    """
    x = symbols(len(f))
    origin = np.zeros(len(f))
    for name, formula in [*((f"f[{i}]", one) for i, one in enumerate(f)), ("V", V)]:
        if not np.isfinite(_at(formula, _directions(len(f), 1e-9))).all():
            raise InvalidOption(f"{name} is not a finite number all around x = 0")
        value = float(_at(formula, origin))
        exact = formula.subs(dict.fromkeys(x, 0))
        if not abs(value) <= (0.0 if exact.is_Rational else _ZERO):
            fault = "so x = 0 is no equilibrium" if name != "V" else "where it must be 0"
            raise InvalidOption(
                f"{name} is {value:.6g} at x = 0, {fault}",
                hint="Take x from the equilibrium on, and V from its value there on.",
            )
    slopes = [sympy.diff(V, one) for one in x]
    V_dot = _shortest(sympy.Add(*(a * b for a, b in zip(slopes, f, strict=True))))
    speeds = [sympy.diff(V_dot, one) for one in x]
    A = _numbers("f", [[sympy.diff(one, by) for by in x] for one in f])
    gradient = _numbers("V", [slopes])[0]
    second = 0.5 * _numbers("V", [[sympy.diff(one, by) for by in x] for one in slopes])
    rates = 0.5 * _numbers("V_dot", [[sympy.diff(one, by) for by in x] for one in speeds])
    scale = 2.0 * float(np.abs(A).max() * np.abs(second).max())
    P, Q = symmetric_form(second), symmetric_form(0.0 - rates, scale)
    known = V, V_dot, P, Q, poles_of(A)
    is_flat = bool(np.abs(gradient).max() <= _ZERO)
    is_positive = is_flat and _is_definite(V, P, x)
    if _is_definite(-V_dot, Q, x) and is_positive:
        reason = f"asymptotically stable by Lyapunov's theorem: {_NEAR} is negative definite"
        return NonlinearLyapunov(*known, "asymptotically_stable", reason)
    for sign, word in ((1, "negative"), (-1, "positive")):
        lowest = float((sign * P.eigenvalues).min())
        opposite = not is_flat or lowest < -1e-9 * float(np.abs(P.eigenvalues).max())
        form = symmetric_form(sign * Q.matrix, scale)
        if opposite and _is_definite(-sign * V_dot, form, x):
            reason = f"unstable by Lyapunov's instability theorem: near x = 0 V_dot is {word} "
            reason += f"definite, and V is {word} at points as near to it as one likes"
            return NonlinearLyapunov(*known, "unstable", reason)
    if not is_positive:
        reason = "nothing: V is not shown to be positive definite near x = 0"
        return NonlinearLyapunov(*known, "nothing", reason + _example("V", V, x, -1))
    zeros = _zeros(-V_dot, x)
    if zeros is None:
        reason = "nothing: V_dot <= 0 near x = 0 is not shown"
        return NonlinearLyapunov(*known, "nothing", reason + _example("V_dot", V_dot, x, 1))
    if not zeros:
        reason = f"stable by Lyapunov's theorem: {_NEAR} is 0 everywhere, so V never falls and "
        reason += "x = 0 is not asymptotically stable"
        return NonlinearLyapunov(*known, "stable", reason, ())
    invariant, is_alone = _invariant(f, zeros, x)
    if is_alone:
        verdict: VerdictName = "asymptotically_stable"
        reason = f"asymptotically stable by LaSalle's principle: {_NEAR} is negative semidefinite, "
        reason += "and no motion but x = 0 stays where V_dot = 0"
    else:
        verdict = "stable"
        reason = f"stable by Lyapunov's theorem: {_NEAR} is negative semidefinite; that no motion "
        reason += "but x = 0 stays where V_dot = 0 (LaSalle) is not shown"
    return NonlinearLyapunov(*known, verdict, reason, tuple(zeros), tuple(invariant))


def _at(formula: Formula, x: Array) -> Array:
    with np.errstate(all="ignore"):
        return np.asarray(np.broadcast_to(values(formula, np.asarray(x)), np.shape(x)[:-1]))


def _numbers(name: str, rows: list[list[Formula]]) -> Array:
    """Values of formulas at x = 0.

    Raises:
        InvalidOption: One is not finite.
    """
    origin = np.zeros(len(rows[0]))
    found = np.array([[float(_at(one, origin)) for one in row] for row in rows])
    if not np.isfinite(found).all():
        raise InvalidOption(f"derivatives of {name} are no finite numbers at x = 0")
    return found


# ------------------------------------------------------------------------------ forms of a formula


def _terms(formula: Formula) -> float:
    """Number of terms of a formula that is multiplied out, at most."""
    if formula.is_Add:
        return sum(map(_terms, formula.args))
    if formula.is_Mul:
        return math.prod(map(_terms, formula.args))
    if formula.is_Pow and formula.exp.is_Integer and formula.exp > 0:
        count, power = _terms(formula.base), int(formula.exp)
        return math.comb(int(min(count, 1e6)) + power - 1, power)
    return 1


def _expanded(formula: Formula) -> Formula:
    return sympy.expand(formula) if _terms(formula) <= _MAX_TERMS else formula


def _factored(formula: Formula) -> Formula:
    return sympy.factor(formula) if _terms(formula) <= _MAX_FACTORED else formula


def _shortest(formula: Formula) -> Formula:
    """The shortest form of a formula that is found."""
    forms = [formula, _expanded(formula)]
    forms.append(_factored(forms[-1]))
    if _terms(formula) <= _MAX_FACTORED:
        turns = {
            one: sympy.sqrt(1 - sympy.cos(one.args[0]) ** 2) for one in formula.atoms(sympy.sin)
        }
        squares = {one**2: by**2 for one, by in turns.items()}
        forms += [sympy.cancel(form) for form in (formula, formula.subs(squares))]
    return min((form for form in forms if is_known(form)), key=sympy.count_ops)


# ----------------------------------------------------------------------------------- definiteness


def _is_definite(formula: Formula, form: SymmetricForm, x: Sequence[Formula]) -> bool:
    """Whether a function is shown to be positive definite near 0, with its quadratic part."""
    if form.definiteness is Definiteness.POSITIVE:
        return True
    zeros = _zeros(formula, x)
    return zeros is not None and _rank(zeros, x) == len(x)


def _rank(zeros: Sequence[Formula], x: Sequence[Formula]) -> int:
    """Rank of the gradients of functions at x = 0."""
    if not zeros:
        return 0
    rows = np.array(
        [[float(_at(sympy.diff(one, by), np.zeros(len(x)))) for by in x] for one in zeros]
    )
    rows = rows[np.isfinite(rows).all(axis=1)]
    sizes = np.linalg.norm(rows, axis=1)
    rows = rows[sizes > _UNSURE] / sizes[sizes > _UNSURE, None]
    return int(np.linalg.matrix_rank(rows, tol=_UNSURE)) if len(rows) else 0


def _zeros(formula: Formula, x: Sequence[Formula]) -> list[Formula] | None:
    """Functions that are 0 together where a function is 0, if it is shown to be >= 0 near x = 0.

    None where it is not.
    """
    if _is_above(formula, _directions(len(x), _RADII[0]), -1).any():
        return None
    direct = _zeros_of_terms(formula, x)
    if direct is not None:
        return direct
    found: list[Formula] = []
    for part in _parts(_expanded(formula), x):
        forms = (part, _factored(part))
        zeros = next((z for z in (_zeros_of_terms(one, x) for one in forms) if z is not None), None)
        zeros = _zeros_of_square(part, x) if zeros is None else zeros
        if zeros is None:
            return None
        found += zeros
    return found


def _parts(formula: Formula, x: Sequence[Formula]) -> list[Formula]:
    """Sums of the terms that share states, each 0 at x = 0; their sum is the formula."""
    parts: list[Formula] = []
    for term in sympy.Add.make_args(formula):
        joined = [part for part in parts if part.free_symbols & term.free_symbols]
        parts = [part for part in parts if part not in joined]
        parts.append(sympy.Add(term, *joined))
    origin = dict.fromkeys(x, 0)
    return [part - part.subs(origin) for part in parts if part.free_symbols]


def _zeros_of_terms(formula: Formula, x: Sequence[Formula]) -> list[Formula] | None:
    """As ``_zeros``, by the sign of each term; those of one state are taken together."""
    alone: dict[Formula, Formula] = {}
    terms, constant = [], sympy.Integer(0)
    for term in sympy.Add.make_args(formula):
        if len(term.free_symbols) == 1:
            (one,) = term.free_symbols
            alone[one] = alone.get(one, 0) + term
        elif term.free_symbols:
            terms.append(term)
        else:
            constant += term
    constant += sympy.Add(*(part.subs(one, 0) for one, part in alone.items()))
    if sympy.expand(constant) != 0:
        return None
    terms += [part - part.subs(one, 0) for one, part in alone.items()]
    found = []
    for term in terms:
        sign, zero = _sign(term, x)
        if sign < 0 or zero is None:
            return None
        if zero != 0:
            found += _zeros(zero, x) or _zeros(-zero, x) or [zero]
    return found


def _sign(term: Formula, x: Sequence[Formula]) -> tuple[int, Formula | None]:
    """Sign of a product near x = 0, and a function that is 0 where it is; None if not shown."""
    sign, zero = 1, sympy.Integer(1)
    alone: dict[Formula, Formula] = {}
    origin = dict.fromkeys(x, 0)
    factors = [term] if len(term.free_symbols) == 1 else sympy.Mul.make_args(term)
    is_product = sum(bool(one.free_symbols) for one in factors) > 1
    for factor in factors:
        value = factor.subs(origin)
        if value != 0:
            number = float(_at(value, np.zeros(1)))
            if not _UNSURE < abs(number) < math.inf and not value.is_Rational:
                return 1, None
            sign *= 1 if number > 0.0 else -1
        elif len(factor.free_symbols) == 1:
            (one,) = factor.free_symbols
            alone[one] = alone.get(one, 1) * factor
        else:
            base, power = factor.as_base_exp()
            if not (power.is_Integer and power > 0) or (power == 1 and not is_product):
                return 1, None
            if power % 2:
                signed = ((way, _zeros(way * base, x)) for way in (1, -1))
                way, inner = next(((way, zeros) for way, zeros in signed if zeros), (1, None))
                if inner is None:
                    return 1, None
                sign, base = sign * way, sympy.Add(*(one**2 for one in inner))
            zero *= base
    for one, part in alone.items():
        order, leading = _leading(part, one)
        if order is None or order % 2:
            return (1, sympy.Integer(0)) if part.is_zero else (1, None)
        sign, zero = sign * leading, zero * one
    return sign, zero


def _leading(formula: Formula, one: Formula) -> tuple[int | None, int]:
    """Order of the first derivative of a function of one state that is not 0 at 0, and its sign."""
    for order in range(_MAX_ORDER + 1):
        value = formula.subs(one, 0)
        if value != 0:
            number = float(_at(value, np.zeros(1)))
            is_sure = _UNSURE < abs(number) < math.inf or value.is_Rational
            return (order if is_sure else None), 1 if number > 0.0 else -1
        formula = sympy.diff(formula, one)
    return None, 1


def _zeros_of_square(formula: Formula, x: Sequence[Formula]) -> list[Formula] | None:
    """As ``_zeros``, of a quadratic form."""
    if not formula.is_polynomial(*x):
        return None
    H = sympy.hessian(formula, x)
    column = sympy.Matrix(x)
    if H.free_symbols or sympy.expand(formula - (column.T * H * column)[0] / 2) != 0:
        return None
    kind = symmetric_form(np.array(H, dtype=np.float64)).definiteness
    if kind not in (Definiteness.POSITIVE, Definiteness.SEMIPOSITIVE):
        return None
    return [row for row in H * column if row != 0]


def _directions(n: int, radius: float) -> Array:
    """States around 0: along the axes, then by seeded chance."""
    ways = np.random.default_rng(0).normal(size=(_DIRECTIONS, n))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    return radius * np.vstack([np.eye(n), -np.eye(n), ways]) + 0.0


def _is_above(formula: Formula, states: Array, sign: int) -> NDArray[np.bool_]:
    """Whether a function with a sign before it is above 0 by more than rounding, at states."""
    sizes = [np.abs(_at(term, states)) for term in sympy.Add.make_args(formula)]
    return np.asarray(sign * _at(formula, states) > _UNSURE * np.sum(sizes, axis=0))


def _example(name: str, formula: Formula, x: Sequence[Formula], sign: int) -> str:
    """A clause that names a state at which a function has the wrong sign; empty for none found."""
    states = np.vstack([_directions(len(x), radius) for radius in _RADII])
    is_wrong = _is_above(formula, states, sign)
    if not is_wrong.any():
        return ""
    k = int(np.argmax(is_wrong))
    state = ", ".join(f"{value:.6g}" for value in states[k])
    return f"; {name} is {float(_at(formula, states)[k]):.6g} at x = [{state}]"


# ----------------------------------------------------------------------------------------- LaSalle


def _invariant(
    f: Sequence[Formula], zeros: Sequence[Formula], x: Sequence[Formula]
) -> tuple[list[Formula], bool]:
    """Functions that are 0 along motions on which others stay 0, and whether x = 0 is the only one.

    Args:
        f: The system.
        zeros: Functions that stay 0.
        x: The states.
    """
    known = [_single(_stripped(zero)) for zero in zeros]
    level = known
    added: list[Formula] = []
    for _ in x:
        if _rank(known, x) == len(x):
            return added, True
        still = {one: 0 for one in known if one.is_Symbol}
        derived = (
            sympy.Add(*(sympy.diff(one, by) * rate for by, rate in zip(x, f, strict=True)))
            for one in level
        )
        shown = [_stripped(_expanded(one.subs(still))) for one in derived]
        shown = [one for one in shown if not {one, -one} & {*known, *added, sympy.Integer(0)}]
        level = [_single(one) for one in shown]
        added, known = added + shown, known + level
    return added, _rank(known, x) == len(x)


def _stripped(formula: Formula) -> Formula:
    """A function without its powers and the factors that are not 0 at x = 0."""
    origin = dict.fromkeys(formula.free_symbols, 0)
    factors = (one for one in sympy.Mul.make_args(_factored(formula)) if one.subs(origin) == 0)
    return sympy.Mul(*(one.base if one.is_Pow and one.exp.is_positive else one for one in factors))


def _single(formula: Formula) -> Formula:
    """A function of one state as that state, where it is 0 near x = 0 at 0 only."""
    if len(formula.free_symbols) != 1:
        return formula
    (one,) = formula.free_symbols
    return one if _leading(formula, one)[0] is not None else formula

"""Quadratic Lyapunov functions V = x^T P x of linear systems x_dot = A x.

    V_dot = x^T (A^T P + P A) x = -x^T Q x.

Lyapunov: the origin is asymptotically stable if P and Q are positive definite, stable if Q is
positive semidefinite only, and unstable if Q is positive definite and P is not. LaSalle: with Q
positive semidefinite it is asymptotically stable if no motion but x = 0 stays where x^T Q x = 0,
which for a linear system is the observability of (Q, A).
"""

from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_continuous_lyapunov

from kinematics.arrays import Array, frozen, numbers
from kinematics.errors import InvalidOption

Poles: TypeAlias = NDArray[np.complex128]

#: Rounding error of an eigenvalue, as part of the largest, for each row of the matrix.
_ROUNDING = 16.0 * float(np.finfo(np.float64).eps)
#: An observability matrix of unit rows has this smallest singular value, or it has lost its rank.
_RANK = 1e-10
#: Largest residual A^T P + P A + Q of a solution, as part of the largest product.
_RESIDUAL = 1e-8


class Definiteness(Enum):
    """Definiteness of a symmetric matrix; zero eigenvalues are those below rounding error."""

    POSITIVE = "positive definite"
    SEMIPOSITIVE = "positive semidefinite"
    ZERO = "zero"
    INDEFINITE = "indefinite"
    SEMINEGATIVE = "negative semidefinite"
    NEGATIVE = "negative definite"


class Verdict(Enum):
    """Conclusion from a quadratic Lyapunov function; the value is a sentence."""

    ASYMPTOTICALLY_STABLE = (
        "asymptotically stable: P is positive definite and V_dot is negative definite"
    )
    STABLE_BY_LASALLE = (
        "asymptotically stable by LaSalle: P is positive definite, V_dot is negative "
        "semidefinite, and no motion but x = 0 stays where V_dot = 0"
    )
    STABLE = (
        "stable: P is positive definite and V_dot is negative semidefinite; a motion other than "
        "x = 0 stays where V_dot = 0, so not asymptotically stable by this V"
    )
    UNSTABLE = "unstable: V_dot is negative definite, and V is negative somewhere near x = 0"
    NO_POSITIVE_V = "nothing: P is not positive definite, so V is no Lyapunov function"
    NO_FALL = "nothing: V_dot is positive somewhere, so V is no Lyapunov function"


@dataclass(frozen=True, slots=True, eq=False)
class SymmetricForm:
    """The form x^T S x of a symmetric matrix.

    Args:
        matrix: S, shape (n, n).
        minors: Leading principal minors, shape (n,): all are positive exactly where S is positive
            definite (Sylvester). They do not tell semidefinite from indefinite.
        eigenvalues: Ascending, shape (n,).
        definiteness: Definiteness by the eigenvalues.
    """

    matrix: Array
    minors: Array
    eigenvalues: Array
    definiteness: Definiteness


@dataclass(frozen=True, slots=True, eq=False)
class QuadraticLyapunov:
    """V = x^T P x of x_dot = A x, with V_dot = -x^T Q x.

    Args:
        A: Shape (n, n).
        P: The form V.
        Q: The form -V_dot.
        is_symmetric: Whether the P that was given was symmetric; its symmetric part, which has
            the same V, was taken otherwise.
        poles: Eigenvalues of A, complex, shape (n,), by their real parts.
        verdict: Conclusion of Lyapunov's and LaSalle's theorems.
    """

    A: Array
    P: SymmetricForm
    Q: SymmetricForm
    is_symmetric: bool
    poles: Poles
    verdict: Verdict

    def values(self, x: ArrayLike) -> tuple[Array, Array]:
        """V and V_dot at states x, shape (..., n); both have the shape (...).

        Raises:
            InvalidOption: A state has the wrong length or is not finite.
        """
        states = np.array(x, dtype=np.float64)
        if states.ndim == 0 or states.shape[-1] != len(self.A) or not np.isfinite(states).all():
            raise InvalidOption(
                f"a state x must be {len(self.A)} finite numbers, one for each row of A"
            )
        V = np.einsum("...i,ij,...j->...", states, self.P.matrix, states)
        return V, -np.einsum("...i,ij,...j->...", states, self.Q.matrix, states)


def quadratic_lyapunov(A: ArrayLike, P: ArrayLike) -> QuadraticLyapunov:
    """Examine V = x^T P x as a Lyapunov function of x_dot = A x.

    Args:
        A: Shape (n, n).
        P: Shape (n, n); of one that is not symmetric the symmetric part is taken.

    Raises:
        InvalidOption: A matrix is not square, not finite, or the sizes differ.
    """
    system, given = _square("A", A), _square("P", P)
    _same_size(system, "P", given)
    symmetric = 0.5 * (given + given.T)
    is_symmetric = bool(np.abs(given - given.T).max() <= _ROUNDING * np.abs(given).max())
    return _examined(system, symmetric, -(system.T @ symmetric + symmetric @ system), is_symmetric)


def solve_lyapunov(A: ArrayLike, Q: ArrayLike) -> QuadraticLyapunov:
    """Solve A^T P + P A = -Q for P, by the Schur form of A (Bartels and Stewart).

    Args:
        A: Shape (n, n), no two eigenvalues of which add up to 0.
        Q: Symmetric, shape (n, n).

    Raises:
        InvalidOption: A matrix is not square, not finite or Q not symmetric, the sizes differ, or
            the equation has no single solution.
    """
    system, target = _square("A", A), _square("Q", Q)
    _same_size(system, "Q", target)
    if np.abs(target - target.T).max() > _ROUNDING * np.abs(target).max():
        raise InvalidOption("Q is not symmetric", hint="Give (Q + Q^T) / 2: it has the same form.")
    poles = np.linalg.eigvals(system).astype(np.complex128)
    sums = np.abs(poles[:, None] + poles)
    if sums.min() <= len(system) * _ROUNDING * max(np.abs(poles).max(), 1e-300):
        _refuse_pair(poles, sums)
    solution = np.asarray(solve_continuous_lyapunov(system.T, -target), dtype=np.float64)
    P = 0.5 * (solution + solution.T)
    residual = system.T @ P + P @ system + target
    size = np.abs(target).max() + np.abs(system).max() * np.abs(P).max()
    if not np.abs(residual).max() <= _RESIDUAL * size:
        _refuse_pair(poles, sums)
    return _examined(system, P, target, is_symmetric=True)


def _refuse_pair(poles: Poles, sums: Array) -> None:
    """Refuse a system two of whose eigenvalues add up to 0.

    Raises:
        InvalidOption: Always.
    """
    i, j = np.unravel_index(int(np.argmin(sums)), sums.shape)
    raise InvalidOption(
        f"A^T P + P A = -Q has no single solution: the eigenvalues {poles[i]:.6g} and "
        f"{poles[j]:.6g} of A add up to 0",
        hint="Give P, or another A: one whose eigenvalues all have negative real parts has one.",
    )


def _examined(A: Array, P: Array, Q: Array, is_symmetric: bool) -> QuadraticLyapunov:
    scale = 2.0 * float(np.abs(A).max() * np.abs(P).max())
    forms = symmetric_form(P), symmetric_form(Q, scale)
    return QuadraticLyapunov(frozen(A), *forms, is_symmetric, poles_of(A), _verdict(A, *forms))


def poles_of(A: Array) -> Poles:
    """Eigenvalues of a matrix (n, n), in the order of their real parts, then of the imaginary."""
    poles = np.linalg.eigvals(A).astype(np.complex128)
    return poles[np.lexsort((poles.imag, poles.real))]


def symmetric_form(S: Array, scale: float = 0.0) -> SymmetricForm:
    """The form of a symmetric matrix.

    Args:
        S: Shape (n, n).
        scale: Size of the terms that S is the sum of: where these cancel, what is left is
            rounding error.
    """
    n = len(S)
    values = np.linalg.eigvalsh(S)
    tolerance = n * _ROUNDING * max(float(np.abs(values).max()), scale)
    minors = np.array([np.linalg.det(S[:k, :k]) for k in range(1, n + 1)])
    kind = _definiteness(float(values[0]), float(values[-1]), tolerance)
    return SymmetricForm(frozen(S), frozen(minors), frozen(values), kind)


def _definiteness(smallest: float, largest: float, tolerance: float) -> Definiteness:
    if smallest > tolerance:
        return Definiteness.POSITIVE
    if largest < -tolerance:
        return Definiteness.NEGATIVE
    if smallest >= -tolerance:
        return Definiteness.SEMIPOSITIVE if largest > tolerance else Definiteness.ZERO
    return Definiteness.SEMINEGATIVE if largest <= tolerance else Definiteness.INDEFINITE


def _verdict(A: Array, P: SymmetricForm, Q: SymmetricForm) -> Verdict:
    falls = Q.definiteness
    if falls is Definiteness.POSITIVE:
        if P.definiteness is Definiteness.POSITIVE:
            return Verdict.ASYMPTOTICALLY_STABLE
        # A singular P can only be one by rounding: where P x = 0 it would be x^T Q x = 0.
        is_singular = P.definiteness in (Definiteness.SEMIPOSITIVE, Definiteness.ZERO)
        return Verdict.NO_POSITIVE_V if is_singular else Verdict.UNSTABLE
    if P.definiteness is not Definiteness.POSITIVE:
        return Verdict.NO_POSITIVE_V
    if falls in (Definiteness.SEMIPOSITIVE, Definiteness.ZERO):
        return Verdict.STABLE_BY_LASALLE if _is_observable(A, Q.matrix) else Verdict.STABLE
    return Verdict.NO_FALL


def _is_observable(A: Array, Q: Array) -> bool:
    """Whether no motion of x_dot = A x but x = 0 stays where Q x = 0 (Hautus)."""
    n = len(A)
    size = max(float(np.abs(A).max()), 1e-300)
    weight = size / max(float(np.abs(Q).max()), 1e-300)
    for pole in np.linalg.eigvals(A):
        pencil = np.vstack([pole * np.eye(n) - A, weight * Q])
        if np.linalg.svd(pencil, compute_uv=False)[-1] <= _RANK * size:
            return False
    return True


def _square(name: str, value: ArrayLike) -> Array:
    M = numbers(value, name)
    if M.ndim != 2 or M.shape[0] != M.shape[1] or not M.size:
        raise InvalidOption(
            f"{name} has shape {M.shape}", hint=f"Give {name} as rows, as many as columns."
        )
    return M


def _same_size(A: Array, name: str, M: Array) -> None:
    if A.shape != M.shape:
        raise InvalidOption(
            f"A is {len(A)} x {len(A)}, {name} is {len(M)} x {len(M)}",
            hint="Both must have one row for each state.",
        )


def form_text(S: Array) -> str:
    """The form x^T S x as people write it, for example "x1² - x1 x2 + 3 x2²"."""
    text = ""
    for i, j in zip(*np.triu_indices(len(S)), strict=True):
        value = float(S[i, j] if i == j else S[i, j] + S[j, i])
        if value == 0.0:
            continue
        size = f"{abs(value):.6g}"
        variables = f"x{i + 1}²" if i == j else f"x{i + 1} x{j + 1}"
        sign = "-" if value < 0.0 else "+"
        text += f" {sign} {variables}" if size == "1" else f" {sign} {size} {variables}"
    return text.removeprefix(" + ").replace(" - ", "-", int(text.startswith(" -"))) or "0"

"""Solutions of a nearly singular arm along the curves on which they lie.

Where a Jacobian J of six joints loses the direction u, the error e(q) of a pose can be made to
vanish but for its part along u: a curve of configurations,

    e(q) = rho u,  so along the unit tangent t:  J t + u drho/ds = 0,

whose zeros of rho are the solutions. An arm that has a singularity's whole family of solutions has
rho = 0 everywhere; one that misses it by little has a few zeros, hardly attracting any search that
starts elsewhere. The curve is followed by its tangent, corrected in the bordered system

    [J u; t 0] [dq; rho] = [e; 0],

which is regular where J is not, folds of the curve included.
Source: numerical continuation in pseudo-arclength, and bordered systems for singular points.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.linear_solve import solve_kernel
from kinematics.arrays import Array, Indices
from kinematics.frame import Frame
from kinematics.ik.closed_form.refine import size_kernel
from kinematics.ik.numeric.dls_step import error_kernel, project_kernel
from kinematics.jacobian import frame_and_jacobian_kernel

#: Joints of such a Jacobian: as many as a pose has directions.
JOINTS = 6
#: A pivot no larger than this makes a matrix of metres and radians singular.
SINGULAR = 1e-14
#: Added to squares of singular values, so that matrices of them are regular however singular J is:
#: rounding of a pivot is a hundredth of it, and eigenvectors stay as they are.
_REGULAR = 1e-13


@kernel
def weakest_kernel(J: Array, joints: Indices, u: Array, v: Array, across: Array) -> float:
    """Write the left and right unit vectors of the least singular value of J into u, v; its value.

    By inverse iteration; ``across`` (6,) is a direction u must be normal to, or zero.
    """
    M, b = np.empty((JOINTS, JOINTS)), np.empty(JOINTS)
    for i in range(JOINTS):
        u[i] = 1.0 + 0.3 * math.sin(1.0 + 2.0 * i)
    for _ in range(6):
        along = np.dot(across, u)
        for i in range(JOINTS):
            b[i] = u[i] - along * across[i]
            for k in range(JOINTS):
                M[i, k] = 10.0 * across[i] * across[k]
                for a in range(JOINTS):
                    M[i, k] += J[i, joints[a]] * J[k, joints[a]]
            M[i, i] += _REGULAR
        solve_kernel(M, b, 0.0)
        b -= np.dot(across, b) * across
        u[:] = b / math.sqrt(np.sum(b * b))
    for a in range(JOINTS):
        v[a] = 0.0
        for i in range(JOINTS):
            v[a] += J[i, joints[a]] * u[i]
    value = math.sqrt(np.sum(v * v))
    # J^T u is rounding where the value is: what J moves least, directly.
    for a in range(JOINTS):
        b[a] = v[a] / value if value > 1e-6 else 1.0 + 0.3 * math.sin(1.0 + 2.0 * a)
    for _ in range(0 if value > 1e-6 else 6):
        for a in range(JOINTS):
            for c in range(JOINTS):
                M[a, c] = _REGULAR if a == c else 0.0
                for i in range(JOINTS):
                    M[a, c] += J[i, joints[a]] * J[i, joints[c]]
        solve_kernel(M, b, 0.0)
        b /= math.sqrt(np.sum(b * b))
    v[:] = b
    return value


@kernel
def joint_direction_kernel(J: Array, joints: Indices, w: Array) -> Array:
    """The unit direction of the joints (6,) that J takes to the direction w, or nearest to it."""
    M, v = np.empty((JOINTS, JOINTS)), np.zeros(JOINTS)
    for i in range(JOINTS):
        for k in range(JOINTS):
            M[i, k] = 1e-16 if i == k else 0.0
            for a in range(JOINTS):
                M[i, k] += J[i, joints[a]] * J[k, joints[a]]
    b = w.copy()
    solve_kernel(M, b, 0.0)
    for a in range(JOINTS):
        for i in range(JOINTS):
            v[a] += J[i, joints[a]] * b[i]
    return v / math.sqrt(np.sum(v * v))


#: The first step along a curve [rad].
_FIRST = 1e-3
#: The largest step [rad].
_LONGEST = 0.12
#: A curve whose steps must be shorter than this [rad] is given up.
_SHORTEST = 1e-7
#: Steps along a curve at most.
_STEPS = 1200
#: Length of a curve at most [rad].
_WAY = 30.0
#: Corrections of a step at most.
_CORRECTIONS = 6
#: A correction smaller than this [rad] is the last one.
_CONVERGED = 1e-11
#: Cosine of the largest turn of a step.
_TURN = 0.95
#: Halvings of a step that holds a zero.
_HALVINGS = 24
#: Halvings of a step that holds a least value, which may be a zero.
_TOUCHES = 40
#: Points of a curve are remembered this far apart [rad].
_APART = 0.03
#: Where |rho| is larger, a curve is left: beyond it there are no twins of a solution [m or rad].
_BEYOND = 0.3


class Curve(NamedTuple):
    """A curve of configurations whose error is left open in one direction only.

    Args:
        model: ``Chain.model``.
        link: Number of the link.
        T: The pose that the link is to reach.
        joints: The joints that move, shape (6,).
        moving: Whether u is that of the least singular value all along, else it stays.
        tolerance: Zeros between which |rho| stays below this are one [m or rad].
    """

    model: Array
    link: int
    T: Frame
    joints: Indices
    moving: bool
    tolerance: float


class _Point(NamedTuple):
    """A point of a curve.

    Args:
        q: The configuration, shape (n,).
        rho: Error along the open direction [m or rad].
        slope: Derivative of rho along the curve, drho/ds.
    """

    q: Array
    rho: float
    slope: float


@kernel
def sharpen_kernel(
    model: Array, link: int, T: Frame, joints: Indices, q: Array
) -> tuple[float, float]:
    """Newton's steps while they help, to the last bits: the errors [m], [rad] that are left.

    A small singular value turns what is left of an error into that much more of an angle.
    """
    n = q.shape[0]
    J, M, b, trial = np.empty((6, n)), np.empty((6, 6)), np.empty(6), np.empty(n)
    error = error_kernel(frame_and_jacobian_kernel(model, q, link, J), T)
    square = project_kernel(error, error)
    for _ in range(12):
        for i in range(6):
            b[i] = error[i]
            for a in range(JOINTS):
                M[i, a] = J[i, joints[a]]
        if not solve_kernel(M, b, SINGULAR):
            break
        trial[:] = q
        for a in range(JOINTS):
            trial[joints[a]] += b[a]
        error = error_kernel(frame_and_jacobian_kernel(model, trial, link, J), T)
        after = project_kernel(error, error)
        if not after < square:
            break
        q[:], square = trial, after
    error = error_kernel(frame_and_jacobian_kernel(model, q, link, J), T)
    return size_kernel(error)


@kernel
def _border(J: Array, joints: Indices, u: Array, t: Array, M: Array) -> None:
    """Write [J u; t 0] of the joints that move into M (7, 7)."""
    for i in range(6):
        for a in range(JOINTS):
            M[i, a] = J[i, joints[a]]
        M[i, 6] = u[i]
        M[6, i] = t[i]
    M[6, 6] = 0.0


@kernel
def correct_kernel(
    curve: Curve, u: Array, t: Array, reach: float, q: Array, J: Array
) -> tuple[bool, float]:
    """Bring q onto a curve across its tangent; whether it is there, and rho.

    Args:
        curve: The curve.
        u: Unit direction that is left open, shape (6,).
        t: Unit tangent, shape (6,).
        reach: Corrections go no farther than this [rad].
        q: The configuration, shape (n,); its joints move onto the curve.
        J: Filled with the Jacobian at the last but one configuration, which differs by rounding,
            shape (6, n).
    """
    model, link, T, joints = curve.model, curve.link, curve.T, curve.joints
    M, b = np.empty((7, 7)), np.empty(7)
    moved = 0.0
    for _ in range(_CORRECTIONS):
        error = error_kernel(frame_and_jacobian_kernel(model, q, link, J), T)
        _border(J, joints, u, t, M)
        b[0], b[1], b[2], b[3], b[4], b[5] = error
        b[6] = 0.0
        if not solve_kernel(M, b, SINGULAR):
            return False, 0.0
        size = 0.0
        for a in range(JOINTS):
            size += b[a] * b[a]
        size = math.sqrt(size)
        moved += size
        if not moved <= reach:
            return False, 0.0
        for a in range(JOINTS):
            q[joints[a]] += b[a]
        if size < _CONVERGED:
            return True, b[6]
        if size < 1e-6:
            # The next correction would be below rounding: its square.
            error = error_kernel(frame_and_jacobian_kernel(model, q, link, J), T)
            rho = 0.0
            for i in range(6):
                rho += u[i] * error[i]
            return True, rho
    return False, 0.0


@kernel
def tangent_kernel(
    J: Array, joints: Indices, moving: bool, u: Array, t: Array
) -> tuple[bool, float]:
    """Turn t into the curve's unit tangent, and u with it if it moves; drho/ds."""
    M, b = np.empty((7, 7)), np.empty(7)
    for _ in range(2 if moving else 1):
        _border(J, joints, u, t, M)
        b[:6], b[6] = 0.0, 1.0
        if not solve_kernel(M, b, SINGULAR):
            return False, 0.0
        size = math.sqrt(np.sum(b[:6] * b[:6]))
        for a in range(JOINTS):
            t[a] = b[a] / size
        if moving:
            _border(J, joints, u, t, M)
            b[:6], b[6] = 0.0, 1.0
            if not solve_kernel(np.ascontiguousarray(M.T), b, SINGULAR):
                return False, 0.0
            size = math.sqrt(np.sum(b[:6] * b[:6]))
            for i in range(6):
                u[i] = b[i] / size
    slope = 0.0
    for i in range(6):
        for a in range(JOINTS):
            slope -= u[i] * J[i, joints[a]] * t[a]
    return True, slope


@kernel
def follow_kernel(  # noqa: C901, PLR0912
    curve: Curve, start: Array, u0: Array, t0: Array, visited: Array, seen: int, roots: Array
) -> tuple[int, int, bool]:
    """Follow a curve one way and write starts of its zeros into ``roots``.

    Args:
        curve: The curve.
        start: A configuration on or near the curve, shape (n,).
        u0: Unit direction that is left open, shape (6,).
        t0: Unit tangent, the way to go, shape (6,).
        visited: Configurations and tangents where curves have been, shape (w, 12).
        seen: Rows of it that are filled.
        roots: The answer, shape (r, n).

    Returns:
        How many zeros, rows of ``visited`` that are filled, and whether the curve is closed.
    """
    n, joints = start.shape[0], curve.joints
    J = np.empty((6, n))
    u, t = u0.copy(), t0.copy()
    q, trial = start.copy(), np.empty(n)
    u1, t1 = np.empty(6), np.empty(6)
    count = 0
    fine, rho = correct_kernel(curve, u, t, 0.2, q, J)
    if not fine:
        return 0, seen, False
    fine, slope = tangent_kernel(J, joints, curve.moving, u, t)
    if not fine:
        return 0, seen, False
    origin, toward = q.copy(), t.copy()
    h, length, since, peak = _FIRST, 0.0, _APART, abs(rho)
    if abs(rho) < 1e-12:
        # At a zero itself rounding decides its sign: that of what follows.
        rho = math.copysign(1e-300, slope)
    for _ in range(_STEPS):
        trial[:] = q
        for k in range(JOINTS):
            trial[joints[k]] += h * t[k]
        u1[:], t1[:] = u, t
        fine, after = correct_kernel(curve, u1, t1, 0.5 * h + 1e-9, trial, J)
        slope1 = 0.0
        if fine:
            fine, slope1 = tangent_kernel(J, joints, curve.moving, u1, t1)
            fine = fine and np.dot(t, t1) > _TURN and np.dot(u, u1) > _TURN
        if not fine:
            h *= 0.4
            if h < _SHORTEST:
                break
            continue
        here, there = _Point(q, rho, slope), _Point(trial, after, slope1)
        count, peak = _add_zeros(curve, u, t, here, there, peak, roots, count)
        peak = max(peak, abs(after))
        length += h
        q[:], rho, slope, t[:], u[:] = trial, after, slope1, t1, u1
        since += h
        if seen < visited.shape[0] and since > _APART:
            since = 0.0
            for k in range(JOINTS):
                visited[seen, k], visited[seen, JOINTS + k] = q[joints[k]], t[k]
            seen += 1
        if abs(rho) > _BEYOND or length > _WAY:
            break
        if length > 0.2:
            away, past = 0.0, 0.0
            for k in range(n):
                away = max(away, abs(wrap_kernel(q[k] - origin[k])))
            for k in range(JOINTS):
                past += wrap_kernel(q[joints[k]] - origin[joints[k]]) * toward[k]
            if away < h and past >= 0.0 and np.dot(t, toward) > 0.9:
                return count, seen, True
        h = min(1.5 * h, _LONGEST)
    return count, seen, False


@kernel
def _add_zeros(
    curve: Curve, u: Array, t: Array, a: _Point, b: _Point, peak: float, roots: Array, count: int
) -> tuple[int, float]:
    """Add starts of the zeros between two points of a curve.

    Args:
        curve: The curve.
        u: Unit direction that is left open, shape (6,).
        t: Unit tangent, shape (6,).
        a: The first point.
        b: The second point.
        peak: The largest |rho| since the last zero [m or rad].
        roots: The answer, shape (r, n).
        count: Rows of it that are filled.

    Returns:
        Rows that are filled now, and the peak.
    """
    tolerance = curve.tolerance
    if (a.rho < 0.0) != (b.rho < 0.0):
        if max(peak, abs(b.rho)) > tolerance and count < roots.shape[0]:
            _find_zero(curve, u, t, a, b, roots[count])
            return count + 1, 0.0
        return count, 0.0
    if a.rho * a.slope >= 0.0 or b.rho * b.slope <= 0.0:
        return count, peak
    # |rho| is least inside.
    low, high, m, s = a.q.copy(), b.q.copy(), np.empty_like(a.q), np.empty(6)
    w, J = np.empty(6), np.empty((6, a.q.shape[0]))
    rho_m = a.rho
    for _ in range(_TOUCHES):
        m[:] = 0.5 * (low + high)
        fine, rho_m = correct_kernel(curve, u, t, 1.0, m, J)
        if not fine or (rho_m < 0.0) != (a.rho < 0.0):
            break
        s[:], w[:] = t, u
        fine, slope = tangent_kernel(J, curve.joints, False, w, s)
        if slope * rho_m < 0.0:
            low[:] = m
        else:
            high[:] = m
        if np.abs(high - low).max() < 1e-8:
            break
    if (rho_m < 0.0) != (a.rho < 0.0):
        middle = _Point(m, rho_m, 0.0)
        if peak > tolerance and count < roots.shape[0]:
            _find_zero(curve, u, t, a, middle, roots[count])
            count, peak = count + 1, 0.0
        if max(peak, abs(rho_m)) > tolerance and count < roots.shape[0]:
            _find_zero(curve, u, t, middle, b, roots[count])
            count += 1
        peak = 0.0
    elif abs(rho_m) <= tolerance and peak > tolerance and count < roots.shape[0]:
        roots[count] = m
        count, peak = count + 1, 0.0
    return count, peak


@kernel
def _find_zero(curve: Curve, u: Array, t: Array, a: _Point, b: _Point, out: Array) -> None:
    """Write the zero between a and b, where rho has two signs, into ``out``."""
    J = np.empty((6, out.shape[0]))
    low, high, left, right = 0.0, 1.0, a.rho, b.rho
    out[:] = 0.5 * (a.q + b.q)
    for k in range(_HALVINGS):
        # The false position, or the middle in turn.
        x = (low * right - high * left) / (right - left) if k % 2 == 0 else 0.5 * (low + high)
        out[:] = a.q + x * (b.q - a.q)
        fine, rho = correct_kernel(curve, u, t, 1.0, out, J)
        if not fine or abs(rho) < 1e-14:
            break
        if (rho < 0.0) == (a.rho < 0.0):
            low, left = x, rho
        else:
            high, right = x, rho
        if high - low < 1e-6:
            break


@kernel
def wrap_kernel(angle: float) -> float:
    """The angle without whole turns, in [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@kernel
def is_visited_kernel(visited: Array, seen: int, joints: Indices, q: Array, beside: float) -> bool:
    """Whether a curve that was followed runs through q, or by it within ``beside`` [rad]."""
    d = np.empty(JOINTS)
    for row in range(seen):
        square, along = 0.0, 0.0
        for k in range(JOINTS):
            d[k] = wrap_kernel(q[joints[k]] - visited[row, k])
            square += d[k] * d[k]
            along += d[k] * visited[row, JOINTS + k]
        if square < _LONGEST * _LONGEST:
            across = square - along * along
            limit = beside + 0.2 * square
            if across < limit * limit:
                return True
    return False

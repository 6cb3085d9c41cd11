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

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from kinematics.frame import Frame
from kinematics.ik.dls_step import error_kernel
from kinematics.jacobian import frame_and_jacobian_kernel
from kinematics.linear_solve import solve_kernel

#: Joints that a curve runs through: as many as a pose has directions.
JOINTS = 6
#: Steps along a curve [rad]: the first, the largest, the least; so many, over so long a way.
_FIRST, _LONGEST, _SHORTEST, _STEPS, _WAY = 1e-3, 0.12, 1e-7, 1200, 30.0
#: Corrections of a step, how small the last one is, and the cosine of its largest turn.
_CORRECTIONS, _CONVERGED, _TURN = 6, 1e-11, 0.95
#: Halvings of a step that holds a zero, or a least value that may be one.
_HALVINGS, _TOUCHES = 24, 40
#: Points of a curve are remembered so far [rad] apart.
_TOLD = 0.03
#: A pivot no larger than this makes a matrix of metres and radians singular.
_SINGULAR = 1e-14
#: Where a curve is left: beyond this there are no twins of a solution [m] or [rad].
_BEYOND = 0.3


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
            M[i, i] += 1e-15
        solve_kernel(M, b, _SINGULAR)
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
                M[a, c] = 1e-15 if a == c else 0.0
                for i in range(JOINTS):
                    M[a, c] += J[i, joints[a]] * J[i, joints[c]]
        solve_kernel(M, b, _SINGULAR)
        b /= math.sqrt(np.sum(b * b))
    v[:] = b
    return value


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
    square = _square(error)
    for _ in range(12):
        for i in range(6):
            b[i] = error[i]
            for a in range(JOINTS):
                M[i, a] = J[i, joints[a]]
        if not solve_kernel(M, b, _SINGULAR):
            break
        trial[:] = q
        for a in range(JOINTS):
            trial[joints[a]] += b[a]
        error = error_kernel(frame_and_jacobian_kernel(model, trial, link, J), T)
        after = _square(error)
        if not after < square:
            break
        q[:], square = trial, after
    error = error_kernel(frame_and_jacobian_kernel(model, q, link, J), T)
    return (
        math.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2),
        math.sqrt(error[3] ** 2 + error[4] ** 2 + error[5] ** 2),
    )


@kernel
def _square(e: tuple[float, float, float, float, float, float]) -> float:
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3] + e[4] * e[4] + e[5] * e[5]


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
    model: Array, link: int, T: Frame, joints: Indices, u: Array, t: Array, reach: float,
    q: Array, J: Array,
) -> tuple[bool, float]:  # fmt: skip
    """Bring q onto the curve across t, by no more than ``reach``; whether it is there, and rho.

    J is left at the last but one configuration, which differs by rounding.
    """
    M, b = np.empty((7, 7)), np.empty(7)
    moved = 0.0
    for _ in range(_CORRECTIONS):
        error = error_kernel(frame_and_jacobian_kernel(model, q, link, J), T)
        _border(J, joints, u, t, M)
        b[0], b[1], b[2], b[3], b[4], b[5] = error
        b[6] = 0.0
        if not solve_kernel(M, b, _SINGULAR):
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
        if not solve_kernel(M, b, _SINGULAR):
            return False, 0.0
        size = math.sqrt(np.sum(b[:6] * b[:6]))
        for a in range(JOINTS):
            t[a] = b[a] / size
        if moving:
            _border(J, joints, u, t, M.T)
            b[:6], b[6] = 0.0, 1.0
            if not solve_kernel(M, b, _SINGULAR):
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
    model: Array, link: int, T: Frame, joints: Indices, moving: bool, way: float, start: Array,
    u0: Array, t0: Array, tolerance: float, visited: Array, seen: int, roots: Array,
) -> tuple[int, int, bool]:  # fmt: skip
    """Follow a curve from ``start`` along ``way`` t0 and write starts of its zeros into ``roots``.

    Args:
        model: ``Chain.model``.
        link: The number of the link.
        T: The pose.
        joints: The joints that move, shape (6,).
        moving: Whether u is that of the least singular value all along, else it stays.
        way: 1 or -1.
        start: A configuration on or near the curve, shape (n,); its joints move onto it.
        u0: Unit direction that is left open, shape (6,).
        t0: Unit tangent, shape (6,).
        tolerance: Zeros between which rho stays below this are one.
        visited: Where curves have been: configurations and tangents, shape (w, 12).
        seen: Rows of it that are filled.
        roots: The answer, shape (r, n).

    Returns:
        How many zeros, rows of ``visited`` that are filled, and whether the curve is closed.
    """
    n = start.shape[0]
    J, u, t = np.empty((6, n)), u0.copy(), way * t0
    q, trial = start.copy(), np.empty(n)
    u1, t1 = np.empty(6), np.empty(6)
    count = 0
    fine, rho = correct_kernel(model, link, T, joints, u, t, 0.2, q, J)
    if not fine:
        return 0, seen, False
    fine, slope = tangent_kernel(J, joints, moving, u, t)
    if not fine:
        return 0, seen, False
    origin, toward = q.copy(), t.copy()
    h, length, told, peak = _FIRST, 0.0, _TOLD, abs(rho)
    if abs(rho) < 1e-12:
        # At a zero itself rounding decides its sign: that of what follows.
        rho = math.copysign(1e-300, slope)
    for _ in range(_STEPS):
        trial[:] = q
        for k in range(JOINTS):
            trial[joints[k]] += h * t[k]
        u1[:], t1[:] = u, t
        fine, after = correct_kernel(model, link, T, joints, u1, t1, 0.5 * h + 1e-9, trial, J)
        slope1 = 0.0
        if fine:
            fine, slope1 = tangent_kernel(J, joints, moving, u1, t1)
            fine = fine and np.dot(t, t1) > _TURN and np.dot(u, u1) > _TURN
        if not fine:
            h *= 0.4
            if h < _SHORTEST:
                break
            continue
        count, peak = _between(
            model, link, T, joints, u, t, (rho, slope, after, slope1), q, trial, peak, tolerance,
            J, roots, count,
        )  # fmt: skip
        peak = max(peak, abs(after))
        length += h
        q[:], rho, slope, t[:], u[:] = trial, after, slope1, t1, u1
        told += h
        if seen < visited.shape[0] and told > _TOLD:
            told = 0.0
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
def _between(
    model: Array, link: int, T: Frame, joints: Indices, u: Array, t: Array,
    ends: tuple[float, float, float, float], a: Array, b: Array, peak: float, tolerance: float,
    J: Array, roots: Array, count: int,
) -> tuple[int, float]:  # fmt: skip
    """Add starts of the zeros between two points of a curve; how many there are, and the peak.

    ``ends`` holds rho and drho/ds of both, ``peak`` the largest |rho| since the last zero.
    """
    rho_a, slope_a, rho_b, slope_b = ends
    if (rho_a < 0.0) != (rho_b < 0.0):
        if max(peak, abs(rho_b)) > tolerance and count < roots.shape[0]:
            _zero(model, link, T, joints, u, t, a, rho_a, b, rho_b, J, roots[count])
            return count + 1, 0.0
        return count, 0.0
    if rho_a * slope_a >= 0.0 or rho_b * slope_b <= 0.0:
        return count, peak
    # |rho| is least inside.
    low, high, m, s = a.copy(), b.copy(), np.empty_like(a), np.empty(6)
    w = np.empty(6)
    rho_m = rho_a
    for _ in range(_TOUCHES):
        m[:] = 0.5 * (low + high)
        fine, rho_m = correct_kernel(model, link, T, joints, u, t, 1.0, m, J)
        if not fine or (rho_m < 0.0) != (rho_a < 0.0):
            break
        s[:], w[:] = t, u
        fine, slope = tangent_kernel(J, joints, False, w, s)
        if slope * rho_m < 0.0:
            low[:] = m
        else:
            high[:] = m
        if np.abs(high - low).max() < 1e-8:
            break
    if (rho_m < 0.0) != (rho_a < 0.0):
        if peak > tolerance and count < roots.shape[0]:
            _zero(model, link, T, joints, u, t, a, rho_a, m, rho_m, J, roots[count])
            count, peak = count + 1, 0.0
        if max(peak, abs(rho_m)) > tolerance and count < roots.shape[0]:
            _zero(model, link, T, joints, u, t, m, rho_m, b, rho_b, J, roots[count])
            count += 1
        peak = 0.0
    elif abs(rho_m) <= tolerance and peak > tolerance and count < roots.shape[0]:
        roots[count] = m
        count, peak = count + 1, 0.0
    return count, peak


@kernel
def _zero(
    model: Array, link: int, T: Frame, joints: Indices, u: Array, t: Array, a: Array, rho_a: float,
    b: Array, rho_b: float, J: Array, out: Array,
) -> None:  # fmt: skip
    """Write the zero between a and b, where rho has two signs, into ``out``."""
    low, high, left, right = 0.0, 1.0, rho_a, rho_b
    out[:] = 0.5 * (a + b)
    for k in range(_HALVINGS):
        # The false position, or the middle in turn.
        x = (low * right - high * left) / (right - left) if k % 2 == 0 else 0.5 * (low + high)
        out[:] = a + x * (b - a)
        fine, rho = correct_kernel(model, link, T, joints, u, t, 1.0, out, J)
        if not fine or abs(rho) < 1e-14:
            break
        if (rho < 0.0) == (rho_a < 0.0):
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
def joint_direction_kernel(J: Array, joints: Indices, w: Array) -> Array:
    """The unit direction of the joints (6,) that J takes to the direction w, or nearest to it."""
    M, v = np.empty((JOINTS, JOINTS)), np.zeros(JOINTS)
    for i in range(JOINTS):
        for k in range(JOINTS):
            M[i, k] = 1e-16 if i == k else 0.0
            for a in range(JOINTS):
                M[i, k] += J[i, joints[a]] * J[k, joints[a]]
    b = w.copy()
    solve_kernel(M, b, _SINGULAR)
    for a in range(JOINTS):
        for i in range(JOINTS):
            v[a] += J[i, joints[a]] * b[i]
    return v / math.sqrt(np.sum(v * v))


@kernel
def is_visited_kernel(visited: Array, seen: int, joints: Indices, q: Array, room: float) -> bool:
    """Whether a curve that was followed runs through q, or by it within ``room`` [rad]."""
    d = np.empty(JOINTS)
    for row in range(seen):
        square, along = 0.0, 0.0
        for k in range(JOINTS):
            d[k] = wrap_kernel(q[joints[k]] - visited[row, k])
            square += d[k] * d[k]
            along += d[k] * visited[row, JOINTS + k]
        if square < _LONGEST * _LONGEST:
            across = square - along * along
            limit = room + 0.2 * square
            if across < limit * limit:
                return True
    return False

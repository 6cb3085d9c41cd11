"""Decoupling for any first joints: three that place a point, and up to three axes through it.

The last joints turn about axes that meet in the wrist point W, so W depends on the first three
alone, whatever turns or slides:

    p = A_1 X_1 A_2 X_2 A_3 X_3 w,   X_i = Rz(q_i) or Tz(q_i)

With p' = A_1^-1 p and g = A_2 X_2 f(q_3), f = A_3 X_3 w, joint 1 leaves two numbers of g alone: g_z
and |g|^2 where it turns, g_x and g_y where it slides. They are linear in the point y = X_2 f that
joint 2 moves, N y = h(q_3), and what else is known of y, |y| across its axis or two of its
coordinates, is one equation in q_3: a trigonometric polynomial of degree two where joint 3 turns,
a polynomial of degree four where it slides. The wrist's angles are those of the rotation left.
An arm of two joints before its wrist gets a slide along axis 1 that stays at 0.

Source: "The kinematics of manipulators under computer control", 1968.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.structure import MEETING_TOLERANCE, PARALLEL_TOLERANCE
from kinematics.ik.ranking import distance, whole_turns
from kinematics.ik.solution import IkSolution
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain, JointType
from kinematics.pose import inverse, rotation_error, rotation_z, transform

#: Largest error of a solution [m], [rad].
TOLERANCE = 1e-9
#: Coefficients and lengths relative to those of the arm below this are rounding.
_ROUNDING = 1e-11
#: Imaginary part of a double root after rounding, relative to the arm or to the unit circle.
_DOUBLE = 1e-4
#: Configurations nearer than this are one branch that two roots gave [rad or m].
_SAME = 1e-5
#: Values of a free joint that are tried, its seed's first.
_MEMBERS = 9
#: Values of three joints without a meaning, at which only degenerate arms are singular.
_GENERIC = (0.7, 0.4, 1.1)
#: Newton's steps that take the error of double roots away.
_STEPS = 6

Solver = Callable[[Array], Iterator[tuple[float, ...]]]


@dataclass(frozen=True, slots=True, eq=False)
class Decoupled:
    """An arm whose wrist point three joints place.

    Args:
        before: Offsets A_1 to A_3, shape (3, 4, 4).
        slides: Which of the three joints slide.
        virtual: Whether the first is a slide that the arm does not have.
        w: W in the frame behind joint 3, shape (3,) [m].
        wrist: Offsets of the joints that turn about W and of the link behind, shape (k + 1, 4, 4).
        W: W in the link's frame, shape (3,) [m].
        size: Length of the arm [m].
    """

    before: Array
    slides: tuple[bool, bool, bool]
    virtual: bool
    w: Array
    wrist: Array
    W: Array
    size: float


@lru_cache(maxsize=256)
def decoupled(chain: Chain, link: str | None = None, *, position: bool = False) -> Decoupled | None:
    """The decoupling of a chain up to a link (the tip); None where it has none.

    Args:
        chain: The robot.
        link: The link; the tip where none is named.
        position: Whether its position alone is asked for, which three joints place.
    """
    carrier = chain.link(link or chain.tip_link)
    m = carrier.joint + 1
    first = 3 if position or m >= 4 else 2
    turns = chain.joint_types[:m] == JointType.REVOLUTE
    if not first <= m <= first + 3 or not turns[first:].all() or (position and m != 3):
        return None
    if first == 2 and not turns[0]:
        return None
    F = np.array([np.eye(4), *chain.offsets[:m]])
    for i in range(1, m + 1):
        F[i] = F[i - 1] @ F[i]
    end = F[m] @ carrier.T_joint_link
    point = _wrist_point(F[first + 1 :], end)
    if point is None:
        return None
    offsets = [*chain.offsets[:first]]
    slides = [not turn for turn in turns[:first]]
    if first == 2:
        offsets, slides = [offsets[0], np.eye(4), offsets[1]], [True, *slides]
    size = float(np.linalg.norm(chain.offsets[1:m, :3, 3], axis=1).sum())
    size += float(np.linalg.norm(carrier.T_joint_link[:3, 3]))
    form = Decoupled(
        np.array(offsets),
        (slides[0], slides[1], slides[2]),
        first == 2,
        _apply(inverse(F[first]), point),
        np.array([*chain.offsets[first:m], carrier.T_joint_link]),
        _apply(inverse(end), point),
        max(size, 1e-3),
    )
    return form if _places_point(form) else None


def _places_point(form: Decoupled) -> bool:
    """Whether the three joints move W in all directions, but for singular configurations."""
    columns, _ = _lever_columns(form, _GENERIC)
    return float(np.linalg.svd(columns)[1][2]) > 1e-6 * min(form.size, 1.0)


def _lever_columns(form: Decoupled, first: Sequence[float] | Array) -> tuple[Array, float]:
    """Columns of W's Jacobian as rows (3, 3), and the depth of W across axes 1 and 2 [m]."""
    T, frames = np.eye(4), []
    for A, slides, q in zip(form.before, form.slides, first, strict=True):
        frames.append(T @ A)
        T = frames[-1] @ transform(
            np.eye(3) if slides else rotation_z(q), [0.0, 0.0, q] if slides else None
        )
    z, p = np.array(frames)[:, :3, 2], np.array(frames)[:, :3, 3]
    W = _apply(T, form.w)
    J = np.where(np.array(form.slides)[:, None], z, np.cross(z, W - p))
    return J, float(np.cross(z[0], z[1]) @ (W - p[1]))


def _branch(form: Decoupled, first: Array, hand: str) -> str:
    """Name of a branch, such as "shoulder+ elbow- wrist+".

    A sign is that of the factor of the Jacobian's determinant which vanishes where this branch and
    its opposite meet, as far as it has factors: of the depth of W across axes 1 and 2 where both
    turn, and of the determinant of W's Jacobian divided by that.
    """
    J, depth = _lever_columns(form, first)
    names = []
    sign = float(np.linalg.det(J))
    if not any(form.slides[:2]) and abs(depth) > _ROUNDING:
        names.append(f"shoulder{'+' if depth > 0.0 else '-'}")
        sign *= depth
    if not all(form.slides):
        names.append(f"elbow{'+' if sign > 0.0 else '-'}")
    return " ".join([*names, hand] if hand else names)


def _wrist_point(F: Array, end: Array) -> Array | None:
    """The point that the axes z of frames have in common; the link's origin where there are none.

    Args:
        F: Frames of the wrist's joints, shape (k, 4, 4).
        end: Frame of the link.
    """
    if len(F) == 0:
        return np.asarray(end[:3, 3])
    if len(F) == 1:
        return np.asarray(F[0, :3, 3])
    z, p = F[:, :3, 2], F[:, :3, 3]
    if (np.linalg.norm(np.cross(z[:-1], z[1:]), axis=1) <= PARALLEL_TOLERANCE).any():
        return None
    across = np.eye(3) - z[:, :, None] * z[:, None, :]
    point = np.linalg.lstsq(across.sum(0), np.einsum("kij,kj->i", across, p), rcond=None)[0]
    away = np.einsum("kij,kj->ki", across, point - p)
    return point if np.linalg.norm(away, axis=1).max() <= MEETING_TOLERANCE else None


def solutions(
    chain: Chain, form: Decoupled, target: Array, near: Array, *, link: str | None, position: bool
) -> tuple[list[IkSolution], bool]:
    """All branches for a pose, and whether that is all: no joint is free to move under it.

    Those outside the limits are among them. Where a joint is free (W on axis 1, a straight wrist)
    one configuration stands for all of them: the seed's value if that is inside the limits.

    Args:
        chain: The robot.
        form: Its decoupling.
        target: T_base_link, shape (4, 4).
        near: Configuration that whole turns and free joints are near to, shape (n,).
        link: The link to bring there; the tip where none is named.
        position: Whether its position alone counts.
    """
    found: list[IkSolution] = []
    free = False
    frames = target @ np.array([*form.W, 1.0])
    scale = max(form.size, float(np.linalg.norm(frames[:3])))
    near_arm = np.array([0.0, near[0], near[1]]) if form.virtual else near[:3]
    for first, free_arm in _arms(form, frames[:3], near_arm, scale):
        for last, free_wrist, hand in _hands(form, first, target, near):
            q = near.copy()
            values = [*first[int(form.virtual) :], *last]
            q[: len(values)] = values
            q, errors = _polish(chain, q, target, link, position)
            if max(errors) > TOLERANCE or (form.virtual and abs(first[0]) > _SAME * scale):
                continue
            copies = whole_turns(chain, q, 1, near)
            q = copies[0] if len(copies) else q
            if any(distance(chain, q, other.joints) < _SAME for other in found):
                continue
            free = free or free_arm or free_wrist
            q.setflags(write=False)
            found.append(IkSolution(q, *errors, 0, _branch(form, first, hand), len(copies) > 0))
    return found, not free


# ------------------------------------------------------------------------------ first three joints


def _arms(form: Decoupled, p: Array, near: Array, scale: float) -> Iterator[tuple[Array, bool]]:
    """Values of the first three joints that bring W to p, and whether one of them is free."""
    A2, A3 = form.before[1], form.before[2]
    p = _apply(inverse(form.before[0]), p)
    first, second, third = form.slides

    def f(q3: Array) -> Array:
        return _apply(A3, _moved(third, q3, form.w))

    o, R = A2[:3, 3], A2[:3, :3]
    N = R[:2, :] if first else np.array([R[2, :], 2.0 * (R.T @ o)])

    def h(q3: Array) -> Array:
        """Right side of N y = h, shape (..., 2)."""
        if first:
            return np.broadcast_to(p[:2] - o[:2], (*q3.shape, 2))
        length = (f(q3) ** 2).sum(axis=-1)
        rest = p @ p - o @ o - length
        return np.stack([np.full_like(rest, p[2] - o[2]), rest], axis=-1)

    for q3, free3 in _thirds(form, f, h, N, near[2], scale):
        for q2, free2 in _seconds(second, f(q3), h(q3), N, near[1], scale, slides_first=first):
            g = _apply(A2, _moved(second, q2, f(q3)))
            if first:
                yield np.array([p[2] - g[2], float(q2), float(q3)]), free2 or free3
                continue
            lever = min(np.hypot(g[0], g[1]), np.hypot(p[0], p[1]))
            turn = math.atan2(p[1], p[0]) - math.atan2(g[1], g[0])
            free1 = bool(lever <= 1e-7 * scale)
            for q1 in _members(near[0]) if free1 else [turn]:
                yield np.array([q1, float(q2), float(q3)]), free1 or free2 or free3


def _thirds(
    form: Decoupled,
    f: Callable[[Array], Array],
    h: Callable[[Array], Array],
    N: Array,
    near: float,
    scale: float,
) -> Iterator[tuple[NDArray[np.float64], bool]]:
    """Values of joint 3 at which some y solves N y = h."""
    slides_first, second, third = form.slides

    def residual(q3: Array) -> Array:
        fv, hv = f(q3), h(q3)
        if second:
            # y = f + d z: d is between the two equations.
            if slides_first or abs(N[0, 2]) > _ROUNDING:
                e = hv - fv @ N.T
                if slides_first:
                    return np.asarray(N[1, 2] * e[..., 0] - N[0, 2] * e[..., 1])
                d = e[..., 0] / N[0, 2]
                return np.asarray(e[..., 1] - N[1, 2] * d - 2.0 * fv[..., 2] * d - d * d)
            return np.asarray(hv[..., 0] - fv @ N[0])
        hv = hv - fv[..., 2:] * N[:, 2]
        n = N[:, :2]
        square = fv[..., 0] ** 2 + fv[..., 1] ** 2
        determinant = n[0, 0] * n[1, 1] - n[0, 1] * n[1, 0]
        if abs(determinant) <= _ROUNDING * max(float(np.abs(n).max()) ** 2, 1e-30):
            U = np.linalg.svd(n)[0]
            return np.asarray(hv @ U[:, 1])
        y = np.stack(
            [n[1, 1] * hv[..., 0] - n[0, 1] * hv[..., 1],
             n[0, 0] * hv[..., 1] - n[1, 0] * hv[..., 0]], axis=-1,
        )  # fmt: skip
        return np.asarray((y**2).sum(axis=-1) - determinant**2 * square)

    roots = _slide_roots(residual, scale) if third else _turn_roots(residual)
    if roots is None:
        for q3 in _members(near) if not third else [near]:
            yield np.asarray(q3), True
        return
    for q3 in roots:
        yield np.asarray(q3), False


def _turn_roots(residual: Callable[[Array], Array]) -> Array | None:
    """Zeros of a trigonometric polynomial of degree two; None where it vanishes everywhere."""
    samples = residual(np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False))
    c = np.fft.fft(samples) / 8.0
    coefficients = np.array([c[2], c[1], c[0], c[-1], c[-2]])
    largest = np.abs(coefficients).max()
    if largest <= _ROUNDING**2 or np.abs(samples).max() <= 1e-14:
        return None
    coefficients[np.abs(coefficients) <= 1e-14 * largest] = 0.0
    z = np.roots(coefficients)
    z = z[np.abs(np.abs(z) - 1.0) < _DOUBLE * 10.0]
    return np.asarray(np.angle(z), dtype=np.float64)


def _slide_roots(residual: Callable[[Array], Array], scale: float) -> Array | None:
    """Zeros of a polynomial of degree four; None where it vanishes everywhere."""
    at = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    samples = residual(at * scale)
    if np.abs(samples).max() <= 1e-14:
        return None
    coefficients = np.linalg.solve(np.vander(at), samples)
    coefficients[np.abs(coefficients) <= 1e-13 * np.abs(coefficients).max()] = 0.0
    d = np.roots(coefficients)
    return np.asarray(d.real[np.abs(d.imag) < _DOUBLE * 10.0] * scale)


def _seconds(
    slides: bool, f: Array, h: Array, N: Array, near: float, scale: float, *, slides_first: bool
) -> Iterator[tuple[NDArray[np.float64], bool]]:
    """Values of joint 2 for one of joint 3."""
    if slides:
        e = h - N @ f
        if slides_first:
            n = N[:, 2]
            if n @ n > _ROUNDING:
                yield np.asarray((n @ e) / (n @ n)), False
            return
        if abs(N[0, 2]) > _ROUNDING:
            yield np.asarray(e[0] / N[0, 2]), False
            return
        half = 0.5 * N[1, 2] + f[2]
        square = half * half + e[1]
        if square > -_DOUBLE * scale * scale:
            root = math.sqrt(max(square, 0.0))
            yield np.asarray(-half + root), False
            yield np.asarray(-half - root), False
        return
    lever = math.hypot(f[0], f[1])
    if lever <= 1e-9 * scale:
        for q2 in _members(near):
            yield np.asarray(q2), True
        return
    n, rest = N[:, :2], h - N[:, 2] * f[2]
    U, s, Vt = np.linalg.svd(n)
    u = U.T @ rest
    if s[0] <= _ROUNDING:
        return
    if s[1] > 1e-9 * s[0]:
        ys = [Vt.T @ (u / s)]
    else:
        along = u[0] / s[0]
        square = lever * lever - along * along
        if square < -_DOUBLE * scale * scale:
            return
        side = math.sqrt(max(square, 0.0))
        ys = [Vt.T @ np.array([along, side]), Vt.T @ np.array([along, -side])]
    for y in ys:
        yield np.asarray(math.atan2(y[1], y[0]) - math.atan2(f[1], f[0])), False


# ------------------------------------------------------------------------------ wrist


def _hands(
    form: Decoupled, first: Array, target: Array, near: Array
) -> Iterator[tuple[list[float], bool, str]]:
    """Angles of the wrist behind the first joints, whether one of them is free, its name."""
    k = len(form.wrist) - 1
    if k == 0:
        yield [], False, ""
        return
    R = np.eye(3)
    for A, slides, q in zip(form.before, form.slides, first, strict=True):
        R = R @ A[:3, :3] @ (np.eye(3) if slides else rotation_z(q))
    M = (R @ form.wrist[0, :3, :3]).T @ target[:3, :3] @ form.wrist[k, :3, :3].T
    if k == 1:
        yield [math.atan2(M[1, 0], M[0, 0])], False, ""
        return
    B = form.wrist[1, :3, :3]
    if k == 2:
        a = math.atan2(M[1, 2], M[0, 2]) - math.atan2(B[1, 2], B[0, 2])
        rest = (rotation_z(a) @ B).T @ M
        yield [a, math.atan2(rest[1, 0], rest[0, 0])], False, ""
        return
    C = form.wrist[2, :3, :3]
    # The z column: u . Rz(b) v = M_zz with u = B^T z and v = C z.
    u, v = B[2, :], C[:, 2]
    cosine, sine = u[0] * v[0] + u[1] * v[1], u[1] * v[0] - u[0] * v[1]
    amplitude, d = math.hypot(cosine, sine), M[2, 2] - u[2] * v[2]
    if amplitude <= _ROUNDING or abs(d) > amplitude + _DOUBLE:
        return
    middle = math.atan2(sine, cosine)
    half = math.acos(min(max(d / amplitude, -1.0), 1.0))
    straight = math.hypot(M[0, 2], M[1, 2]) <= 1e-7
    for b, name in ((middle + half, "wrist+"), (middle - half, "wrist-"))[: 1 if straight else 2]:
        t = B @ rotation_z(b) @ v
        turn = math.atan2(M[1, 2], M[0, 2]) - math.atan2(t[1], t[0])
        offset = len(near[: 2 if form.virtual else 3])
        for a in _members(near[offset]) if straight else [turn]:
            rest = (rotation_z(a) @ B @ rotation_z(b) @ C).T @ M
            yield [a, b, math.atan2(rest[1, 0], rest[0, 0])], straight, name


# ------------------------------------------------------------------------------ small parts


def _members(near: float) -> list[float]:
    """Values of a free angle, that of the seed first."""
    return [near + 2.0 * math.pi * i / _MEMBERS for i in range(_MEMBERS)]


def _apply(T: Array, v: Array) -> Array:
    return np.asarray(v @ T[:3, :3].T + T[:3, 3])


def _moved(slides: bool, q: NDArray[np.float64], v: Array) -> Array:
    """Points v (3,) moved by a joint with values q (...), shape (..., 3)."""
    if slides:
        return np.asarray(v + np.multiply.outer(q, [0.0, 0.0, 1.0]))
    c, s = np.cos(q), np.sin(q)
    return np.stack([c * v[0] - s * v[1], s * v[0] + c * v[1], np.full_like(c, v[2])], axis=-1)


def _polish(
    chain: Chain, q: Array, target: Array, link: str | None, position: bool
) -> tuple[Array, tuple[float, float]]:
    """Newton's steps towards the pose, and the errors left [m], [rad]."""
    rows = 3 if position else 6
    best, least = q, (math.inf, math.inf)
    for _ in range(_STEPS):
        T = forward(chain, q, link)
        turn = rotation_error(T[:3, :3], target[:3, :3])
        e = np.concatenate([target[:3, 3] - T[:3, 3], turn])
        errors = (float(np.linalg.norm(e[:3])), 0.0 if position else float(np.linalg.norm(e[3:])))
        if max(errors) < max(least):
            best, least = q, errors
        if max(errors) < 1e-13 or max(errors) > 0.1:
            break
        q = q + np.linalg.lstsq(geometric(chain, q, link)[:rows], e[:rows], rcond=1e-9)[0]
    return best.copy(), least

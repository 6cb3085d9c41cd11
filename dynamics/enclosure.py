"""Bounds of torque and tool speed that hold for every instant of a stretch of motion.

Over a stretch of time t + h d, -1 <= d <= 1, each quantity is enclosed by a line in d and a radius,

    x(d) in x_0 + x_1 d + [-r, r].

Sums, products and sines of such enclosures are enclosures again, with what is of second order in d
gone into the radius, so that the radius shrinks with the square of h (first-order Taylor models,
"Rigorous global search: continuous problems", 1996). The Newton-Euler recursion is run on them, in
the joints' own frames. Rounding, 1e-12 of the bounds, is not accounted for.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from compiled.vec3 import add, load
from dynamics.model.body import Bodies, bodies
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.trajectory.polynomial import shift_kernel
from kinematics.trajectory.trajectory import Trajectory

#: Enclosures looked at for one answer, at most: a second of work.
MAX_CELLS = 100_000
#: Share by which a bound may exceed the largest value found.
_SHARP = 1e-3

Enclosure = tuple[float, float, float]
Vector = tuple[Enclosure, Enclosure, Enclosure]


@kernel
def scale(k: float, x: Enclosure) -> Enclosure:
    """The multiple k x for a number k."""
    return k * x[0], k * x[1], abs(k) * x[2]


@kernel(allocates=False)
def multiply(x: Enclosure, y: Enclosure) -> Enclosure:
    """The product x y; half of the slopes' product goes to the middle."""
    bend = 0.5 * x[1] * y[1]
    radius = (
        abs(bend) + (abs(x[0]) + abs(x[1])) * y[2] + (abs(y[0]) + abs(y[1])) * x[2] + x[2] * y[2]
    )
    return x[0] * y[0] + bend, x[0] * y[1] + x[1] * y[0], radius


@kernel(allocates=False)
def sine_cosine(x: Enclosure) -> tuple[Enclosure, Enclosure]:
    """The sine and cosine of x, by their tangents and the largest second derivative, 1."""
    s, c = math.sin(x[0]), math.cos(x[0])
    bend = 0.5 * (abs(x[1]) + x[2]) ** 2
    return (s, c * x[1], abs(c) * x[2] + bend), (c, -s * x[1], abs(s) * x[2] + bend)


@kernel
def plus(u: Vector, v: Vector) -> Vector:
    """The sum u + v."""
    return add(u[0], v[0]), add(u[1], v[1]), add(u[2], v[2])


@kernel
def cross(u: Vector, v: Vector) -> Vector:
    """The cross product u x v."""
    return (
        add(multiply(u[1], v[2]), scale(-1.0, multiply(u[2], v[1]))),
        add(multiply(u[2], v[0]), scale(-1.0, multiply(u[0], v[2]))),
        add(multiply(u[0], v[1]), scale(-1.0, multiply(u[1], v[0]))),
    )


@kernel(allocates=False)
def combine(a: float, b: float, c: float, v: Vector) -> Enclosure:
    """The sum a v_x + b v_y + c v_z for numbers a, b, c."""
    return add(add(scale(a, v[0]), scale(b, v[1])), scale(c, v[2]))


@kernel(allocates=False)
def cross_constant(v: Vector, a: float, b: float, c: float) -> Vector:
    """The cross product v x (a, b, c) for numbers a, b, c."""
    return (
        add(scale(c, v[1]), scale(-b, v[2])),
        add(scale(a, v[2]), scale(-c, v[0])),
        add(scale(b, v[0]), scale(-a, v[1])),
    )


@kernel(allocates=False)
def to_joint(A: Array, s: Enclosure, c: Enclosure, v: Vector) -> Vector:
    """A vector of the frame before a joint in the frame behind it: Rz(q)^T R_A^T v."""
    x = combine(A[0, 0], A[1, 0], A[2, 0], v)
    y = combine(A[0, 1], A[1, 1], A[2, 1], v)
    z = combine(A[0, 2], A[1, 2], A[2, 2], v)
    return (
        add(multiply(c, x), multiply(s, y)),
        add(multiply(c, y), scale(-1.0, multiply(s, x))),
        z,
    )


@kernel(allocates=False)
def to_parent(A: Array, s: Enclosure, c: Enclosure, v: Vector) -> Vector:
    """The other way: R_A Rz(q) v."""
    x = add(multiply(c, v[0]), scale(-1.0, multiply(s, v[1])))
    y = add(multiply(s, v[0]), multiply(c, v[1]))
    turned = (x, y, v[2])
    return (
        combine(A[0, 0], A[0, 1], A[0, 2], turned),
        combine(A[1, 0], A[1, 1], A[1, 2], turned),
        combine(A[2, 0], A[2, 1], A[2, 2], turned),
    )


@kernel(allocates=False)
def motion_kernel(c: Array, shifted: Array, time: float, h: float) -> Vector:
    """Position, velocity and acceleration of the polynomial c over time +- h."""
    shift_kernel(c, time, shifted)
    p, v, a = shifted[0], 0.0, 0.0
    p1, v1, a1 = 0.0, 0.0, 0.0
    pr, vr, ar = 0.0, 0.0, 0.0
    power = 1.0
    for k in range(1, c.shape[0]):
        # d^k, d^(k-1), d^(k-2) with their factors; h^(k-2), h^(k-1), h^k in turn.
        if k == 1:
            v, p1 = shifted[1], shifted[1] * h
            continue
        x, y = k * shifted[k], k * (k - 1.0) * shifted[k]
        if k == 2:
            a, v1 = y, x * h
        elif k == 3:
            a1 = y * h
        else:
            ar += abs(y) * power
        if k > 2:
            vr += abs(x) * power * h
        pr += abs(shifted[k]) * power * h * h
        power *= h
    return (p, p1, pr), (v, v1, vr), (a, a1, ar)


@kernel(allocates=False)
def enclosure_kernel(
    bodies: Bodies, tip: Array, motions: Array, vectors: Array, out: Array
) -> Enclosure:
    """Write the enclosures of the torques (n, 3); answer that of the tip's squared speed.

    Args:
        bodies: The robot.
        tip: The tip's place in the last joint's frame, shape (3,).
        motions: Enclosures of q, q_dot and q_ddot, shape (n, 3, 3).
        vectors: Room for forces and moments, shape (2, n, 3, 3).
        out: Shape (n, 3).
    """
    n = motions.shape[0]
    zero = (0.0, 0.0, 0.0)
    still = (zero, zero, zero)
    w, dw, v = still, still, still
    g = bodies.gravity
    a = ((-g[0], 0.0, 0.0), (-g[1], 0.0, 0.0), (-g[2], 0.0, 0.0))
    for i in range(n):
        A = bodies.offsets[i]
        q, qd, qdd = _load(motions[i])
        px, py, pz = A[0, 3], A[1, 3], A[2, 3]
        turns = bodies.types[i] == 0
        if turns:
            s, c = sine_cosine(q)
            arm_speed = cross_constant(w, px, py, pz)
            a = plus(a, plus(cross_constant(dw, px, py, pz), cross(w, arm_speed)))
        else:
            s, c = zero, (1.0, 0.0, 0.0)
            arm = (
                add((px, 0.0, 0.0), scale(A[0, 2], q)),
                add((py, 0.0, 0.0), scale(A[1, 2], q)),
                add((pz, 0.0, 0.0), scale(A[2, 2], q)),
            )
            arm_speed = cross(w, arm)
            a = plus(a, plus(cross(dw, arm), cross(w, arm_speed)))
        v = to_joint(A, s, c, plus(v, arm_speed))
        a, w, dw = to_joint(A, s, c, a), to_joint(A, s, c, w), to_joint(A, s, c, dw)
        if turns:
            # w x z qd = (w_y, -w_x, 0) qd.
            turn = (multiply(w[1], qd), scale(-1.0, multiply(w[0], qd)), qdd)
            dw = plus(dw, turn)
            w = (w[0], w[1], add(w[2], qd))
        else:
            coriolis = (
                scale(2.0, multiply(w[1], qd)),
                scale(-2.0, multiply(w[0], qd)),
                qdd,
            )
            a = plus(a, coriolis)
            v = (v[0], v[1], add(v[2], qd))
        m, b, tensor = bodies.masses[i], bodies.centers[i], bodies.tensors[i]
        swing = cross(w, cross_constant(w, b[0], b[1], b[2]))
        center = plus(a, plus(cross_constant(dw, b[0], b[1], b[2]), swing))
        force = (scale(m, center[0]), scale(m, center[1]), scale(m, center[2]))
        turning = (
            combine(tensor[0, 0], tensor[0, 1], tensor[0, 2], w),
            combine(tensor[1, 0], tensor[1, 1], tensor[1, 2], w),
            combine(tensor[2, 0], tensor[2, 1], tensor[2, 2], w),
        )
        gaining = (
            combine(tensor[0, 0], tensor[0, 1], tensor[0, 2], dw),
            combine(tensor[1, 0], tensor[1, 1], tensor[1, 2], dw),
            combine(tensor[2, 0], tensor[2, 1], tensor[2, 2], dw),
        )
        moment = plus(gaining, cross(w, turning))
        # b x force = -(force x b).
        moment = plus(moment, cross_constant(force, -b[0], -b[1], -b[2]))
        _store(vectors[0, i], force)
        _store(vectors[1, i], moment)
    v = plus(v, cross_constant(w, tip[0], tip[1], tip[2]))
    _torques_kernel(bodies, motions, vectors, out)
    return add(add(multiply(v[0], v[0]), multiply(v[1], v[1])), multiply(v[2], v[2]))


@kernel(allocates=False)
def _torques_kernel(bodies: Bodies, motions: Array, vectors: Array, out: Array) -> None:
    """From the forces and moments that move the bodies to those at the joints, from the tip."""
    zero = (0.0, 0.0, 0.0)
    still = (zero, zero, zero)
    force, moment = still, still
    for i in range(motions.shape[0] - 1, -1, -1):
        force = plus(force, _load(vectors[0, i]))
        moment = plus(moment, _load(vectors[1, i]))
        q, qd, qdd = _load(motions[i])
        turns = bodies.types[i] == 0
        torque = moment[2] if turns else force[2]
        torque = add(torque, scale(bodies.motor_inertia[i], qdd))
        torque = add(torque, scale(bodies.viscous_friction[i], qd))
        out[i, 0], out[i, 1], out[i, 2] = torque
        A = bodies.offsets[i]
        if turns:
            s, c = sine_cosine(q)
        else:
            s, c = zero, (1.0, 0.0, 0.0)
        force, moment = to_parent(A, s, c, force), to_parent(A, s, c, moment)
        arm = ((A[0, 3], 0.0, 0.0), (A[1, 3], 0.0, 0.0), (A[2, 3], 0.0, 0.0))
        if not turns:
            arm = plus(arm, (scale(A[0, 2], q), scale(A[1, 2], q), scale(A[2, 2], q)))
        moment = plus(moment, cross(arm, force))


@kernel
def _store(room: Array, v: Vector) -> None:
    for k in range(3):
        room[0, k], room[1, k], room[2, k] = v[0][k], v[1][k], v[2][k]


@kernel
def _load(room: Array) -> Vector:
    return load(room[0], 0), load(room[1], 0), load(room[2], 0)


@kernel
def bounds_kernel(
    bodies: Bodies,
    tip: Array,
    breaks: Array,
    coefficients: Array,
    cells: Array,
    torques: Array,
    speeds: Array,
) -> None:
    """Write enclosures over cells of time.

    Args:
        bodies: The robot.
        tip: The tip's place in the last joint's frame, shape (3,).
        breaks: Breaks of the trajectory, shape (m + 1,).
        coefficients: Coefficients of the trajectory, shape (m, n, k).
        cells: (piece, middle, half length) of each, shape (c, 3).
        torques: The enclosures found, shape (c, n, 3).
        speeds: Enclosures of the tip's squared speed, shape (c, 3).
    """
    n, size = coefficients.shape[1:]
    motions, shifted = np.empty((n, 3, 3)), np.empty(size)
    vectors = np.empty((2, n, 3, 3))
    for k in range(cells.shape[0]):
        piece = int(cells[k, 0])
        for j in range(n):
            motion = motion_kernel(
                coefficients[piece, j], shifted, cells[k, 1] - breaks[piece], cells[k, 2]
            )
            _store(motions[j], motion)
        square = enclosure_kernel(bodies, tip, motions, vectors, torques[k])
        speeds[k, 0], speeds[k, 1], speeds[k, 2] = square


class Use(NamedTuple):
    """Largest use of a limit.

    Args:
        ratio: Never exceeded at any instant.
        reached: Exceeded at some instant, a thousandth less as a rule.
        joint: Index of the joint.
        time: Approximate time of the largest use [s].
    """

    ratio: float
    reached: float
    joint: int
    time: float


def torque_use(chain: Chain, trajectory: Trajectory, effort: ArrayLike) -> Use:
    """The largest |torque| / limit of all joints over all of a motion.

    Args:
        chain: The robot, what it carries included.
        trajectory: Trajectory of the joints.
        effort: Limits, shape (n,), inf where there is none [N m or N].

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
    """
    limits = np.asarray(effort, dtype=np.float64)[:, None]
    use = _Search(bodies(chain), np.zeros(3), trajectory)
    return use.worst(lambda torques, _: torques / limits)


def tool_speed_use(chain: Chain, trajectory: Trajectory, speed: float) -> Use:
    """The largest speed of the tip's origin over a limit [m/s], over a motion; joint is unused."""
    tip = chain.tip
    n = tip.joint + 1
    if n == 0:
        return Use(0.0, 0.0, 0, 0.0)
    none = np.zeros(n)
    light = Bodies(
        chain.joint_types[:n], chain.offsets[:n], none, np.zeros((n, 3)), np.zeros((n, 3, 3)),
        none, none, np.zeros(3), np.zeros((1, 1)),
    )  # fmt: skip
    use = _Search(light, np.array(tip.T_joint_link[:3, 3]), trajectory)
    found = use.worst(lambda _, squares: squares[:, None] / speed**2)
    return found._replace(ratio=math.sqrt(found.ratio), reached=math.sqrt(found.reached))


class _Search:
    """Cells of time, halved where what is not known of them could still be the largest."""

    def __init__(self, packed: Bodies, tip: Array, trajectory: Trajectory) -> None:
        self._bodies, self._tip, self._trajectory = packed, tip, trajectory
        self._coefficients = np.ascontiguousarray(trajectory.coefficients[:, : len(packed.types)])

    def worst(self, ratios: Callable[[Array, Array], Array]) -> Use:
        """The worst of ratios (c, k, 3), enclosures computed from torques and squared speeds."""
        breaks = self._trajectory.breaks
        half = 0.5 * np.diff(breaks)
        cells = np.column_stack([np.arange(len(half)), breaks[:-1] + half, half])
        reached, settled, joint, time, visited = 0.0, 0.0, 0, 0.0, 0
        while len(cells):
            visited += len(cells)
            found = ratios(*self._enclosures(cells))
            middle, slope, radius = np.moveaxis(found, -1, 0)
            low = (np.abs(middle) - radius).max(axis=1)
            high = np.abs(middle) + np.abs(slope) + radius
            top = high.max(axis=1)
            best = int(np.argmax(low))
            if low[best] > reached:
                reached, time = float(low[best]), float(cells[best, 1])
                joint = int(np.argmax(np.abs(middle[best]) - radius[best]))
            enough = (top <= (1.0 + _SHARP) * reached) | (visited > MAX_CELLS)
            settled = max(settled, float(top[enough].max(initial=0.0)))
            cells = _halves(cells[~enough])
        return Use(settled, reached, joint, time)

    def _enclosures(self, cells: Array) -> tuple[Array, Array]:
        torques = np.empty((len(cells), len(self._bodies.types), 3))
        speeds = np.empty((len(cells), 3))
        bounds_kernel(
            self._bodies, self._tip, self._trajectory.breaks, self._coefficients,
            np.ascontiguousarray(cells), torques, speeds,
        )  # fmt: skip
        return torques, speeds


def _halves(cells: Array) -> Array:
    half = 0.5 * cells[:, 2:]
    step = np.concatenate([np.zeros_like(half), half, np.zeros_like(half)], axis=1)
    smaller = cells.copy()
    smaller[:, 2:] = half
    return np.concatenate([smaller - step, smaller + step])

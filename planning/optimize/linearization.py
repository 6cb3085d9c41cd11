"""Linearization of a motion at checkpoints: distances, efforts, constraints.

Each is a function h(z) that must not exceed 0, with the room it has in a unit of its own; between
two convex problems they are looked at anew.

Torques and the tool's speed along a motion, and how they change with it.

CasADi writes down the Newton-Euler recursion and differentiates it once for each robot; the
function is kept and called through buffers.

Linear rows in the unknowns z = (control points, duration T, slack s).

Limits hold by the control points of the derivatives, |D_r P| <= limit_r T^r. T^r lies above its
tangent, so the tangent in its place keeps the rows linear and on the safe side. What is not linear
in the control points (distances, torques, constraints) is linearised at places along the motion,
and may be violated by the slack s >= 0 that all of them share.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
import scipy.sparse

from dynamics.inverse import inverse_dynamics
from dynamics.symbolic import symbolic_inverse_dynamics
from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.model.chain import Chain
from kinematics.symbolic import symbolic_jacobian
from planning.constrained.checker import ConstrainedChecker, narrow_rows
from planning.constraints.row import Column
from planning.optimize.iterate import Iterate
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Obstruction, Task
from planning.values.deadline import Deadline

#: Its stubs know no stacks of sparse and dense matrices.
sparse: Any = scipy.sparse


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """lower <= A z <= upper.

    Args:
        A: Sparse, R x (N n + 2).
        lower: Shape (R,).
        upper: Shape (R,).
    """

    A: Any
    lower: Array
    upper: Array

    @classmethod
    def below(cls, A: Any, upper: Array) -> "Rows":
        """A z <= upper."""
        return cls(A, np.full(len(upper), -np.inf), upper)


def stack_rows(blocks: Sequence[Rows]) -> Rows:
    """All rows of several blocks."""
    return Rows(
        sparse.vstack([block.A for block in blocks], format="csc"),
        np.concatenate([block.lower for block in blocks]),
        np.concatenate([block.upper for block in blocks]),
    )


def limit_rows(task: Task, iterate: Iterate, hair: float) -> list[Rows]:
    """The limits of velocity, acceleration and jerk, ``hair`` (a share) below what is allowed."""
    blocks, T = [], iterate.duration
    for order, limits in task.orders.items():
        D = _scaled_differences(iterate.space, order, tuple(limits.tolist()))
        # Divided by the limit and T^r: |D P / T^r| - r T'/T <= 1 - r.
        count, power = D.shape[0], T**order
        time = np.full((count, 1), -order / T * (1.0 - hair))
        upper = np.full(count, (1.0 - order) * (1.0 - hair))
        none = np.zeros((count, 1))
        for sign in (1.0, -1.0):
            A = sparse.hstack([sign / power * D, time, none])
            blocks.append(Rows.below(A, upper))
    return blocks


@bounded_cache(maxsize=32)
def _scaled_differences(space: SplineSpace, order: int, limits: tuple[float, ...]) -> Any:
    D = sparse.csr_matrix(space.differences[order - 1])
    return sparse.kron(D, sparse.diags(1.0 / np.array(limits)), format="csr")


def end_rows(iterate: Iterate, start: End, end: End) -> list[Rows]:
    """Velocity and acceleration at ends that are not at rest, D_r P = value T^r linearised."""
    blocks = []
    for place, given in ((0, start), (-1, end)):
        if given.still:
            continue
        for order, value in enumerate(given.derivatives[1:], start=1):
            blocks.append(_end_row(iterate, place, order, value))
    return blocks


def _end_row(iterate: Iterate, place: int, order: int, value: Array) -> Rows:
    n, T = iterate.points.shape[1], iterate.duration
    D = sparse.csr_matrix(iterate.space.differences[order - 1][[place]] / T**order)
    A = sparse.hstack(
        [sparse.kron(D, sparse.identity(n)), -(order / T * value)[:, None], np.zeros((n, 1))]
    )
    known = (1.0 - order) * value
    return Rows(A, known, known)


def local_matrix(
    iterate: Iterate,
    places: Array,
    gradients: Sequence[Array],
    in_time: Array | None = None,
    in_slack: float = 0.0,
) -> Any:
    """Derivatives  sum_r g_r . (B_r P) + c T + k s  of what is looked at along the motion.

    Args:
        iterate: Iterate at which it is linearised.
        places: u of each row, shape (R,).
        gradients: Gradients with respect to q, dq/du, d2q/du2 as far as they count, shape (R, n)
            each.
        in_time: c, shape (R,).
        in_slack: k.

    Returns:
        Sparse, R x (N n + 2).
    """
    space, (N, n), R = iterate.space, iterate.points.shape, len(places)
    width = (space.degree + 1) * n
    values = np.zeros((R, space.degree + 1, n))
    first: Indices = np.zeros(R, dtype=np.int64)
    for order, g in enumerate(gradients):
        first, basis = space.basis(places, order)
        values += basis[:, :, None] * g[:, None, :]
    columns = first[:, None] * n + np.arange(width)
    time = np.zeros(R) if in_time is None else in_time
    entries = np.column_stack([values.reshape(R, width), time, np.full(R, in_slack)])
    columns = np.column_stack([columns, np.broadcast_to([N * n, N * n + 1], (R, 2))])
    starts = np.arange(R + 1) * (width + 2)
    shape = (R, N * n + 2)
    return sparse.csr_matrix((entries.ravel(), columns.ravel(), starts), shape=shape)


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Values at places along a motion, and their derivatives (m values, K places, n joints).

    Args:
        values: Shape (K, m).
        gradients: Gradients with respect to q, dq/du, d2q/du2, shape (K, m, n) each.
        in_time: Derivatives with respect to the duration, shape (K, m).
    """

    values: Array
    gradients: tuple[Array, Array, Array]
    in_time: Array


def torques(chain: Chain, iterate: Iterate, places: Array) -> Response:
    """Joint torques [N m or N], m = n.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
    """
    return _response(_torque_function(chain), chain.n, iterate, places)


def tool_speed(chain: Chain, iterate: Iterate, places: Array) -> Response:
    """The speed of the tip's origin [m/s], m = 1."""
    return _response(_speed_function(chain), 1, iterate, places)


def _response(function: Any, m: int, iterate: Iterate, places: Array) -> Response:
    q, q1, q2 = (iterate.sample(places, order) for order in range(3))
    T, (K, n) = iterate.duration, q.shape
    states = np.concatenate([q, q1 / T, q2 / T**2], axis=1)
    state, value, slope = np.empty(3 * n), np.empty(m), np.empty((3 * n, m))
    buffer, run = function.buffer()
    buffer.set_arg(0, state.data)
    buffer.set_res(0, value.data)
    buffer.set_res(1, slope.reshape(-1).data)
    values, slopes = np.empty((K, m)), np.empty((K, 3 * n, m))
    for k in range(K):
        state[:] = states[k]
        run()
        values[k], slopes[k] = value, slope
    J = slopes.transpose(0, 2, 1)
    by_velocity, by_acceleration = J[:, :, n : 2 * n], J[:, :, 2 * n :]
    in_time = -np.einsum("kmn,kn->km", by_velocity, q1) / T**2
    in_time -= 2.0 * np.einsum("kmn,kn->km", by_acceleration, q2) / T**3
    return Response(values, (J[:, :, :n], by_velocity / T, by_acceleration / T**2), in_time)


@bounded_cache(maxsize=16)
def _torque_function(chain: Chain) -> Any:
    z = casadi.SX.sym("z", 3 * chain.n)
    q, qd, qdd = casadi.vertsplit(z, chain.n)
    return _function(z, symbolic_inverse_dynamics(chain, q, qd, qdd))


@bounded_cache(maxsize=16)
def _speed_function(chain: Chain) -> Any:
    z = casadi.SX.sym("z", 3 * chain.n)
    q, qd, _ = casadi.vertsplit(z, chain.n)
    v = casadi.mtimes(symbolic_jacobian(chain, q)[:3, :], qd)
    # Keeps the tool's speed differentiable where it stands still [m^2/s^2].
    return _function(z, casadi.sqrt(casadi.dot(v, v) + 1e-9))


def _function(z: Any, value: Any) -> Any:
    slope = casadi.densify(casadi.jacobian(value, z))
    return casadi.Function("response", [z], [casadi.densify(value), slope])


# Violations that count as 1.
#: Of a distance [m].
DEPTH = 0.01
#: Of a constraint's residual [m or rad].
RESIDUAL = 0.01
#: Of a torque or the tool's speed, as a share of the limit [-].
SHARE = 0.1
#: Loads aimed at are lower by this share than what is allowed.
_HEADROOM = 5e-3
#: Residuals aimed at are lower than what is allowed by this, and by a tenth of half a row's width
#: at most [m or rad].
_AIM = 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoints:
    """Places at which a motion is linearized.

    Args:
        at: u, shape (K,).
        spare: Distance to keep beyond the margins, shape (K,) [m].
    """

    at: Array
    spare: Array

    @classmethod
    def uniform(cls, breaks: Sequence[float], each: int, spare: float) -> "Checkpoints":
        """Checkpoints with an equal number in each piece."""
        starts, lengths = np.asarray(breaks[:-1]), np.diff(breaks)
        at = starts[:, None] + lengths[:, None] * (np.arange(each) + 0.5) / each
        return cls(at.ravel(), np.full(at.size, spare))

    def with_more(self, at: Sequence[float], about: float, spare: float) -> "Checkpoints":
        """With more places; they and all nearer to them than ``about`` get more to spare."""
        gained = self.spare.copy()
        for place in at:
            gained[np.abs(self.at - place) < about] += spare
        more = np.full(len(at), self.spare.min() + spare)
        return Checkpoints(np.append(self.at, at), np.append(gained, more))


@dataclass(frozen=True, slots=True, eq=False)
class Linearization:
    """Linear model of distances, efforts and constraints at an iterate.

    Args:
        rows: Rows with the slack by which they may be violated.
        violation: The largest violation, 1 is much; 0 where there is none.
        obstruction: Obstruction that is violated the most.
    """

    rows: tuple[Rows, ...]
    violation: float
    obstruction: Obstruction | None = None


_UNSEEN = Linearization(
    (), np.inf, Obstruction("time was up before the motion was checked", "Allow more time.")
)


def linearize(
    task: Task, iterate: Iterate, places: Checkpoints, reach: float, deadline: Deadline
) -> Linearization:
    """Linearize distances, efforts and constraints along a motion.

    Args:
        task: Requirements on the motion.
        iterate: The motion.
        places: Places along the motion.
        reach: How far control points will be moved at most [rad or m].
        deadline: Instant at which linearizing stops: nothing good is known of the motion then.
    """
    near = _distances(task, iterate, places, reach, deadline)
    if deadline.passed:
        return _UNSEEN
    seen = [near, *_loads(task, iterate, places)]
    if task.constraints is not None and task.constraints.rows:
        seen.append(_constraints(task, iterate, places))
    rows = tuple(row for view in seen for row in view.rows)
    worst = max(seen, key=lambda view: view.violation)
    return Linearization(rows, worst.violation, worst.obstruction)


def length(chain: Chain) -> float:
    """Approximate length of the stretched out robot [m]."""
    return max(float(np.linalg.norm(chain.offsets[1:, :3, 3], axis=1).sum()), 1e-3)


def _distances(
    task: Task, iterate: Iterate, places: Checkpoints, reach: float, deadline: Deadline
) -> Linearization:
    # Pairs are looked at that are nearer than this part of what the trust region lets the robot
    # move, and get rows if they are among so many nearest of a place. What is overlooked is found
    # when the motion is proved, and has its place added.
    within = 0.7 * reach * max(length(task.chain), 1.0)
    own, gaps, slopes, worst, obstruction = [], [], [], 0.0, None
    samples = iterate.sample(places.at)
    for k, q in enumerate(samples):
        if deadline.passed:
            return _UNSEEN
        near = task.checker.gradient(q, within + places.spare[k])
        distances, gradients = near.distances, near.gradients
        if not len(distances):
            continue
        least = int(np.argmin(distances))
        if -distances[least] > worst:
            worst = -float(distances[least])
            a, b = task.checker.model.pair_name(int(near.pairs[least]))
            message = f"{a!r} and {b!r} are closer than their margin by {worst:.4g} m"
            obstruction = Obstruction(message, "Lower the margin, or move the obstacle.")
        room = distances - places.spare[k] - 0.5 * reach * np.abs(gradients).sum(axis=1)
        kept = np.argsort(room, kind="stable")[:8]
        kept = kept[room[kept] < 0.0]
        own.append(np.full(len(kept), k))
        gaps.append(distances[kept] - places.spare[k])
        slopes.append(gradients[kept])
    if not own:
        return Linearization((), 0.0)
    index, gap, slope = np.concatenate(own), np.concatenate(gaps), np.concatenate(slopes)
    # gap + slope . (q - q0) + s >= 0.
    A = local_matrix(iterate, places.at[index], [-slope], in_slack=-DEPTH)
    rows = Rows.below(A, gap - (slope * samples[index]).sum(axis=1))
    return Linearization((rows,), worst / DEPTH, obstruction)


def _loads(task: Task, iterate: Iterate, places: Checkpoints) -> list[Linearization]:
    if task.loads is None:
        return []
    chain, seen = task.loads.chain, []
    effort, speed = task.loads.effort, task.loads.tool_speed
    if effort is not None:
        q = iterate.sample(places.at)
        still = inverse_dynamics(chain, q, np.zeros_like(q), np.zeros_like(q)) / effort
        found = _shares(torques(chain, iterate, places.at), effort)
        names = [f"the torque of joint {name!r}" for name in chain.joint_names]
        seen += [
            _load(iterate, places, found, sign, 2.0 * (1.0 - sign * still), names)
            for sign in (1.0, -1.0)
        ]
    if speed is not None:
        found = _shares(tool_speed(chain, iterate, places.at), np.array([speed]))
        in_time = np.ones_like(found.values)
        seen.append(_load(iterate, places, found, 1.0, in_time, ["the tool's speed"]))
    return seen


def least_factor(task: Task, iterate: Iterate, places: Checkpoints) -> float:
    """Factor of a motion's duration that its efforts need at the checkpoints."""
    if task.loads is None:
        return 0.0
    chain, factor = task.loads.chain, 0.0
    effort, speed = task.loads.effort, task.loads.tool_speed
    if effort is not None:
        q = iterate.sample(places.at)
        still = inverse_dynamics(chain, q, np.zeros_like(q), np.zeros_like(q)) / effort
        share = torques(chain, iterate, places.at).values / effort
        room = np.maximum(1.0 - _HEADROOM - np.sign(share) * still, _HEADROOM)
        moved = np.maximum(np.abs(share) - np.sign(share) * still, 0.0)
        factor = float(np.sqrt((moved / room).max()))
    if speed is not None:
        fastest = float(tool_speed(chain, iterate, places.at).values.max())
        factor = max(factor, fastest / (speed * (1.0 - _HEADROOM)))
    return factor


def _shares(found: Response, limits: Array) -> Response:
    """Values and derivatives as shares of their limits."""
    first, second, third = (g / limits[:, None] for g in found.gradients)
    return Response(found.values / limits, (first, second, third), found.in_time / limits)


def _load(
    iterate: Iterate,
    places: Checkpoints,
    found: Response,
    sign: float,
    gain: Array,
    names: list[str],
) -> Linearization:
    """Rows of loads; ``gain`` is by how much a motion T times as long may use more at T = 1.

    With h the share at rest, what moves must keep within (1 - h) T^2, the tool's speed within T:
    the tangents of these lie on the safe side, as those of T^-2 would not.
    """
    (K, m), n, T = found.values.shape, iterate.points.shape[1], iterate.duration
    values = sign * found.values.ravel()
    rows = [sign * gradient.reshape(-1, n) for gradient in found.gradients]
    in_time = -np.broadcast_to(gain, (K, m)).ravel() / T
    A = local_matrix(iterate, np.repeat(places.at, m), rows, in_time, in_slack=-SHARE)
    z = np.append(iterate.points.ravel(), [T, 0.0])
    upper = (1.0 - _HEADROOM) - values + A @ z
    worst = int(np.argmax(values))
    over = max(float(values[worst]) - 1.0, 0.0)
    message = f"{names[worst % m]} is {1.0 + over:.4g} times its limit"
    obstruction = Obstruction(message, "Carry less, or raise the limit.")
    return Linearization((Rows.below(A, upper),), over / SHARE, obstruction)


def _constraints(task: Task, iterate: Iterate, places: Checkpoints) -> Linearization:
    assert task.constraints is not None
    samples = iterate.sample(places.at)
    residuals, J = task.constraints.evaluate(samples)
    if isinstance(task.checker, ConstrainedChecker):
        # Narrower rows than asked for, so that they hold between the places too.
        wanted, narrow = task.constraints.packed, task.checker.rows
        residuals = residuals + (wanted[:, Column.UPPER] - narrow[:, Column.UPPER])
    m = residuals.shape[1]
    slope = J.reshape(-1, samples.shape[1])
    A = local_matrix(iterate, np.repeat(places.at, m), [slope], in_slack=-RESIDUAL)
    # Where a linear model aims at a bound, the motion ends a little beyond it.
    rows = task.constraints.packed
    aim = rows[:, Column.UPPER] - narrow_rows(task.constraints, 0.1, _AIM)[:, Column.UPPER]
    upper = (slope * np.repeat(samples, m, axis=0)).sum(axis=1) - (residuals + aim).ravel()
    worst = int(np.argmax(residuals))
    over = max(float(residuals.ravel()[worst]), 0.0)
    message = f"{task.constraints.label(worst % m)} is violated by {over:.4g}"
    obstruction = Obstruction(message, "Widen its tolerance.")
    return Linearization((Rows.below(A, upper),), over / RESIDUAL, obstruction)

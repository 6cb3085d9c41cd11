"""Torque limits and a limit of the tool's speed, on a path and on a motion.

Along a path q(s) with x = (ds/dt)^2 and u = d2s/dt2 the joint torques are

    tau = alpha u + beta x + phi sqrt(x) + g,
    alpha = M q',  beta = M q'' + C(q, q') q',  phi = B q',  g = G(q),

so |tau| <= T are linear limits of (u, x) but for the viscous friction phi sqrt(x). A concave term
lies below each of its tangents, a convex one below its chord: both stand in on the safe side, the
tangent at a guess of x. Between the places checked nothing is promised; what a whole motion needs
at most is then bounded for every instant, and the motion slowed down by what it lacks.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dynamics.enclosure import Use, tool_speed_use, torque_use
from dynamics.inverse import inverse_dynamics
from kinematics.arrays import Array
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.options import TimingFailed
from planning.timing.path.path import JointPath, piece_values
from planning.timing.speed.constraints import Cells
from planning.timing.time_scaling import ScaledTime
from planning.values.limits import EffortLimits

# The torques aimed at are this much below the limits, so that what is bounded with an error of a
# thousandth is within them.
_HEADROOM = 2e-3
_HAIR = 1e-6


class KnotLimits(NamedTuple):
    """Further linear limits at places on a path, of ds/dt and d2s/dt2.

    Args:
        caps: Largest (ds/dt)^2, inf where there is none, shape (k,).
        rows: (a, b, lo, up) of lo <= a d2s/dt2 + b (ds/dt)^2 <= up, shape (k, r, 4).
    """

    caps: Array
    rows: Array


#: Further limits at some places (k,) of a path, or None.
Extra = Callable[[JointPath, Array], KnotLimits]


def effort_rows(loads: EffortLimits) -> Extra:
    """Limits at places on a path, as ``planning.timing.jerk.grid`` asks for them."""
    return lambda path, places: knot_limits(
        loads, *(path.sample(places, order) for order in range(3))
    )


def knot_limits(
    loads: EffortLimits, q: Array, q1: Array, q2: Array, guess: Array | None = None
) -> KnotLimits:
    """The limits of (u, x) where the path is at q with the derivatives q' and q'', all (k, n).

    Args:
        loads: The limits of torque and tool speed.
        q: Positions.
        q1: First derivatives with respect to s.
        q2: Second derivatives.
        guess: Guess of x, shape (k,).

    Raises:
        TimingFailed: At some place a joint can't even hold the robot.
    """
    caps = np.full(len(q), np.inf)
    if loads.tool_speed is not None:
        J = geometric(loads.chain, q)[:, :3]
        with np.errstate(divide="ignore"):
            speeds = np.linalg.norm(np.einsum("kij,kj->ki", J, q1), axis=1)
            caps = (loads.tool_speed / speeds) ** 2
    if loads.effort is None:
        return KnotLimits(caps, np.zeros((len(q), 0, 4)))
    return KnotLimits(caps, _torque_rows(loads, q, q1, q2, guess))


def _torque_rows(loads: EffortLimits, q: Array, q1: Array, q2: Array, guess: Array | None) -> Array:
    assert loads.effort is not None
    none = np.zeros_like(q)
    phi = loads.chain.viscous_friction * q1
    gravity = inverse_dynamics(loads.chain, q, none, none)
    alpha = inverse_dynamics(loads.chain, q, none, q1) - gravity
    beta = inverse_dynamics(loads.chain, q, q1, q2) - gravity - phi
    limit = loads.effort * (1.0 - _HEADROOM)
    _check_rest(loads.chain, gravity, limit)
    rows = []
    for sign in (1.0, -1.0):
        room = limit - sign * gravity
        a, b = sign * alpha / room, sign * beta / room
        drag = sign * phi / room
        x = np.full(len(q), np.inf) if guess is None else guess
        with np.errstate(divide="ignore", invalid="ignore"):
            # The share of the room for torque that the tangent of the friction may take.
            most = 2.0 * 0.5 / np.maximum(drag, 0.0)
            # The tangent touches at no lower a speed than this part of the one where it takes its
            # share.
            root = np.clip(np.sqrt(x)[:, None], 0.05 * most, most)
            tangent = np.where(drag > 0.0, 0.5 * drag / root, 0.0)
        shift = np.where(drag > 0.0, 0.5 * np.maximum(drag, 0.0) * np.nan_to_num(root), 0.0)
        ones = 1.0 - shift
        bounded = np.isfinite(room)
        # A bound that is not there, as a number: infinities would not multiply with the duals'
        # zeros.
        rows.append(
            np.stack(
                [
                    np.where(bounded, a / ones, 0.0),
                    np.where(bounded, (b + tangent) / ones, 0.0),
                    np.full_like(a, -1e12),
                    np.ones_like(a),
                ],
                axis=-1,
            )
        )
    return np.concatenate(rows, axis=1)


def _check_rest(chain: Chain, gravity: Array, limit: Array) -> None:
    over = np.abs(gravity) - limit
    if (over >= 0.0).any():
        k, j = np.unravel_index(int(np.argmax(over)), over.shape)
        name = chain.joint_names[j]
        raise TimingFailed(
            f"joint {name!r} needs {abs(gravity[k, j]):.6g} to hold the robot still at a place "
            f"on the path, its torque limit is {limit[j] / (1.0 - _HEADROOM):.6g}",
            hint="Carry less, raise the limit, or choose another path.",
        )


def estimate_uses(loads: EffortLimits, trajectory: Trajectory) -> dict[str, Use]:
    """Largest use of each limit by a motion, by "torque" and "tool_speed".

    Slows motions down only: the proof bounds the use by ``planning.proof.limits.effort``.
    """
    found = {}
    if loads.effort is not None:
        found["torque"] = torque_use(loads.chain, trajectory, loads.effort)
    if loads.tool_speed is not None:
        found["tool_speed"] = tool_speed_use(loads.chain, trajectory, loads.tool_speed)
    return found


def slow_down(loads: EffortLimits, dilated: ScaledTime, longest: float = np.inf) -> ScaledTime:
    """The motion slowed down until it keeps the limits at every instant.

    Args:
        loads: The limits.
        dilated: The motion.
        longest: Duration beyond which it is not wanted [s].

    Raises:
        TimingFailed: No slowing down does, or it takes longer.
    """
    trajectory, factor = dilated.trajectory, dilated.factor
    for _ in range(40):
        needed = _slow_down_factor(loads, trajectory)
        if max(needed, 1.0) * trajectory.duration > longest:
            break
        if needed <= 1.0:
            return ScaledTime(trajectory, factor)
        factor *= needed * (1.0 + _HAIR)
        trajectory = trajectory.dilate(needed * (1.0 + _HAIR))
        if loads.effort is None:
            # A motion that is slower all along has a slower tool by just as much.
            return ScaledTime(trajectory, factor)
    raise TimingFailed(
        "no slower motion was found that keeps the torque limits",
        hint="Carry less, raise the limits, or choose another path.",
    )


def _slow_down_factor(loads: EffortLimits, trajectory: Trajectory) -> float:
    """By how much a motion has to be slowed down, about; at most 1 where it need not be."""
    uses, needed = estimate_uses(loads, trajectory), 0.0
    if "tool_speed" in uses:
        needed = uses["tool_speed"].ratio
    if "torque" in uses and uses["torque"].ratio > 1.0:
        use = uses["torque"]
        q = trajectory.sample([use.time])
        assert loads.effort is not None
        gravity = inverse_dynamics(loads.chain, q, np.zeros_like(q), np.zeros_like(q))[0]
        still = min(abs(gravity[use.joint]) / loads.effort[use.joint], 1.0 - _HEADROOM)
        needed = max(needed, np.sqrt((use.ratio - still) / (1.0 - still)), 1.0 + _HAIR)
    return float(needed)


def with_effort_rows(
    cells: Cells, path: JointPath, loads: EffortLimits, squares: Array | None = None
) -> Cells:
    """The grid with rows and caps of loads, which hold at both ends of each cell.

    Args:
        cells: The grid; no cell of it straight.
        path: Path of the motion.
        loads: The limits.
        squares: Guess of x at the grid points.
    """
    rows, caps = [cells.rows], cells.caps.copy()
    for end in (0, 1):
        places = cells.starts + end * cells.lengths
        q, q1, q2 = (
            piece_values(path.coefficients[cells.pieces], places, order) for order in range(3)
        )
        index = slice(end, len(caps) - 1 + end)
        guess = None if squares is None else squares[index]
        found = knot_limits(loads, q, q1, q2, guess)
        caps[index] = np.minimum(caps[index], found.caps)
        a, b = found.rows[..., 0], found.rows[..., 1]
        # u = (x_1 - x_0) / (2 l), and x is that of this end.
        slope = a / (2.0 * cells.lengths[:, None])
        rows.append(np.stack([b * (1 - end) - slope, b * end + slope], axis=-1))
    return cells._replace(rows=np.ascontiguousarray(np.concatenate(rows, axis=1)), caps=caps)

"""The closed loop in compiled form: robot, controller, reference and disturbance as one equation.

    M q_ddot + C q_dot + B q_dot + G = sat(u) + d + J^T F + s,

with the torque s of the joints' stops. The state is x = [q; q_dot; estimate], N = 2 n + b numbers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from compiled.vec3 import column, cross, dot, load, subtract
from dynamics.forward import acceleration_kernel
from dynamics.kernels.composite import frames_kernel
from dynamics.model.body import ORIGIN_COLUMN, REVOLUTE, TYPE, Z_COLUMN
from kinematics.arrays import Array
from tracking.controllers.control_law import (
    Law,
    Space,
    control_kernel,
    lyapunov_kernel,
    lyapunov_rate_kernel,
)
from tracking.simulation.disturbance import StopArrays, add_stops

#: A state beyond this [rad, m, rad/s, m/s] is no robot any more: the loop has run away.
RUNAWAY = 1e6
#: Trial steps this far out are refused unseen, so that nothing overflows; accepted ones end it.
HOPELESS = 1e3 * RUNAWAY

# Places in ``Loop.flags``.
#: Evaluations of the rate so far.
EVALUATIONS = 0
#: Piece of the reference.
PIECE = 1
#: 1 where the torque is held from one call of the controller to the next.
HELD = 2
#: 1 where the disturbance acts.
DISTURBED = 3
#: 1 + the joint at which the mass matrix was not positive definite, 0 for none.
FAILED = 4
FLAG_COUNT = 5


class Loop(NamedTuple):
    """A closed loop as arrays.

    Args:
        law: The controller.
        space: Scratch of it.
        limit: Effort limits, shape (n,), inf where there is none.
        constant: Constant disturbance, shape (n,).
        amplitude: Amplitude of the periodic disturbance, shape (n,).
        turn: Angular frequency of the disturbance [rad/s].
        wrench: F at the tip, shape (6,).
        tip: The tip in the frame of the joint that carries it, shape (3,).
        carrier: Joint that carries the tip, -1 for none.
        breaks: Breaks of the reference, shape (m + 1,).
        coefficients: Coefficients of the reference, shape (m + 1, n, k); the last piece is the rest
            at its end.
        noise: Noise added to q and q_dot that the controller gets, shape (2, n).
        command: Held torque and rate of change of the estimate, shape (n + b,).
        asked: Torque before saturation, shape (n,).
        state: Values of q and q_dot that the controller gets, shape (2, n).
        reference: The reference and its two derivatives, shape (3, n).
        stops: The joints' stops.
        flags: Flags from ``EVALUATIONS`` on, shape (FLAG_COUNT,).
    """

    law: Law
    space: Space
    limit: Array
    constant: Array
    amplitude: Array
    turn: float
    wrench: Array
    tip: Array
    carrier: int
    breaks: Array
    coefficients: Array
    noise: Array
    command: Array
    asked: Array
    state: Array
    reference: Array
    stops: StopArrays
    flags: NDArray[np.int64]


@kernel(allocates=False)
def reference_kernel(breaks: Array, coefficients: Array, piece: int, t: float, out: Array) -> None:
    """Write the reference at t and its two derivatives into out (3, n), by Horner's scheme."""
    c, u = coefficients[piece], t - breaks[piece]
    for j in range(out.shape[1]):
        p, v, a = 0.0, 0.0, 0.0
        for k in range(c.shape[1] - 1, -1, -1):
            a = a * u + 2.0 * v
            v = v * u + p
            p = p * u + c[j, k]
        out[0, j], out[1, j], out[2, j] = p, v, a


@kernel(allocates=False)
def command_kernel(loop: Loop, t: float, x: Array, command: Array) -> None:
    """Write the saturated torque and the rate of the estimate at state x into command (n + b,)."""
    n = loop.limit.shape[0]
    reference_kernel(loop.breaks, loop.coefficients, loop.flags[PIECE], t, loop.reference)
    for i in range(n):
        loop.state[0, i] = x[i] + loop.noise[0, i]
        loop.state[1, i] = x[n + i] + loop.noise[1, i]
    control_kernel(
        loop.law, loop.space, loop.state, loop.reference, x[2 * n :], loop.asked, command[n:]
    )
    for i in range(n):
        command[i] = min(max(loop.asked[i], -loop.limit[i]), loop.limit[i])


@kernel(allocates=False)
def add_disturbance(loop: Loop, t: float, q: Array, torque: Array) -> None:
    """Add d(t) + J^T F to the torque (n,)."""
    n = torque.shape[0]
    wave = np.sin(loop.turn * t)
    for i in range(n):
        torque[i] += loop.constant[i] + loop.amplitude[i] * wave
    F = loop.wrench
    size = 0.0
    for i in range(6):
        size += abs(F[i])
    if loop.carrier < 0 or size == 0.0:
        return
    f, m = load(F, 0), load(F, 3)
    rows, frames = loop.law.robot, loop.space.work
    frames_kernel(rows, q, frames)
    E, p = frames[loop.carrier], loop.tip
    at = (
        E[0] * p[0] + E[1] * p[1] + E[2] * p[2] + E[3],
        E[4] * p[0] + E[5] * p[1] + E[6] * p[2] + E[7],
        E[8] * p[0] + E[9] * p[1] + E[10] * p[2] + E[11],
    )
    for i in range(loop.carrier + 1):
        E = frames[i]
        z = column(E, Z_COLUMN)
        if rows[i, TYPE] == REVOLUTE:
            arm = subtract(at, column(E, ORIGIN_COLUMN))
            torque[i] += dot(z, m) + dot(z, cross(arm, f))
        else:
            torque[i] += dot(z, f)


@kernel(allocates=False)
def rate_kernel(loop: Loop, t: float, x: Array, rate: Array) -> None:
    """Write the time derivative of the state x (N,) into rate; NaN where it is hopeless."""
    n = loop.limit.shape[0]
    loop.flags[EVALUATIONS] += 1
    for i in range(x.shape[0]):
        if not abs(x[i]) < HOPELESS:
            rate[:] = np.nan
            return
    if loop.flags[HELD] == 0:
        command_kernel(loop, t, x, loop.command)
    q, qd, torque = x[:n], x[n : 2 * n], loop.space.vectors[3]
    for i in range(n):
        torque[i] = loop.command[i]
    if loop.flags[DISTURBED] != 0:
        add_disturbance(loop, t, q, torque)
    add_stops(loop.stops, q, qd, torque)
    failed = acceleration_kernel(
        loop.law.robot, q, qd, torque, loop.space.work, loop.space.M, rate[n : 2 * n]
    )
    if failed >= 0:
        loop.flags[FAILED] = failed + 1
        rate[:] = np.nan
        return
    for i in range(n):
        rate[i] = qd[i]
    for k in range(2 * n, x.shape[0]):
        rate[k] = loop.command[k - n]


@kernel(allocates=False)
def lyapunov_at(loop: Loop, t: float, x: Array, rate: Array) -> tuple[float, float]:
    """V at the true state x (N,) and its rate V_dot; ``rate`` (N,) is a work array."""
    n = loop.limit.shape[0]
    rate_kernel(loop, t, x, rate)
    # Samples are no steps of the integrator.
    loop.flags[EVALUATIONS] -= 1
    reference_kernel(loop.breaks, loop.coefficients, loop.flags[PIECE], t, loop.reference)
    for i in range(n):
        loop.state[0, i], loop.state[1, i] = x[i], x[n + i]
    law, space, estimate = loop.law, loop.space, x[2 * n :]
    V = lyapunov_kernel(law, space, loop.state, loop.reference, estimate)
    V_dot = lyapunov_rate_kernel(law, space, loop.state, loop.reference, estimate, rate)
    return V, V_dot


#: Differences use half of the digits: less is rounded off, more is not linear any more.
DIFFERENCE = 1e-8


@kernel(allocates=False)
def jacobian_kernel(loop: Loop, t: float, x: Array, f: Array, work: Array, J: Array) -> None:
    """Write the Jacobian of the derivative f (N,) at x into J (N, N), by differences.

    Two rows of ``work`` (., N) are overwritten.
    """
    N, trial, rate = x.shape[0], work[0], work[1]
    for j in range(N):
        trial[j] = x[j]
    for j in range(N):
        trial[j] = x[j] + DIFFERENCE * max(1.0, abs(x[j]))
        step = trial[j] - x[j]
        rate_kernel(loop, t, trial, rate)
        trial[j] = x[j]
        for i in range(N):
            J[i, j] = (rate[i] - f[i]) / step

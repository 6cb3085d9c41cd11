"""Samples and bounds of a run, recorded step by step."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array
from tracking.simulation.integrators.explicit import (
    STAGES,
    Steps,
    explicit_dense,
    explicit_polynomials,
)
from tracking.simulation.integrators.global_error import (
    ROUNDING,
    ErrorCarrier,
    carry_errors,
    error_carrier,
)
from tracking.simulation.loop import HELD, PIECE, Loop, command_kernel, lyapunov_at
from tracking.tube.motion_bounds import (
    NODES,
    SHARES,
    STEP_COEFFICIENTS,
    MotionBounds,
    bound_step,
    hermite_polynomials,
    raise_peaks,
)

# Places in ``Record.counters``.
SAMPLES = 0
EXPLICIT_STEPS = 1
IMPLICIT_STEPS = 2
COUNTER_COUNT = 3
#: Steps of a held torque up to this [s] are bounded by Hermite polynomials, which cost nothing.
_SHORT_HELD_STEP = 5e-3


class Record(NamedTuple):
    """Samples, one a row.

    Args:
        times: Instants of the samples, shape (m,) [s]; the last is the end.
        states: x, shape (m, N).
        torques: Torques after saturation, shape (m, n).
        saturated: Shape (m, n).
        lyapunov: V and its rate, shape (m, 2).
        references: Position and velocity, shape (m, 2, n).
        bounds: Bounds of errors, positions and velocities over all steps.
        counters: Counters from ``SAMPLES`` on, shape (COUNTER_COUNT,).
    """

    times: Array
    states: Array
    torques: Array
    saturated: NDArray[np.bool_]
    lyapunov: Array
    references: Array
    bounds: MotionBounds
    counters: NDArray[np.int64]


class Scratch(NamedTuple):
    """Work arrays of a run.

    Args:
        end: State at the end of a step, shape (N,).
        between: State within it, shape (N,).
        command: Torque and rate of the estimate, shape (n + b,).
        rate: Time derivative of the state, shape (N,).
        motion: The state over a step as polynomials, shape (N, 8).
        nodes: States at ``SHARES`` of a step, shape (NODES, N).
        torques: Torques there, shape (NODES, n).
        errors: Errors of the integrator on their way.
        weights: Squares of the reciprocal tolerances of each state, shape (N,).
        tolerances: Relative and absolute, shape (2,).
    """

    end: Array
    between: Array
    command: Array
    rate: Array
    motion: Array
    nodes: Array
    torques: Array
    errors: ErrorCarrier
    weights: Array
    tolerances: Array


def scratch(start: Array, n: int, tolerances: Array, *, has_tube: bool) -> Scratch:
    """Work arrays of a run.

    Args:
        start: State that it begins with, shape (N,).
        n: Number of joints.
        tolerances: Relative and absolute, shape (2,).
        has_tube: Whether errors are carried along for a tube.
    """
    N, allowed = len(start), tolerances[1] + tolerances[0] * np.maximum(1.0, np.abs(start))
    motion = np.empty((N, STEP_COEFFICIENTS))
    errors = error_carrier(N, N - n, is_kept=has_tube)
    return Scratch(
        np.empty(N),
        np.empty(N),
        np.empty(N - n),
        np.empty(N),
        motion,
        np.empty((NODES, N)),
        np.empty((NODES, n)),
        errors,
        allowed**-2,
        tolerances,
    )


@kernel(allocates=False)
def sample(loop: Loop, record: Record, t: float, x: Array, scratch: Scratch) -> None:
    """Record a sample at time t and state x (N,)."""
    command = scratch.command
    k, n = record.counters[SAMPLES], record.torques.shape[1]
    if loop.flags[HELD] == 0:
        command_kernel(loop, t, x, command)
    else:
        for i in range(command.shape[0]):
            command[i] = loop.command[i]
    for i in range(n):
        record.torques[k, i] = command[i]
        record.saturated[k, i] = loop.asked[i] != command[i]
        record.bounds.peak_torque[i] = max(record.bounds.peak_torque[i], abs(command[i]))
    for i in range(x.shape[0]):
        record.states[k, i] = x[i]
    V, V_dot = lyapunov_at(loop, t, x, scratch.rate)
    record.lyapunov[k, 0], record.lyapunov[k, 1] = V, V_dot
    for i in range(n):
        record.references[k, 0, i] = loop.reference[0, i]
        record.references[k, 1, i] = loop.reference[1, i]
    record.counters[SAMPLES] = k + 1


@kernel(allocates=False)
def write_motion(
    loop: Loop,
    steps: Steps,
    record: Record,
    scratch: Scratch,
    x: Array,
    t: float,
    h: float,
    after: float,
) -> None:
    """Write the motion over an explicit step h from time t and state x into ``scratch.motion``."""
    is_due = record.times[record.counters[SAMPLES]] < after
    is_short = loop.flags[HELD] != 0 and h <= _SHORT_HELD_STEP
    if is_short and not scratch.errors.is_kept and not is_due:
        n = 2 * loop.limit.shape[0]
        hermite_polynomials(steps.K[0], steps.K[STAGES], h, x, scratch.end, scratch.motion[:n])
        return
    explicit_dense(loop, steps, t, h, x, scratch.end)
    explicit_polynomials(steps.F, x, scratch.motion)


@kernel(allocates=False)
def sample_within(
    loop: Loop,
    record: Record,
    scratch: Scratch,
    x: Array,
    t: float,
    h: float,
    after: float,
) -> None:
    """Record the samples due before ``after`` in a step h from time t and state x."""
    if scratch.errors.is_kept:
        for k in range(NODES):
            state_at(scratch.motion, SHARES[k], scratch.nodes[k])
    while (
        record.counters[SAMPLES] < record.times.shape[0] - 1
        and record.times[record.counters[SAMPLES]] < after
    ):
        at = record.times[record.counters[SAMPLES]]
        share = (at - t) / h
        if share <= 0.0:
            sample(loop, record, at, x, scratch)
            continue
        state_at(scratch.motion, share, scratch.between)
        sample(loop, record, at, scratch.between, scratch)


@kernel(allocates=False)
def state_at(motion: Array, share: float, out: Array) -> None:
    """Write the state at a part of a step, by its polynomials (N, 8), into out (N,)."""
    for i in range(out.shape[0]):
        value = 0.0
        for k in range(motion.shape[1] - 1, -1, -1):
            value = value * share + motion[i, k]
        out[i] = value


@kernel(allocates=False)
def note_step(
    loop: Loop,
    record: Record,
    scratch: Scratch,
    x: Array,
    t: float,
    h: float,
    error: float,
) -> None:
    """Bound the motion over an accepted step h from time t and state x (N,).

    With a tube the errors of the integrator are carried along, and torques are bounded. ``error``
    is the root mean square over all states in units of the tolerance.
    """
    piece, N = loop.flags[PIECE], x.shape[0]
    bounds, tolerances = record.bounds, scratch.tolerances
    motion = scratch.motion[: 2 * loop.limit.shape[0]]
    bound_step(bounds, loop.coefficients[piece], loop.breaks[piece], motion, t, h)
    if not scratch.errors.is_kept:
        return
    allowed = scratch.between
    for i in range(N):
        size = max(abs(x[i]), abs(scratch.end[i]))
        allowed[i] = np.sqrt(N) * error * (tolerances[1] + tolerances[0] * size) + ROUNDING * size
    middle = scratch.nodes[NODES // 2]
    largest = bounds.global_error
    carry_errors(loop, scratch.errors, t, h, middle, allowed, scratch.weights, largest)
    if loop.flags[HELD] != 0:
        # What is held was noted when the controller was called.
        return
    for k in range(NODES):
        command_kernel(loop, t + SHARES[k] * h, scratch.nodes[k], scratch.command)
        for i in range(loop.limit.shape[0]):
            scratch.torques[k, i] = scratch.command[i]
    raise_peaks(scratch.torques, loop.limit, bounds.peak_torque)

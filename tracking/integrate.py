"""A closed loop integrated from cut to cut, with its samples, in one compiled run."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from tracking.explicit import (
    STABILITY,
    STAGES,
    Steps,
    explicit_dense,
    explicit_interpolate,
    explicit_step,
)
from tracking.implicit import (
    Stages,
    factor_all,
    implicit_interpolate,
    implicit_step,
    jacobian,
)
from tracking.loop import (
    DISTURBED,
    EVALUATIONS,
    FAILED,
    HELD,
    PIECE,
    RUNAWAY,
    Loop,
    command_kernel,
    lyapunov_at,
    rate_kernel,
    reference_kernel,
)
from tracking.schedule import Cuts

#: How a course ends.
COMPLETED, DIVERGED, EXHAUSTED, SINGULAR_MASS_MATRIX = 0, 1, 2, 3
#: Steps at the border of stability, in a row as good as, after which a loop counts as stiff.
_STIFF_STEPS = 15
#: Calm steps after which the count begins anew.
_CALM_STEPS = 6
#: So many steps shorter than this on average [s] are no arm's motion either, though the method is
#: stable: it is the accuracy of its inner stages that a stiff loop spoils.
_MANY_STEPS, _SHORT = 5000, 5e-5
#: A step this part of the time since the cut is nothing but rounding error.
_SMALLEST = 1e-14
_SAFETY = 0.9


class Record(NamedTuple):
    """Samples, one a row.

    Args:
        times: When, shape (m,) [s]; the last is the end.
        states: x, shape (m, N).
        torques: After saturation, shape (m, n).
        saturated: Shape (m, n).
        lyapunov: Shape (m,).
        references: Position and velocity, shape (m, 2, n).
        worst: Largest tracking error so far, shape (n,).
        counters: Samples so far; steps of the explicit and of the implicit method, shape (3,).
    """

    times: Array
    states: Array
    torques: Array
    saturated: NDArray[np.bool_]
    lyapunov: Array
    references: Array
    worst: Array
    counters: NDArray[np.int64]


@kernel
def weigh(loop: Loop, record: Record, t: float, x: Array) -> None:
    """Keep the largest tracking error of each joint."""
    reference_kernel(loop.breaks, loop.coefficients, loop.flags[PIECE], t, loop.reference)
    for i in range(record.worst.shape[0]):
        record.worst[i] = max(record.worst[i], abs(loop.reference[0, i] - x[i]))


@kernel
def sample(loop: Loop, record: Record, t: float, x: Array, command: Array) -> None:
    """Record one sample; ``command`` (n + b,) is scratch."""
    k, n = record.counters[0], record.worst.shape[0]
    if loop.flags[HELD] == 0:
        command_kernel(loop, t, x, command)
    else:
        for i in range(command.shape[0]):
            command[i] = loop.command[i]
    for i in range(n):
        record.torques[k, i] = command[i]
        record.saturated[k, i] = loop.asked[i] != command[i]
    for i in range(x.shape[0]):
        record.states[k, i] = x[i]
    record.lyapunov[k] = lyapunov_at(loop, t, x)
    weigh(loop, record, t, x)
    for i in range(n):
        record.references[k, 0, i] = loop.reference[0, i]
        record.references[k, 1, i] = loop.reference[1, i]
    record.counters[0] = k + 1


@kernel(inline="always")
def first_step(loop: Loop, steps: Steps, t: float, x: Array, tolerances: Array) -> float:
    """A step to begin with, from the size of the derivatives ("... Equations I", section II.4)."""
    N, K = x.shape[0], steps.K
    d0, d1, d2 = 0.0, 0.0, 0.0
    for i in range(N):
        scale = tolerances[1] + tolerances[0] * abs(x[i])
        d0 += (x[i] / scale) ** 2
        d1 += (K[0, i] / scale) ** 2
    h = 1e-6 if d0 < 1e-10 or d1 < 1e-10 else 0.01 * np.sqrt(d0 / d1)
    for i in range(N):
        steps.trial[i] = x[i] + h * K[0, i]
    rate_kernel(loop, t + h, steps.trial, K[1])
    for i in range(N):
        scale = tolerances[1] + tolerances[0] * abs(x[i])
        d2 += ((K[1, i] - K[0, i]) / scale) ** 2
    most = max(np.sqrt(d1 / N), np.sqrt(d2 / N) / h)
    if not np.isfinite(most):
        return h
    return min(100.0 * h, (0.01 / most) ** 0.125 if most > 1e-15 else max(1e-6, 1e-3 * h))


@kernel
def run_kernel(  # noqa: C901, PLR0912, PLR0915  one loop over segments and steps
    loop: Loop,
    cuts: Cuts,
    steps: Steps,
    stages: Stages,
    record: Record,
    tolerances: Array,
    most: int,
    x: Array,
) -> int:
    """Integrate x (N,) from the first cut to the last, in at most ``most`` evaluations.

    Begins with the explicit method and goes over to the implicit one for good where the loop
    turns out to be stiff.

    Returns:
        How it ended.
    """
    N, segments = x.shape[0], cuts.times.shape[0] - 1
    end, between, command = np.empty(N), np.empty(N), np.empty(loop.command.shape[0])
    stiff_steps, calm_steps, is_stiff = 0, 0, False
    h, tried = 0.0, 0.0
    for s in range(segments):
        t, stop = cuts.times[s], cuts.times[s + 1]
        loop.flags[PIECE] = cuts.pieces[s]
        loop.flags[DISTURBED] = 1 if cuts.disturbed[s] else 0
        for k in range(loop.noise.shape[1]):
            loop.noise[0, k] = cuts.noise[cuts.noises[s], 0, k]
            loop.noise[1, k] = cuts.noise[cuts.noises[s], 1, k]
        if cuts.called[s]:
            command_kernel(loop, t, x, loop.command)
        if record.counters[0] == 0:
            sample(loop, record, t, x, command)
        rate_kernel(loop, t, x, steps.K[0])
        if loop.flags[FAILED] > 0:
            return SINGULAR_MASS_MATRIX
        if h == 0.0 or (s == 0):
            h = first_step(loop, steps, t, x, tolerances)
        if loop.flags[HELD] != 0:
            # A held torque makes a smooth motion over a short time: try it in one step.
            h = max(h, stop - t)
        rejected, has_jacobian, factored = False, False, 0.0
        while t < stop:
            if loop.flags[EVALUATIONS] >= most:
                return EXHAUSTED
            left = stop - t
            if not h > _SMALLEST * max(abs(t), stop - cuts.times[s]):
                return DIVERGED
            # Two steps of half the rest instead of a whole one and a tiny one.
            tried = left if h >= left else (min(h, 0.5 * left))
            if is_stiff:
                if not has_jacobian:
                    jacobian(loop, stages, t, x, steps.K[0])
                    has_jacobian, factored = True, 0.0
                if factored != tried:
                    if not factor_all(stages, tried):
                        h = 0.5 * tried
                        continue
                    factored = tried
                error = implicit_step(
                    loop, stages, t, tried, x, steps.K[0], tolerances, end, rejected or s == 0
                )
                growth = 0.25
            else:
                error, touch = explicit_step(loop, steps, t, tried, x, tolerances, end)
                growth = 0.125
                if touch > STABILITY:
                    stiff_steps, calm_steps = stiff_steps + 1, 0
                else:
                    calm_steps += 1
                    if calm_steps >= _CALM_STEPS:
                        stiff_steps = 0
            if loop.flags[FAILED] > 0:
                return SINGULAR_MASS_MATRIX
            if not error <= 1.0:
                rejected = True
                if not np.isfinite(error):
                    h = 0.25 * tried
                else:
                    h = tried * max(0.2, _SAFETY * error**-growth)
                continue
            record.counters[2 if is_stiff else 1] += 1
            last = tried >= left
            after = stop if last else t + tried
            for i in range(N):
                if not abs(end[i]) <= RUNAWAY:
                    return DIVERGED
            dense = False
            while (
                record.counters[0] < record.times.shape[0] - 1
                and record.times[record.counters[0]] < after
            ):
                at = record.times[record.counters[0]]
                place = (at - t) / tried
                if place <= 0.0:
                    sample(loop, record, at, x, command)
                    continue
                if is_stiff:
                    implicit_interpolate(stages, x, place, between)
                else:
                    if not dense:
                        explicit_dense(loop, steps, t, tried, x, end)
                        dense = True
                    explicit_interpolate(steps, x, place, between)
                sample(loop, record, at, between, command)
            factor_up = 10.0 if error == 0.0 else min(10.0, _SAFETY * error**-growth)
            h = tried * max(0.2, min(factor_up, 1.0) if rejected else factor_up)
            rejected = False
            if is_stiff:
                # Close to the same step the factors are worth keeping.
                if tried <= h <= 1.2 * tried:
                    h = tried
                has_jacobian = False
            for i in range(N):
                x[i] = end[i]
            t = after
            weigh(loop, record, t, x)
            if last:
                break
            if is_stiff:
                rate_kernel(loop, t, x, steps.K[0])
            else:
                for i in range(N):
                    steps.K[0, i] = steps.K[STAGES, i]
            if not is_stiff and (
                stiff_steps >= _STIFF_STEPS
                or (
                    loop.flags[HELD] == 0
                    and record.counters[1] >= _MANY_STEPS
                    and t < _SHORT * record.counters[1]
                )
            ):
                is_stiff = True
        if not is_stiff and stiff_steps >= _STIFF_STEPS:
            is_stiff = True
    sample(loop, record, cuts.times[segments], x, command)
    return COMPLETED

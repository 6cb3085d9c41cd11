"""Integration of a closed loop from event to event, with its samples, in one compiled run."""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from tracking.simulation.integrators.explicit import STABILITY, STAGES, Steps, explicit_step
from tracking.simulation.integrators.global_error import begin_call
from tracking.simulation.integrators.implicit import (
    Stages,
    factor_all,
    implicit_polynomials,
    implicit_step,
)
from tracking.simulation.integrators.record import (
    EXPLICIT_STEPS,
    IMPLICIT_STEPS,
    SAMPLES,
    Record,
    Scratch,
    note_step,
    sample,
    sample_within,
    write_motion,
)
from tracking.simulation.loop import (
    DISTURBED,
    EVALUATIONS,
    FAILED,
    HELD,
    PIECE,
    RUNAWAY,
    Loop,
    command_kernel,
    jacobian_kernel,
    rate_kernel,
)
from tracking.simulation.setup import Events

# How a run ends.
COMPLETED = 0
DIVERGED = 1
#: The evaluations were used up.
EXHAUSTED = 2
SINGULAR_MASS_MATRIX = 3
#: Steps at the border of stability, in a row as good as, after which a loop counts as stiff.
_STIFF_STEPS = 15
#: Calm steps after which the count begins anew.
_CALM_STEPS = 6
#: After so many steps a loop may count as stiff for their length alone.
_MANY_STEPS = 5000
#: Steps shorter than this on average [s] are no arm's motion, though the method is stable: it is
#: the accuracy of its inner stages that a stiff loop spoils.
_SHORT_STEP = 5e-5
#: A step this part of the time since the event is nothing but rounding error.
_SMALLEST_STEP = 1e-14
#: Part of the step that the estimated error would allow that is tried next.
_SAFETY = 0.9
#: Longest factor by which a step shrinks, and grows.
_MAX_SHRINK = 0.2
_MAX_GROWTH = 10.0
#: Error orders of both methods: a step goes with the error to minus this power.
_EXPLICIT_POWER = 0.125
_IMPLICIT_POWER = 0.25


@kernel(inline="always")
def first_step(loop: Loop, steps: Steps, t: float, x: Array, tolerances: Array) -> float:
    """The first step [s], from the size of the derivatives.

    Source: "Solving Ordinary Differential Equations I", section II.4.
    """
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


@kernel(allocates=False)
def _begin_segment(
    loop: Loop, events: Events, record: Record, scratch: Scratch, s: int, x: Array
) -> None:
    """Set what acts in segment s of the events, which begins at state x (N,)."""
    loop.flags[PIECE] = events.pieces[s]
    loop.flags[DISTURBED] = 1 if events.disturbed[s] else 0
    for k in range(loop.noise.shape[1]):
        loop.noise[0, k] = events.noise[events.noises[s], 0, k]
        loop.noise[1, k] = events.noise[events.noises[s], 1, k]
    if events.called[s]:
        command_kernel(loop, events.times[s], x, loop.command)
        for i in range(loop.limit.shape[0]):
            peak = record.bounds.peak_torque
            peak[i] = max(peak[i], abs(loop.command[i]))
        if scratch.errors.is_kept:
            begin_call(loop, scratch.errors, events.times[s], x, scratch.weights)


@kernel(allocates=False)
def _has_run_away(x: Array) -> bool:
    """Whether a state (N,) is beyond every robot's, or not a number."""
    for i in range(x.shape[0]):  # noqa: SIM110  compiled, without a generator
        if not abs(x[i]) <= RUNAWAY:
            return True
    return False


@kernel(allocates=False)
def _is_stiff(loop: Loop, record: Record, t: float, stiff_steps: int) -> bool:
    """Whether the explicit method has been at its border, or its steps have been tiny, too long."""
    count = record.counters[EXPLICIT_STEPS]
    return bool(
        stiff_steps >= _STIFF_STEPS
        or (loop.flags[HELD] == 0 and count >= _MANY_STEPS and t < _SHORT_STEP * count)
    )


@kernel(allocates=False)
def run_kernel(  # noqa: C901, PLR0912, PLR0915  one loop over segments and steps
    loop: Loop,
    events: Events,
    steps: Steps,
    stages: Stages,
    record: Record,
    scratch: Scratch,
    most: int,
    x: Array,
) -> int:
    """Integrate x (N,) from the first event to the last, in at most ``most`` evaluations.

    Begins with the explicit method and goes over to the implicit one for good where the loop
    turns out to be stiff.

    Returns:
        Outcome of the integration.
    """
    N, segments, tolerances = x.shape[0], events.times.shape[0] - 1, scratch.tolerances
    end, stiff_steps, calm_steps, is_stiff, h = scratch.end, 0, 0, False, 0.0
    for s in range(segments):
        t, stop = events.times[s], events.times[s + 1]
        _begin_segment(loop, events, record, scratch, s, x)
        if record.counters[SAMPLES] == 0:
            sample(loop, record, t, x, scratch)
        rate_kernel(loop, t, x, steps.K[0])
        if loop.flags[FAILED] > 0:
            return SINGULAR_MASS_MATRIX
        if h == 0.0 or s == 0:
            h = first_step(loop, steps, t, x, tolerances)
        if loop.flags[HELD] != 0:
            # A held torque makes a smooth motion over a short time: try it in one step.
            h = max(h, stop - t)
        rejected, has_jacobian, factored = False, False, 0.0
        while t < stop:
            if loop.flags[EVALUATIONS] >= most:
                return EXHAUSTED
            left = stop - t
            if not h > _SMALLEST_STEP * max(abs(t), stop - events.times[s]):
                return DIVERGED
            # Two steps of half the rest instead of a whole one and a tiny one.
            tried = left if h >= left else (min(h, 0.5 * left))
            if is_stiff:
                if not has_jacobian:
                    jacobian_kernel(loop, t, x, steps.K[0], stages.vectors, stages.J)
                    has_jacobian, factored = True, 0.0
                if factored != tried:
                    if not factor_all(stages, tried):
                        h = 0.5 * tried
                        continue
                    factored = tried
                error = implicit_step(
                    loop, stages, t, tried, x, steps.K[0], tolerances, end, rejected or s == 0
                )
                power = _IMPLICIT_POWER
            else:
                error, touch = explicit_step(loop, steps, t, tried, x, tolerances, end)
                power = _EXPLICIT_POWER
                calm_steps = 0 if touch > STABILITY else calm_steps + 1
                if touch > STABILITY:
                    stiff_steps += 1
                elif calm_steps >= _CALM_STEPS:
                    stiff_steps = 0
            if loop.flags[FAILED] > 0:
                return SINGULAR_MASS_MATRIX
            if not error <= 1.0:
                shrink = max(_MAX_SHRINK, _SAFETY * error**-power) if np.isfinite(error) else 0.25
                rejected, h = True, tried * shrink
                continue
            is_last = tried >= left
            after = stop if is_last else t + tried
            record.counters[IMPLICIT_STEPS if is_stiff else EXPLICIT_STEPS] += 1
            if _has_run_away(end):
                return DIVERGED
            if is_stiff:
                implicit_polynomials(stages, x, scratch.motion)
            else:
                write_motion(loop, steps, record, scratch, x, t, tried, after)
            sample_within(loop, record, scratch, x, t, tried, after)
            note_step(loop, record, scratch, x, t, tried, error)
            growth = _MAX_GROWTH if error == 0.0 else min(_MAX_GROWTH, _SAFETY * error**-power)
            h = tried * max(_MAX_SHRINK, min(growth, 1.0) if rejected else growth)
            if is_stiff and tried <= h <= 1.2 * tried:
                # Close to the same step the factors are worth keeping.
                h = tried
            rejected, has_jacobian = False, False
            for i in range(N):
                x[i] = end[i]
            t = after
            if is_last:
                break
            if is_stiff:
                rate_kernel(loop, t, x, steps.K[0])
                continue
            for i in range(N):
                steps.K[0, i] = steps.K[STAGES, i]
            is_stiff = _is_stiff(loop, record, t, stiff_steps)
        is_stiff = is_stiff or stiff_steps >= _STIFF_STEPS
    sample(loop, record, events.times[segments], x, scratch)
    return COMPLETED

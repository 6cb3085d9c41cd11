"""The closed loop with one of this package's controllers: no Python between start and end."""

import numpy as np

from dynamics.forward import massless
from dynamics.model.body import bodies
from kinematics.arrays import Array
from tracking.controllers.control_law import Law, space
from tracking.simulation.disturbance import Disturbance, stop_arrays
from tracking.simulation.integrators.explicit import ALL_STAGES, POWERS, Steps
from tracking.simulation.integrators.implicit import stages
from tracking.simulation.integrators.integrate import (
    DIVERGED,
    EXHAUSTED,
    SINGULAR_MASS_MATRIX,
    run_kernel,
)
from tracking.simulation.integrators.record import (
    COUNTER_COUNT,
    EXPLICIT_STEPS,
    IMPLICIT_STEPS,
    SAMPLES,
    Record,
    scratch,
)
from tracking.simulation.loop import EVALUATIONS, FAILED, FLAG_COUNT, HELD, Loop
from tracking.simulation.result import SimulationOutcome, SimulationResult, settling_time
from tracking.simulation.setup import Setup
from tracking.tube.motion_bounds import empty_bounds

_OUTCOMES = {
    DIVERGED: SimulationOutcome.DIVERGED,
    EXHAUSTED: SimulationOutcome.EXHAUSTED,
}


def run(setup: Setup, law: Law) -> SimulationResult:
    """Integrate a closed loop of compiled parts.

    Begins with an explicit method of order 8 and goes over to an implicit one where it is stiff.

    Raises:
        MissingInertia: The robot lacks an inertia.
    """
    n, N, options = setup.robot.n, len(setup.start), setup.options
    bodies(setup.robot)
    loop = _loop(setup, law)
    record = empty_record(setup.times, n, N, has_tube=options.tube)
    x = setup.start.copy()
    steps = Steps(np.zeros((ALL_STAGES, N)), np.zeros((POWERS, N)), np.zeros(N))
    tolerances = np.array([options.relative_tolerance, options.absolute_tolerance])
    outcome = run_kernel(
        loop,
        setup.events,
        steps,
        stages(N),
        record,
        scratch(x, n, tolerances, has_tube=options.tube),
        options.max_evaluations,
        x,
    )
    if outcome == SINGULAR_MASS_MATRIX:
        raise massless(setup.robot, int(loop.flags[FAILED]) - 1)
    ended = _OUTCOMES.get(outcome, SimulationOutcome.COMPLETED)
    return result_of(setup, record, ended, int(loop.flags[EVALUATIONS]))


def _loop(setup: Setup, law: Law) -> Loop:
    n, b = setup.robot.n, len(law.columns)
    acting = setup.disturbance or Disturbance()
    constant, amplitude = acting.parts(setup.robot)
    tip = setup.robot.tip
    breaks, coefficients = setup.signal.arrays()
    flags = np.zeros(FLAG_COUNT, dtype=np.int64)
    flags[HELD] = int(setup.zero_order_hold)
    return Loop(
        law,
        space(n, law),
        np.array(setup.limit),
        np.array(constant),
        np.array(amplitude),
        2.0 * np.pi * acting.frequency,
        np.array(acting.wrench),
        np.array(tip.T_joint_link[:3, 3]),
        tip.joint,
        breaks,
        coefficients,
        np.zeros((2, n)),
        np.zeros(n + b),
        np.zeros(n),
        np.zeros((2, n)),
        np.zeros((3, n)),
        stop_arrays(setup.robot, setup.options.stops),
        flags,
    )


def empty_record(times: Array, n: int, N: int, *, has_tube: bool) -> Record:
    """A record of n joints and N states without a sample."""
    m = len(times)
    return Record(
        np.array(times),
        np.zeros((m, N)),
        np.zeros((m, n)),
        np.zeros((m, n), dtype=np.bool_),
        np.zeros((m, 2)),
        np.zeros((m, 2, n)),
        empty_bounds(float(times[-1]), n, has_cells=has_tube),
        np.zeros(COUNTER_COUNT, dtype=np.int64),
    )


def result_of(
    setup: Setup, record: Record, outcome: SimulationOutcome, evaluations: int
) -> SimulationResult:
    """The samples of a run, and what is bounded over all of it."""
    n, m = setup.robot.n, int(record.counters[SAMPLES])
    x, references = record.states[:m], record.references[:m]
    error = references[:, 0] - x[:, :n]
    times = record.times[:m]
    return SimulationResult(
        outcome=outcome,
        times=times,
        position=x[:, :n],
        velocity=x[:, n : 2 * n],
        reference_position=references[:, 0],
        reference_velocity=references[:, 1],
        torque=record.torques[:m],
        saturated=record.saturated[:m].copy(),
        lyapunov=record.lyapunov[:m, 0],
        lyapunov_rate=record.lyapunov[:m, 1],
        estimate=x[:, 2 * n :],
        bounds=record.bounds,
        max_tracking_error=np.maximum(record.bounds.max_error, np.abs(error).max(axis=0)),
        settling_time=settling_time(times, error, setup.options.settling_tolerance),
        evaluations=evaluations,
        steps=int(record.counters[EXPLICIT_STEPS]),
        implicit_steps=int(record.counters[IMPLICIT_STEPS]),
    )

"""The closed loop with a controller of the user's own, called from Python at every evaluation."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from dynamics.forward import forward_dynamics_kernel, massless
from dynamics.model.body import bodies
from kinematics.arrays import Array
from kinematics.velocity import holding_torques
from tracking.controllers.controller import AdaptiveController, Controller, Flow
from tracking.simulation.compiled import empty_record, result_of
from tracking.simulation.disturbance import add_stops, stop_arrays
from tracking.simulation.integrators.explicit import explicit_polynomials
from tracking.simulation.integrators.record import EXPLICIT_STEPS, SAMPLES
from tracking.simulation.loop import HOPELESS, RUNAWAY
from tracking.simulation.result import SimulationOutcome, SimulationResult
from tracking.simulation.setup import Setup
from tracking.tube.motion_bounds import STEP_COEFFICIENTS, bound_step


class _Command(NamedTuple):
    """Command of the controller at one instant."""

    torque: Array
    saturated: NDArray[np.bool_]
    adaptation: Array


_Law = Callable[[float, Array], _Command]


def run(setup: Setup) -> SimulationResult:
    """Integrate a closed loop by an explicit method of order 8, from cut to cut.

    Raises:
        MissingInertia: The robot, or a model that the controller needs, lacks an inertia.
    """
    return _Loop(setup).run()


class _Loop:
    """One run; the state x is [q; q_dot; estimate]."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.rows = bodies(setup.robot).rows
        self.n = setup.robot.n
        self.segment = 0
        self.held: _Command | None = None
        tube, states = setup.options.tube, len(setup.start)
        self.record = empty_record(setup.times, self.n, states, has_tube=tube)
        self.reference = setup.signal.arrays()
        self.stops = stop_arrays(setup.robot, setup.options.stops)
        self.evaluations = 0

    def run(self) -> SimulationResult:
        """Integrate segment by segment: each is smooth, or holds one torque."""
        outcome, x, events = SimulationOutcome.COMPLETED, self.setup.start, self.setup.events
        law: _Law = self.command
        for self.segment in range(len(events.pieces)):
            start, end = events.times[self.segment : self.segment + 2]
            if self.setup.zero_order_hold:
                if events.called[self.segment]:
                    self.held = self.command(start, x)
                law = self.keep
            if not self.record.counters[SAMPLES]:
                self.sample(start, x, law)
            outcome, x = self.advance(float(start), float(end), x, law)
            if outcome is not SimulationOutcome.COMPLETED:
                break
        else:
            self.sample(float(events.times[-1]), x, law)
        return result_of(self.setup, self.record, outcome, self.evaluations)

    def keep(self, _t: float, _x: Array) -> _Command:
        """The command that is held."""
        assert self.held is not None
        return self.held

    def command(self, t: float, x: Array) -> _Command:
        """The controller's torque cut off at the limits, and the change of its estimate."""
        n, events = self.n, self.setup.events
        noise = events.noise[events.noises[self.segment]]
        q, qd = x[:n] + noise[0], x[n : 2 * n] + noise[1]
        reference = self.setup.signal.at(t, int(events.pieces[self.segment]))
        controller, adaptation = self.with_estimate(x), np.zeros(0)
        asked = controller.torque(t, q, qd, reference)
        if isinstance(controller, AdaptiveController):
            adaptation = controller.adaptation(t, q, qd, reference)
        torque = np.clip(asked, -self.setup.limit, self.setup.limit)
        return _Command(torque, torque != asked, adaptation)

    def with_estimate(self, x: Array) -> Controller:
        """The controller at the state's estimate."""
        controller = self.setup.controller
        if isinstance(controller, AdaptiveController):
            return controller.with_estimate(x[2 * self.n :])
        return controller

    def disturbance(self, t: float, q: Array) -> Array:
        """Disturbance torques on the joints, shape (n,)."""
        acting = self.setup.disturbance
        if acting is None or not self.setup.events.disturbed[self.segment]:
            return np.zeros(self.n)
        constant, amplitude = acting.parts(self.setup.robot)
        wave = np.sin(2.0 * np.pi * acting.frequency * t)
        pushed = holding_torques(self.setup.robot, q, acting.wrench)
        return np.asarray(constant + amplitude * wave + pushed)

    def rate(self, t: float, x: Array, law: _Law) -> Array:
        """Time derivative of the state; NaN, which no integrator accepts, where it is hopeless."""
        self.evaluations += 1
        if not np.abs(x).max() < HOPELESS:
            return np.full_like(x, np.nan)
        n = self.n
        command = law(t, x)
        # Straight to the kernel: the state is known to be finite and of the right length.
        state, qdd = np.empty((1, 3, n)), np.empty((1, n))
        state[0, :2] = x[: 2 * n].reshape(2, n)
        state[0, 2] = command.torque + self.disturbance(t, x[:n])
        add_stops(self.stops, x[:n], x[n : 2 * n], state[0, 2])
        failed = forward_dynamics_kernel(self.rows, state, qdd)
        if failed >= 0:
            raise massless(self.setup.robot, failed)
        return np.concatenate([x[n : 2 * n], qdd[0], command.adaptation])

    def advance(
        self, start: float, end: float, x: Array, law: _Law
    ) -> tuple[SimulationOutcome, Array]:
        """Integrate over one segment, recording what falls into it."""
        options = self.setup.options
        solver = DOP853(
            partial(self.rate, law=law),
            start,
            x,
            end,
            rtol=options.relative_tolerance,
            atol=options.absolute_tolerance,
            # A held torque makes a smooth motion over a short time: try it in one step.
            first_step=end - start if self.setup.zero_order_hold else None,
        )
        while solver.status == "running":
            if self.evaluations >= options.max_evaluations:
                return SimulationOutcome.EXHAUSTED, solver.y
            before = solver.t, solver.y
            failure = solver.step()
            if failure is not None or np.abs(solver.y).max() > RUNAWAY:
                return SimulationOutcome.DIVERGED, solver.y
            self.record.counters[EXPLICIT_STEPS] += 1
            self.note(before, solver, law)
        return SimulationOutcome.COMPLETED, solver.y

    def note(self, before: tuple[float, Array], solver: "DOP853[np.float64]", law: _Law) -> None:
        """Record the samples of one step, those at its end excepted, and the step's bounds."""
        t_old, x_old = before
        times = self.setup.times[:-1]
        interpolate: Any = solver.dense_output()
        counters, bounds = self.record.counters, self.record.bounds
        while counters[SAMPLES] < len(times) and times[counters[SAMPLES]] < solver.t:
            t = float(times[counters[SAMPLES]])
            self.sample(t, interpolate(t) if t > t_old else x_old, law)
        breaks, coefficients = self.reference
        piece = int(self.setup.events.pieces[self.segment])
        motion = np.empty((2 * self.n, STEP_COEFFICIENTS))
        explicit_polynomials(np.ascontiguousarray(interpolate.F), np.array(x_old), motion)
        bound_step(bounds, coefficients[piece], breaks[piece], motion, t_old, solver.t - t_old)
        # Errors of a loop in Python are summed up, not carried along: true of stable loops.
        # A step is accepted where its error, a root mean square, is at most the tolerance.
        options, n = self.setup.options, self.n
        size = np.maximum(np.abs(x_old[:n]), np.abs(solver.y[:n]))
        scale = options.absolute_tolerance + options.relative_tolerance * size
        bounds.global_error[0] += np.sqrt(len(x_old)) * scale
        self.note_torque(law(solver.t, solver.y).torque)

    def note_torque(self, torque: Array) -> None:
        """Raise the largest torque of each joint to ``torque`` (n,)."""
        peak = self.record.bounds.peak_torque
        np.maximum(peak, np.abs(torque), out=peak)

    def sample(self, t: float, x: Array, law: _Law) -> None:
        """Record one sample."""
        n = self.n
        q, qd = x[:n], x[n : 2 * n]
        reference = self.setup.signal.at(t, int(self.setup.events.pieces[self.segment]))
        command = law(t, x)
        self.note_torque(command.torque)
        controller, robot = self.with_estimate(x), self.setup.robot
        rate = self.rate(t, x, law)
        self.evaluations -= 1  # Samples are no steps of the integrator.
        flow = Flow(q, qd, rate[n : 2 * n], rate[2 * n :])
        V = controller.lyapunov(q, qd, reference, robot)
        V_dot = controller.lyapunov_rate(flow, reference, robot)
        record, k = self.record, self.record.counters[SAMPLES]
        record.states[k], record.torques[k], record.saturated[k] = x, *command[:2]
        record.references[k] = reference.position, reference.velocity
        record.lyapunov[k] = V, V_dot
        record.counters[SAMPLES] += 1

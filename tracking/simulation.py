"""The closed loop: a robot, its controller and a trajectory, integrated over time."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import DOP853

from dynamics.body import bodies
from dynamics.forward import forward_dynamics_kernel, massless
from kinematics.chain import Array, Chain
from kinematics.errors import InvalidOption, InvalidRobotState
from kinematics.trajectory import MAX_SAMPLES, Trajectory
from tracking.controller import AdaptiveController, Controller
from tracking.reference import ReferenceSignal
from tracking.result import SimulationOutcome, SimulationResult, settling_time

#: A state beyond this [rad, m, rad/s, m/s] is no robot any more: the loop has run away.
RUNAWAY = 1e6
# Trial steps this far out are refused unseen, so that nothing overflows; accepted ones end it.
_HOPELESS = 1e3 * RUNAWAY
# A period that would begin this part of one before the end is the end itself, to rounding.
_SAME_PERIOD = 1e-6


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """How to integrate and what to record.

    Args:
        duration: [s]; the trajectory's own where none is given, longer to watch it settle.
        sample_period: Time between two samples of the result [s].
        control_period: Time for which the torque is held [s]; None for a continuous controller.
        relative_tolerance: Of each step of the integrator.
        absolute_tolerance: Of each step [rad, m, rad/s, m/s].
        saturate: Cut the torque off at the robot's effort limits; all must then be known.
        settling_tolerance: Largest tracking error of a settled robot [rad or m].
        max_evaluations: Evaluations of the robot's dynamics before giving up.

    Raises:
        InvalidOption: A value is not positive, or a tolerance is not within 1e-13 to 1e-2.
    """

    duration: float | None = None
    sample_period: float = 0.01
    control_period: float | None = None
    relative_tolerance: float = 1e-8
    absolute_tolerance: float = 1e-10
    saturate: bool = True
    settling_tolerance: float = 1e-3
    max_evaluations: int = 1_000_000

    def __post_init__(self) -> None:
        for name in ("duration", "sample_period", "control_period", "settling_tolerance"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise InvalidOption(f"{name} is {value}", hint="Give a positive finite number.")
        for name in ("relative_tolerance", "absolute_tolerance"):
            value = getattr(self, name)
            # Below 1e-13 rounding errors alone exceed it; above 1e-2 the answer means nothing.
            if not 1e-13 <= value <= 1e-2:
                raise InvalidOption(f"{name} is {value}", hint="Give one from 1e-13 to 1e-2.")
        if self.max_evaluations < 1:
            raise InvalidOption(
                f"max_evaluations is {self.max_evaluations}", hint="Give at least 1."
            )


def simulate(
    controller: Controller,
    trajectory: Trajectory,
    options: SimulationOptions | None = None,
    *,
    robot: Chain | None = None,
    initial_position: ArrayLike | None = None,
    initial_velocity: ArrayLike | None = None,
    disturbance: ArrayLike | None = None,
) -> SimulationResult:
    """Let a controller drive a robot along a trajectory, and hold it at rest at the end.

    M q_ddot + C q_dot + B q_dot + G = sat(u) + d, by an explicit Runge-Kutta method of order 8
    with error control (DOP853, "Solving Ordinary Differential Equations I", section II.5). The
    joints have no stops: position limits are not enforced.

    Args:
        controller: With the model it believes in.
        trajectory: The reference.
        options: How to integrate.
        robot: The true robot, for example ``dynamics.body.scale_masses`` of the model; the
            controller's model where none is given.
        initial_position: Shape (n,) [rad or m]; the start of the trajectory by default.
        initial_velocity: Shape (n,) [rad/s or m/s]; that of the trajectory by default.
        disturbance: d, constant torque at the joints that the controller does not know of,
            shape (n,) [N m or N].

    Returns:
        The motion up to the end or to where it broke off, as the outcome says.

    Raises:
        InvalidOption: Trajectory and robot have different joints, or too many samples are asked.
        InvalidRobotState: An initial state or the disturbance has the wrong length or is not
            finite.
        MissingInertia: The robot, or a model that the controller needs, lacks an inertia.
        MissingLimit: An effort limit is not known, and ``saturate`` is on.
    """
    body = controller.chain if robot is None else robot
    loop = _Loop(controller, trajectory, options or SimulationOptions(), body)
    start = loop.signal.at(0.0)
    q = start.position if initial_position is None else initial_position
    qd = start.velocity if initial_velocity is None else initial_velocity
    state = [body.configuration(q, "initial_position"), body.configuration(qd, "initial_velocity")]
    if any(part.shape != (body.n,) for part in state):
        raise InvalidRobotState("a simulation starts at one state, not at a batch of them")
    if isinstance(controller, AdaptiveController):
        state.append(controller.estimate)
    if disturbance is not None:
        loop.disturbance = body.configuration(disturbance, "disturbance")
    return loop.run(np.concatenate(state))


class _Command(NamedTuple):
    """What the controller does at one instant."""

    torque: Array
    saturated: NDArray[np.bool_]
    adaptation: Array


_Law = Callable[[float, Array], _Command]


class _Sample(NamedTuple):
    """One row of the result; the fields are named as there."""

    times: float
    position: Array
    velocity: Array
    reference_position: Array
    reference_velocity: Array
    torque: Array
    saturated: NDArray[np.bool_]
    lyapunov: float
    estimate: Array


class _Loop:
    """One run of ``simulate``; the state x is [q; q_dot; estimate]."""

    def __init__(
        self,
        controller: Controller,
        trajectory: Trajectory,
        options: SimulationOptions,
        robot: Chain,
    ) -> None:
        _check_joints(controller.chain, trajectory, robot)
        self.rows = bodies(robot).rows
        self.controller, self.options, self.robot = controller, options, robot
        self.signal = ReferenceSignal(trajectory)
        self.duration = trajectory.duration if options.duration is None else options.duration
        self.times = list(_periods(self.duration, options.sample_period, "sample_period"))
        self.limit = np.full(robot.n, np.inf)
        if options.saturate:
            self.limit = robot.limits.require("effort", robot.joint_names)
        self.disturbance = np.zeros(robot.n)
        self.worst = np.zeros(robot.n)
        self.evaluations = 0
        self.samples: list[_Sample] = []

    def run(self, x: Array) -> SimulationResult:
        """Integrate segment by segment: each is smooth, or holds one torque."""
        outcome = SimulationOutcome.COMPLETED
        for start, end in self.segments():
            law = self.law(start, x)
            if not self.samples:
                self.sample(start, x, law)
            outcome, x = self.advance(start, end, x, law)
            if outcome is not SimulationOutcome.COMPLETED:
                break
        else:
            self.sample(self.duration, x, law)
        return self.result(outcome)

    def segments(self) -> Iterator[tuple[float, float]]:
        """Spans of time over which the right-hand side is smooth."""
        if self.options.control_period is None:
            cuts = [0.0, *self.signal.breaks(self.duration), self.duration]
        else:
            periods = _periods(self.duration, self.options.control_period, "control_period")
            cuts = [*periods, self.duration]
        return pairwise(cuts)

    def law(self, start: float, x: Array) -> _Law:
        """The controller over one segment: continuous in one piece, or held from its start."""
        smooth = partial(self.command, piece=self.signal.piece(start))
        if self.options.control_period is None:
            return smooth
        held = smooth(start, x)
        return lambda _t, _x: held

    def command(self, t: float, x: Array, piece: int) -> _Command:
        """The controller's torque cut off at the limits, and the change of its estimate."""
        n = self.robot.n
        q, qd, reference = x[:n], x[n : 2 * n], self.signal.at(t, piece)
        controller, adaptation = self.with_estimate(x), np.zeros(0)
        asked = controller.torque(t, q, qd, reference)
        if isinstance(controller, AdaptiveController):
            adaptation = controller.adaptation(t, q, qd, reference)
        torque = np.clip(asked, -self.limit, self.limit)
        return _Command(torque, torque != asked, adaptation)

    def with_estimate(self, x: Array) -> Controller:
        """The controller at the state's estimate."""
        if isinstance(self.controller, AdaptiveController):
            return self.controller.with_estimate(x[2 * self.robot.n :])
        return self.controller

    def rate(self, t: float, x: Array, law: _Law) -> Array:
        """Time derivative of the state; NaN, which no integrator accepts, where it is hopeless."""
        self.evaluations += 1
        if not np.abs(x).max() < _HOPELESS:
            return np.full_like(x, np.nan)
        n = self.robot.n
        command = law(t, x)
        # Straight to the kernel: the state is known to be finite and of the right length.
        state, qdd = np.empty((1, 3, n)), np.empty((1, n))
        state[0, :2] = x[: 2 * n].reshape(2, n)
        state[0, 2] = command.torque + self.disturbance
        failed = forward_dynamics_kernel(self.rows, state, qdd)
        if failed >= 0:
            raise massless(self.robot, failed)
        return np.concatenate([x[n : 2 * n], qdd[0], command.adaptation])

    def advance(
        self, start: float, end: float, x: Array, law: _Law
    ) -> tuple[SimulationOutcome, Array]:
        """Integrate over one segment, recording what falls into it."""
        solver = DOP853(
            partial(self.rate, law=law),
            start,
            x,
            end,
            rtol=self.options.relative_tolerance,
            atol=self.options.absolute_tolerance,
            # A held torque makes a smooth motion over a short time: try it in one step.
            first_step=None if self.options.control_period is None else end - start,
        )
        while solver.status == "running":
            if self.evaluations >= self.options.max_evaluations:
                return SimulationOutcome.EXHAUSTED, solver.y
            before = solver.t, solver.y
            failure = solver.step()
            if failure is not None or np.abs(solver.y).max() > RUNAWAY:
                return SimulationOutcome.RAN_AWAY, solver.y
            self.note(before, solver, law)
        return SimulationOutcome.COMPLETED, solver.y

    def note(self, before: tuple[float, Array], solver: "DOP853[np.float64]", law: _Law) -> None:
        """Record the samples of one step, those at its end excepted, and the error at its end."""
        t_old, x_old = before
        interpolate: Callable[[float], Array] | None = None
        while len(self.samples) < len(self.times) and self.times[len(self.samples)] < solver.t:
            t = self.times[len(self.samples)]
            if t > t_old and interpolate is None:
                interpolate = solver.dense_output()
            self.sample(t, x_old if interpolate is None else interpolate(t), law)
        self.weigh(self.signal.at(solver.t).position - solver.y[: self.robot.n])

    def sample(self, t: float, x: Array, law: _Law) -> None:
        """Record one sample."""
        n = self.robot.n
        q, qd, estimate = x[:n], x[n : 2 * n], x[2 * n :]
        reference, command = self.signal.at(t), law(t, x)
        self.weigh(reference.position - q)
        V = self.with_estimate(x).lyapunov(q, qd, reference)
        at = reference.position, reference.velocity, command.torque, command.saturated
        self.samples.append(_Sample(t, q, qd, *at, V, estimate))

    def weigh(self, error: Array) -> None:
        """Keep the largest error of each joint."""
        self.worst = np.maximum(self.worst, np.abs(error))

    def result(self, outcome: SimulationOutcome) -> SimulationResult:
        """All samples side by side."""
        columns = {
            name: np.array([getattr(sample, name) for sample in self.samples])
            for name in _Sample._fields
        }
        error = columns["reference_position"] - columns["position"]
        settled = settling_time(columns["times"], error, self.options.settling_tolerance)
        return SimulationResult(
            outcome=outcome,
            **columns,
            max_tracking_error=self.worst,
            settling_time=settled,
            evaluations=self.evaluations,
        )


def _periods(duration: float, period: float, name: str) -> Iterator[float]:
    """Times 0, period, 2 period, ... before ``duration``."""
    if duration / period > MAX_SAMPLES:
        raise InvalidOption(
            f"a {name} of {period} s over {duration} s gives more than {MAX_SAMPLES} of them",
            hint=f"Give at least {duration / MAX_SAMPLES:.3g} s.",
        )
    count = max(1, math.ceil(duration / period - _SAME_PERIOD))
    return (i * period for i in range(count))


def _check_joints(model: Chain, trajectory: Trajectory, robot: Chain) -> None:
    for name, joints in (("trajectory", trajectory.joint_names), ("robot", robot.joint_names)):
        if joints != model.joint_names:
            raise InvalidOption(
                f"the {name} has the joints {', '.join(joints)}, "
                f"the controller's model has {', '.join(model.joint_names)}",
                hint="Give all three the same joints in the same order.",
            )

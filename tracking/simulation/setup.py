"""One run of a closed loop, checked and ready to be integrated.

Events of a closed loop: breaks of the reference, control periods, disturbances.

Options of the simulation of a closed loop.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotState, MissingLimit
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory, uniform_times
from tracking.controllers.controller import AdaptiveController, Controller
from tracking.simulation.disturbance import Disturbance, EncoderNoise, JointStops
from tracking.simulation.loop import RUNAWAY
from tracking.simulation.references import ReferenceSignal


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """Options of integration and recording.

    Args:
        duration: [s]; the trajectory's own where none is given, longer to watch it settle.
        sample_period: Time between two samples of the result [s].
        control_period: Time for which the torque is held [s]; None for a continuous controller.
        relative_tolerance: Relative tolerance of each step of the integrator.
        absolute_tolerance: Absolute tolerance of each step [rad, m, rad/s, m/s].
        saturate: Cut the torque off at the robot's effort limits; all must then be known.
        settling_tolerance: Largest tracking error of a settled robot [rad or m].
        stops: Stops of the joints at their position limits; none where none are given, so that
            joints pass their limits.
        tube: Whether bounds are kept in cells of time, with the integrator's errors carried along,
            for ``tracking.tube.tube``; a simulation takes about twice as long.
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
    stops: JointStops | None = None
    tube: bool = False

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


# Events closer than this part of the duration are one.
_SAME_EVENT = 1e-12


class Events(NamedTuple):
    """Instants at which the loop is not smooth or the controller is called (s segments between).

    Args:
        times: Shape (s + 1,) [s].
        pieces: Piece of the reference on each segment, shape (s,).
        called: Whether a held controller is called at the start, shape (s,).
        noises: Row of the encoders' errors, shape (s,).
        disturbed: Whether the disturbance acts, shape (s,).
        noise: The encoders' errors, shape (., 2, n).
    """

    times: Array
    pieces: NDArray[np.int64]
    called: NDArray[np.bool_]
    noises: NDArray[np.int64]
    disturbed: NDArray[np.bool_]
    noise: Array


def schedule(
    signal: ReferenceSignal,
    duration: float,
    options: SimulationOptions,
    disturbance: Disturbance | None,
    noise: EncoderNoise | None,
) -> Events:
    """All events of a run of ``duration`` seconds.

    Raises:
        InvalidOption: A period is too short for the duration.
    """
    called = np.zeros(0)
    if options.control_period is not None:
        called = uniform_times(duration, options.control_period, "control_period")[:-1]
    elif noise is not None:
        called = uniform_times(duration, noise.period, "encoder period")[:-1]
    others = signal.breaks(duration)
    if disturbance is not None:
        others += disturbance.cuts(duration)
    marks = [*((t, True) for t in called.tolist()), *((t, False) for t in [0.0, *others])]
    marks.sort(key=lambda mark: (mark[0], not mark[1]))
    starts, flags = [marks[0][0]], [marks[0][1]]
    for t, is_call in marks[1:]:
        if t - starts[-1] > _SAME_EVENT * duration:
            starts.append(t)
            flags.append(is_call)
        else:
            flags[-1] = flags[-1] or is_call
    rows = np.cumsum(flags) - 1 if len(called) else np.zeros(len(starts), dtype=np.int64)
    acts = [disturbance is not None and disturbance.start <= t < disturbance.end for t in starts]
    n = signal.trajectory.n
    return Events(
        np.array([*starts, duration]),
        np.array([signal.piece(t + _SAME_EVENT * duration) for t in starts], dtype=np.int64),
        np.array(flags) & (options.control_period is not None),
        np.asarray(rows, dtype=np.int64),
        np.array(acts),
        np.zeros((max(len(called), 1), 2, n)) if noise is None else noise.draw(len(called), n),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """Setup of one simulation run.

    Args:
        controller: Controller with the model that it has.
        robot: The true robot.
        options: Settings of the integration.
        signal: The reference.
        times: Instants of the samples, shape (m,) [s]; the last is the duration.
        events: Instants at which the loop is not smooth.
        limit: Effort limits, shape (n,), inf where there is none.
        disturbance: Disturbance that the controller does not know of.
        start: The state x = [q; q_dot; estimate], shape (N,).
    """

    controller: Controller
    robot: Chain
    options: SimulationOptions
    signal: ReferenceSignal
    times: Array
    events: Events
    limit: Array
    disturbance: Disturbance | None
    start: Array

    @property
    def zero_order_hold(self) -> bool:
        """Whether the torque is held from one call of the controller to the next."""
        return self.options.control_period is not None


def prepare(
    controller: Controller,
    trajectory: Trajectory,
    options: SimulationOptions,
    robot: Chain,
    initial: tuple[ArrayLike | None, ArrayLike | None],
    disturbance: Disturbance | None,
    noise: EncoderNoise | None,
) -> Setup:
    """Check everything that a run needs.

    Raises:
        InvalidOption: Trajectory and robot have different joints, or too many samples are asked.
        InvalidRobotState: An initial state has the wrong length or is not finite.
        MissingLimit: An effort limit is not known, and the options ask for saturation.
    """
    _check_joints(controller.chain, trajectory, robot)
    duration = trajectory.duration if options.duration is None else options.duration
    samples = uniform_times(duration, options.sample_period, "sample_period")
    limit = np.full(robot.n, np.inf)
    if options.saturate:
        limit = _effort_limits(robot)
    signal = ReferenceSignal(trajectory)
    start = signal.at(0.0)
    q = start.position if initial[0] is None else initial[0]
    qd = start.velocity if initial[1] is None else initial[1]
    state = [
        robot.configuration(q, "initial_position"),
        robot.configuration(qd, "initial_velocity"),
    ]
    if any(part.shape != (robot.n,) for part in state):
        raise InvalidRobotState("a simulation starts at one state, not at a batch of them")
    _check_start(robot, np.array(state), options)
    if isinstance(controller, AdaptiveController):
        state.append(controller.estimate)
    return Setup(
        controller,
        robot,
        options,
        signal,
        samples,
        schedule(signal, duration, options, disturbance, noise),
        limit,
        disturbance,
        np.concatenate(state),
    )


def _effort_limits(robot: Chain) -> Array:
    """Largest torques of the motors, shape (n,).

    Raises:
        MissingLimit: One is not known.
    """
    try:
        return robot.limits.require("effort", robot.joint_names)
    except MissingLimit as error:
        hint = f'{error.hint} Or let the motors give any torque: "saturate": false.'
        raise MissingLimit(error.message, hint=hint, **error.details) from None


def _check_joints(model: Chain, trajectory: Trajectory, robot: Chain) -> None:
    for name, joints in (("trajectory", trajectory.joint_names), ("robot", robot.joint_names)):
        if joints != model.joint_names:
            raise InvalidOption(
                f"the {name} has the joints {', '.join(joints)}, "
                f"the controller's model has {', '.join(model.joint_names)}",
                hint="Give all three the same joints in the same order.",
            )


def _check_start(robot: Chain, state: Array, options: SimulationOptions) -> None:
    """Refuse initial positions and velocities (2, n) at which no robot can be.

    Raises:
        InvalidRobotState: A value is beyond every robot's, or a joint starts inside a stop.
    """
    row, joint = np.unravel_index(int(np.argmax(np.abs(state))), state.shape)
    name = repr(robot.joint_names[int(joint)])
    if abs(state[row, joint]) > RUNAWAY:
        quantity = ("position", "velocity")[int(row)]
        raise InvalidRobotState(
            f"the initial {quantity} of joint {name} is {state[row, joint]:.6g}",
            hint=f"Give at most {RUNAWAY:g}: a loop that goes beyond counts as run away.",
        )
    limits = robot.limits
    inside = (state[0] < limits.lower) | (state[0] > limits.upper)
    if options.stops is not None and inside.any():
        first = int(np.argmax(inside))
        raise InvalidRobotState(
            f"joint {robot.joint_names[first]!r} starts at {state[0, first]:.6g}, inside its stop",
            hint="Start within the position limits, or leave the joint stops out.",
        )

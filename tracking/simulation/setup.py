"""One run of a closed loop, checked and ready to be integrated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotState, MissingLimit
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from tracking.controllers.controller import AdaptiveController, Controller
from tracking.simulation.disturbance import Disturbance, EncoderNoise
from tracking.simulation.loop import RUNAWAY
from tracking.simulation.options import SimulationOptions
from tracking.simulation.references import ReferenceSignal
from tracking.simulation.schedule import Events, periods, schedule


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
    samples = list(periods(duration, options.sample_period, "sample_period"))
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
        np.array([*samples, duration]),
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

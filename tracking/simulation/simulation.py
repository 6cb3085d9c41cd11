"""The closed loop: a robot, its controller and a trajectory, integrated over time."""

from numpy.typing import ArrayLike

from kinematics.arrays import typed
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from tracking.controllers.controller import Controller
from tracking.simulation import callback, compiled
from tracking.simulation.disturbance import Disturbance, EncoderNoise
from tracking.simulation.result import SimulationResult
from tracking.simulation.setup import SimulationOptions, prepare

__all__ = ["Disturbance", "EncoderNoise", "SimulationOptions", "simulate"]


@typed
def simulate(
    controller: Controller,
    trajectory: Trajectory,
    options: SimulationOptions | None = None,
    *,
    robot: Chain | None = None,
    initial_position: ArrayLike | None = None,
    initial_velocity: ArrayLike | None = None,
    disturbance: Disturbance | ArrayLike | None = None,
    noise: EncoderNoise | None = None,
) -> SimulationResult:
    """Let a controller drive a robot along a trajectory, and hold it at rest at the end.

        M q_ddot + C q_dot + B q_dot + G = sat(u) + d,

    by an explicit Runge-Kutta method of order 8 with error control, and from where the loop turns
    out to be stiff by an implicit one of order 5. Controllers of this package run compiled; one of
    the user's own is called from Python, with the explicit method only. The joints have no stops:
    position limits are not enforced.

    Args:
        controller: Controller with the model that it has.
        trajectory: The reference.
        options: Settings of the integration.
        robot: The true robot, for example the model with ``dynamics.model.body.scale_masses`` or
            ``dynamics.model.payload.with_inertias``; the controller's model where none is given.
        initial_position: Shape (n,) [rad or m]; the start of the trajectory by default.
        initial_velocity: Shape (n,) [rad/s or m/s]; that of the trajectory by default.
        disturbance: Disturbance of the robot that the controller does not know of; an array (n,) is
            a constant torque [N m or N].
        noise: Errors of what the controller is told of the state.

    Returns:
        The motion up to the end or to where it broke off, as the outcome says.

    Raises:
        InvalidOption: Trajectory and robot have different joints, or too many samples are asked.
        InvalidRobotState: An initial state or the disturbance has the wrong length or is not
            finite.
        MissingInertia: The robot, or a model that the controller needs, lacks an inertia.
        MissingLimit: An effort limit is not known, and the options ask for saturation.
    """
    body = controller.chain if robot is None else robot
    if disturbance is not None and not isinstance(disturbance, Disturbance):
        disturbance = Disturbance(torque=disturbance)
    if disturbance is not None:
        disturbance.parts(body)
    setup = prepare(
        controller,
        trajectory,
        options or SimulationOptions(),
        body,
        (initial_position, initial_velocity),
        disturbance,
        noise,
    )
    law = controller.compiled_law(body)
    return callback.run(setup) if law is None else compiled.run(setup, law)

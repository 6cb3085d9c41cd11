"""Closed-loop simulation of a robot that follows a motion under a controller."""

from typing import Any, TypedDict

from armwright_client.base import Answer, Options, Positive, Request
from armwright_client.trajectory import Trajectory


class SimulateOptions(TypedDict, total=False):
    """What may differ between the model and the robot that is simulated.

    Args:
        model_error: Errors of the controller's model.
        disturbance: Forces the controller does not know of.
        initial_state: Where the robot is when the motion begins.
        timeout: [s].
    """

    model_error: Options
    disturbance: Options
    initial_state: Options
    timeout: float


class SimulateRequest(Request):
    """A motion to be followed under a controller; see `SimulateOptions`."""

    robot: str
    trajectory: Trajectory
    controller: Options
    model_error: Options | None = None
    disturbance: Options | None = None
    initial_state: Options | None = None
    timeout: Positive | None = None


class Simulation(Answer):
    """How well the motion was followed.

    Args:
        time: [s].
        position: q at each time.
        velocity: q̇ at each time.
        reference: What was to be followed.
        torque: At each time [N m or N].
        tracking_error: At each time.
        lyapunov: V(t).
        max_tracking_error: Of each joint, or of all.
        settled: Whether the error stays small at the end.
    """

    time: list[float] | None = None
    position: list[list[float]] | None = None
    velocity: list[list[float]] | None = None
    reference: Any = None
    torque: list[list[float]] | None = None
    tracking_error: list[list[float]] | None = None
    lyapunov: list[float] | None = None
    max_tracking_error: Any
    settled: Any

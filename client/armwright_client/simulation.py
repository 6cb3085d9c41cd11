"""Closed-loop simulation of a robot that follows a motion under a controller."""

from typing import TypedDict

from armwright_client.base import (
    Answer,
    Matrix,
    Options,
    OptionsList,
    Positive,
    Request,
    Vector,
    VectorLike,
)
from armwright_client.scene import AllowedPairs, SceneReference
from armwright_client.trajectory import Trajectory


class SimulateOptions(TypedDict, total=False):
    """Options of a simulation: model errors, disturbances, integration.

    Args:
        motors: Motors of all joints or of each: inertia, gear_ratio, torque_constant, ...; the
            robot's own if left out.
        motor_inertia: J of the robot, in place of its own [kg m² or kg].
        viscous_friction: B of the robot, in place of its own [N m s/rad or N s/m].
        coulomb_friction: Dry friction of the robot, in place of its own [N m or N].
        effort_limits: Of the drives, in place of the robot's [N m or N].
        joint_stops: Stops of the joints: stiffness, dissipation; {} for the usual ones.
        model_error: Errors of the controller's model: mass_scale, inertias, payload, ...
        disturbance: Forces the controller does not know of: torque, amplitude, wrench, ...
        initial_state: Where the robot is when the motion begins: joints, offset, ...
        noise: Standard deviations of the encoders: position, velocity.
        control_period: How long each torque is held [s]; a continuous controller if left out.
        duration: [s]; the trajectory's if left out.
        sample_period: Of the answer [s].
        saturate: Whether torques are cut off at the effort limits.
        settling_tolerance: [rad or m].
        relative_tolerance: Of the integrator.
        absolute_tolerance: Of the integrator.
        scene: With one, the tracking tube is answered.
        frame: Of an inline scene that names none: a link that stands still, or "tool".
        attached: What the robot holds.
        allowed_collisions: More pairs that may touch.
        timeout: [s].
        seed: Of the noise.
    """

    motors: Options | OptionsList
    motor_inertia: float | VectorLike
    viscous_friction: float | VectorLike
    coulomb_friction: float | VectorLike
    effort_limits: float | VectorLike
    joint_stops: Options
    model_error: Options
    disturbance: Options
    initial_state: Options
    noise: Options
    control_period: float
    duration: float
    sample_period: float
    saturate: bool
    settling_tolerance: float
    relative_tolerance: float
    absolute_tolerance: float
    scene: SceneReference
    frame: str
    attached: OptionsList
    allowed_collisions: AllowedPairs
    timeout: float
    seed: int


class SimulateRequest(Request):
    """A motion to be followed under a controller; see `SimulateOptions`."""

    robot: str
    trajectory: Trajectory | None = None
    reference: Options | None = None
    controller: Options
    motors: Options | OptionsList | None = None
    motor_inertia: float | Vector | None = None
    viscous_friction: float | Vector | None = None
    coulomb_friction: float | Vector | None = None
    effort_limits: float | Vector | None = None
    joint_stops: Options | None = None
    model_error: Options | None = None
    disturbance: Options | None = None
    initial_state: Options | None = None
    noise: Options | None = None
    control_period: Positive | None = None
    duration: Positive | None = None
    sample_period: Positive | None = None
    saturate: bool | None = None
    settling_tolerance: Positive | None = None
    relative_tolerance: Positive | None = None
    absolute_tolerance: Positive | None = None
    scene: SceneReference | None = None
    frame: str | None = None
    attached: OptionsList | None = None
    allowed_collisions: AllowedPairs | None = None
    timeout: Positive | None = None
    seed: int | None = None


class RemainingClearance(Answer):
    """Clearance of the reference from obstacles, or among own links, and what tracking leaves.

    Args:
        clearance: The certificate's bound for the reference [m]; None with nothing to hit.
        pair: The pair that comes nearest.
        displacement: Of any point from where it should be, or of a link as another one sees it, at
            most [m].
        displaced_link: The link that is displaced that much.
        seen_from: The link that sees it; None for the base.
        remaining: Clearance that is left, at least [m].
    """

    clearance: float | None = None
    pair: tuple[str, str] | None = None
    displacement: float
    displaced_link: str | None = None
    seen_from: str | None = None
    remaining: float | None = None


class TrackedLimitUse(Answer):
    """Use of one kind of limit by the tracked motion.

    Args:
        ratio: Largest |value| / limit; for positions of the distance from the middle of the range
            to half the range. Above 1 the limit is broken.
        joint: The joint.
    """

    ratio: float
    joint: str


class Tube(Answer):
    """Whether the motion as it was tracked still clears all obstacles.

    Args:
        joint_error: Largest error of each joint.
        reach: How far any point of the robot moves for a unit of each joint, at most.
        displacement: Of any point of the robot from where it should be, at most [m].
        reference_clearance: The certificate's bound [m]; None with nothing to hit.
        remaining_clearance: What is left [m], at least: the smaller of the two below.
        obstacles: Clearance from obstacles, and what tracking leaves of it.
        own_links: Clearance among the robot's own links, likewise.
        limits: Use of position, velocity and torque limits by the tracked motion.
        tracked_clearance: Certified of the cubic through the samples of the tracked motion [m].
        clears: Whether the tracked motion is proved to clear everything.
        reason: Why not.
    """

    joint_error: list[float]
    reach: list[float]
    displacement: float
    reference_clearance: float | None = None
    remaining_clearance: float | None = None
    obstacles: RemainingClearance
    own_links: RemainingClearance
    limits: dict[str, TrackedLimitUse]
    tracked_clearance: float | None = None
    clears: bool
    reason: str | None = None


class SimulationReference(Answer):
    """The reference that the controller follows."""

    position: Matrix
    velocity: Matrix


class SimulatedController(Answer):
    """The controller with the gains that were used.

    Args:
        type: Its name.
        gains: Each gain by its name.
        parameter_names: Of the estimate of an adaptive controller.
        parameter_labels: As textbooks write them, with units: "m2·lc2 [kg m]".
        parameter_units: Of each entry of the estimate.
    """

    type: str
    gains: dict[str, list[float] | Matrix]
    parameter_names: list[str] | None = None
    parameter_labels: list[str] | None = None
    parameter_units: list[str] | None = None


class Simulation(Answer):
    """Course of a simulation.

    Args:
        outcome: "completed", "ran_away" or "exhausted".
        advice: What that means and what to try.
        time: [s].
        position: q at each time.
        velocity: q̇ at each time.
        reference: The reference that the controller follows.
        torque: At each time, after saturation [N m or N].
        voltage: Of the motors, at each time [V]; None where neither the request nor the robot has
            any.
        saturated: Whether any joint wanted more than its limit.
        tracking_error: At each time.
        lyapunov: V(t).
        lyapunov_rate: dV/dt along the simulated motion.
        estimate: Parameters at each time, of an adaptive controller.
        true_parameters: Those of the robot.
        max_tracking_error: Of all joints, over all steps of the integrator.
        max_joint_errors: The same of each joint.
        settled: Whether the error stays small at the end.
        settling_time: From when on [s].
        controller: With its gains.
        motor_inertia: J of the simulated robot.
        viscous_friction: B of the simulated robot.
        coulomb_friction: Dry friction of the simulated robot.
        tube: Where a scene was given.
        notes: What a reader of the numbers should know: limits, jumps, proofs that do not apply.
        integration: What it took.
    """

    outcome: str
    advice: str
    time: list[float]
    position: Matrix
    velocity: Matrix
    reference: SimulationReference
    torque: Matrix
    voltage: Matrix | None = None
    saturated: list[bool]
    tracking_error: Matrix
    lyapunov: list[float]
    lyapunov_rate: list[float]
    estimate: Matrix | None = None
    true_parameters: list[float] | None = None
    max_tracking_error: float
    max_joint_errors: list[float]
    settled: bool
    settling_time: float | None = None
    controller: SimulatedController
    motor_inertia: list[float]
    viscous_friction: list[float]
    coulomb_friction: list[float]
    tube: Tube | None = None
    notes: list[str]
    integration: dict[str, int]

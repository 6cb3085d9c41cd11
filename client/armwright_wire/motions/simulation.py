"""Closed loops on the wire: controllers, references, errors of models, and what came of it."""

from typing import Annotated, ClassVar, Literal

from pydantic import AliasChoices, ConfigDict, Field

from armwright_wire.base import (
    MAX_BATCH,
    MAX_JOINTS,
    Answer,
    Body,
    BodyWithRules,
    Frame,
    JointVector,
    Label,
    Matrix,
    Name,
    NonNegative,
    Number,
    Positive,
    Seed,
    Timeout,
    Vector3,
    Vector6,
    examples,
)
from armwright_wire.motions.trajectory import TrajectoryBody
from armwright_wire.robots.payload import Payload
from armwright_wire.robots.robot import LinkInertia, Motor
from armwright_wire.scenes.check import WithScene
from armwright_wire.scenes.scene import SceneReference

Vector = Number | JointVector


class Hold(Body):
    """A reference that stands still."""

    type: Literal["hold"] = "hold"
    joints: JointVector
    """[rad or m]"""
    duration: Positive
    """[s]"""


class Step(Body):
    """A reference that jumps; the robot starts where it stands before, at rest."""

    type: Literal["step"] = "step"
    start: JointVector = Field(validation_alias=AliasChoices("from"), serialization_alias="from")
    """where it stands before [rad or m]"""
    end: JointVector = Field(validation_alias=AliasChoices("to"), serialization_alias="to")
    """where it stands after [rad or m]"""
    at: NonNegative = 0.0
    """when it jumps [s]"""
    duration: Positive
    """of the whole [s]"""


class Sine(Body):
    """center + amplitude sin(2π frequency t + phase); one number holds for all joints."""

    type: Literal["sine"] = "sine"
    center: JointVector
    """[rad or m]"""
    amplitude: Vector
    """[rad or m]"""
    frequency: NonNegative | list[NonNegative]
    """[Hz]"""
    phase: Vector = 0.0
    """[rad]"""
    duration: Positive
    """[s]"""


class Spline(Body):
    """A cubic spline through points; it lasts until the last time."""

    type: Literal["spline"] = "spline"
    points: Annotated[list[JointVector], Field(min_length=2, max_length=MAX_BATCH)]
    """[rad or m]"""
    times: Annotated[list[NonNegative], Field(min_length=2, max_length=MAX_BATCH)]
    """one for each point, ascending from 0 [s]"""
    interpolation: Literal["natural_spline", "clamped_spline"] = "clamped_spline"
    """clamped: at rest at both ends; natural: without acceleration there"""


NamedReference = Annotated[Hold | Step | Sine | Spline, Field(discriminator="type")]


#: Base parameters: thirteen a joint at most.
MAX_PARAMETERS = 13 * MAX_JOINTS

Gain = Positive | JointVector
GainMatrix = Positive | JointVector | list[JointVector]
Frequency = Annotated[
    Gain | None, Field(description="of the closed loop's poles [rad/s], in place of the gains")
]
Damping = Annotated[
    Gain,
    Field(
        description="ratio of the poles: 1 is critical; with natural_frequency only, and not for "
        "passivity and adaptive, whose gains it does not enter"
    ),
]


class ControllerBody(Body):
    """Fields of every controller; a gain may be one number for all joints."""

    model_config = ConfigDict(populate_by_name=True)

    natural_frequency: Frequency = None
    damping: Damping = 1.0


class IndependentJoint(ControllerBody):
    """Each joint a motor of its own: u = J q̈ʳ + B q̇ʳ + Kp q̃ + Kd dq̃/dt."""

    type: Literal["independent_joint"] = "independent_joint"
    Kp: Gain | None = Field(None, validation_alias=AliasChoices("Kp", "kp"))
    Kd: Gain | None = Field(None, validation_alias=AliasChoices("Kd", "kd"))
    inertia: Gain | None = None
    """J fed forward; the motors' own if left out, or where the robot gives none what each joint
    feels of the arm at the start of the trajectory
    """
    motors: list[Motor] | None = None
    """one a joint; as `motors` of the request, which every controller takes"""


class ComputedTorque(ControllerBody):
    """Feedback linearisation: u = M (q̈ʳ + Kd dq̃/dt + Kp q̃) + C q̇ + B q̇ + G."""

    type: Literal["computed_torque"] = "computed_torque"
    Kp: Gain | None = Field(None, validation_alias=AliasChoices("Kp", "kp"))
    Kd: Gain | None = Field(None, validation_alias=AliasChoices("Kd", "kd"))


class PdGravity(ControllerBody):
    """u = Kp q̃ + Kd dq̃/dt + G, for a reference that stands still."""

    type: Literal["pd_gravity"] = "pd_gravity"
    Kp: GainMatrix | None = Field(None, validation_alias=AliasChoices("Kp", "kp"))
    Kd: GainMatrix | None = Field(None, validation_alias=AliasChoices("Kd", "kd"))


class _SlidingGains(ControllerBody):
    """Gains of controllers whose error slides along r = dq̃/dt + Λ q̃."""

    Lambda: Gain | None = Field(None, validation_alias=AliasChoices("Lambda", "lambda"))
    """Λ [1/s]"""
    K: GainMatrix | None = Field(None, validation_alias=AliasChoices("K", "k"))
    """one number, one a joint, or a matrix; the proof needs one that couples joints of equal Λ
    only, and a note says where it does not hold
    """


class Passivity(_SlidingGains):
    """u = M a + C v + B q̇ + G + K r with r = dq̃/dt + Λ q̃."""

    type: Literal["passivity"] = "passivity"


class Adaptive(_SlidingGains):
    """Slotine and Li: u = Y Θ̂ + K r with dΘ̂/dt = Γ Yᵀ r on the base parameters."""

    type: Literal["adaptive"] = "adaptive"
    Gamma: GainMatrix = Field(1.0, validation_alias=AliasChoices("Gamma", "gamma"))
    """Γ, one number, one a base parameter, or a matrix"""
    estimate: Literal["model", "zero"] | list[Number] = "model"
    """Θ̂ at the start: the model's, nothing, or one number a base parameter"""
    motors: bool | None = None
    """learn motor inertias and frictions too; by default where there are any"""
    known_zeros: bool = False
    """parameters that are exactly 0 in the model are known to be 0, so that fewer base parameters
    are learned
    """
    parameters: Annotated[list[Label], Field(min_length=1, max_length=MAX_PARAMETERS)] | None = None
    """the base parameters that are learned, by their names in `parameter_names` or by what leads
    these (mx2); all if left out. The model's values are taken for the others
    """


Controller = Annotated[
    IndependentJoint | ComputedTorque | PdGravity | Passivity | Adaptive,
    Field(discriminator="type"),
]


#: Samples of an answer: with seven joints 50 MB.
MAX_SAMPLES = 100_000

Each = NonNegative | list[NonNegative]


class ModelError(Body):
    """Difference of the controller's model from the simulated robot."""

    mass_scale: Gain | None = None
    """mass and inertia of each body times this in the model: one number or one a joint; 1.2 makes
    the controller believe in bodies a fifth too heavy
    """
    inertias: dict[str, LinkInertia] | None = None
    """what the model believes of some links, by their names"""
    payload: Payload | None = None
    """a load that the robot carries and the model does not know of"""
    motor_inertia: Each | None = None
    """the model's, in place of the robot's"""
    viscous_friction: Each | None = None
    """the model's, in place of the robot's"""
    coulomb_friction: Each | None = None
    """dry friction of the model, in place of the robot's [N m or N]"""
    gravity: Vector3 | None = None
    """the model's [m/s²]"""


class Disturbance(Body):
    """torque + amplitude sin(2π frequency t) at the joints and a wrench at the tip."""

    torque: Number | JointVector = 0.0
    """constant [N m or N]"""
    amplitude: Number | JointVector = 0.0
    """[N m or N]"""
    frequency: NonNegative = 0.0
    """[Hz]"""
    wrench: Vector6 | None = None
    """on the tip, in the root frame [N, N m]"""
    start: NonNegative | None = None
    """[s] in the trajectory's time, as `time` of the answer; its start if left out"""
    end: Positive | None = None
    """[s] in the trajectory's time; never if left out"""


class InitialState(Body):
    """State of the robot when the motion begins."""

    joints: JointVector | None = None
    """the trajectory's start if left out"""
    velocities: JointVector | None = None
    """the trajectory's if left out"""
    offset: JointVector | None = None
    """added to the joints [rad or m]"""
    velocity_offset: JointVector | None = None
    """added to the velocities"""


class EncoderNoise(Body):
    """Standard deviations of what the controller is told of the state; drawn by `seed`."""

    position: NonNegative = 0.0
    """[rad or m]"""
    velocity: NonNegative = 0.0
    """[rad/s or m/s]"""
    period: Positive | None = None
    """for a continuous controller [s]; a millisecond if left out"""


class JointStops(Body):
    """Stops at the position limits: torque k p (1 + c dp/dt) against a joint p beyond its limit."""

    stiffness: Positive = 1e4
    """k [N m/rad or N/m]"""
    dissipation: NonNegative = 5.0
    """c [s/rad or s/m]: of a speed v about v / (1 + 2 c v / 3) is left"""


class SimulateRequest(WithScene, BodyWithRules):
    """A motion to be followed under a controller."""

    one_of: ClassVar[tuple[str, ...]] = ("trajectory", "reference")

    model_config = ConfigDict(json_schema_extra={"examples": examples("SimulateRequest")})

    robot: Name = Field(examples=["panda"])
    """name of a stored or built-in robot"""
    trajectory: TrajectoryBody | None = None
    reference: NamedReference | None = None
    """hold, step, sine or spline, in place of a trajectory"""
    controller: Controller
    """control law with its gains"""
    motors: Motor | list[Motor] | None = None
    """one for all joints or one a joint, in place of the robot's motors, motor inertias and viscous
    frictions, under any controller; the robot's own motors if left out
    """
    motor_inertia: Each | None = None
    """J of the robot, reflected at the joints, in place of its own [kg m² or kg]"""
    viscous_friction: Each | None = None
    """B of the robot, in place of its own [N m s/rad or N s/m]"""
    coulomb_friction: Each | None = None
    """dry friction of the robot, in place of its own [N m or N]"""
    effort_limits: Gain | None = None
    """of the drives' torques u, in place of the robot's [N m or N]"""
    joint_stops: JointStops | None = None
    """stops of the joints, {} for the usual ones; without, limits are passed"""
    model_error: ModelError | None = None
    disturbance: Disturbance | None = None
    initial_state: InitialState | None = None
    noise: EncoderNoise | None = None
    control_period: Positive | None = None
    """how long each torque is held [s]; a continuous controller if left out"""
    duration: Positive | None = None
    """[s]; the trajectory's if left out, longer to watch it settle at the end"""
    sample_period: Positive = 0.01
    """of the answer [s]"""
    saturate: bool = True
    """cut torques off at the effort limits and the motors' voltage limits"""
    settling_tolerance: Positive = 1e-3
    """[rad or m]"""
    relative_tolerance: Annotated[float, Field(ge=1e-13, le=1e-2)] = 1e-8
    """error that each step of the integrator may make, relative to the state"""
    absolute_tolerance: Annotated[float, Field(ge=1e-13, le=1e-2)] = 1e-10
    """error that each step of the integrator may make [rad or m, and per second]"""
    scene: SceneReference | None = None
    """with one, the tracking tube is answered; an empty one will do. Tolerances are then at most
    1e-10 (relative) and 1e-12 (absolute)
    """
    frame: Frame | None = None
    """of an inline scene that names none"""
    timeout: Timeout | None = None
    seed: Seed = 0


class RemainingClearance(Answer):
    """Clearance of the reference from obstacles, or among own links, and what tracking leaves."""

    clearance: float | None
    """the certificate's bound for the reference [m]; null with nothing to hit"""
    pair: tuple[str, str] | None
    """the pair that comes nearest"""
    displacement: float
    """from obstacles: of any point of the robot from where it should be; among own links: of a link
    as another one sees it; at most [m]
    """
    displaced_link: str | None
    """the link that is displaced that much"""
    seen_from: str | None
    """the link that sees it; null for the base"""
    remaining: float | None
    """clearance that is left, at least [m]"""


class LimitUseAnswer(Answer):
    """Use of one kind of limit by the tracked motion."""

    ratio: float
    """largest |value| / limit; for positions of the distance from the middle of the range to half
    the range; above 1 the limit is broken
    """
    joint: str
    """the joint that uses most of its limit"""


class TubeAnswer(Answer):
    """Whether the motion as it was tracked still clears all obstacles."""

    joint_error: list[float]
    """largest |qʳ − q| of each joint"""
    reach: list[float]
    """how far any point of the robot moves for a unit of each joint, at most"""
    displacement: float
    """of any point of the robot from where it should be, at most [m]"""
    reference_clearance: float | None
    """the certificate's bound for the reference [m]; null with nothing to hit"""
    remaining_clearance: float | None
    """what is left [m], at least: the smaller of obstacles' and own links'"""
    obstacles: RemainingClearance
    own_links: RemainingClearance
    limits: dict[str, LimitUseAnswer]
    """position, velocity and torque of the tracked motion, where limits are known"""
    tracked_clearance: float | None = None
    """certified clearance of the cubic through the samples of the tracked motion [m]: tighter, and
    true but for what the cubic misses between samples; null with nothing to hit, without time, or
    for a sample_period above 0.01 s
    """
    clears: bool
    """whether the tracked motion is proved to clear everything"""
    reason: str | None = None
    """why not"""


class ReferenceAnswer(Answer):
    """Reference that the controller follows."""

    position: Matrix
    """of the joints at each time [rad or m]"""
    velocity: Matrix
    """of the joints at each time [rad/s or m/s]"""


class ControllerAnswer(Answer):
    """The controller with the gains that were used."""

    type: str
    """kind of controller"""
    gains: dict[str, list[float] | Matrix]
    """by name: one number a joint, or rows of a matrix"""
    parameter_names: list[str] | None = None
    """of the estimate, if adaptive"""
    parameter_labels: list[str] | None = Field(None, examples=[["m2·lc2 [kg m]"]])
    """as textbooks write them, with units"""
    parameter_units: list[str] | None = None
    """of each entry of the estimate"""


class SimulateAnswer(Answer):
    """Course of a simulation; rows belong to the times."""

    outcome: Literal["completed", "ran_away", "exhausted"]
    """whether the simulation reached its end, and if not why"""
    advice: str
    """what the outcome means and what to try"""
    time: list[float]
    """of each row [s]"""
    position: Matrix
    """q of the robot [rad or m]"""
    velocity: Matrix
    """q̇ of the robot [rad/s or m/s]"""
    reference: ReferenceAnswer
    torque: Matrix
    """after saturation [N m or N]"""
    voltage: Matrix | None = None
    """V of the motors, after saturation [V]; null where neither the request nor the robot has
    motors
    """
    saturated: list[bool]
    """whether any joint wanted more than its limit"""
    tracking_error: Matrix
    """qʳ − q"""
    lyapunov: list[float]
    """V(t) of the controller's proof, with the true robot's M and parameters"""
    lyapunov_rate: list[float]
    """dV/dt along the simulated motion, wrong model, saturation and disturbance included; where the
    proof applies, it is the proof's and never positive
    """
    estimate: Matrix | None = None
    """Θ̂(t) of an adaptive controller"""
    true_parameters: list[float] | None = None
    """Θ of the robot, for comparison"""
    max_tracking_error: float
    """of any joint at any instant, bounded over every step of the integrator [rad or m]"""
    max_joint_errors: list[float]
    """the same of each joint"""
    settled: bool
    """the error stays within settling_tolerance until the end"""
    settling_time: float | None = None
    """since when it does [s]; null where it does not"""
    controller: ControllerAnswer
    motor_inertia: list[float]
    """J of the simulated robot, M = D + J"""
    viscous_friction: list[float]
    """B of the simulated robot"""
    coulomb_friction: list[float]
    """dry friction of the simulated robot"""
    tube: TubeAnswer | None = None
    notes: list[str]
    """limits that the reference, the start or the tracked motion does not keep, jumps of the
    reference, proofs that do not apply
    """
    integration: dict[str, int]
    """evaluations, explicit and implicit steps (the latter where it is stiff)"""

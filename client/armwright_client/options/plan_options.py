"""Options of requests that plan, prove or follow motions: fields of `armwright_wire`'s requests."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias, TypedDict

from armwright_wire.base import VectorLike
from armwright_wire.goals.goal import Clearance, Constraints, GoalCosts, Start
from armwright_wire.goals.tool_motion import TimedToolMotions
from armwright_wire.motions.certificate import Premises, Stops
from armwright_wire.motions.retime import PathToKeep, PathTolerance, RetimeTiming
from armwright_wire.motions.timing import Timing
from armwright_wire.motions.trajectory import LimitsBody
from armwright_wire.plans.plan import PlannerName, Refine
from armwright_wire.plans.task import MovedObject
from armwright_wire.robots.lyapunov import PendulumParameters
from armwright_wire.robots.payload import Payload
from armwright_wire.scenes.check import (
    AllowedCollisions,
    Attached,
    FingerPositions,
)
from armwright_wire.scenes.scene import SceneReference
from armwright_wire.scenes.tool import Margins, TipReference, ToolReference

#: An object whose fields the models of requests check.
Options: TypeAlias = Mapping[str, Any]


class ToolOptions(TypedDict, total=False):
    """Options of any request about a robot with a tool.

    Args:
        tool: Tool that is mounted meanwhile: name of a stored or built-in one, or a tool.
        tcp: Tip of it, or that of an attached object; may be left out where the tool has one.
        margins: Distances that links and objects keep [m].
    """

    tool: ToolReference | None
    tcp: TipReference | None
    margins: Margins | None


class HeldOptions(ToolOptions, total=False):
    """Options of kinematics, where `link` may name what is held.

    Args:
        attached: Objects whose frames are links of their ids, each at its pose.
        link: Link that is meant; the tip if left out.
        frame: Frame of the answer, and of a twist or wrench that is given: a link that stands
            still, or "tool"; the root frame if left out.
    """

    attached: Sequence[Attached | Options] | None
    link: str | None
    frame: str | None


class SceneOptions(ToolOptions, total=False):
    """Options of any request about a robot among obstacles.

    Args:
        scene: Obstacles: the name of a stored scene, or a scene.
        frame: Frame of poses and of an inline scene that name none: a link that stands still, or
            "tool" at the start.
        attached: Objects that move with a link.
        allowed_collisions: Pairs that may touch, beside those of the robot and the scene.
        timeout: Time for the whole request [s].
    """

    scene: SceneReference | None
    frame: str | None
    attached: Sequence[Attached | Options] | None
    allowed_collisions: AllowedCollisions | None
    timeout: float | None


class PlanningOptions(SceneOptions, total=False):
    """Options of any request that plans motions.

    Args:
        margin: Distance to be kept from obstacles [m].
        timing: Speeds, and how time is found.
        limits: Limits of the joints, in place of the robot's.
        goal_costs: Costs of the configurations of a pose, of which the cheapest is taken.
        stops: Stops that every motion is proved to have from every instant; it is slowed down for
            them.
        witness: Whether each certificate has a witness, from which anybody can check it.
        seed: Seed of all random choices: the same seed, the same answer.
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    margin: float
    timing: Timing
    limits: LimitsBody | None
    goal_costs: GoalCosts | None
    stops: Stops
    witness: bool
    seed: int
    keep: bool


class CellOptions(SceneOptions, total=False):
    """Options of any request about configurations or motions that are given.

    Args:
        fingers: Positions of joints of the gripper meanwhile [rad or m].
        margin: Distance to be kept from obstacles [m].
    """

    fingers: FingerPositions
    margin: float


class CheckOptions(CellOptions, total=False):
    """Options of a collision check.

    Args:
        depth: False leaves depths and clearance out, and nearly all of the time.
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    depth: bool
    keep: bool


class PlanOptions(PlanningOptions, total=False):
    """Options of a plan beyond robot, start and goal.

    Args:
        planner: "auto" if left out.
        planner_options: The planner's own.
        refine: Whether, or how, the motion that was found is optimised.
        constraints: Constraints that hold along the path.
        fingers: Positions of joints of the gripper meanwhile [rad or m].
        clearance: Distance to be kept wherever there is room.
        collisions: "ignore" looks at no collisions at all, and the certificate says so.
        start_state_tolerance: A start or goal so little outside a limit is moved onto it
            [rad or m]; if left out a start by 0.01 % of the limit, a goal by 1e-6.
        path: Tolerance within which the motion keeps near the path of the answer.
    """

    planner: PlannerName
    planner_options: Options
    refine: bool | Refine
    constraints: Constraints
    fingers: FingerPositions
    clearance: Clearance
    collisions: Literal["check", "ignore"]
    start_state_tolerance: float
    path: PathTolerance


class ValidateOptions(CellOptions, total=False):
    """Options of `validate`: margins, limits and constraints beyond the robot's own limits.

    Args:
        limits: Limits in place of the robot's.
        constraints: Constraints that hold along the path.
        collisions: "ignore" looks at no collisions at all, and the certificate says so.
        tool_motions: Lines and arcs that the tool has to keep to.
        path: Waypoints that the joints have to be near, and the tolerance.
        torque_limits: Whether the robot's effort limits hold too.
        payload: Payload that the tip carries, for torques.
        tool_speed: Largest speed of the tip [m/s].
        stops: Stops that the motion is proved to have from every instant.
        witness: Whether the certificate has a witness, from which anybody can check it.
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    limits: LimitsBody
    constraints: Constraints
    collisions: Literal["check", "ignore"]
    tool_motions: TimedToolMotions
    path: PathToKeep
    torque_limits: bool
    payload: Payload
    tool_speed: float
    stops: Stops
    witness: bool
    keep: bool


class RetimeOptions(ToolOptions, total=False):
    """Options of a timing: the robot, or limits in its place.

    Args:
        robot: Robot whose limits hold.
        limits: Limits in place of the robot's.
        timing: Speeds, and how time is found.
        timeout: Deadline [s].
    """

    robot: str | None
    limits: LimitsBody | None
    timing: RetimeTiming | None
    timeout: float | None


class GuardOptions(CellOptions, total=False):
    """Options of the gate: how the arm stops, and what its motions keep to.

    Args:
        limits: Limits in place of the robot's.
        stop: Stops of the arm: "path", "joints" or "both".
        tracking: Distance of a state from the motion that the arm has, at most [rad or m].
        arm: Name of the arm itself, which one session at a time may guard.
    """

    limits: LimitsBody
    stop: Literal["path", "joints", "both"]
    tracking: float
    arm: str


class ProgramOptions(TypedDict, total=False):
    """Options of an export: points and program.

    Args:
        sample_period: Time between points [s].
        sample_count: Number of points of messages and tables, in place of a period.
        least_spacing: Least time between points of messages and tables [s].
        interpolation: Interpolation of messages and tables.
        path_tolerance: Distance of the motion from the legs of a path at most [rad].
        blend: How far from a point the flange may be where its corner is cut, at most [m].
        speed: Share of the axes' largest speeds, for paths.
        name: Name of the program.
        frame_id: Frame id of the header of a ROS message.
        ports: Numbers or names in the controller of outputs and inputs, by those of stages.
        gripper: Digital output that closes the gripper.
        different_scene: Whether to export all the same, proved for what is given here.
        timeout: Deadline [s].
    """

    sample_period: float
    sample_count: int
    least_spacing: float
    interpolation: Literal["quintic", "cubic", "linear"]
    path_tolerance: float
    blend: float
    speed: float
    name: str
    frame_id: str
    ports: Mapping[str, int | str]
    gripper: int | str
    different_scene: bool
    timeout: float | None


class ExportOptions(CellOptions, ProgramOptions, total=False):
    """Options of an export of a motion.

    Args:
        premises: Premises of the certificate that the motion has; other ones are refused.
    """

    premises: Premises


class LyapunovOptions(TypedDict, total=False):
    """Options of a Lyapunov function that is a formula.

    Args:
        f: Formulas of dx/dt = f(x) in x1 ... xn, one a state, for example "-sin(x1) - x2".
        V: Formula of V(x), beside f.
        system: "pendulum", in place of f and V: its V is the energy.
        parameters: Parameters of that system: mass, length, gravity, damping.
    """

    f: Sequence[str]
    V: str
    system: Literal["pendulum"]
    parameters: PendulumParameters | Options


class SimulateOptions(SceneOptions, total=False):
    """Options of a simulation: model errors, disturbances, integration.

    With a scene the answer has the tracking tube.

    Args:
        motors: Motors of all joints or of each: inertia, gear_ratio, torque_constant, ...; the
            robot's own if left out.
        motor_inertia: J of the robot, in place of its own [kg m² or kg].
        viscous_friction: B of the robot, in place of its own [N m s/rad or N s/m].
        coulomb_friction: Dry friction of the robot, in place of its own [N m or N].
        effort_limits: Effort limits of the drives, in place of the robot's [N m or N].
        joint_stops: Stops of the joints: stiffness, dissipation; {} for the usual ones.
        model_error: Errors of the controller's model: mass_scale, inertias, payload, ...
        disturbance: Forces the controller does not know of: torque, amplitude, wrench, ...
        initial_state: State of the robot at the motion's beginning: joints, offset, ...
        noise: Standard deviations of the encoders: position, velocity.
        control_period: How long each torque is held [s]; a continuous controller if left out.
        duration: [s]; the trajectory's if left out.
        sample_period: Sample period of the answer [s].
        saturate: Whether torques are cut off at the effort limits.
        settling_tolerance: [rad or m].
        relative_tolerance: Relative tolerance of the integrator.
        absolute_tolerance: Absolute tolerance of the integrator.
        seed: Seed of the noise.
    """

    motors: Options | Sequence[Options]
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
    seed: int


class TaskOptions(PlanningOptions, total=False):
    """Options of a task beyond robot, start and stages.

    Args:
        objects: Obstacles that stand elsewhere than the scene says.
        fingers: Positions of joints of the gripper at the start [rad or m].
        improve: Time to look for a better answer after the first [s].
        allow_partial: Whether the first stages are an answer where not all can be done.
    """

    objects: Sequence[MovedObject]
    fingers: Mapping[str, float]
    improve: float
    allow_partial: bool


class TourOptions(PlanningOptions, total=False):
    """Options of a tour beyond robot and goals.

    Args:
        start: Start of the tour; any goal if left out.
        end: "any" goal, back at the "start", or a configuration.
        precedence: Pairs of goals or groups: the first is visited before the second.
        constraints: Constraints that every leg has to hold.
        clearance: Distance to be kept wherever there is room; none if left out.
        start_state_tolerance: A configuration so little outside a limit is moved onto it
            [rad or m]; if left out a start or end by 0.01 % of the limit, a goal by 1e-6.
        rounds: Rounds of search and proof after the first tour that is proved.
        leg_timeout: Longest that one leg is planned [s].
        allow_partial: Whether a tour that leaves goals out is an answer.
    """

    start: Start | None
    end: Literal["any", "start"] | Start
    precedence: Sequence[tuple[str, str]]
    constraints: Constraints
    clearance: Clearance | None
    start_state_tolerance: float
    rounds: int
    leg_timeout: float
    allow_partial: bool

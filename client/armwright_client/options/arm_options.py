"""Options of requests about one robot: fields of `armwright_wire`'s requests."""

from collections.abc import Mapping, Sequence
from typing import Generic, Literal, TypeVar

from armwright_client.options.plan_options import HeldOptions, SceneOptions, ToolOptions
from armwright_wire.base import RowsLike, VectorLike
from armwright_wire.goals.goal import Constraints
from armwright_wire.pose import Orientation, Pose
from armwright_wire.robots.calibration import Accuracy, Plane
from armwright_wire.robots.identification import DriveName
from armwright_wire.robots.kinematics import Axis, GradientOptions
from armwright_wire.robots.payload import Payload
from armwright_wire.robots.potential import PotentialOptions
from armwright_wire.robots.reach import BaseRegion, ReachTolerance
from armwright_wire.scenes.scene import Engine

#: Velocities and accelerations: a vector for one configuration, rows for many.
V = TypeVar("V")


class FkOptions(HeldOptions, total=False):
    """Options of forward kinematics.

    Args:
        orientation: Form of the orientations; quaternions if left out.
        fingers: Positions of joints of the gripper [rad or m], a list for one position with each
            configuration; the others where the robot holds them.
    """

    orientation: Orientation | None
    fingers: Mapping[str, float | Sequence[float]] | None


class JacobianOptions(HeldOptions, total=False):
    """Options of a Jacobian.

    Args:
        point: A point fixed to the link, in its frame [m]; its origin if left out.
        kind: "geometric" if left out.
        axes: Rows that count, of velocities along x, y, z and about rx, ry, rz; all if left out.
    """

    point: VectorLike
    kind: Literal["geometric", "analytic_zyz"]
    axes: Sequence[Axis]


class IkOptions(SceneOptions, total=False):
    """Options of inverse kinematics.

    With a scene or with attached objects, solutions are free of collisions.

    Args:
        link: The tip if left out.
        seed_joints: Configuration at which the search begins; solutions near it are better.
        method: "auto" if left out.
        all_solutions: Whether solutions outside limits or in collision are answered too, with the
            reason.
        all_turns: Whether copies by whole turns of joints inside the limits are answered too.
        max_solutions: Largest number of solutions.
        choice: Criterion of the best solution; "nearest" to the seed if left out.
        parameters: Arm angles or values of the locked joint of a seven-joint arm's closed form.
        axes: Axes of the pose's own frame that count; all if left out.
        gradient: Gradient of the method "gradient".
        constraints: Constraints beyond the pose, or in its place.
        posture: Configuration that solutions under constraints are nearest to; the seed if left
            out.
        seed: Seed of the random generator.
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    link: str
    seed_joints: VectorLike
    method: Literal["auto", "analytic", "numeric", "gradient", "constrained"]
    all_solutions: bool
    all_turns: bool
    max_solutions: int
    choice: Literal["nearest", "limits", "manipulability"]
    parameters: VectorLike
    axes: Sequence[Axis]
    gradient: GradientOptions
    constraints: Constraints
    posture: VectorLike
    seed: int
    keep: bool


class VelocityOptions(HeldOptions, total=False):
    """Options of velocity kinematics.

    Args:
        joint_velocities: Joint velocities whose twist is asked for [rad/s or m/s].
        twist: (linear, angular), whose joint velocities are asked for [m/s, rad/s].
        nullspace: Joint velocities of which the part that leaves the link at rest is added.
        point: A point fixed to the link, in its frame [m]; its origin if left out.
        damped_below: Singular values below it are damped; 0 for the plain pseudo-inverse.
        axes: Rows that count, in the order of the twist's numbers; all six if left out.
    """

    joint_velocities: VectorLike
    twist: VectorLike
    nullspace: VectorLike
    point: VectorLike
    damped_below: float
    axes: Sequence[Axis]


class ModelOptions(ToolOptions, total=False):
    """Changes of the robot's model: payload, motors, friction, gravity.

    Args:
        gravity: Acceleration of gravity in the frame [m/s²].
        frame: A link that stands still, or "tool"; the root frame if left out.
        payload: A load in addition.
        motor_inertia: J, one number or one a joint [kg m² or kg].
        viscous_friction: B, one number or one a joint [N m s/rad or N s/m].
        coulomb_friction: Dry friction, one number or one a joint [N m or N].
    """

    gravity: VectorLike
    frame: str
    payload: Payload
    motor_inertia: float | VectorLike
    viscous_friction: float | VectorLike
    coulomb_friction: float | VectorLike


class DynamicsOptions(ModelOptions, Generic[V], total=False):
    """State of motion and wrench; see also `ModelOptions`.

    Args:
        velocities: One row a configuration [rad/s or m/s]; at rest if left out.
        accelerations: One row a configuration [rad/s² or m/s²]; 0 if left out.
        wrench: (force, moment) that the tip exerts, along the frame's axes [N, N m].
        christoffel_symbols: Answer c_ijk too.
        partial_jacobians: Answer J_v and J_w of every body too.
    """

    velocities: V | None
    accelerations: V | None
    wrench: VectorLike | None
    christoffel_symbols: bool
    partial_jacobians: bool


class ForwardDynamicsOptions(ModelOptions, Generic[V], total=False):
    """State of motion, torques and wrench; see also `ModelOptions`.

    Args:
        velocities: One row a configuration [rad/s or m/s]; at rest if left out.
        torques: One row a configuration [N m or N]; 0 if left out.
        wrench: (force, moment) that the tip exerts, along the frame's axes [N, N m].
    """

    velocities: V | None
    torques: V | None
    wrench: VectorLike | None


class WrenchOptions(HeldOptions, total=False):
    """Options of a wrench: where it is exerted.

    Args:
        point: Point in the link's frame [m]; its origin if left out.
        axes: Parts of the wrench that may differ from 0, in the order of its numbers; all six if
            left out.
    """

    point: VectorLike
    axes: Sequence[Axis]


class RegressorOptions(ModelOptions, total=False):
    """Options of the regressor; see also `ModelOptions`.

    Args:
        reference_velocities: v of Y(q, q̇, a, v), with the accelerations as a.
        motors: Whether motor inertias and frictions count; by default where the robot has any.
        known_zeros: Count parameters that are exactly 0 as known.
    """

    reference_velocities: VectorLike
    motors: bool
    known_zeros: bool


class PotentialSettings(ToolOptions, total=False):
    """Settings of the potential field and of its computation.

    Args:
        options: Weights and reach of the field.
        frame: Frame of an inline scene that names none: a link that stands still, or "tool".
        engine: Projection onto obstacles: closed forms ("exact") or FCL's distance query.
        timeout: Deadline [s].
    """

    options: PotentialOptions | None
    frame: str | None
    engine: Engine
    timeout: float | None


class ReachOptions(SceneOptions, total=False):
    """Options of a question about reach; see `ReachRequest`.

    Args:
        link: The link to bring to the poses; the tip if left out.
        tolerance: Deviation that is allowed.
        margin: Distance to be kept from obstacles [m].
        choice: Criterion of the best configuration; the first one found will do with ``first``.
        clearance: Measure clearances.
        joints: Answer the best configurations.
        bases: Candidates for the base.
        base_region: Candidates on the floor.
        seed: Seed of the numeric search.
    """

    link: str | None
    tolerance: ReachTolerance | None
    margin: float
    choice: Literal["manipulability", "clearance", "limits", "first"]
    clearance: bool
    joints: bool | None
    bases: Sequence[Pose] | None
    base_region: BaseRegion | None
    seed: int


class IdentifyOptions(ToolOptions, total=False):
    """Options of an identification; see `IdentifyRequest`.

    Args:
        find: "payload" for the load alone; the robot if left out.
        link: Link that carries the load; the tip if left out.
        drives: Parameters of the drives to be found too.
        cutoff: Cutoff of the filter [Hz].
        timeout: [s]; the service's default if left out.
    """

    find: Literal["robot", "payload"]
    link: str | None
    drives: Sequence[DriveName] | None
    cutoff: float | None
    timeout: float | None


class ExcitationOptions(SceneOptions, total=False):
    """Options of an exciting motion; see `ExcitationRequest`.

    Args:
        start: Where it begins and ends [rad or m]; the middle of the limits if left out.
        period: Its duration [s].
        harmonics: Sines and cosines of each joint.
        drives: Parameters of the drives to be found too.
        velocity_scaling: Share of the velocity limits.
        acceleration_scaling: Share of the acceleration limits.
        margin: Distance to be kept from obstacles [m].
        fingers: Positions of joints of the gripper [rad or m].
        evaluations: Motions that are tried.
        sample_period: Period of the samples that are answered [s].
        seed: Seed of the search.
    """

    start: VectorLike | None
    period: float
    harmonics: int
    drives: Sequence[DriveName] | None
    velocity_scaling: float
    acceleration_scaling: float
    margin: float
    fingers: Mapping[str, float] | None
    evaluations: int
    sample_period: float | None
    seed: int


class CalibrateOptions(ToolOptions, total=False):
    """Options of a calibration: measurements of one kind; see `CalibrateRequest`.

    Args:
        poses: Poses of the link, one for each configuration.
        positions: Positions of its origin [m].
        distances: Distances of its origin from the anchor [m].
        anchor: The point that distances are from [m].
        plane: A plane that its origin touches.
        link: Link that is measured; the tip if left out.
        unknown: "frame" and "tip", where how they stand is to be found too.
        noise: Standard deviations of measurements; found if left out.
        tolerance: Standard deviations of the arm's making.
        timeout: [s]; the service's default if left out.
    """

    poses: Sequence[Pose] | None
    positions: RowsLike | None
    distances: VectorLike | None
    anchor: VectorLike | None
    plane: Plane | None
    link: str | None
    unknown: Sequence[Literal["frame", "tip"]]
    noise: Accuracy | None
    tolerance: Accuracy | None
    timeout: float | None

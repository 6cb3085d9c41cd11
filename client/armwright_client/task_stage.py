"""Stages of tasks: motions, choices, and changes of what the robot holds."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import Field

from armwright_client.base import (
    PLAIN,
    Matrix3,
    Names,
    NonNegative,
    Positive,
    Request,
    Vector,
    Vector3,
)
from armwright_client.certificate import LimitValues
from armwright_client.check import FingerPositions
from armwright_client.constraint import Constraints
from armwright_client.goal import Goal
from armwright_client.plan import Timing
from armwright_client.planner import PlannerName
from armwright_client.pose import AnyPose, Pose
from armwright_client.reach import ReachTolerance
from armwright_client.scene import AllowedPairs, TouchDepth

if TYPE_CHECKING:
    Poses: TypeAlias = Sequence[Pose]
    FramedPoses: TypeAlias = Sequence[AnyPose]
else:
    Poses = Annotated[list[Pose], PLAIN]
    FramedPoses = Annotated[list[AnyPose], PLAIN]


class TaskStageRequest(Request):
    """Fields that every stage has.

    Args:
        name: By which later stages refer to it.
        margin: Distance to be kept, in place of the task's [m].
        allowed_collisions: Pairs that may touch during this stage.
        constraints: That hold during this stage.
        timing: In place of the task's.
        limits: In place of the task's.
    """

    name: str | None = None
    margin: NonNegative | None = None
    allowed_collisions: AllowedPairs | None = None
    constraints: Constraints | None = None
    timing: Timing | None = None
    limits: LimitValues | None = None


class MoveStage(TaskStageRequest):
    """A free motion to a goal, or to where the approach after it begins.

    Args:
        goal: Left out before an approach.
        tolerance: Region about the goal's poses.
        end_of: Name of an earlier stage, in place of the goal.
        planner: One of those of a plan.
        blend: Pass the goal without resting, at most so far from it in joint space [rad or m].
    """

    kind: Literal["move"] = "move"
    goal: Goal | None = None
    tolerance: ReachTolerance | None = None
    end_of: str | None = None
    planner: PlannerName = "auto"
    blend: Positive | None = None


class StraightStage(TaskStageRequest):
    """A straight motion of the tool.

    Args:
        distance: Least and most way [m].
        direction: Of the motion.
        frame: Of the direction, "tool" or "root".
        max_deviation: Of the tool's origin from its line [m].
        max_orientation_deviation: Of its orientation [rad].
    """

    distance: Vector
    direction: Vector3 | None = None
    frame: Literal["tool", "root"] | None = None
    max_deviation: Positive = 1e-4
    max_orientation_deviation: Positive = 1e-3


class ApproachStage(StraightStage):
    """The straight end of the way to the grasp, place or goal of the next stage."""

    kind: Literal["approach"] = "approach"


class RetreatStage(StraightStage):
    """A straight way off."""

    kind: Literal["retreat"] = "retreat"


class LiftStage(StraightStage):
    """A straight way up."""

    kind: Literal["lift"] = "lift"


class GraspRegion(Request):
    """Grasps all about an axis of the object.

    Args:
        pose: Of the tool in the object's frame at angle and offset 0.
        axis: Through the object's origin.
        angles: Least and largest angle about it [rad].
        offsets: Least and largest way along it [m].
        angle_samples: Angles that are tried.
        offset_samples: Offsets that are tried.
    """

    pose: Pose
    axis: Vector3 = Field(default_factory=lambda: [0.0, 0.0, 1.0])
    angles: Vector = Field(default_factory=lambda: [0.0, 0.0])
    offsets: Vector = Field(default_factory=lambda: [0.0, 0.0])
    angle_samples: int = 18
    offset_samples: int = 1


class GraspStage(TaskStageRequest, TouchDepth):
    """A choice among grasps of an object.

    Args:
        object: Its name in the scene.
        grasps: Poses of the tool in the object's frame.
        region: In place of a list.
        touch_links: Links that may touch it from the approach on.
        support: What it stands on.
        touch_depth: How deep these may overlap [m]; None for any depth.
    """

    kind: Literal["grasp"] = "grasp"
    object: str
    grasps: Poses | None = None
    region: GraspRegion | None = None
    touch_links: Names = Field(default_factory=list)
    support: str | Names | None = None


class PlaceRegion(Request):
    """Poses of the object on a rectangle.

    Args:
        pose: Of the object in the middle; its z is across the rectangle.
        size: Along x and y of the pose [m].
        angles: Least and largest angle about its z [rad].
        samples: Along x and y.
        angle_samples: Angles that are tried.
    """

    pose: AnyPose
    size: Vector = Field(default_factory=lambda: [0.0, 0.0])
    angles: Vector = Field(default_factory=lambda: [0.0, 0.0])
    samples: list[int] = Field(default_factory=lambda: [3, 3])
    angle_samples: int = 4


class PlaceStage(TaskStageRequest, TouchDepth):
    """A choice among poses of the held object.

    Args:
        object: What is held, if left out.
        poses: Of the object.
        region: In place of a list.
        relative_to: Obstacle in whose frame they are.
        support: What it is put on.
        touch_depth: How deep the two may overlap [m]; None for any depth.
    """

    kind: Literal["place"] = "place"
    object: str | None = None
    poses: FramedPoses | None = None
    region: PlaceRegion | None = None
    relative_to: str | None = None
    support: str | Names | None = None


class AttachStage(TaskStageRequest, TouchDepth):
    """The object becomes a part of the robot.

    Args:
        object: Its name in the scene.
        link: That holds it; the tip if left out.
        touch_links: Names that it may touch while it is held.
        touch_depth: How deep they may overlap [m]; None for any depth.
        mass: [kg].
        center_of_mass: In the object's frame [m].
        inertia: About it [kg m^2].
    """

    kind: Literal["attach"] = "attach"
    object: str
    link: str | None = None
    touch_links: Names = Field(default_factory=list)
    mass: Positive | None = None
    center_of_mass: Vector3 | None = None
    inertia: Matrix3 | None = None


class DetachStage(TaskStageRequest, TouchDepth):
    """The object becomes an obstacle.

    Args:
        object: What is held, if left out.
        touch_links: Links that may touch it until a free motion begins.
        touch_depth: How deep they may overlap [m]; None for any depth.
    """

    kind: Literal["detach"] = "detach"
    object: str | None = None
    touch_links: Names = Field(default_factory=list)


class WaitStage(TaskStageRequest):
    """The arm stands still.

    Args:
        duration: [s].
    """

    kind: Literal["wait"] = "wait"
    duration: Positive


class OpenStage(TaskStageRequest):
    """The gripper opens.

    Args:
        joints: Where joints of the gripper go [rad or m]; if left out, its state of the name.
        state: In place of joints: a state of the gripper.
        duration: [s]; half a second if left out, or what the fingers' speeds need.
    """

    kind: Literal["open"] = "open"
    joints: FingerPositions | None = None
    state: str | None = None
    duration: Positive | None = None


class CloseStage(TaskStageRequest):
    """The gripper closes.

    Args:
        joints: Where joints of the gripper go [rad or m]; if left out, its state of the name.
        state: In place of joints: a state of the gripper.
        duration: [s]; half a second if left out, or what the fingers' speeds need.
    """

    kind: Literal["close"] = "close"
    joints: FingerPositions | None = None
    state: str | None = None
    duration: Positive | None = None


TaskStage: TypeAlias = (
    MoveStage
    | ApproachStage
    | RetreatStage
    | LiftStage
    | GraspStage
    | PlaceStage
    | AttachStage
    | DetachStage
    | WaitStage
    | OpenStage
    | CloseStage
)

if TYPE_CHECKING:
    Stages: TypeAlias = Sequence[TaskStage]
else:
    Stages = Annotated[list[Annotated[TaskStage, Field(discriminator="kind")]], PLAIN]

"""Tasks of several stages on the wire, and their answers."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import ConfigDict, Discriminator, Field, Tag, model_validator

from armwright_wire.base import (
    Answer,
    Beside,
    Body,
    Frame,
    InFrame,
    Keepable,
    Label,
    Length,
    Matrix3,
    Name,
    NonNegative,
    Number,
    PlanId,
    Point,
    Positive,
    Seed,
    Timeout,
    Vector3,
    check_company,
    exactly_one,
    examples,
)
from armwright_wire.goals.constraint import Constraints
from armwright_wire.goals.goal import ConfigurationAnswer, Goal, GoalCosts, Start
from armwright_wire.goals.tool_motion import ReferencePoseAnswer
from armwright_wire.motions.certificate import CertificateAnswer, Stops
from armwright_wire.motions.timing import Timing
from armwright_wire.motions.trajectory import LimitsBody, TrajectoryAnswer
from armwright_wire.plans.plan import PathAnswer, Reproducibility, Stage
from armwright_wire.pose import Pose, PoseAnswer, PoseInFrame
from armwright_wire.robots.reach import ReachTolerance
from armwright_wire.scenes.check import (
    TOUCH_DEPTH,
    AllowedCollisions,
    Attached,
    AttachedObjects,
    FingerPositions,
    Margin,
    TouchDepth,
)
from armwright_wire.scenes.scene import SceneReference
from armwright_wire.scenes.tool import WithTool

MAX_STAGES = 200
#: Grasps or places of one stage.
MAX_TARGETS = 10_000
MAX_TOUCHING = 100

Range = Annotated[list[Number], Field(min_length=2, max_length=2)]
Samples = Annotated[int, Field(ge=1, le=1_000)]
Labels = Annotated[list[Label], Field(max_length=MAX_TOUCHING)]
Distance = Annotated[
    list[Annotated[Positive, Field(le=10.0)]],
    Field(
        min_length=2, max_length=2, description="[least, most] way [m]; the longest is tried first"
    ),
]
Support = Label | Annotated[list[Label], Field(min_length=1, max_length=100)]
Deviation = Annotated[float, Field(ge=1e-7, le=1.0)]


class StageBody(Body):
    """Fields that every stage has."""

    name: Label | None = Field(None, description="by which later stages refer to it")
    margin: Margin | None = Field(None, description="in place of the task's [m]")
    allowed_collisions: AllowedCollisions | None = Field(
        None, description="pairs that may touch during this stage"
    )
    constraints: Constraints | None = Field(None, description="to be held during this stage")
    timing: Timing | None = Field(None, description="in place of the task's")
    limits: LimitsBody | None = Field(None, description="in place of the task's")


class MoveStage(StageBody):
    """A free motion to a goal, or to where the approach after it begins."""

    kind: Literal["move"] = "move"
    goal: Goal | None = Field(
        None, description="any that a plan takes; left out before an approach: where that begins"
    )
    tolerance: ReachTolerance | None = Field(
        None, description="region about the goal's poses, in their own frame"
    )
    end_of: Label | None = Field(
        None, description="in place of goal: name of an earlier stage, whose last configuration"
    )
    planner: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]{1,64}$")] = Field(
        "auto", description="one of those of a plan, but not cartesian"
    )
    blend: Annotated[Positive, Field(le=10.0)] | None = Field(
        None,
        description="pass the goal without resting, at most so far from it, Euclidean in joint "
        "space [rad or m]; a free motion with the same timing and limits follows",
    )

    @model_validator(mode="after")
    def _check_form(self) -> "MoveStage":
        if self.goal is not None and self.end_of is not None:
            raise ValueError("give goal or end_of, not both")
        if self.tolerance is not None and self.goal is None:
            raise ValueError("tolerance needs goal")
        if self.blend is not None and self.goal is None and self.end_of is None:
            raise ValueError("blend needs goal or end_of: without, the stage ends at an approach")
        if self.planner.lower() == "cartesian":
            raise ValueError("planner cartesian: ask for an approach, retreat or lift")
        return self


class StraightStage(StageBody):
    """A straight motion of the tool."""

    distance: Distance = Field(examples=[[0.05, 0.1]])
    direction: Vector3 | None = Field(
        None,
        description="of the motion; if left out: approach along z of the tool, retreat against it, "
        "lift along z of the root",
    )
    frame: Literal["tool", "root"] | None = Field(
        None, description="of the direction; the tool for approach and retreat, else the root"
    )
    max_deviation: Deviation = Field(
        1e-4, description="of the tool's origin from its line, for every instant [m]"
    )
    max_orientation_deviation: Deviation = Field(1e-3, description="of its orientation [rad]")


class ApproachStage(StraightStage):
    """The straight end of the way to the grasp, place or goal of the next stage."""

    kind: Literal["approach"] = "approach"


class RetreatStage(StraightStage):
    """A straight way off."""

    kind: Literal["retreat"] = "retreat"


class LiftStage(StraightStage):
    """A straight way up."""

    kind: Literal["lift"] = "lift"


class GraspRegion(Body):
    """Grasps all about an axis of the object: Trans(d a) Rot(a, φ) pose."""

    pose: Pose = Field(description="of the tool in the object's frame at angle and offset 0")
    axis: Vector3 = Field([0.0, 0.0, 1.0], description="through the object's origin")
    angles: Range = Field([0.0, 0.0], description="[least, largest] angle about it [rad]")
    offsets: Range = Field([0.0, 0.0], description="[least, largest] way along it [m]")
    angle_samples: Samples = Field(18, description="angles that are tried")
    offset_samples: Samples = Field(1, description="offsets that are tried")


class GraspSearch(Body):
    """How grasps are looked for on the surface of an object."""

    count: Annotated[int, Field(ge=1, le=500)] = Field(24, description="most grasps that are tried")
    angles: Annotated[int, Field(ge=1, le=72)] = Field(
        8, description="approaches about the line between the fingers, or turns of a cup"
    )
    friction: Annotated[Positive, Field(le=10.0)] = Field(
        0.4, description="coefficient of friction at the fingers"
    )
    depth: Annotated[Number, Field(ge=-1.0, le=1.0)] = Field(
        0.0, description="how far the tip goes beyond the middle of what is gripped [m]"
    )
    radius: Length = Field(0.01, description="in which a surface is flat under a cup [m]")
    seed: Seed = 0


class FoundGrasps(Body):
    """Grasps found from the shape of the object, with the fingers of the robot or its tool."""

    one_of: ClassVar[tuple[str, ...]] = ("antipodal", "top", "side", "suction")

    antipodal: GraspSearch | None = Field(None, description="two fingers, from anywhere")
    top: GraspSearch | None = Field(
        None, description="two fingers from above, as the object stands at the start"
    )
    side: GraspSearch | None = Field(None, description="two fingers, level")
    suction: GraspSearch | None = Field(None, description="a cup on a flat place")

    @model_validator(mode="after")
    def _check_form(self) -> "FoundGrasps":
        exactly_one(self, self.one_of)
        return self


def _form_of_grasps(value: object) -> str:
    named = isinstance(value, dict) and not FoundGrasps.model_fields.keys().isdisjoint(value)
    return "found" if named or isinstance(value, FoundGrasps) else "list"


if TYPE_CHECKING:
    # Tuples may be given.
    Grasps: TypeAlias = Sequence[Pose] | FoundGrasps
else:
    Grasps = Annotated[
        Annotated[list[Pose], Field(min_length=1, max_length=MAX_TARGETS), Tag("list")]
        | Annotated[FoundGrasps, Tag("found")],
        Discriminator(_form_of_grasps),
    ]


class GraspStage(StageBody):
    """A choice among grasps of an object; without an approach before it, a free motion there."""

    one_of: ClassVar[tuple[str, ...]] = ("grasps", "region")

    kind: Literal["grasp"] = "grasp"
    object: Label = Field(description="name of the obstacle", examples=["crate"])
    grasps: Grasps | None = Field(
        None,
        description="poses of the tool in the object's frame, or how they are found from its shape",
    )
    region: GraspRegion | None = Field(None, description="of grasps, in place of a list")
    touch_links: Labels = Field(
        default_factory=list,
        description="links that may touch the object from the approach on, and while it is held",
    )
    support: Support | None = Field(
        None, description="what it stands on: they may touch from attach to the end of the lift"
    )
    touch_depth: TouchDepth = TOUCH_DEPTH

    @model_validator(mode="after")
    def _check_form(self) -> "GraspStage":
        exactly_one(self, self.one_of)
        return self


class PlaceRegion(Body):
    """Poses of the object on a rectangle across z of a pose, turned about that z."""

    pose: PoseInFrame = Field(description="of the object in the middle of the rectangle")
    size: Annotated[list[NonNegative], Field(min_length=2, max_length=2)] = Field(
        [0.0, 0.0], description="along x and y of the pose [m]"
    )
    angles: Range = Field([0.0, 0.0], description="[least, largest] angle about its z [rad]")
    samples: Annotated[list[Samples], Field(min_length=2, max_length=2)] = Field(
        [3, 3], description="along x and y"
    )
    angle_samples: Samples = Field(4, description="angles that are tried")


class PlaceStage(StageBody):
    """A choice among poses of the held object; without an approach, a free motion there."""

    one_of: ClassVar[tuple[str, ...]] = ("poses", "region")

    kind: Literal["place"] = "place"
    object: Label | None = Field(None, description="what is held, if that is one thing")
    poses: Annotated[list[PoseInFrame], Field(min_length=1, max_length=MAX_TARGETS)] | None = Field(
        None, description="of the object"
    )
    region: PlaceRegion | None = Field(None, description="of poses, in place of a list")
    relative_to: Label | None = Field(
        None, description="an obstacle in whose frame the poses are, wherever it then stands"
    )
    support: Support | None = Field(
        None, description="what it is put on: they may touch from the approach to detach"
    )
    touch_depth: TouchDepth = TOUCH_DEPTH

    @model_validator(mode="after")
    def _check_form(self) -> "PlaceStage":
        exactly_one(self, self.one_of)
        return self


class AttachStage(StageBody):
    """The object becomes a part of the robot, where it stands."""

    only_beside: ClassVar[Beside] = {"center_of_mass": ("mass",), "inertia": ("mass",)}

    kind: Literal["attach"] = "attach"
    object: Label = Field(description="name of the obstacle", examples=["crate"])
    link: Label | None = Field(None, description="that holds it and moves with the tip; the tip")
    touch_links: Labels = Field(
        default_factory=list, description="links and obstacles that it may touch while it is held"
    )
    touch_depth: TouchDepth = TOUCH_DEPTH
    mass: Positive | None = Field(None, description="for torques [kg]")
    center_of_mass: Point | None = Field(None, description="in the object's frame [m]")
    inertia: Matrix3 | None = Field(None, description="about it, in the object's axes [kg m^2]")

    @model_validator(mode="after")
    def _check_form(self) -> "AttachStage":
        check_company(self)
        return self


class DetachStage(StageBody):
    """The object becomes an obstacle, where it is held."""

    kind: Literal["detach"] = "detach"
    object: Label | None = Field(None, description="what is held, if that is one thing")
    touch_links: Labels = Field(
        default_factory=list,
        description="links that may touch it until a free motion begins, beside those of its grasp",
    )
    touch_depth: TouchDepth = TOUCH_DEPTH


class WaitStage(StageBody):
    """The arm stands still."""

    kind: Literal["wait"] = "wait"
    duration: Annotated[Positive, Field(le=3600.0)] = Field(description="[s]")


class GripperStage(StageBody):
    """The gripper opens or closes while the arm stands still."""

    joints: FingerPositions | None = Field(
        None,
        description="where joints of the gripper go [rad or m]; the others stay. If left out, the "
        "gripper's state of the name open or close, if it has one",
    )
    state: Label | None = Field(None, description="in place of joints: a state of the gripper")
    duration: Annotated[Positive, Field(le=3600.0)] | None = Field(
        None, description="[s]; half a second if left out, or what the fingers' speeds need"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "GripperStage":
        if self.joints is not None and self.state is not None:
            raise ValueError("give joints or state, not both")
        return self


class OpenStage(GripperStage):
    """The gripper opens."""

    kind: Literal["open"] = "open"


class CloseStage(GripperStage):
    """The gripper closes."""

    kind: Literal["close"] = "close"
    until: Literal["contact"] | None = Field(
        None,
        description="contact: the fingers stop where they touch the object of the grasp right "
        "before, for each grasp of its list where that is; joints or state say how far they may "
        "close. A grasp that fewer than two fingers touch is not taken",
    )


StageUnion = Annotated[
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
    | CloseStage,
    Field(discriminator="kind"),
]


class MovedObject(Body):
    """An obstacle of the scene that stands elsewhere."""

    id: Label = Field(description="its name", examples=["crate"])
    pose: Pose = Field(description="where it stands, in the root frame")


class TaskRequest(WithTool, Keepable):
    """A sequence of stages to be planned as one."""

    model_config = ConfigDict(json_schema_extra={"examples": examples("TaskRequest")})

    robot: Name = Field(description="name of the robot", examples=["panda"])
    scene: SceneReference | None = Field(
        None, description="a stored scene by its name, or a scene", examples=["table"]
    )
    frame: Frame | None = Field(None, description="of poses that name none; the root if left out")
    start: Start = Field(description="where the arm stands")
    stages: Annotated[list[StageUnion], Field(min_length=1, max_length=MAX_STAGES)] = Field(
        description="in order"
    )
    objects: Annotated[list[MovedObject], Field(max_length=MAX_TARGETS)] | None = Field(
        None, description="obstacles that stand elsewhere than the scene says: `after.objects`"
    )
    attached: AttachedObjects | None = Field(
        None, description="held at the start, as `after.attached` of the task before"
    )
    fingers: FingerPositions | None = Field(
        None,
        description="where joints of the gripper stand at the start [rad or m], as "
        "`after.fingers`; the others where the robot holds them",
    )
    allowed_collisions: AllowedCollisions | None = Field(
        None, description="pairs that may touch in all stages"
    )
    margin: Margin = 0.0
    timing: Timing = Field(default_factory=Timing, description="how paths become motions")
    limits: LimitsBody | None = Field(None, description="in place of the robot's")
    goal_costs: GoalCosts | None = None
    stops: Stops = "none"
    improve: Annotated[NonNegative, Field(le=86_400.0)] = Field(
        0.0, description="time to look for a better answer after the first proved one [s]"
    )
    allow_partial: bool = Field(
        False, description="the first stages are an answer where not all can be done"
    )
    timeout: Timeout | None = Field(None, description="for all stages together [s]")
    seed: Seed = 0

    @model_validator(mode="after")
    def _check_stops(self) -> "TaskRequest":
        passing = [i for i, one in enumerate(self.stages) if getattr(one, "blend", None)]
        if self.stops != "none" and passing:
            raise ValueError(
                f"stops are proved of motions that end at rest: leave blend of stage {passing[0]} "
                "out, or stops"
            )
        return self


class PlacedObject(Answer):
    """An obstacle that a task has moved, and where it stands."""

    id: str = Field(description="its name")
    pose: PoseAnswer = Field(description="where it stands, in the root frame")


class HeldObject(Answer):
    """An object that the robot holds, as `attached` of a request takes it."""

    id: str = Field(description="its name")
    link: str = Field(description="that holds it")
    pose: PoseAnswer = Field(description="in the frame of the link")
    touch_links: list[str] = Field(description="names that it may touch")
    touch_depth: float | None = Field(None, description="how deep it may overlap these [m]")
    mass: float | None = Field(None, description="[kg]")
    center_of_mass: list[float] | None = Field(None, description="in the object's frame [m]")
    inertia: list[list[float]] | None = Field(
        None, description="about it, in the object's axes [kg m^2]"
    )


class WorldAnswer(Answer):
    """The objects after a stage; a request takes the fields, to go on from here."""

    objects: list[PlacedObject] = Field(description="obstacles that stand elsewhere than before")
    attached: list[HeldObject] = Field(description="what the robot holds")
    fingers: dict[str, float] = Field(
        default_factory=dict,
        description="where joints of the gripper stand that can be moved [rad or m]",
    )

    def as_options(self) -> dict[str, Any]:
        """The options `objects`, `attached` and `fingers` of a task that goes on from here."""
        return {
            "objects": [MovedObject(id=item.id, pose=item.pose) for item in self.objects],
            "attached": [
                Attached(
                    **{name: value for name, value in item if value is not None}
                    | {"touch_depth": item.touch_depth}
                )
                for item in self.attached
            ],
            "fingers": self.fingers,
        }


class TaskStageAnswer(Answer):
    """One stage with its motion and the proof."""

    index: int = Field(description="its number, from 0")
    kind: str = Field(description="as requested")
    name: str | None = Field(None, description="as requested")
    begins: float = Field(description="when it begins in the whole task [s]")
    choice: int | None = Field(None, description="number of the grasp, place or goal chosen")
    configuration: ConfigurationAnswer | None = Field(
        None, description="the one chosen at its end; null where no pose leaves a choice"
    )
    planner: str | None = Field(None, description="that found its path; null where it stands still")
    stages: list[Stage] = Field(default_factory=list, description="of planning")
    path: PathAnswer | None = Field(None, description="null where the arm stands still")
    trajectory: TrajectoryAnswer = Field(description="its motion, from its own time 0")
    fingers: TrajectoryAnswer | None = Field(
        None, description="motion of the gripper's joints beside it; null where they stand still"
    )
    certificate: CertificateAnswer = Field(
        description="the proof, with what is held and with the motion of the fingers"
    )
    reference: list[ReferencePoseAnswer] | None = Field(
        None,
        description="poses that a straight motion holds the tool to, at drawn instants of its own "
        "time; null of other stages",
    )
    passes: bool = Field(
        False, description="the arm passes its end without resting, within its blend"
    )
    after: WorldAnswer = Field(description="the objects after it")
    notes: list[str] = Field(default_factory=list, description="what was done to the request")


class TrialAnswer(Answer):
    """One alternative under the choices before it, and what came of it."""

    choices: list[int] = Field(description="numbers of the alternatives chosen up to this one")
    stage: int = Field(description="number of the stage that has the alternatives")
    outcome: str = Field(
        description="solved, failed, in_collision, outside_limits, out_of_reach, or open: not tried"
    )
    reasons: dict[str, int] = Field(description="each with how many configurations had it")
    joints: list[float] | None = Field(
        None, description="one of the configurations that failed, inside the limits [rad or m]"
    )


class ImprovementAnswer(Answer):
    """A proved answer that was the best so far: its time and its configurations."""

    milliseconds: float = Field(description="since the search began")
    duration: float = Field(description="of all stages [s]")


class TaskAnswer(InFrame):
    """All stages of a task, each with a motion that is proved."""

    status: Literal["success", "partial"] = Field(
        description="partial: the first stages only, where that was asked for"
    )
    duration: float = Field(description="of all stages [s]")
    stages: list[TaskStageAnswer] = Field(description="in order")
    trials: list[TrialAnswer] = Field(description="what was tried, by stage")
    trials_omitted: int = Field(0, description="how many more there were")
    improvements: list[ImprovementAnswer] = Field(description="the last one is answered")
    exhausted: bool = Field(
        description="every combination was tried, or can't be better by its estimate"
    )
    failure: dict[str, Any] | None = Field(
        None, description="of a partial answer: why the later stages could not be done"
    )
    reproducibility: Reproducibility = Field(description="seed, hashes and versions")
    plan_id: PlanId = None

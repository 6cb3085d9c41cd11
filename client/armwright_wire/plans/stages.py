"""Stages of tasks on the wire."""

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Tag,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from armwright_wire.base import (
    AS_LIST,
    Beside,
    Body,
    BodyWithRules,
    Label,
    Length,
    NonNegative,
    Number,
    Point,
    Positive,
    Range,
    Seed,
    Vector3,
    is_given,
    not_where,
)
from armwright_wire.goals.goal import Constraints, Goal
from armwright_wire.goals.tool_motion import CartesianOptions, ToolDeviations
from armwright_wire.motions.timing import Timing
from armwright_wire.motions.trajectory import LimitsBody
from armwright_wire.pose import Pose, PoseInFrame
from armwright_wire.robots.reach import ReachTolerance
from armwright_wire.scenes.check import (
    TOUCH_DEPTH,
    AllowedCollisions,
    Carried,
    FingerPositions,
    Margin,
    TouchDepth,
)
from armwright_wire.scenes.tool import TipReference, ToolReference

MAX_STAGES = 200
#: Grasps or places of one stage.
MAX_TARGETS = 10_000

SampleCount = Annotated[int, Field(ge=1, le=1_000)]
Labels = Annotated[list[Label], Field(max_length=100)]
Distance = Annotated[
    list[Annotated[Positive, Field(le=10.0)]],
    Field(
        min_length=2, max_length=2, description="[least, most] way [m]; the longest is tried first"
    ),
]
Support = Label | Annotated[list[Label], Field(min_length=1, max_length=100)]
#: Number or name of an output or input.
Port = Annotated[int, Field(ge=0, le=100_000)] | Label


class StageBody(Body):
    """Fields that every stage has."""

    name: Label | None = None
    """by which later stages refer to it"""
    margin: Margin | None = None
    """in place of the task's [m]"""
    allowed_collisions: AllowedCollisions | None = None
    """pairs that may touch during this stage"""
    constraints: Constraints | None = None
    """to be held during this stage"""
    timing: Timing | None = None
    """in place of the task's"""
    limits: LimitsBody | None = None
    """in place of the task's"""
    tool: ToolReference | None = None
    """that the robot has from this stage on, in place of the one before"""
    tcp: TipReference | None = None
    """tip of the tool from this stage on, or that of an object which is held by then, until it is
    detached
    """


class Via(Body):
    """A configuration or pose, or one of a set, that a free motion goes through."""

    goal: Goal
    """one, or any of several"""
    blend: Annotated[Positive, Field(le=10.0)] | None = None
    """pass without resting, at most so far from it, Euclidean in joint space [rad or m]; rest there
    if left out
    """


class MoveStage(StageBody, BodyWithRules):
    """A free motion to a goal, or to where the approach after it begins."""

    only_beside: ClassVar[Beside] = {"tolerance": ("goal",), "blend": ("goal", "end_of")}
    at_most_one = (("goal", "end_of"),)
    published_rules = (
        {"properties": {"planner": {"not": {"pattern": "^[Cc][Aa][Rr][Tt][Ee][Ss][Ii][Aa][Nn]$"}}}},
    )

    kind: Literal["move"] = "move"
    goal: Goal | None = None
    """any that a plan takes; left out before an approach: where that begins"""
    tolerance: ReachTolerance | None = None
    """region about the goal's poses, in their own frame"""
    via: Annotated[list[Via], Field(min_length=1, max_length=20)] | None = None
    """to go through on the way, in order, each as a stage move of its own"""
    end_of: Label | None = None
    """in place of goal: name of an earlier stage, whose last configuration"""
    planner: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]{1,64}$")] = "auto"
    """one of those of a plan, but not cartesian"""
    blend: Annotated[Positive, Field(le=10.0)] | None = None
    """pass the goal without resting, at most so far from it, Euclidean in joint space [rad or m]; a
    free motion with the same timing and limits follows
    """

    @model_validator(mode="after")
    def _check_form(self) -> "MoveStage":
        if self.planner.lower() == "cartesian":
            raise ValueError("planner cartesian: ask for an approach, retreat or lift")
        return self

    def through(self) -> list["MoveStage"]:
        """Stages that go to what is in `via`, with all else as in this one."""
        left_out = ("goal", "tolerance", "end_of", "via", "blend", "name")
        own = {name: x for name, x in self if name in self.model_fields_set - {*left_out}}
        return [MoveStage(**own, goal=at.goal, blend=at.blend) for at in self.via or ()]


class StraightStage(StageBody, ToolDeviations):
    """A straight motion of the tool."""

    published_rules = (not_where("frame", direction="normal"),)

    direction: Vector3 | Literal["normal"] | None = None
    """of the motion; if left out: approach and insert along z of the tool, retreat against it, lift
    along z of the root. normal: along the surface normal that is nearest to the tip, towards it for
    approach and insert
    """
    frame: Literal["tool", "root", "object", "support"] | None = None
    """of the direction; the root for lift, else the tool. object and support: those of the grasp or
    place that it leads to or comes from, as they then stand
    """
    relative_to: Label | None = None
    """the object whose frame or surface it is, in place of that of the target"""

    @model_validator(mode="after")
    def _check_form(self) -> "StraightStage":
        if self.direction == "normal" and self.frame is not None:
            raise ValueError("direction normal has no frame")
        return self


class ApproachStage(StraightStage):
    """The straight end of the way to the grasp, place or goal of the next stage."""

    kind: Literal["approach"] = "approach"
    distance: Distance = Field(examples=[[0.05, 0.1]])


class RetreatStage(StraightStage):
    """A straight way off."""

    kind: Literal["retreat"] = "retreat"
    distance: Distance = Field(examples=[[0.05, 0.1]])


class LiftStage(StraightStage):
    """A straight way up."""

    kind: Literal["lift"] = "lift"
    distance: Distance = Field(examples=[[0.05, 0.1]])


class InsertStage(StraightStage):
    """What is held is pushed straight into something."""

    kind: Literal["insert"] = "insert"
    distance: Annotated[Positive, Field(le=10.0)]
    """whole way [m]"""
    into: Support | None = None
    """what it may touch from this stage to the next free motion"""
    touch_depth: TouchDepth = TOUCH_DEPTH


class FollowStage(StageBody, ToolDeviations):
    """Lines or an arc of the tool from where it is."""

    tool_speed: Positive | None = None
    """largest speed of the tip [m/s]"""


class LineStage(FollowStage, BodyWithRules):
    """A straight motion of the tool to a pose, or through several."""

    one_of: ClassVar[tuple[str, ...]] = ("pose", "poses")
    only_beside: ClassVar[Beside] = {"blend": ("poses",)}

    kind: Literal["line"] = "line"
    pose: PoseInFrame | None = None
    poses: Annotated[list[PoseInFrame], Field(min_length=1, max_length=1_000)] | None = None
    """in order; the tool rests at each without a blend"""
    blend: NonNegative | None = None
    """how far from corners the tool may cut them [m]"""


class ArcStage(FollowStage, BodyWithRules):
    """A circular motion of the tool to a pose, through a point or about a centre."""

    one_of: ClassVar[tuple[str, ...]] = ("via", "center")
    only_beside: ClassVar[Beside] = {"normal": ("center",)}

    kind: Literal["arc"] = "arc"
    pose: PoseInFrame
    via: Point | None = None
    """on the arc, in the frame of the pose [m]"""
    center: Point | None = None
    """in the frame of the pose [m]"""
    normal: Vector3 | None = None
    """to turn about by the right hand"""


class SeamStage(StageBody, CartesianOptions):
    """A seam as of the planner "cartesian"; the arm goes to its beginning by a free motion."""

    published_rules = (is_given("waypoints"), not_where(allow_partial=True))

    kind: Literal["seam"] = "seam"

    @model_validator(mode="after")
    def _check_form(self) -> "SeamStage":
        if self.waypoints is None:
            raise ValueError("a seam needs waypoints")
        if self.allow_partial:
            raise ValueError("a stage is done as a whole: leave allow_partial out")
        return self


class GraspRegion(Body):
    """Grasps all about an axis of the object: Trans(d a) Rot(a, φ) pose."""

    pose: Pose
    """of the tool in the object's frame at angle and offset 0"""
    axis: Vector3 = Field([0.0, 0.0, 1.0])
    """through the object's origin"""
    angles: Range = Field([0.0, 0.0])
    """[least, largest] angle about it [rad]"""
    offsets: Range = Field([0.0, 0.0])
    """[least, largest] way along it [m]"""
    angle_samples: SampleCount = 18
    """angles that are tried"""
    offset_samples: SampleCount = 1
    """offsets that are tried"""


class GraspSearch(Body):
    """How grasps are looked for on the surface of an object."""

    count: Annotated[int, Field(ge=1, le=500)] = 24
    """most grasps that are tried"""
    angles: Annotated[int, Field(ge=1, le=72)] = 8
    """approaches about the line between the fingers, or turns of a cup"""
    friction: Annotated[Positive, Field(le=10.0)] = 0.4
    """coefficient of friction at the fingers"""
    depth: Annotated[Number, Field(ge=-1.0, le=1.0)] = 0.0
    """how far the tip goes beyond the middle of what is gripped [m]"""
    radius: Length = 0.01
    """in which a surface is flat under a cup [m]"""
    seed: Seed = 0


class FoundGrasps(BodyWithRules):
    """Grasps found from the shape of the object, with the fingers of the robot or its tool."""

    one_of: ClassVar[tuple[str, ...]] = ("antipodal", "top", "side", "suction")

    antipodal: GraspSearch | None = None
    """two fingers, from anywhere"""
    top: GraspSearch | None = None
    """two fingers from above, as the object stands at the start"""
    side: GraspSearch | None = None
    """two fingers, level"""
    suction: GraspSearch | None = None
    """a cup on a flat place"""


def _form_of_grasps(value: object) -> str:
    named = isinstance(value, dict) and not FoundGrasps.model_fields.keys().isdisjoint(value)
    return "found" if named or isinstance(value, FoundGrasps) else "list"


_Listed = Annotated[
    Sequence[Pose], AS_LIST, Field(min_length=1, max_length=MAX_TARGETS), Tag("list")
]
Grasps = Annotated[_Listed | Annotated[FoundGrasps, Tag("found")], Discriminator(_form_of_grasps)]


class GraspStage(StageBody, BodyWithRules):
    """A choice among grasps of an object; without an approach before it, a free motion there."""

    one_of: ClassVar[tuple[str, ...]] = ("grasps", "region")

    kind: Literal["grasp"] = "grasp"
    object: Label = Field(examples=["crate"])
    """name of the obstacle"""
    grasps: Grasps | None = None
    """poses of the tool in the object's frame, or how they are found from its shape"""
    region: GraspRegion | None = None
    """of grasps, in place of a list"""
    touch_links: Labels = Field(default_factory=list)
    """links that may touch the object from the approach on, and while it is held"""
    support: Support | None = None
    """what it stands on: they may touch from attach to the end of the lift"""
    touch_depth: TouchDepth = TOUCH_DEPTH


class RestingPlaces(Body):
    """Poses of the object on the flat tops of its supports, each face down that it stands on."""

    samples: Annotated[list[SampleCount], Field(min_length=2, max_length=2)] = Field([3, 3])
    """spots along x and y of the surface"""
    angle_samples: SampleCount = 4
    """turns that are tried at each"""


class PlaceRegion(RestingPlaces):
    """Poses of the object on a rectangle across z of a pose, turned about that z."""

    pose: PoseInFrame
    """of the object in the middle of the rectangle"""
    size: Annotated[list[NonNegative], Field(min_length=2, max_length=2)] = Field([0.0, 0.0])
    """along x and y of the pose [m]"""
    angles: Range = Field([0.0, 0.0])
    """[least, largest] angle about its z [rad]"""


class PlaceGrid(Body):
    """Poses of objects side by side; a place inside of `for_each` takes the next one."""

    pose: PoseInFrame
    """of the first object"""
    step: Point
    """from one to the next along x, y and z of the pose [m]"""
    count: Annotated[list[SampleCount], Field(min_length=3, max_length=3)] = Field([1, 1, 1000])
    """along x, y and z; along x first"""
    first: Annotated[int, Field(ge=0)] = 0
    """number of the first free place"""
    fill: Literal["next", "any"] = "next"
    """the next place by number, or any that is free"""


class PlaceStage(StageBody, BodyWithRules):
    """A choice among poses of the held object; without an approach, a free motion there."""

    one_of: ClassVar[tuple[str, ...]] = ("poses", "region", "grid", "stack", "resting")
    needs: ClassVar[Beside] = {"resting": ("object", "support")}
    at_most_one = (("resting", "relative_to"),)

    kind: Literal["place"] = "place"
    object: Label | None = None
    """what is held, if that is one thing"""
    poses: Annotated[list[PoseInFrame], Field(min_length=1, max_length=MAX_TARGETS)] | None = None
    """of the object"""
    region: PlaceRegion | None = None
    """of poses, in place of a list"""
    grid: PlaceGrid | None = None
    """of poses, filled one by one"""
    stack: PlaceGrid | None = None
    """likewise; each object may touch the one that was put there before it"""
    resting: RestingPlaces | None = None
    """poses found from the shapes of the object and of `support`, as it stands"""
    relative_to: Label | None = None
    """an obstacle in whose frame the poses are, wherever it then stands"""
    support: Support | None = None
    """what it is put on: they may touch from the approach to detach"""
    touch_depth: TouchDepth = TOUCH_DEPTH


class AttachStage(StageBody, Carried):
    """The object becomes a part of the robot, where it stands."""

    kind: Literal["attach"] = "attach"
    object: Label = Field(examples=["crate"])
    """name of the obstacle"""
    link: Label | None = None
    """that holds it and moves with the tip; the tip"""


class DetachStage(StageBody):
    """The object becomes an obstacle, where it is held."""

    kind: Literal["detach"] = "detach"
    object: Label | None = None
    """what is held, if that is one thing"""
    touch_links: Labels = Field(default_factory=list)
    """links that may touch it until a free motion begins, beside those of its grasp"""
    touch_depth: TouchDepth = TOUCH_DEPTH


class WaitStage(StageBody):
    """The arm stands still."""

    kind: Literal["wait"] = "wait"
    duration: Annotated[Positive, Field(le=3600.0)]
    """[s]"""


class GripperStage(StageBody, BodyWithRules):
    """The gripper opens or closes while the arm stands still."""

    at_most_one = (("joints", "state"),)

    joints: FingerPositions | None = None
    """where joints of the gripper go [rad or m]; the others stay. If left out, the gripper's state
    of the name open or close, if it has one
    """
    state: Label | None = None
    """in place of joints: a state of the gripper"""
    duration: Annotated[Positive, Field(le=3600.0)] | None = None
    """[s]; half a second if left out, or what the fingers' speeds need"""


class OpenStage(GripperStage):
    """The gripper opens."""

    kind: Literal["open"] = "open"


class CloseStage(GripperStage):
    """The gripper closes."""

    kind: Literal["close"] = "close"
    until: Literal["contact"] | None = None
    """contact: the fingers stop where they touch the object of the grasp right before, for each
    grasp of its list where that is; joints or state say how far they may close. A grasp that fewer
    than two fingers touch is not taken
    """


class SignalStage(StageBody):
    """A digital output is switched while the arm stands still: it stands in the program."""

    kind: Literal["signal"] = "signal"
    output: Port = Field(examples=[3])
    """number of the output, or its name"""
    value: bool = True
    """on or off"""
    duration: Annotated[NonNegative, Field(le=3600.0)] = 0.0
    """how long the arm stands after it [s]"""


class SetStage(StageBody):
    """An analog output is given a number while the arm stands still."""

    kind: Literal["set"] = "set"
    output: Port = Field(examples=["spindle"])
    """number of the output, or its name"""
    value: Number
    """that it gets, in the controller's units"""


class WaitForStage(StageBody):
    """The program waits for a digital input while the arm stands still."""

    kind: Literal["wait_for"] = "wait_for"
    input: Port = Field(examples=[1])
    """number of the input, or its name"""
    value: bool = True
    """that is waited for: on or off"""


class ForEachStage(Body):
    """Stages once for each object; `{object}` in their texts is the object's name."""

    tag_is_needed: ClassVar[bool] = False

    kind: Literal["for_each"] = "for_each"
    for_each: dict[
        Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,31}$")],
        Annotated[list[Label], Field(min_length=1, max_length=MAX_STAGES)],
    ] = Field(examples=[{"object": ["part_1", "part_2"]}])
    """names that stand for `{object}`; several lists of one length go side by side"""
    order: Literal["written", "free", "shortest"] = "written"
    """free: another order where this one can't be done; shortest: the one that takes the least time
    of those found before the timeout, at the top level
    """
    stages: Annotated[list["StageUnion"], Field(min_length=1, max_length=MAX_STAGES)]
    """of each, in order"""

    @model_validator(mode="after")
    def _check_lists(self) -> "ForEachStage":
        if len({len(items) for items in self.for_each.values()}) != 1:
            raise ValueError("for_each: give lists of one length")
        return self


class RegraspStage(BodyWithRules):
    """The object may be put down and be grasped again, where no one grasp does for all."""

    one_of: ClassVar[tuple[str, ...]] = ("supports", "poses", "region")
    tag_is_needed: ClassVar[bool] = False
    only_beside: ClassVar[Beside] = {"support": ("poses", "region")}

    kind: Literal["regrasp"] = "regrasp"
    supports: Annotated[list[Label], Field(min_length=1, max_length=100)] | None = Field(
        None, examples=[["bench"]]
    )
    """obstacles with a flat top to put it down on"""
    poses: Annotated[list[PoseInFrame], Field(min_length=1, max_length=MAX_TARGETS)] | None = None
    """of the object where it is put down"""
    region: PlaceRegion | None = None
    """of such poses, in place of a list"""
    support: Support | None = None
    """what it stands on there"""
    grasps: Grasps | None = None
    """of the grasps after; those of the grasp before if left out, antipodal ones where these are
    top or side
    """
    most: Annotated[int, Field(ge=1, le=3)] = 1
    """how often at most"""
    distance: Distance = Field([0.02, 0.08])
    """[least, most] way down to where it is put, and of the tool off it"""


class FallbackStage(Body):
    """Alternatives in order: the first that can be done, with all that follows."""

    tag_is_needed: ClassVar[bool] = False

    kind: Literal["fallback"] = "fallback"
    fallback: Annotated[
        list[Annotated[list["StageUnion"], Field(max_length=MAX_STAGES)]],
        Field(min_length=1, max_length=100),
    ]
    """stages of each alternative"""


def _with_kind(value: object) -> object:
    """A stage that is told by its own field, with its kind."""
    if isinstance(value, dict) and "kind" not in value:
        if kind := next((name for name in ("for_each", "fallback") if name in value), None):
            return {"kind": kind, **value}
        if "regrasp" in value:
            own = value["regrasp"]
            if len(value) > 1:
                raise ValueError("regrasp holds all fields of its stage: none stands beside it")
            told = isinstance(own, dict) and own.get("kind") in (None, "regrasp")
            return {"kind": "regrasp", **(own if told else value)}
    return value


class _KindTold:
    """The published schema of stages that are told by their own field in place of a kind."""

    def __get_pydantic_json_schema__(
        self, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        schema = handler(core_schema)
        again = {"required": ["regrasp"], "properties": {"regrasp": schema["oneOf"][-1]}}
        told = [{"required": [name]} for name in ("kind", "for_each", "fallback", "regrasp")]
        schema["oneOf"].append({"type": "object", "additionalProperties": False} | again)
        return schema | {"allOf": [{"anyOf": told}]}


#: A stage that is no block of others.
SingleStage: TypeAlias = (
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
    | InsertStage
    | LineStage
    | ArcStage
    | SeamStage
    | SignalStage
    | SetStage
    | WaitForStage
)
StageUnion = Annotated[
    SingleStage | ForEachStage | FallbackStage | RegraspStage,
    Field(discriminator="kind"),
    BeforeValidator(_with_kind),
    _KindTold(),
]

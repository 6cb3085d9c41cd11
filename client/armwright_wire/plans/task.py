"""Tasks of several stages on the wire, and their answers."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from armwright_wire.base import Answer, Body, InFrame, Label, NonNegative, PlanId, examples
from armwright_wire.goals.goal import ConfigurationAnswer, Start
from armwright_wire.goals.tool_motion import ReferencePoseAnswer
from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.motions.trajectory import TrajectoryAnswer
from armwright_wire.plans.plan import PathAnswer, PlanningRequest, Reproducibility, Stage
from armwright_wire.plans.stages import MAX_STAGES, MAX_TARGETS, StageUnion
from armwright_wire.pose import Pose, PoseAnswer
from armwright_wire.scenes.check import (
    AllowedCollisions,
    Attached,
    AttachedObjects,
    FingerPositions,
)
from armwright_wire.scenes.tool import HeldTip


class MovedObject(Body):
    """An obstacle of the scene that stands elsewhere."""

    id: Label = Field(examples=["crate"])
    """its name"""
    pose: Pose
    """where it stands, in the root frame"""


class TaskRequest(PlanningRequest):
    """A sequence of stages to be planned as one."""

    model_config = ConfigDict(json_schema_extra={"examples": examples("TaskRequest")})

    start: Start
    """where the arm stands"""
    stages: Annotated[list[StageUnion], Field(min_length=1, max_length=MAX_STAGES)]
    """in order"""
    objects: Annotated[list[MovedObject], Field(max_length=MAX_TARGETS)] | None = None
    """obstacles that stand elsewhere than the scene says: `after.objects`"""
    attached: AttachedObjects | None = None
    """held at the start, as `after.attached` of the task before"""
    fingers: FingerPositions | None = None
    """where joints of the gripper stand at the start [rad or m], as `after.fingers`; the others
    where the robot holds them
    """
    allowed_collisions: AllowedCollisions | None = None
    """pairs that may touch in all stages"""
    improve: Annotated[NonNegative, Field(le=86_400.0)] = 0.0
    """time to look for a better answer after the first proved one [s]"""
    allow_partial: bool = False
    """the first stages are an answer where not all can be done"""

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

    id: str
    """its name"""
    pose: PoseAnswer
    """where it stands, in the root frame"""


class HeldObject(Answer):
    """An object that the robot holds, as `attached` of a request takes it."""

    id: str
    """its name"""
    link: str
    """that holds it"""
    pose: PoseAnswer
    """in the frame of the link"""
    touch_links: list[str]
    """names that it may touch"""
    touch_depth: float | None = None
    """how deep it may overlap these [m]"""
    mass: float | None = None
    """[kg]"""
    center_of_mass: list[float] | None = None
    """in the object's frame [m]"""
    inertia: list[list[float]] | None = None
    """about it, in the object's axes [kg m^2]"""


class WorldAnswer(Answer):
    """The objects after a stage; a request takes the fields, to go on from here."""

    objects: list[PlacedObject]
    """obstacles that stand elsewhere than before"""
    attached: list[HeldObject]
    """what the robot holds"""
    fingers: dict[str, float] = Field(default_factory=dict)
    """where joints of the gripper stand that can be moved [rad or m]"""

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


class EventAnswer(Answer):
    """What a stage says to the machines around."""

    port: int | str
    """number or name of the output or input"""
    value: float
    """1 for on, 0 for off, or the number that is set"""


class TaskStageAnswer(Answer):
    """One stage with its motion and the proof."""

    index: int
    """its number, from 0; those of `for_each` count once for each object, those of `fallback` as
    far as they were taken
    """
    item: str | None = None
    """the object of `for_each`, or the number of the alternative, it is for"""
    event: EventAnswer | None = None
    """of signal, set and wait_for"""
    tip: HeldTip | None = None
    """point of a held object that leads in it"""
    kind: str
    """as requested"""
    name: str | None = None
    """as requested"""
    begins: float
    """when it begins in the whole task [s]"""
    choice: int | None = None
    """number of the grasp, place or goal chosen"""
    configuration: ConfigurationAnswer | None = None
    """the one chosen at its end; null where no pose leaves a choice"""
    planner: str | None = None
    """that found its path; null where it stands still"""
    stages: list[Stage] = Field(default_factory=list)
    """of planning"""
    path: PathAnswer | None = None
    """null where the arm stands still"""
    trajectory: TrajectoryAnswer
    """its motion, from its own time 0"""
    fingers: TrajectoryAnswer | None = None
    """motion of the gripper's joints beside it; null where they stand still"""
    certificate: CertificateAnswer
    """the proof, with what is held and with the motion of the fingers"""
    reference: list[ReferencePoseAnswer] | None = None
    """poses that a straight motion holds the tool to, at drawn instants of its own time; null of
    other stages
    """
    passes: bool = False
    """the arm passes its end without resting, within its blend"""
    after: WorldAnswer
    """the objects after it"""
    notes: list[str] = Field(default_factory=list)
    """what was done to the request"""


class TrialAnswer(Answer):
    """One alternative under the choices before it, and what came of it."""

    choices: list[int]
    """numbers of the alternatives chosen up to this one"""
    stage: int
    """number of the stage that has the alternatives"""
    outcome: str
    """solved, failed, in_collision, outside_limits, out_of_reach, or open: not tried"""
    reasons: dict[str, int]
    """each with how many configurations had it"""
    joints: list[float] | None = None
    """one of the configurations that failed, inside the limits [rad or m]"""


class ImprovementAnswer(Answer):
    """A proved answer that was the best so far: its time and its configurations."""

    milliseconds: float
    """since the search began"""
    duration: float
    """of all stages [s]"""


class OrderAnswer(Answer):
    """An order of `for_each` that was to be the shortest."""

    items: list[str]
    """objects in the order that was found"""
    duration: float
    """of all stages in this order [s]"""
    written: float | None = None
    """of all stages in the order as written [s]; null where it can't be done"""
    saved: float | None = None
    """the difference of these [s]"""


class TaskAnswer(InFrame):
    """All stages of a task, each with a motion that is proved."""

    status: Literal["success", "partial"]
    """partial: the first stages only, where that was asked for"""
    duration: float
    """of all stages [s]"""
    stages: list[TaskStageAnswer]
    """in order"""
    trials: list[TrialAnswer]
    """what was tried, by stage"""
    trials_omitted: int = 0
    """how many more there were"""
    orders: list[OrderAnswer] = Field(default_factory=list)
    """of `for_each` with the order shortest, one after another"""
    improvements: list[ImprovementAnswer]
    """the last one is answered"""
    exhausted: bool
    """every combination was tried, or can't be better by its estimate"""
    failure: dict[str, Any] | None = None
    """of a partial answer: why the later stages could not be done"""
    reproducibility: Reproducibility
    """seed, hashes and versions"""
    plan_id: PlanId = None

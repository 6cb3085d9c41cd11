"""Answers to tasks of several stages on the wire."""

from typing import Any, Literal

from pydantic import Field

from armwright_wire.base import Answer, InFrame, PlanId
from armwright_wire.cartesian import ReferencePoseAnswer
from armwright_wire.certificate import CertificateAnswer, TrajectoryAnswer
from armwright_wire.goal_costs import ConfigurationAnswer
from armwright_wire.plan import PathAnswer, Reproducibility, Stage
from armwright_wire.pose import PoseAnswer


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

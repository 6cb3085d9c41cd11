"""Tasks of several stages: pick and place as one question."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypedDict

from pydantic import Field

from armwright_client.base import PLAIN, Answer, InFrame, NonNegative, Positive, Request
from armwright_client.certificate import Certificate, LimitValues
from armwright_client.check import Attached, AttachedObjects, FingerPositions
from armwright_client.clearance import ConfigurationReport, GoalCosts
from armwright_client.goal import Start
from armwright_client.plan import JointPath, Reproducibility, Stage, Timing
from armwright_client.pose import Pose
from armwright_client.scene import AllowedPairs, SceneReference
from armwright_client.task_stage import Stages
from armwright_client.tool_motion_report import ReferencePose
from armwright_client.trajectory import TimedTrajectory


class MovedObject(Request):
    """An obstacle of the scene that stands elsewhere.

    Args:
        id: Its name.
        pose: Where it stands.
    """

    id: str
    pose: Pose


if TYPE_CHECKING:
    MovedObjects: TypeAlias = Sequence[MovedObject]
else:
    MovedObjects = Annotated[list[MovedObject], PLAIN]


class TaskOptions(TypedDict, total=False):
    """Options of a task beyond robot, start and stages.

    Args:
        scene: A stored scene's name, or a scene.
        frame: Of what names none: a link that stands still, or "tool" at the start.
        objects: Obstacles that stand elsewhere than the scene says.
        attached: Objects that are held at the start.
        fingers: Where joints of the gripper stand at the start [rad or m].
        allowed_collisions: Pairs that may touch in all stages.
        margin: Distance to be kept [m].
        timing: How paths become motions.
        limits: Of the joints, in place of the robot's.
        goal_costs: Weights by which configurations of poses are chosen.
        improve: Time to look for a better answer after the first [s].
        allow_partial: Whether the first stages are an answer where not all can be done.
        timeout: For all stages together [s].
        seed: Of the random generators.
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    scene: SceneReference
    frame: str
    objects: Sequence[MovedObject]
    attached: Sequence[Attached]
    fingers: Mapping[str, float]
    allowed_collisions: AllowedPairs
    margin: float
    timing: Timing
    limits: LimitValues
    goal_costs: GoalCosts
    improve: float
    allow_partial: bool
    timeout: float
    seed: int
    keep: bool


class TaskRequest(Request):
    """A sequence of stages to be planned as one; see `TaskOptions`."""

    robot: str
    scene: SceneReference | None = None
    frame: str | None = None
    start: Start
    stages: Stages
    objects: MovedObjects | None = None
    attached: AttachedObjects | None = None
    fingers: FingerPositions | None = None
    allowed_collisions: AllowedPairs | None = None
    margin: NonNegative = 0.0
    timing: Timing | None = None
    limits: LimitValues | None = None
    goal_costs: GoalCosts | None = None
    improve: NonNegative = 0.0
    allow_partial: bool = False
    timeout: Positive | None = None
    seed: int = 0
    keep: bool | None = None


class PlacedObject(Answer):
    """An obstacle that a task has moved.

    Args:
        id: Its name.
        pose: Where it stands.
    """

    id: str
    pose: Pose


class HeldObject(Answer):
    """An object that the robot holds.

    Args:
        id: Its name.
        link: That holds it.
        pose: In the frame of the link.
        touch_links: Names that it may touch.
        touch_depth: How deep it may overlap these [m]; None for any depth.
        mass: [kg].
        center_of_mass: In the object's frame [m].
        inertia: About it [kg m^2].
    """

    id: str
    link: str
    pose: Pose
    touch_links: list[str]
    touch_depth: float | None = None
    mass: float | None = None
    center_of_mass: list[float] | None = None
    inertia: list[list[float]] | None = None


class TaskWorld(Answer):
    """The objects after a stage.

    Args:
        objects: Obstacles that stand elsewhere than before the task.
        attached: What the robot holds.
        fingers: Where joints of the gripper stand [rad or m].
    """

    objects: list[PlacedObject]
    attached: list[HeldObject]
    fingers: dict[str, float] = Field(default_factory=dict)

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


class TaskStageReport(Answer):
    """One stage with its motion and the proof.

    Args:
        index: Its number.
        kind: Its kind.
        name: Its name.
        begins: When it begins in the whole task [s].
        choice: Number of the grasp, place or goal chosen.
        configuration: The one chosen at its end; None where no pose leaves a choice.
        planner: That found its path.
        stages: Of planning.
        path: Its waypoints.
        trajectory: Its motion.
        fingers: Motion of the gripper's joints beside it; None where they stand still.
        certificate: The proof.
        reference: Poses that a straight motion holds the tool to, at drawn instants.
        passes: Whether the arm passes its end without resting.
        after: The objects after it.
        notes: What was done to the request.
    """

    index: int
    kind: str
    name: str | None = None
    begins: float
    choice: int | None = None
    configuration: ConfigurationReport | None = None
    planner: str | None = None
    stages: list[Stage] = Field(default_factory=list)
    path: JointPath | None = None
    trajectory: TimedTrajectory
    fingers: TimedTrajectory | None = None
    certificate: Certificate
    reference: list[ReferencePose] | None = None
    passes: bool = False
    after: TaskWorld
    notes: list[str] = Field(default_factory=list)


class Trial(Answer):
    """One alternative under the choices before it, and what came of it.

    Args:
        choices: Numbers of the alternatives chosen up to this one.
        stage: Number of its stage.
        outcome: What came of it.
        reasons: Each with how many configurations had it.
        joints: One of the configurations that failed.
    """

    choices: list[int]
    stage: int
    outcome: str
    reasons: dict[str, int]
    joints: list[float] | None = None


class Improvement(Answer):
    """A proved answer that was the best so far: its time and its configurations.

    Args:
        milliseconds: Since the search began.
        duration: Of all stages [s].
    """

    milliseconds: float
    duration: float


class TaskPlan(InFrame):
    """All stages of a task, each with a motion that is proved.

    Args:
        status: "success" or "partial".
        duration: Of all stages [s].
        stages: In order.
        trials: What was tried.
        trials_omitted: How many more there were.
        improvements: Proved answers in the order they were found.
        exhausted: Whether nothing was left to try.
        failure: Of a partial answer: why it ends early.
        reproducibility: Seed, hashes and versions.
        plan_id: Of the kept plan, if it was kept.
    """

    status: str
    duration: float
    stages: list[TaskStageReport]
    trials: list[Trial]
    trials_omitted: int = 0
    improvements: list[Improvement]
    exhausted: bool
    failure: dict[str, Any] | None = None
    reproducibility: Reproducibility
    plan_id: str | None = None

"""The gate for motions that others make, on the wire: proposals, verdicts, changes of scenes."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field
from pydantic.config import JsonDict

from armwright_wire.base import (
    JOINTS_EXAMPLE,
    Answer,
    Beside,
    Body,
    BodyWithRules,
    JointVector,
    Label,
    Name,
    NamePair,
    NonNegative,
    Number,
    Positive,
    Timeout,
)
from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.motions.trajectory import LimitsBody, TrajectoryAnswer, TrajectoryBody
from armwright_wire.plans.task import MovedObject
from armwright_wire.scenes.check import Margin, WithFingers, WithScene
from armwright_wire.scenes.scene import Obstacle

#: A minute at 30 Hz.
_MAX_SAMPLES = 2_000
#: Obstacles that one message adds, moves or takes out.
_MAX_CHANGES = 1_000

Interpolation = Literal["linear", "cubic", "quintic", "natural_spline", "clamped_spline"]
Rows = Annotated[list[JointVector], Field(min_length=1, max_length=_MAX_SAMPLES)]
Duration = Annotated[Positive, Field(le=60.0)]

_STEP: JsonDict = {
    "state": {"positions": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]},
    "proposal": {"joint_velocities": [0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "duration": 0.1},
    "latency": 0.01,
}


class GuardState(Body):
    """State of the arm."""

    positions: JointVector = Field(examples=[JOINTS_EXAMPLE])
    """of the joints"""
    velocities: JointVector | None = None
    """at rest if left out"""
    accelerations: JointVector | None = None
    """none if left out"""
    elapsed: NonNegative | None = None
    """in a session: time since the motion accepted last began, when the state was measured [s]. The
    proposal then begins where that motion is after the latency
    """


class Proposal(BodyWithRules):
    """A motion that somebody is about to send."""

    one_of: ClassVar[tuple[str, ...]] = ("trajectory", "samples", "joint_velocities", "twist")
    needs: ClassVar[Beside] = {
        "samples": ("period", "interpolation"),
        "joint_velocities": ("duration",),
        "twist": ("duration",),
    }
    only_beside: ClassVar[Beside] = {
        "period": ("samples",),
        "interpolation": ("samples",),
        "velocities": ("samples",),
        "accelerations": ("samples",),
        "duration": ("joint_velocities", "twist"),
        "link": ("twist",),
    }

    trajectory: TrajectoryBody | None = None
    """a timed motion from the state at the latency on"""
    samples: Rows | None = None
    """targets of the joints, as policies answer them; the first is reached after one period"""
    period: Positive | None = None
    """time between two samples [s]"""
    interpolation: Interpolation | None = None
    """how the controller reads between samples"""
    velocities: Rows | None = None
    """at the samples, for cubic and quintic"""
    accelerations: Rows | None = None
    """at the samples, for quintic"""
    joint_velocities: JointVector | None = None
    """to be held; the joints get there as quickly as their limits allow"""
    twist: Annotated[list[Number], Field(min_length=6, max_length=6)] | None = None
    """of the tool or a link, to be held, in the root frame: [v, w]"""
    duration: Duration | None = None
    """for which velocities are held [s]"""
    link: Label | None = None
    """that has the twist; the tip if left out"""


class GuardStep(Body):
    """A proposal in a session."""

    model_config = ConfigDict(json_schema_extra={"examples": [_STEP]})

    state: GuardState
    proposal: Proposal
    latency: Annotated[NonNegative, Field(le=10.0)] = 0.0
    """time from the state to the begin of the proposal [s]"""
    scene_hash: Label | None = None
    """of the scene that the proposal was made for: it is refused in another"""
    exact: bool = False
    """tell the first instant of a collision, which takes longer"""


class GuardOpening(WithScene, WithFingers):
    """Robot and scene that a session is about: its first message."""

    robot: Name = Field(examples=["panda"])
    """name of a stored or built-in robot"""
    margin: Margin = 0.0
    limits: LimitsBody | None = None
    stop: Literal["path", "joints", "both"] = "path"
    """how the arm stops: on its path, every joint by itself, or either"""
    tracking: Positive = 0.05
    """how far a state may be from the motion that the arm has [rad or m]"""
    arm: Label | None = None
    """name of the arm itself: of two sessions for one the later is refused"""


class GuardRequest(GuardOpening, GuardStep):
    """A proposal for an arm, with its robot and scene."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"robot": "panda", "stop": "path", **_STEP}]}
    )

    timeout: Timeout | None = None


class SceneChange(Body):
    """Change of the scene of a session."""

    add: Annotated[list[Obstacle], Field(max_length=_MAX_CHANGES)] | None = None
    """obstacles, in the root frame"""
    move: Annotated[list[MovedObject], Field(max_length=_MAX_CHANGES)] | None = None
    """obstacles that stand elsewhere"""
    remove: Annotated[list[Label], Field(max_length=_MAX_CHANGES)] | None = None
    """names of obstacles that are gone"""
    elapsed: NonNegative = 0.0
    """time since the motion accepted last began: what is left is proved [s]"""


class GuardChange(Body):
    """A message of a session that changes its scene."""

    change: SceneChange


class GuardStop(Answer):
    """The stop that the arm has."""

    trajectory: TrajectoryAnswer
    """from where the motion ends to rest"""
    certificate: CertificateAnswer
    """of the motion and this stop, and in `stops` of those from every instant of it"""
    number: int
    """of the proposal that it belongs to, from 1; 0 where none was accepted"""


class GuardViolation(Answer):
    """A fault of a proposal."""

    kind: str = Field(examples=["collision"])
    """position, velocity, acceleration, jerk, continuity, collision, stop; start where it does not
    begin in the state; state, stale, scene
    """
    time: float
    """from the begin of the proposal [s]"""
    message: str
    """what is wrong"""
    joint: str | None = None
    """whose limit it is"""
    value: float | None = None
    """that is reached"""
    limit: float | None = None
    """of it"""
    pair: NamePair | None = None
    """the two bodies"""
    depth: float | None = None
    """how much nearer than allowed they are [m]"""


class GuardAnswer(Answer):
    """Verdict of the gate: what was proved of a proposal, and the stop that the arm has."""

    number: int
    """of the proposal in its session, from 1"""
    accepted_until: float
    """up to which the trajectory may be run, 0 for not at all [s]"""
    scale: float
    """share of the speed at which it was proved, 0 where refused"""
    trajectory: TrajectoryAnswer | None
    """proposal as it was proved, up to there; null where it is refused"""
    stop: GuardStop
    clearance: float | None
    """a bound for motion and stop [m]; null with nothing to hit"""
    pair: NamePair | None
    """the two bodies that come nearest"""
    violations: list[GuardViolation]
    """faults of the proposal as it came, one of each kind or more"""
    notes: list[str] = Field(default_factory=list)
    """on the state"""


class GuardReady(Answer):
    """Answer to the first message of a session, or to a change of its scene."""

    robot_hash: str
    """content hash of the robot"""
    scene_hash: str
    """content hash of the scene, as requests may give it"""
    joint_names: list[str]
    """order of the joints"""
    stop: Literal["none", "proved", "void"]
    """what is left of the motion that the arm has: proved in this scene, or void"""
    certificate: CertificateAnswer | None = None
    """of it, where there is one"""

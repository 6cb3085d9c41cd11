"""Kept plans on the wire: lists, documents, replays and bundles."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field
from pydantic.config import JsonDict

from armwright_wire.base import Answer, Body, FreeForm, Instant, Label, Number, Timeout
from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.motions.trajectory import TrajectoryAnswer
from armwright_wire.plans.job import Problem

#: Longest text of a request, robot or scene in a bundle [characters]; bodies are bounded too.
_MAX_TEXT = 2**26
#: Differences between an answer and its replay that are named.
MAX_DIFFERENCES = 20
_ID = "0199f3b1c2d40123456789abcdef0123"
_DIGEST = "9f2c5d0e7a1b4c6d8e0f1a2b3c4d5e6f708192a3b4c5d6e7f8091a2b3c4d5e6f"

Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$", examples=[_DIGEST])]
#: Requests that can be kept: those whose bodies are `Keepable`.
Operation = Annotated[
    str,
    Field(
        pattern=r"^POST /v1/(plan|check|validate|tasks|tours|"
        r"robots/[A-Za-z0-9][A-Za-z0-9_.\-]{0,127}/ik)$",
        examples=["POST /v1/plan"],
    ),
]


class DocumentName(Answer):
    """A robot or scene of a kept plan: its name, and the content that it had."""

    name: str = Field(examples=["my_arm"])
    """in the request"""
    hash: str | None
    """SHA-256 of its stored document; null for a built-in robot, which comes with the version"""


class KeptPlanSummary(Answer):
    """A kept request, without its answer."""

    id: str = Field(examples=[_ID])
    """name of the plan in `/v1/plans/{id}`"""
    operation: Operation
    """request that was answered"""
    status: Literal["succeeded", "failed"]
    """failed: there is a problem instead"""
    code: str | None = Field(None, examples=["GOAL_IN_COLLISION"])
    """of the problem"""
    robot: DocumentName | None = None
    scene: DocumentName | None = None
    """the stored scene; null with none, or one inside of the request"""
    seed: int | None = None
    """of the request's random choices"""
    version: str
    """of Armwright, which answered"""
    digest: Digest
    """SHA-256 of the answer or problem without measured times: equal for equal answers"""
    created: Instant
    """when it was answered"""
    expires: Instant
    """when it is forgotten at the latest"""
    job: str | None = None
    """the job that it answered"""
    replay_of: str | None = None
    """the kept plan that it repeats or changes"""
    proved_here: bool = False
    """this service came to the answer, and all that it says is proved; of an imported plan: from
    the request, the robot and the scene of its bundle
    """


class KeptPlan(KeptPlanSummary):
    """A kept request with its answer or problem."""

    request: Any
    """the body as it was sent"""
    answer: Any = None
    """once succeeded: what the request was answered"""
    problem: Problem | None = None
    """once failed: the problem document"""


class PlanList(Answer):
    """Kept plans, newest first."""

    plans: list[KeptPlanSummary]
    """without requests and answers"""
    next: str | None
    """give it as `after` for the next page"""


_CHANGES: JsonDict = {"margin": 0.01, "planner": "rrt_connect"}


class ReplayRequest(Body):
    """A kept plan to be computed again, perhaps with changes."""

    model_config = ConfigDict(json_schema_extra={"examples": [{}, {"changes": _CHANGES}]})

    changes: FreeForm | None = Field(None, examples=[_CHANGES])
    """fields that replace those of the request, as a JSON merge patch (RFC 7396): objects are
    merged, null removes a field
    """
    documents: Literal["kept", "current"] = "kept"
    """kept: robot and scene as they were; current: those of these names today"""
    keep_replay: bool | None = None
    """keep the replay as a plan too; if left out, that of a job is kept"""


class ReplayAnswer(Answer):
    """The replay of a kept plan, compared with what was kept."""

    same: bool
    """answer or problem are equal but for measured times"""
    differences: list[str]
    """JSON pointers of the first values that differ, the answer's own order"""
    digest: Digest
    """of the new answer or problem"""
    plan_id: str | None = None
    """the replay as a kept plan, if it was kept"""
    answer: Any = None
    """of the request, if it has one"""
    problem: Problem | None = None
    """if it has none"""


class StopRequest(Body):
    """A stop of the motion of a kept plan."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"at": 0.5, "kind": "path"}]})

    at: Number = Field(examples=[0.5])
    """instant of its trajectory at which braking begins [s]"""
    kind: Literal["path", "joints"] = "path"
    """path: to rest along its own path; joints: every joint by itself, which leaves the path"""
    timeout: Timeout | None = None


class StopAnswer(Answer):
    """A stop as a motion of its own."""

    kind: Literal["path", "joints"]
    """of the stop"""
    at: float
    """instant of the kept motion that it leaves [s]"""
    trajectory: TrajectoryAnswer
    """from that instant on, which is its time 0"""
    certificate: CertificateAnswer
    """of the stop; not verified where it meets something"""


class Bundle(Body):
    """A kept plan as a file: all that another installation needs to replay it.

    Documents are texts, so that their bytes and with them their hashes stay as they are.
    """

    armwright_bundle: Annotated[int, Field(ge=1, le=1)]
    """version of this format"""
    operation: Operation
    """request that was answered"""
    version: Label
    """of Armwright, which answered"""
    status: Literal["succeeded", "failed"]
    """failed where there is a problem in place of an answer"""
    seed: int | None = None
    """of the request's random choices"""
    digest: Digest
    """SHA-256 of the answer or problem without measured times"""
    robot: Label | None = None
    """name of the robot, if the request names one"""
    robot_document: Annotated[str, Field(max_length=_MAX_TEXT)] | None = None
    """the stored robot, JSON; null for a built-in one"""
    scene: Label | None = None
    """name of the stored scene, if the request names one"""
    scene_document: Annotated[str, Field(max_length=_MAX_TEXT)] | None = None
    """the stored scene, JSON; null if the request names none"""
    request: Annotated[str, Field(max_length=_MAX_TEXT)]
    """the body, JSON"""
    answer: Annotated[str, Field(max_length=_MAX_TEXT)]
    """the answer or problem, JSON"""

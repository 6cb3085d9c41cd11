"""Results of tasks that are no plain answer; the server reads them, so imports are small."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from pydantic import ValidationError

from service.storage.caches.cache_key import Reference
from service.validation import ProblemError, from_fields
from service.workers.task import Task

if TYPE_CHECKING:
    from planning.proof.certificate import Certificate

#: Code of the problem of a request that does not follow its model.
_MALFORMED = "VALIDATION_ERROR"


@dataclass(frozen=True, slots=True)
class CacheMiss:
    """Result of a task that raised `NotPrepared`: its robot or scene is not prepared (any more)."""

    #: Nothing was computed, see `service.workers.supervisor`.
    is_refusal: ClassVar[bool] = True

    reference: Reference


@dataclass(frozen=True, slots=True)
class TaskProblem:
    """The problem that a task found in place of an answer.

    Args:
        code: The kind of problem.
        message: Fault and its place.
        hint: Advice on how to mend it.
        details: Values a program can use; one named ``stage`` is the step that failed.
    """

    code: str
    message: str
    hint: str | None
    details: dict[str, object]

    @classmethod
    def of(cls, problem: ProblemError) -> "TaskProblem":
        """A problem as a value that workers send."""
        details = {**problem.details, "stage": problem.stage}
        return cls(problem.code, problem.detail, problem.hint, details)

    @property
    def error(self) -> ProblemError:
        """The problem as an exception."""
        return from_fields(self.code, self.message, self.hint, self.details)

    @property
    def is_refusal(self) -> bool:
        """Whether the request is malformed: nothing was computed."""
        return self.code == _MALFORMED


def timed_out(work: str, stage: str) -> TaskProblem:
    """The problem that the deadline passed before some work was done.

    Args:
        work: The end of the sentence: "the search began".
        stage: The step that it would have been.
    """
    return TaskProblem(
        "TIMED_OUT",
        f"the deadline passed before {work}",
        "Allow more time with the field timeout.",
        {"stage": stage},
    )


def overdue(*proofs: "Certificate | None", work: str = "the work was done") -> TaskProblem | None:
    """The problem that the deadline passed before proofs were done; None where it did not.

    Args:
        proofs: Certificates, where there are any.
        work: The end of the sentence, as `timed_out` has it.
    """
    faults = (None if proof is None else proof.violation for proof in proofs)
    if any(fault is not None and fault.kind == "time" for fault in faults):
        return timed_out(work, "certificate")
    return None


def validation_fault(error: ValidationError) -> TaskProblem:
    """The problem of a request that does not follow its model; the server tells all its faults."""
    first = error.errors(include_url=False, include_input=False, include_context=False)[0]
    where = ".".join(str(step) for step in first["loc"]) or "body"
    return TaskProblem(_MALFORMED, f"{where}: {first['msg']}", None, {"stage": "request"})


@dataclass(frozen=True, slots=True)
class PlanOutcome:
    """A plan as it is answered, with the figures that metrics count.

    Args:
        content: The answer, JSON.
        planner: The stage that found it.
        stages: Name and duration [s] of each stage.
    """

    content: bytes
    planner: str
    stages: tuple[tuple[str, float], ...]


#: A task that answers the content of a request about a robot's chain.
ChainTask = Task[[Reference, bytes], bytes]


@dataclass(frozen=True, slots=True)
class RobotModel:
    """The model of a robot, with the sizes that the server goes by.

    Args:
        answer: The model as it is answered, JSON.
        joints: How many joints it has.
        links: How many links its chain has.
    """

    answer: bytes
    joints: int
    links: int


class BatchPart(NamedTuple):
    """Neighbouring problems of a batch, as a batch of their own.

    Args:
        first: Index of the first one in the whole batch.
        size: How many they are.
        content: Request of the problems, JSON.
    """

    first: int
    size: int
    content: bytes


@dataclass(frozen=True, slots=True)
class BatchItem:
    """One problem of a batch.

    Args:
        robot: Name of the robot, perhaps that of all problems.
        scene: The name of a stored scene, if it is in one.
        shared: Whether the problem is in the scene that the batch gives inline.
        timeout: Timeout as the request names it [s].
        content: Fields of this problem alone, JSON.
        mounted: Fields that say which tool is mounted.
    """

    robot: str
    scene: str | None
    shared: bool
    timeout: float | None
    content: bytes
    mounted: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SplitBatch:
    """A batch that was taken apart.

    Args:
        items: Problems of the batch, in order.
        head: The fields that stand beside them, without a scene given inline: JSON, each with a
            comma behind it.
        scene_hash: Hash of the document of a scene given inline; None where there is none.
    """

    items: tuple[BatchItem, ...]
    head: bytes
    scene_hash: str | None


@dataclass(frozen=True, slots=True)
class PlannedPart:
    """Outcomes of the first problems of a part of a batch.

    Args:
        outcomes: A plan or a problem for each, in order; those that are left come later.
        seconds: Time that they took together [s].
    """

    outcomes: tuple[PlanOutcome | TaskProblem, ...]
    seconds: float


@dataclass(frozen=True, slots=True)
class SessionState:
    """State of a session as the server keeps it between messages.

    Args:
        id: The session.
        version: Counts changes of its scene.
        count: Proposals so far.
        scene: The scene as it was changed, pickled; None for that of the opening.
        running: The motion that the arm has, pickled; None where none was accepted.
    """

    id: str
    version: int = 0
    count: int = 0
    scene: bytes | None = None
    running: bytes | None = None


@dataclass(frozen=True, slots=True)
class SessionReply:
    """Answer of a session to a message.

    Args:
        content: The answer, JSON.
        state: State of the session from then on.
    """

    content: bytes
    state: SessionState

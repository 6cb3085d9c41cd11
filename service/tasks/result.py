"""Results of tasks that are no plain answer."""

from dataclasses import dataclass

from service.storage.cache_key import Reference


@dataclass(frozen=True, slots=True)
class CacheMiss:
    """The result of a task whose robot or scene is not prepared (any more)."""

    reference: Reference


@dataclass(frozen=True, slots=True)
class TaskProblem:
    """The problem that a task found in place of an answer.

    Args:
        code: The kind of problem.
        message: What is wrong and where.
        hint: What to do about it.
        details: Values a program can use; one named ``stage`` is the step that failed.
    """

    code: str
    message: str
    hint: str | None
    details: dict[str, object]


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

"""How a request names a stored robot or scene to a worker: where it is, not what it is."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["robot", "scene"]


@dataclass(frozen=True, slots=True)
class Reference:
    """A robot or scene that a worker is to load.

    Args:
        kind: Which of the two.
        name: Its name.
        hash: SHA-256 of its document; of a built-in robot its name.
        folder: Where prepared robots and scenes are kept.
        built_in: Whether it comes with the app, so that there is no document.
    """

    kind: Kind
    name: str
    hash: str
    folder: str
    built_in: bool = False


def builtin_reference(name: str, folder: str = "") -> Reference:
    """The reference of a robot that comes with the app."""
    return Reference("robot", name, name, folder, built_in=True)


@dataclass(frozen=True, slots=True)
class CacheMiss:
    """What a task answers when what it was to load is not prepared (any more)."""

    reference: Reference


class NotPrepared(Exception):
    """Nothing usable is kept for a reference: its document has to be prepared again."""

    def __init__(self, reference: Reference) -> None:
        super().__init__(reference.name)
        self.reference = reference


@dataclass(frozen=True, slots=True)
class TaskProblem:
    """What a task answers when there is an answer only in part: a problem, told as values.

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
    """A plan as it is answered, and what is counted of it.

    Args:
        content: The answer, JSON.
        planner: The stage that found it.
        stages: Name and duration [s] of each stage.
    """

    content: bytes
    planner: str
    stages: tuple[tuple[str, float], ...]

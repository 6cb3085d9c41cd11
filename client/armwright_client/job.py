"""Work that goes on after the answer, and the events that tell of it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from armwright_client.base import Answer
from armwright_client.problem import Problem


class Job(Answer):
    """Where some work stands.

    Args:
        id: To ask for it by.
        status: "queued", "running", "succeeded", "failed" or "cancelled".
        progress: From 0 to 1.
        stage: What is being done.
        result: The answer, once succeeded.
        error: What went wrong, once failed.
    """

    id: str | None = None
    status: str
    progress: float | None = None
    stage: str | None = None
    result: Any = None
    error: Problem | None = None


@dataclass(frozen=True, slots=True)
class JobEvent:
    """A server-sent event.

    Args:
        event: Its kind.
        data: Its text, usually JSON.
        id: Its number, where it has one.
    """

    event: str
    data: str
    id: str | None = None


class EventReader:
    """Makes events of the lines of an event stream, as the HTML standard has it."""

    def __init__(self) -> None:
        self._fields: dict[str, list[str]] = {}

    def feed(self, line: str) -> Iterator[JobEvent]:
        """Take a line without its end; an empty one completes an event."""
        if line:
            name, _, value = line.partition(":")
            self._fields.setdefault(name, []).append(value.removeprefix(" "))
            return
        fields, self._fields = self._fields, {}
        if "data" in fields:
            kind = fields.get("event", ["message"])[-1]
            number = fields["id"][-1] if "id" in fields else None
            yield JobEvent(kind, "\n".join(fields["data"]), number)

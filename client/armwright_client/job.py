"""Work that goes on after the answer, and the events that tell of it."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from armwright_client.base import Answer
from armwright_client.problem import Problem


class Job(Answer):
    """Status of a job.

    Args:
        id: To ask for it by.
        status: "queued", "running", "succeeded", "failed" or "cancelled".
        operation: The request that it answers, as "POST /v1/plan".
        progress: From 0 to 1.
        stage: What is being done.
        created: When it was accepted.
        started: When a worker began with it.
        ended: When it ended.
        expires: When the service forgets it.
        location: What it created, as "/v1/robots/arm".
        result: The answer, once succeeded, as JSON has it.
        error: What went wrong, once failed.
    """

    id: str
    status: str
    operation: str = ""
    progress: float = 0.0
    stage: str | None = None
    created: datetime | None = None
    started: datetime | None = None
    ended: datetime | None = None
    expires: datetime | None = None
    location: str | None = None
    result: Any = None
    error: Problem | None = None

    @property
    def done(self) -> bool:
        """Whether it has ended, one way or another."""
        return self.status in ("succeeded", "failed", "cancelled")


class JobList(Answer):
    """Jobs without their results, newest first.

    Args:
        jobs: A page of them.
        next: To be given as `after` for the next page, if there is one.
    """

    jobs: list[Job]
    next: str | None = None


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

    def job(self) -> Job:
        """Status of the job, as the events of jobs tell.

        Raises:
            pydantic.ValidationError: It is another event.
        """
        return Job.read(self.data.encode())


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

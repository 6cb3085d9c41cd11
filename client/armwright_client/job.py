"""Work that goes on after the answer, and the events that tell of it."""

from collections.abc import Iterator
from dataclasses import dataclass

from armwright_wire.base import Instant
from armwright_wire.plans.job import JobAnswer
from armwright_wire.plans.job import JobList as JobListOfSummaries


class Job(JobAnswer):
    """Status of a job, with its result or error once it has ended; newer services may have more."""

    status: str  # type: ignore[assignment]
    operation: str = ""
    progress: float = 0.0
    created: Instant | None = None  # type: ignore[assignment]

    @property
    def done(self) -> bool:
        """Whether it has ended, one way or another."""
        return self.status in ("succeeded", "failed", "cancelled")


class JobList(JobListOfSummaries):
    """Jobs without their results, newest first."""

    jobs: list[Job]  # type: ignore[assignment]  # a summary is a status without result


@dataclass(frozen=True, slots=True)
class JobEvent:
    """A server-sent event.

    Args:
        event: Kind of the event.
        data: Text of the event, usually JSON.
        id: Number of the event, where it has one.
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

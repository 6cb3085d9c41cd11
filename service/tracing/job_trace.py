"""Spans of a job: the wait for a worker, the work there, and the stages of the work."""

import re

from opentelemetry.context import Context, get_current
from opentelemetry.trace import Span, Status, StatusCode, Tracer, set_span_in_context

#: Stages that are words name their spans; others have text of a request in them.
_WORD = re.compile(r"[a-z_]{1,40}")
#: Codes of faults of the service itself.
_OWN_FAULTS = frozenset({"CRASH", "TIMED_OUT", "OUT_OF_MEMORY"})


class JobTrace:
    """The spans of one job in its queue and in its worker, a `Watch`.

    Args:
        tracer: Makes the spans.
        task: The name of the task, ``"module:function"``.
    """

    def __init__(self, tracer: Tracer, task: str) -> None:
        self._tracer = tracer
        self._task = task
        self._parent = get_current()
        self._stage_name = ""
        self._stage: Span | None = None
        self._inner = self._parent
        self._span = self._start("queue", self._parent)

    def waits(self) -> None:
        """End the span of a worker that was lost, and begin that of another wait."""
        self._end("lost")
        self._span = self._start("queue", self._parent)

    def begins(self) -> None:
        """End the span of the wait, and begin that of the worker."""
        self._span.end()
        self._span = self._start("worker", self._parent)
        self._inner = set_span_in_context(self._span, self._parent)

    def reaches(self, stage: str) -> None:
        """Begin the span of a stage, unless it is the one that goes on."""
        if stage == self._stage_name:
            return
        if self._stage is not None:
            self._stage.end()
        name = stage if _WORD.fullmatch(stage) else "stage"
        self._stage_name = stage
        self._stage = self._tracer.start_span(
            name, self._inner, attributes={"armwright.stage": stage}
        )

    def ends(self, outcome: str) -> None:
        """End all spans."""
        self._end(outcome)

    def _start(self, name: str, parent: Context) -> Span:
        return self._tracer.start_span(name, parent, attributes={"armwright.task": self._task})

    def _end(self, outcome: str) -> None:
        if self._stage is not None:
            self._stage.end()
        self._stage, self._stage_name = None, ""
        self._span.set_attribute("armwright.outcome", outcome)
        if outcome in _OWN_FAULTS:
            self._span.set_status(Status(StatusCode.ERROR, outcome))
        self._span.end()

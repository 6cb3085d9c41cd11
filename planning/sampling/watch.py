"""Stopping rules of a planner, and its progress until then."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from planning.result import Progress
from planning.values.deadline import Deadline

#: Memory that a planner may fill before it is stopped [bytes].
MAX_MEMORY = 1 << 30
#: Where Linux says how many pages a process has.
_STATM = Path("/proc/self/statm")


def resident() -> int:
    """Memory of this process [bytes]; 0 where that can't be told."""
    try:
        # Size of a page of memory [bytes].
        return 4096 * int(_STATM.read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return 0


@dataclass(slots=True)
class Watch:
    """Asked by a planner, again and again, whether to stop.

    Args:
        deadline: Instant at which time is up.
        edges: Number of edges that were checked so far.
        max_iterations: Questions after which to stop.
        max_edges: Edges after which to stop.
        share: Edges after which another run is to be begun, if there is no path yet.
        turn: Questions after which that is so too.
        threshold: Length of a path that is short enough.
        best: Length of the shortest path so far, of a planner that improves its own.
    """

    deadline: Deadline
    edges: Callable[[], int]
    max_iterations: int | None = None
    max_edges: int | None = None
    share: float = math.inf
    turn: float = math.inf
    threshold: float | None = None
    best: Callable[[], float] | None = None
    iterations: int = 0
    reason: str | None = None
    progress: list[Progress] = field(default_factory=list)
    began: float = field(default_factory=time.monotonic)
    memory: int = field(default_factory=resident)

    def __call__(self) -> bool:
        """Whether to stop; why is kept as ``reason``."""
        if self.reason is not None:
            return True
        self.iterations += 1
        if self.best is not None:
            self.note(self.best())
        if self.reason is None:
            self.reason = self._over_budget()
        return self.reason is not None

    def note(self, length: float) -> None:
        """Keep the length of a path, if it is the shortest so far."""
        if not (math.isfinite(length) and length > 0.0):
            return
        # Share of its length by which a path has to be shorter to count as progress.
        if self.progress and length >= (1.0 - 1e-6) * self.progress[-1].length:
            return
        spent = 1e3 * (time.monotonic() - self.began)
        self.progress.append(Progress(spent, self.edges(), length))
        if self.threshold is not None and length <= self.threshold:
            self.reason = "threshold"

    def _over_budget(self) -> str | None:
        if self.deadline.passed:
            return "time"
        if self.max_iterations is not None and self.iterations >= self.max_iterations:
            return "iterations"
        if self.max_edges is not None and self.edges() >= self.max_edges:
            return "edges"
        if not self.progress and (self.edges() >= self.share or self.iterations >= self.turn):
            return "share"
        # Questions between two looks at the memory: one costs as much as a few edges.
        full = self.iterations % 512 == 0 and resident() - self.memory > MAX_MEMORY
        if full:
            self.deadline.interruptions.occurred = True
            return "memory"
        return None

"""One monotonic deadline that every stage of a plan is held to."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class Interruptions:
    """Record of the work that time, or memory, ended early.

    Args:
        occurred: Whether any was. What came of the work then depends on the speed of the machine.
    """

    occurred: bool = False

    def reported_in(self, code: str, details: Mapping[str, Any]) -> dict[str, Any]:
        """Details of a failure, with ``deterministic: False`` where any occurred.

        Args:
            code: Code of the failure. TIMED_OUT says as much by itself.
            details: Details of the failure.
        """
        told = {} if code == "TIMED_OUT" or not self.occurred else {"deterministic": False}
        return {**details, **told}


@dataclass(frozen=True, slots=True)
class Deadline:
    """A moment on the monotonic clock.

    Args:
        at: ``time.monotonic()`` when time is up [s].
        interruptions: Set as soon as anybody learns that time is up; shared with earlier deadlines.
    """

    at: float
    interruptions: Interruptions = field(default_factory=Interruptions, compare=False, repr=False)

    @classmethod
    def after(cls, seconds: float) -> "Deadline":
        """The deadline that many seconds from now."""
        return cls(time.monotonic() + seconds)

    def within(self, seconds: float) -> "Deadline":
        """The deadline that many seconds from now, for a part of this one's work."""
        return Deadline(time.monotonic() + seconds, self.interruptions)

    def at_most(self, seconds: float) -> "Deadline":
        """Deadline of this, or the one that many seconds from now if that is sooner."""
        return Deadline(min(self.at, time.monotonic() + seconds), self.interruptions)

    @property
    def remaining(self) -> float:
        """Remaining time [s], 0 when time is up."""
        return max(self.at - time.monotonic(), 0.0)

    @property
    def passed(self) -> bool:
        """Whether time is up."""
        if time.monotonic() < self.at:
            return False
        self.interruptions.occurred = True
        return True

    def sooner_than(self, seconds: float) -> bool:
        """Whether at most that much time remains [s]."""
        return Deadline(self.at - seconds, self.interruptions).passed

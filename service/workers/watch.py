"""Watches: followers of jobs from the queue to the end."""

from collections.abc import Callable
from typing import Protocol


class Watch(Protocol):
    """A follower of one job. It is called on the event loop, and must be quick."""

    def waits(self) -> None:
        """The job waits for a worker again: the one that had it died or was taken away."""

    def begins(self) -> None:
        """A worker has received the job."""

    def reaches(self, stage: str) -> None:
        """The task has reported progress in a stage."""

    def ends(self, outcome: str) -> None:
        """The job has ended.

        Args:
            outcome: "finished", "cancelled", or the code of the problem.
        """


#: Makes the watch of a job that begins to wait, of the name of its task; None if nobody looks.
Watcher = Callable[[str], Watch | None]

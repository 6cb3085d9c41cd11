"""Reports of the stages of planning, written down as they end."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from planning.result import StageReport

_T = TypeVar("_T")


@dataclass(slots=True)
class Stages:
    """What each stage did, in order.

    Args:
        observer: Told the name of each stage as it begins.
        reports: Of those that have ended.
    """

    observer: Callable[[str], None] | None = None
    reports: list[StageReport] = field(default_factory=list)

    def run(self, name: str, stage: Callable[[], _T], tell: Callable[[_T], tuple[bool, str]]) -> _T:
        """Run a stage, time it, and note what ``tell`` makes of its answer."""
        if self.observer is not None:
            self.observer(name)
        began, computed = time.perf_counter(), time.process_time()
        answer = stage()
        succeeded, detail = tell(answer)
        milliseconds = 1e3 * (time.perf_counter() - began)
        computed = 1e3 * (time.process_time() - computed)
        outcome = "succeeded" if succeeded else "failed"
        self.reports.append(StageReport(name, outcome, milliseconds, detail, computed))
        return answer

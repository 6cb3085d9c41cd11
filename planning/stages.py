"""Reports of the stages of planning, written down as they end."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from planning.result import StageReport

_T = TypeVar("_T")


@dataclass(slots=True)
class Stages:
    """Reports of the stages, in order.

    Args:
        observer: Called with the name of each stage as it begins.
        reports: Reports of the stages that have ended.
    """

    observer: Callable[[str], None] | None = None
    reports: list[StageReport] = field(default_factory=list)

    def run(
        self, name: str, stage: Callable[[], _T], describe: Callable[[_T], tuple[bool, str]]
    ) -> _T:
        """Run a stage and time it; ``describe`` says if it succeeded, and how, for the report."""
        if self.observer is not None:
            self.observer(name)
        began, computed = time.perf_counter(), time.process_time()
        answer = stage()
        succeeded, detail = describe(answer)
        milliseconds = 1e3 * (time.perf_counter() - began)
        computed = 1e3 * (time.process_time() - computed)
        outcome = "succeeded" if succeeded else "failed"
        self.reports.append(StageReport(name, outcome, milliseconds, detail, computed))
        return answer

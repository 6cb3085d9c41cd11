"""The job that this process is working on, as its task sees it; a worker has one at a time."""

import math
import time
from collections.abc import Callable
from typing import Any

from kinematics.caches.preparation_limit import limit_preparation
from planning.values.deadline import Deadline
from service.workers.task import NEVER

#: Progress within a stage is reported at most this often [s].
_REPORT_PERIOD = 0.05
#: Receives progress, from 0 to 1, and the stage.
Report = Callable[[float, str], None]
#: Results are kept at the server at most this often [s]: to write one takes a part of that.
_OFFER_PERIOD = 0.25
#: Receives the result of the job as it would be by now.
Offer = Callable[[Any], None]


class _Current:
    deadline: Deadline = NEVER
    report: Report | None = None
    stage: str | None = None
    last_report: float = 0.0
    silent_until: float = 0.0
    parts_done: int = 0
    offer: Offer | None = None
    last_offer: float = -math.inf


def deadline() -> Deadline:
    """Deadline of the current job; never outside a job."""
    return _Current.deadline


def is_followed() -> bool:
    """Whether anybody follows the progress of the current job."""
    return _Current.report is not None


def report(progress: float, stage: str) -> None:
    """Tell the server how far the current job is.

    Args:
        progress: Progress from 0 to 1.
        stage: Stage of the work, in a word.
    """
    if _Current.report is None:
        return
    now = time.monotonic()
    if now < _Current.silent_until:
        return
    if stage != _Current.stage or now - _Current.last_report >= _REPORT_PERIOD:
        _Current.stage, _Current.last_report = stage, now
        _Current.report(_Current.parts_done + float(progress), stage)


def offer(make: Callable[[], Any]) -> None:
    """Keep a result of the current job at the server, which answers it where nothing better comes.

    Args:
        make: Makes the result, a proved one.
    """
    now = time.monotonic()
    if _Current.offer is not None and now - _Current.last_offer >= _OFFER_PERIOD:
        _Current.offer(make())
        _Current.last_offer = time.monotonic()


def begin(
    deadline: Deadline, report: Report | None, silence: float = 0.0, offer: Offer | None = None
) -> None:
    """Make a job the current one.

    Args:
        deadline: Deadline of the job.
        report: Receives its progress; None where nobody listens.
        silence: Time from now on in which nothing is reported [s].
        offer: Receives results that are the best so far; None where nobody keeps them.
    """
    _Current.report, _Current.offer, _Current.last_offer = report, offer, -math.inf
    begin_part(0, deadline)
    _Current.silent_until = time.monotonic() + silence if silence > 0.0 else 0.0


def begin_part(number: int, deadline: Deadline) -> None:
    """Go on to a part of the current job; its progress is reported beyond that of those before it.

    Args:
        number: Counts the parts that are done: the progress from then on is above it.
        deadline: Deadline of this part.
    """
    _Current.deadline, _Current.parts_done, _Current.stage = deadline, number, None
    limit_preparation(deadline.at)


def end() -> None:
    """Note that the current job is done."""
    begin(NEVER, None)

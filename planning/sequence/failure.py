"""The failure of a search: the stage that cuts all combinations off, and why."""

from planning.sequence.motion import LineStopped
from planning.sequence.record import Blame, Record, hint_of
from planning.sequence.result import SequenceFailure, StagePlan
from planning.sequence.stage import describe_stage
from planning.sequence.task import Task
from planning.values.deadline import Deadline


def search_failure(
    task: Task, record: Record, timeout: float, deadline: Deadline, *, late: bool,
    prefix: tuple[StagePlan, ...],
) -> SequenceFailure:  # fmt: skip
    """Why a search found no motions of all stages.

    Args:
        task: The stages.
        record: What was tried.
        timeout: Of everything [s].
        deadline: The end of everything.
        late: Whether time was up.
        prefix: Proved stages of the combination that came farthest.
    """
    k, reason, times, known = record.blame() or Blame(0, "time was up", 1, {})
    what = describe_stage(task.stages, k)
    hint = hint_of(task.stages[k], reason)
    details = {"index": k, "reason": reason, "count": times, **known}
    if late:
        code = "TIMED_OUT"
        message = (
            f"no proved answer within the timeout of {timeout:.3g} s; the search "
            f"came to {what}: {reason} ({times} times)"
        )
        hint = f"Allow more time. {hint}"
    else:
        code = "PLANNING_FAILED"
        message = f"no combination can be done: {what} fails: {reason} ({times} times)"
    details = deadline.interruptions.reported_in(code, details)
    return SequenceFailure(code, message, hint, k, details, record.trials, prefix)


def describe_stop(led: LineStopped) -> str:
    """Why a straight motion is too short, in words."""
    return f"the tool comes {led.distance:.3g} m straight: {led.stop.message}"

"""What callers are told when a job has no result."""

import signal

import pytest

from service.http.errors import document, headers_of, status_of
from service.problem import ProblemError
from service.workers.faults import (
    DeadlineExceeded,
    JobsFull,
    QueueFull,
    ShuttingDown,
    WorkerCrashed,
)


@pytest.mark.parametrize(
    ("exit_code", "cause"),
    [(-signal.SIGSEGV, "SIGSEGV"), (-signal.SIGKILL, "SIGKILL"), (1, "it ended"),
     (None, "it ended"), (-999, "it ended")],
)  # fmt: skip
def test_a_crash_names_the_signal(exit_code: int | None, cause: str) -> None:
    problem = WorkerCrashed("service.endpoints.plan.task:plan", exit_code)
    assert problem.detail.endswith(cause) or cause in problem.detail
    assert status_of(problem) == 500
    assert problem.details == {"task": "service.endpoints.plan.task:plan"}


@pytest.mark.parametrize(
    ("problem", "code", "status", "retry_after"),
    [
        (DeadlineExceeded("t", "waiting for a worker"), "TIMED_OUT", 504, None),
        (DeadlineExceeded("t", "being computed", ["it ended"]), "TIMED_OUT", 504, None),
        (QueueFull(3, 7), "OVERLOADED", 429, "7"),
        (ShuttingDown(), "OVERLOADED", 503, "1"),
        (JobsFull(100, 4), "OVERLOADED", 429, "25"),
        (JobsFull(1, 4), "OVERLOADED", 429, "1"),
        (JobsFull(10_000, 1), "OVERLOADED", 429, "60"),
    ],
)
def test_codes_statuses_and_when_to_ask_again(
    problem: ProblemError, code: str, status: int, retry_after: str | None
) -> None:
    told = document(problem, "/v1/plan")
    assert (told["code"], told["status"]) == (code, status)
    assert headers_of(problem).get("Retry-After") == retry_after
    assert told["hint"]

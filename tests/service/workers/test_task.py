"""Tasks, the queue of those who wait, and what callers are told without a result."""

import pickle
import random
import signal
import time
from dataclasses import dataclass, replace
from typing import Any

import pytest

from planning.values.deadline import Deadline
from service.endpoints.plan.task import plan, validate
from service.http.errors import document, headers_of, status_of
from service.storage.caches.cache_key import Reference, builtin_reference
from service.validation import ProblemError
from service.workers.load import FairQueue
from service.workers.process import Ticket
from service.workers.result import PlanOutcome
from service.workers.state import (
    DeadlineExceeded,
    JobsFull,
    QueueFull,
    ShuttingDown,
    WorkerCrashed,
)
from service.workers.task import (
    GRACE,
    NEVER,
    Job,
    pack_job,
    registered_task,
    task,
    unpack_job,
)
from tests.service import chores


def test_a_task_is_its_function_and_makes_jobs() -> None:
    assert chores.add(1, b=2) == 3
    job = chores.add.job(1, b=2)
    assert (job.task, job.args, job.kwargs) == ("tests.service.chores:add", (1,), {"b": 2})
    assert job.deadline.remaining == float("inf")
    assert pickle.loads(pickle.dumps(job)) == job
    assert unpack_job(pack_job(job)) == job


def test_what_jobs_carry_arrives_as_it_was_sent() -> None:
    reference = Reference("scene", "table", "0a1b", "/data/prepared")
    built_in = builtin_reference("panda", "/data/prepared")
    outcome = PlanOutcome(b"{}", "straight_line", (("preflight", 0.1),))
    for value in (reference, built_in, outcome):
        assert pickle.loads(pickle.dumps(value)) == value
    job = plan.job(built_in, reference, b"{}").with_deadline(Deadline.after(3.0))
    sent = unpack_job(pack_job(job))
    assert (sent.task, sent.args) == (job.task, job.args)


def test_a_deadline_is_a_field_of_the_job() -> None:
    before = time.monotonic()
    job = chores.add.job(1, 2).with_deadline(Deadline.after(3.0))
    assert before + 3.0 <= job.deadline.at <= time.monotonic() + 3.0
    assert job.args == (1, 2)


def test_another_deadline_leaves_all_other_fields_alone() -> None:
    @dataclass(frozen=True, slots=True)
    class Longer(Job[object]):
        origin: str = "unknown"

    before = Longer("a:b", (1,), {"c": 2}, NEVER, 0.5, "an address")
    after = before.with_deadline(Deadline(7.0))
    assert after == replace(before, deadline=Deadline(7.0))
    assert (after.deadline.at, after.grace) == (7.0, 0.5)


def test_tasks_that_mind_their_deadline_have_a_grace() -> None:
    assert plan.grace == validate.grace == GRACE
    assert plan.job(None, None, b"").grace == GRACE  # type: ignore[arg-type]
    assert chores.add.grace == 0.0


def test_two_tasks_of_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="already is a task"):
        task(chores.add.function)
    assert registered_task("tests.service.chores:add") is chores.add


def ticket(client: str, name: str = "t") -> Ticket:
    job: Job[None] = Job(name)
    nobody: Any = None
    return Ticket(job, job.deadline, b"", nobody, None, client=client)


def order(queue: FairQueue) -> list[str]:
    return [queue.popleft().job.task for _ in range(queue.count)]


def filled(*names: str) -> FairQueue:
    queue = FairQueue()
    for name in names:
        queue.append(ticket(name[0], name))
    return queue


def test_clients_take_turns_each_in_its_own_order() -> None:
    assert order(filled("a1", "a2", "a3", "b1", "c1", "c2")) == ["a1", "b1", "c1", "a2", "c2", "a3"]
    assert order(filled("a1", "a2")) == ["a1", "a2"]
    assert order(filled()) == []


def test_what_is_put_back_comes_first() -> None:
    queue = filled("a1", "b1", "b2")
    first = queue.popleft()
    queue.appendleft(first)
    assert order(queue) == ["a1", "b1", "b2"]
    queue = filled("a1", "b1")
    queue.appendleft(ticket("c", "c1"))
    assert order(queue) == ["c1", "a1", "b1"]


def test_what_is_taken_out_is_gone() -> None:
    queue = filled("a1", "b1")
    gone = next(iter(queue))
    assert gone in queue
    queue.remove(gone)
    assert gone not in queue
    assert order(queue) == ["b1"]
    with pytest.raises(KeyError):
        queue.remove(gone)
    with pytest.raises(KeyError):
        queue.popleft()


def test_what_is_ahead_of_a_new_ticket_is_what_comes_before_it() -> None:
    source = random.Random(7)
    for _ in range(200):
        names = [f"{source.choice('abc')}{i}" for i in range(source.randrange(12))]
        queue, client = filled(*names), source.choice("abcd")
        for _ in range(source.randrange(queue.count + 1)):
            queue.popleft()
        ahead = {t.job.task for t in queue.ahead(client)}
        queue.append(ticket(client, "new"))
        names = order(queue)
        before = set(names[: names.index("new")])
        assert before <= ahead, "never told too little"
        assert len(ahead - before) <= 3, "of each other client one at most"


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

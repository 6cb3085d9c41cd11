"""Tasks are registered functions, and jobs are calls of them."""

import pickle
import time
from dataclasses import dataclass, replace

import pytest

from planning.values.deadline import Deadline
from service.endpoints.plan.task import plan, validate
from service.storage.caches.cache_key import Reference, builtin_reference
from service.workers.result import PlanOutcome
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

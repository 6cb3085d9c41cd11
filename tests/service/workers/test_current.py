"""The job that a process works on, as its task sees it: deadline and progress."""

from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from kinematics.caches import preparation_limit
from kinematics.caches.preparation_limit import PreparationTimedOut, check_preparation_time
from planning.values import deadline
from planning.values.deadline import Deadline
from service.workers import current
from service.workers.task import NEVER


class Clock:
    """A clock that stands still until it is set."""

    now = 100.0


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[Clock]:
    made = Clock()
    # Of these modules only: servers of other tests may run in threads of this process.
    for module in (current, deadline, preparation_limit):
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: made.now))
    yield made
    current.end()


def test_outside_a_job_there_is_no_deadline_and_nobody_listens() -> None:
    assert current.deadline() is NEVER
    current.report(0.5, "search")
    assert not current.deadline().passed


def test_a_task_sees_the_deadline_of_its_job_until_that_has_ended() -> None:
    soon = Deadline(123.0)
    current.begin(soon, None)
    assert current.deadline() is soon
    current.end()
    assert current.deadline() is NEVER


def test_progress_is_told_at_most_twenty_times_a_second(clock: Clock) -> None:
    told: list[tuple[float, str]] = []
    current.begin(NEVER, lambda progress, stage: told.append((progress, stage)))
    for step in range(100):
        clock.now = 200.0 + 0.01 * step
        current.report(step / 100, "search")
    assert 18 <= len(told) <= 21
    assert told[0] == (0.0, "search")


def test_a_new_stage_is_told_at_once(clock: Clock) -> None:
    told: list[tuple[float, str]] = []
    current.begin(NEVER, lambda progress, stage: told.append((progress, stage)))
    for stage in ("a", "a", "b", "b", "a"):
        current.report(1, stage)
    assert told == [(1.0, "a"), (1.0, "b"), (1.0, "a")]
    assert all(type(progress) is float for progress, _ in told)


def test_a_job_that_is_soon_over_reports_nothing_where_it_is_told_so(clock: Clock) -> None:
    told: list[str] = []
    current.begin(NEVER, lambda _, stage: told.append(stage), 0.05)
    for step, stage in enumerate("abcdef"):
        clock.now = 100.0 + 0.011 * step
        current.report(0.1, stage)
    assert told == ["f"]
    current.begin(NEVER, lambda _, stage: told.append(stage))
    current.report(0.1, "g")
    assert told == ["f", "g"]


def test_the_stage_of_another_job_is_forgotten(clock: Clock) -> None:
    first: list[str] = []
    second: list[str] = []
    current.begin(NEVER, lambda _, stage: first.append(stage))
    current.report(0.1, "search")
    current.end()
    current.report(0.2, "search")
    current.begin(NEVER, lambda _, stage: second.append(stage))
    current.report(0.3, "search")
    assert (first, second) == (["search"], ["search"])


def test_meshes_are_prepared_until_the_deadline_of_the_job(clock: Clock) -> None:
    check_preparation_time()
    current.begin(Deadline(123.0), None)
    check_preparation_time()
    clock.now = 123.0
    with pytest.raises(PreparationTimedOut):
        check_preparation_time()
    current.end()
    check_preparation_time()

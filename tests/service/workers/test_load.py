"""Durations of tasks, sizes of chunks, the share of background jobs, and requests on their way."""

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.workers.chunk_sizes import LONGEST, SHORTEST, Pace, chunk_sizes
from service.workers.load import BACKGROUND_SHARE, BackgroundShare, Durations, InFlight
from service.workers.supervisor import WorkerSupervisor
from tests.service.workers.pools import chore, working

pytestmark = pytest.mark.anyio


def test_the_mean_follows_what_is_measured() -> None:
    durations = Durations()
    first = durations.mean("plan")
    assert 0.0 < first < 1.0
    durations.note("plan", 3.0)
    assert durations.mean("plan") == 3.0, "the first measurement replaces the guess"
    assert durations.mean("ik") == first
    for _ in range(100):
        durations.note("plan", 1.0)
    assert durations.mean("plan") == pytest.approx(1.0, abs=0.01)


def test_the_spread_follows_what_is_measured() -> None:
    durations = Durations()
    assert durations.spread("plan") == 0.0
    for _ in range(20):
        durations.note("plan", 0.3)
    assert durations.spread("plan") < 1e-15
    for number in range(400):
        durations.note("plan", 0.2 if number % 2 else 0.4)
    assert abs(durations.spread("plan") - 0.1) < 0.01


def test_large_requests_say_little_of_small_ones() -> None:
    durations = Durations()
    for _ in range(50):
        durations.note("task", 8.0, 300_000)
    assert durations.mean("task") == durations.mean("task", 270_000) == 8.0
    # A size that never ran: in proportion to the nearest one that did, and never more than that.
    assert durations.mean("task", 3_000) < 0.2
    assert durations.mean("task", 3_000_000) == 8.0
    durations.note("task", 0.4, 3_000)
    assert durations.mean("task", 2_500) == 0.4
    assert durations.mean("task", 300_000) == 8.0
    assert durations.spread("task", 3_000) == 0.0
    assert 0.4 < durations.mean("task") < 8.0


def test_background_jobs_get_their_share() -> None:
    """Workers that are never idle: what is due is given, and the times add up to the share."""
    share, times = BackgroundShare(), {True: 0.0, False: 0.0}
    for _ in range(5000):
        background = share.is_due
        seconds = 2.0 if background else 0.05
        share.note(seconds, background=background)
        times[background] += seconds
    assert times[True] / sum(times.values()) == pytest.approx(BACKGROUND_SHARE, abs=0.01)


def test_what_is_owed_is_bounded() -> None:
    share = BackgroundShare()
    share.note(1e6, background=True)
    for _ in range(290):
        share.note(1.0, background=False)
        assert not share.is_due
    share.note(20.0, background=False)
    assert share.is_due


@given(
    count=st.integers(1, 3000),
    mean=st.floats(1e-4, 100.0),
    workers=st.integers(1, 16),
    agents=st.integers(1, 20),
)
def test_chunks_hold_all_problems_and_take_neither_too_long_nor_too_short(
    count: int, mean: float, workers: int, agents: int
) -> None:
    pace = Pace(mean, workers, workers * agents)
    sizes = chunk_sizes(count, pace)
    assert sum(sizes) == count
    assert min(sizes) >= 1
    assert sizes == sorted(sizes, reverse=True), "the last ones are the smallest"
    seconds = [size * mean / workers for size in sizes]
    # One problem for each worker may take longer than any chunk should.
    assert max(seconds) <= max(LONGEST + mean / workers, mean) * (1.0 + 1e-9)
    for size, duration in zip(sizes[:-1], seconds[:-1], strict=True):
        assert duration >= SHORTEST * (1.0 - 1e-9)
        assert size >= workers, "no worker is left without a problem"


def test_a_batch_of_half_a_second_stays_whole() -> None:
    assert chunk_sizes(40, Pace(0.01, 1, 2)) == [40]


def test_two_agents_get_equal_shares_of_a_batch() -> None:
    sizes = chunk_sizes(1000, Pace(0.01, 1, 2))
    loads = [0, 0]
    for size in sizes:  # each takes the next chunk when it is free
        loads[loads.index(min(loads))] += size
    assert max(loads) == pytest.approx(500, abs=50)
    assert max(sizes) == 250


def test_chunks_of_unknown_workers_are_those_of_one_agent() -> None:
    assert chunk_sizes(100, Pace(1.0, 2, 0)) == chunk_sizes(100, Pace(1.0, 2, 2))


def test_requests_count_from_their_admission_to_their_answer() -> None:
    in_flight = InFlight()
    for _ in range(5):
        in_flight.enter("a")
    assert (in_flight.count, in_flight.ahead("a", 0), in_flight.ahead("a", 3)) == (5, 5, 2)
    for _ in range(5):
        in_flight.leave("a")
    assert (in_flight.count, in_flight.ahead("a", 0)) == (0, 0)


def test_a_client_with_many_delays_others_by_one() -> None:
    in_flight = InFlight()
    for _ in range(50):
        in_flight.enter("many")
    assert in_flight.ahead("few", 0) == 1
    assert in_flight.ahead("many", 0) == 50


@given(st.lists(st.tuples(st.sampled_from("abc"), st.booleans()), max_size=30))
def test_never_more_come_first_than_there_are(events: list[tuple[str, bool]]) -> None:
    in_flight = InFlight()
    clients: list[str] = []
    for client, ends in events:
        if ends and clients:
            in_flight.leave(clients.pop(0))
        else:
            in_flight.enter(client)
            clients.append(client)
    assert in_flight.count == len(clients)
    for client in "abc":
        assert 0 <= in_flight.ahead(client, 0) <= in_flight.count
        assert in_flight.ahead(client, in_flight.count) == 0


async def test_what_is_still_parsed_counts_against_those_that_arrive(
    workers: WorkerSupervisor,
) -> None:
    await workers.submit(chore("nap", 0.2))
    task = chore("nap", 0.2).task
    assert workers.early_refusal(task, 0.3) is None, "a worker is free"
    for _ in range(4):
        workers.in_flight.enter("")
    refused = workers.early_refusal(task, 0.3)
    assert refused is not None
    assert workers.early_refusal(task, 5.0) is None, "that one has the time"
    assert workers.early_refusal(task, 0.3, "other") is not None, "one goes first"
    # Who has reached the queue is counted there, not twice.
    jobs = [asyncio.ensure_future(workers.submit(chore("nap", 0.2))) for _ in range(4)]
    await working(workers, 1)
    assert workers.in_flight.ahead("", workers.busy + workers.waiting) == 0
    await asyncio.gather(*jobs)


async def test_an_early_refusal_is_judged_anew_when_somebody_comes_or_goes(
    workers: WorkerSupervisor,
) -> None:
    await workers.submit(chore("nap", 0.3))
    task = chore("nap", 0.3).task
    for _ in range(4):
        workers.in_flight.enter("")
    rejected = workers.counters.rejected
    refused = workers.early_refusal(task, 0.5)
    assert refused is not None
    assert workers.early_refusal(task, 0.5) is not None, "nothing has changed"
    assert workers.counters.rejected == rejected + 2, "each one counts"
    for _ in range(4):
        workers.in_flight.leave("")
    assert workers.early_refusal(task, 0.5) is None, "a worker is free at once"
    job = asyncio.ensure_future(workers.submit(chore("nap", 0.3)))
    await working(workers, 1)
    assert workers.early_refusal(task, 0.35) is not None, "it has work again"
    await job
    assert workers.early_refusal(task, 0.35) is None, "and has ended it"

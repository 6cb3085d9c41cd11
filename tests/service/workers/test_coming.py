"""Requests on their way to the queue: counted once, by client, until they are answered."""

import asyncio

from hypothesis import given
from hypothesis import strategies as st

from service.workers.coming import ComingRequests
from tests.service.workers.pools import chore, ready, supervisor, working


def test_requests_count_from_their_admission_to_their_answer() -> None:
    coming = ComingRequests()
    for carrier in range(5):
        coming.note(carrier, "plan", "a")
    assert (len(coming), coming.ahead("a", 0), coming.ahead("a", 3)) == (5, 5, 2)
    coming.note(0, "ik", "a")
    assert len(coming) == 5, "a carrier has one request at a time"
    for carrier in range(7):
        coming.forget(carrier)
    assert (len(coming), coming.ahead("a", 0)) == (0, 0)


def test_a_client_with_many_delays_others_by_one() -> None:
    coming = ComingRequests()
    for carrier in range(50):
        coming.note(carrier, "plan", "many")
    assert coming.ahead("few", 0) == 1
    assert coming.ahead("many", 0) == 50


@given(st.lists(st.tuples(st.sampled_from("abc"), st.booleans()), max_size=30))
def test_never_more_come_first_than_there_are(events: list[tuple[str, bool]]) -> None:
    coming = ComingRequests()
    open_carriers: list[int] = []
    for number, (client, ends) in enumerate(events):
        if ends and open_carriers:
            coming.forget(open_carriers.pop(0))
        else:
            coming.note(number, "plan", client)
            open_carriers.append(number)
    assert len(coming) == len(open_carriers)
    for client in "abc":
        assert 0 <= coming.ahead(client, 0) <= len(coming)
        assert coming.ahead(client, len(coming)) == 0


def test_what_is_still_parsed_counts_against_those_that_arrive() -> None:
    async def run() -> None:
        async with supervisor(1) as workers:
            await ready(workers)
            await workers.submit(chore("nap", 0.2))
            task = chore("nap", 0.2).task
            assert workers.early_refusal(task, 0.3) is None, "a worker is free"
            for carrier in range(4):
                workers.coming.note(carrier, task, "")
            refused = workers.early_refusal(task, 0.3)
            assert refused is not None
            assert workers.early_refusal(task, 5.0) is None, "that one has the time"
            assert workers.early_refusal(task, 0.3, "other") is not None, "one goes first"
            # Who has reached the queue is counted there, not twice.
            jobs = [asyncio.ensure_future(workers.submit(chore("nap", 0.2))) for _ in range(4)]
            await working(workers, 1)
            assert workers.coming.ahead("", workers.busy + workers.waiting) == 0
            await asyncio.gather(*jobs)

    asyncio.run(run())


def test_an_early_refusal_is_judged_anew_when_somebody_comes_or_goes() -> None:
    async def run() -> None:
        async with supervisor(1) as workers:
            await ready(workers)
            await workers.submit(chore("nap", 0.3))
            task = chore("nap", 0.3).task
            for carrier in range(4):
                workers.coming.note(carrier, task, "")
            rejected = workers.counters.rejected
            refused = workers.early_refusal(task, 0.5)
            assert refused is not None
            assert workers.early_refusal(task, 0.5) is refused, "nothing has changed"
            assert workers.counters.rejected == rejected + 2, "each one counts"
            for carrier in range(4):
                workers.coming.forget(carrier)
            assert workers.early_refusal(task, 0.5) is None, "a worker is free at once"
            job = asyncio.ensure_future(workers.submit(chore("nap", 0.3)))
            await working(workers, 1)
            assert workers.early_refusal(task, 0.35) is not None, "it has work again"
            await job
            assert workers.early_refusal(task, 0.35) is None, "and has ended it"

    asyncio.run(run())

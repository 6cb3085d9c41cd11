"""Requests on their way to the queue: counted once, by client, until they are answered."""

import asyncio

from hypothesis import given
from hypothesis import strategies as st

from service.workers.load import InFlight
from tests.service.workers.pools import chore, ready, supervisor, working


def test_requests_count_from_their_admission_to_their_answer() -> None:
    in_flight = InFlight()
    for _ in range(5):
        in_flight.enter("a")
    assert (len(in_flight), in_flight.ahead("a", 0), in_flight.ahead("a", 3)) == (5, 5, 2)
    for _ in range(5):
        in_flight.leave("a")
    assert (len(in_flight), in_flight.ahead("a", 0)) == (0, 0)


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
    assert len(in_flight) == len(clients)
    for client in "abc":
        assert 0 <= in_flight.ahead(client, 0) <= len(in_flight)
        assert in_flight.ahead(client, len(in_flight)) == 0


def test_what_is_still_parsed_counts_against_those_that_arrive() -> None:
    async def run() -> None:
        async with supervisor(1) as workers:
            await ready(workers)
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

    asyncio.run(run())


def test_an_early_refusal_is_judged_anew_when_somebody_comes_or_goes() -> None:
    async def run() -> None:
        async with supervisor(1) as workers:
            await ready(workers)
            await workers.submit(chore("nap", 0.3))
            task = chore("nap", 0.3).task
            for _ in range(4):
                workers.in_flight.enter("")
            rejected = workers.counters.rejected
            refused = workers.early_refusal(task, 0.5)
            assert refused is not None
            assert workers.early_refusal(task, 0.5) is refused, "nothing has changed"
            assert workers.counters.rejected == rejected + 2, "each one counts"
            for _ in range(4):
                workers.in_flight.leave("")
            assert workers.early_refusal(task, 0.5) is None, "a worker is free at once"
            job = asyncio.ensure_future(workers.submit(chore("nap", 0.3)))
            await working(workers, 1)
            assert workers.early_refusal(task, 0.35) is not None, "it has work again"
            await job
            assert workers.early_refusal(task, 0.35) is None, "and has ended it"

    asyncio.run(run())

"""The queue of those who wait: clients take turns."""

import random
from typing import Any

import pytest

from service.workers.load import FairQueue
from service.workers.process import Ticket
from service.workers.task import Job


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

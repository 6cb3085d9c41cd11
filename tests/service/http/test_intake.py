"""Requests that arrive together are parsed one by one; refusals go out in bunches."""

import asyncio
from functools import partial
from itertools import pairwise

from service.http.intake import Intake
from service.http.refusals import Refusals


def test_one_request_is_taken_in_each_turn_and_others_have_theirs_between() -> None:
    async def run() -> list[str]:
        intake, seen = Intake(), list[str]()
        for number in range(3):
            intake.take(partial(seen.append, f"request {number}"))
        for number in range(4):
            seen.append(f"turn {number}")
            await asyncio.sleep(0)
        intake.take(partial(seen.append, "later"))
        return seen

    assert asyncio.run(run()) == [
        "request 0", "turn 0", "request 1", "turn 1", "request 2", "turn 2", "turn 3", "later",
    ]  # fmt: skip


def test_connections_that_are_made_go_first_but_not_for_ever() -> None:
    async def run(connections: int) -> list[int]:
        intake, seen, turn = Intake(), list[int](), 0
        for _ in range(4):
            intake.take(lambda: seen.append(turn))
        while len(seen) < 4:
            if turn < connections:
                intake.note_connection()
            await asyncio.sleep(0)
            turn += 1
        return seen

    assert asyncio.run(run(0)) == [0, 0, 1, 2]
    assert asyncio.run(run(3)) == [0, 3, 4, 5], "three turns for three connections"
    gaps = [b - a for a, b in pairwise(asyncio.run(run(10_000)))]
    assert max(gaps) < 12, "whoever goes on connecting keeps nobody from being answered"
    assert min(gaps[1:]) > 4


def test_a_request_that_fails_does_not_hold_up_the_next() -> None:
    async def run() -> list[int]:
        asyncio.get_running_loop().set_exception_handler(lambda *_: None)
        intake, seen = Intake(), list[int]()
        for number in range(3):
            intake.take(partial(lambda n: seen.append(6 // n), number + 1 if number != 1 else 0))
        for _ in range(5):
            await asyncio.sleep(0)
        return seen

    assert asyncio.run(run()) == [6, 2]


def test_refusals_go_out_in_order_after_a_pause_many_at_a_time() -> None:
    async def run() -> list[tuple[int, float]]:
        refusals, loop = Refusals(), asyncio.get_running_loop()
        began, seen = loop.time(), list[tuple[int, float]]()
        for number in range(10):
            refusals.add(lambda n=number: seen.append((n, loop.time() - began)))  # type: ignore[misc]
        await asyncio.sleep(0.02)
        refusals.add(lambda: seen.append((10, loop.time() - began)))
        while len(seen) < 11:
            await asyncio.sleep(0.005)
        return seen

    seen = asyncio.run(run())
    assert [number for number, _ in seen] == list(range(11))
    assert all(at >= 0.03 for _, at in seen)
    assert seen[9][1] - seen[0][1] < 0.02, "one after the other, in one turn"
    assert seen[10][1] >= 0.05, "what comes later waits as long"


def test_a_refusal_that_fails_does_not_keep_the_others() -> None:
    async def run() -> list[int]:
        asyncio.get_running_loop().set_exception_handler(lambda *_: None)
        refusals, seen = Refusals(), list[int]()
        refusals.add(lambda: seen.append(1 // 0))
        refusals.add(lambda: seen.append(1))
        async with asyncio.timeout(5.0):
            while not seen:
                await asyncio.sleep(0.005)
        return seen

    assert asyncio.run(run()) == [1]

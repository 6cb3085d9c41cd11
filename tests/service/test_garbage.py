"""Garbage of the server: what is loaded is left out, the rest collected when nobody waits."""

import asyncio
import gc
import weakref
from collections.abc import Iterator

import pytest

from service.garbage import collect_when_idle, leave_out_what_is_loaded


@pytest.fixture(autouse=True)
def as_it_was() -> Iterator[None]:
    """Leaves the process's own settings as they were; what is loaded is not looked at meanwhile."""
    thresholds = gc.get_threshold()
    gc.freeze()
    yield
    gc.enable()
    gc.set_threshold(*thresholds)
    gc.unfreeze()


class _Cycle:
    def __init__(self) -> None:
        self.itself = self


def _old_garbage() -> "weakref.ref[_Cycle]":
    """Garbage that only a collection of everything finds; the interpreter begins none itself."""
    gc.disable()
    cycle = _Cycle()
    gc.collect(0)
    gc.collect(1)
    return weakref.ref(cycle)


async def _collected(garbage: "weakref.ref[_Cycle]", *, busy: bool, longest: float) -> bool:
    """Whether garbage is gone after twenty looks."""
    looks = 0

    def has_work() -> bool:
        nonlocal looks
        looks += 1
        return busy

    chore = asyncio.create_task(collect_when_idle(has_work, 0.0, longest))
    while looks < 20 and garbage() is not None:
        await asyncio.sleep(0.0)
    chore.cancel()
    return garbage() is None


def test_what_is_loaded_is_left_out_and_nothing_old_is_looked_at_by_itself() -> None:
    loaded = [[number] for number in range(1000)]
    young, middle, _ = gc.get_threshold()
    before = gc.get_freeze_count()
    leave_out_what_is_loaded()
    assert gc.get_freeze_count() >= before + len(loaded)
    _, first, everything = (one["collections"] for one in gc.get_stats())
    waiting = [[number] for number in range(20 * young * middle)]
    _, then, still = (one["collections"] for one in gc.get_stats())
    assert len(waiting) == 20 * young * middle
    assert then >= first + 10
    assert still == everything


def test_everything_is_collected_when_nobody_waits() -> None:
    assert asyncio.run(_collected(_old_garbage(), busy=False, longest=1e9))


def test_nothing_is_collected_while_somebody_waits() -> None:
    assert not asyncio.run(_collected(_old_garbage(), busy=True, longest=1e9))


def test_under_load_that_never_ends_it_is_collected_all_the_same() -> None:
    assert asyncio.run(_collected(_old_garbage(), busy=True, longest=0.0))

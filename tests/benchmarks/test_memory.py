"""Growth of memory, on courses of which it is known."""

import numpy as np
import pytest

from benchmarks.server.soak import Lives, growth

#: Looks of twenty minutes, one a second [s].
TIMES = np.arange(1200.0)


def course(random: np.random.Generator, rate: float) -> np.ndarray:
    """A line [MiB/h], with noise that lasts for half a minute as caches and arenas make it."""
    noise = random.normal(size=len(TIMES) + 100)
    lasting = np.convolve(noise, np.exp(-np.arange(100) / 30.0), mode="full")[100:-99]
    return np.asarray(100.0 + rate * TIMES / 3600.0 + 0.2 * lasting)


@pytest.mark.parametrize("rate", [0.0, 20.0, -5.0])
def test_the_error_of_a_growth_is_what_it_says(rate: float) -> None:
    random = np.random.default_rng(0)
    found = [growth(list(TIMES), list(course(random, rate))) for _ in range(400)]
    off = np.array([(one.rate - rate) / one.error for one in found])
    # Student's t with eight degrees of freedom: 5 % lie beyond 2.31, 0.1 % beyond 5.04.
    assert 0.01 <= np.mean(np.abs(off) > 2.31) <= 0.11
    assert np.mean(np.abs(off) > 5.04) <= 0.01
    assert abs(np.mean([one.rate for one in found]) - rate) <= 0.5


def test_too_little_tells_nothing() -> None:
    assert not np.isfinite(growth(list(TIMES[:10]), [1.0] * 10).error)
    assert not np.isfinite(Lives().within(60.0).error)
    assert Lives().largest == 0.0
    assert str(growth([], [])) == "too little to tell its growth"
    assert str(growth(list(TIMES), list(100.0 + TIMES / 3600.0))) == "+1.0 +- 0.0 MiB/h"


def lives(leak: float, forked: float) -> Lives:
    """One worker that lives on, others that are killed every twenty seconds.

    Args:
        leak: What each takes more within its life [MiB/h].
        forked: What it is forked with takes more [MiB/h].
    """
    random = np.random.default_rng(1)
    found = Lives()
    born = {0: 0.0}
    for time in TIMES:
        if time % 20.0 == 0.0:
            born[len(born)] = time
        alive = {0: 0.0, len(born) - 1: born[len(born) - 1]}
        memory = {
            # Caches fill within seconds of a life.
            pid: 150.0 + forked * began / 3600.0 + 40.0 * (1.0 - np.exp(-(time - began) / 5.0))
            + leak * (time - began) / 3600.0 + random.normal(0.0, 0.5)
            for pid, began in alive.items()
        }  # fmt: skip
        found.look(time, memory | {-1: 0.0})
    return found


def test_workers_that_leak_nothing() -> None:
    found = lives(0.0, 0.0)
    within, over = found.within(100.0), found.over(100.0)
    assert within.samples == 1
    assert over.samples > 50
    assert abs(within.rate) <= 4.0 * within.error <= 4.0
    assert abs(over.rate) <= 4.0 * over.error <= 12.0
    assert 185.0 <= found.largest <= 195.0
    assert -1 not in found.looks


def test_a_leak_within_lives_is_seen_there() -> None:
    found = lives(30.0, 0.0)
    within = found.within(100.0)
    assert abs(within.rate - 30.0) <= 4.0 * within.error <= 4.0


def test_a_leak_of_what_workers_are_forked_from_is_seen_over_lives() -> None:
    found = lives(0.0, 60.0)
    over = found.over(100.0)
    assert over.rate > 4.0 * over.error
    assert abs(over.rate - 60.0) <= 12.0
    assert abs(found.within(100.0).rate) <= 4.0

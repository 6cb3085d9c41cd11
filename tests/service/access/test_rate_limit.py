"""Rates of requests: a bucket of tokens, checked against simulated time."""

import pytest

from service.access.rate_limit import WINDOW, RateLimiter


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.time = 1000.0

    def __call__(self) -> float:
        return self.time


def test_as_many_come_at_once_as_the_rate_and_then_one_a_share_of_the_window() -> None:
    clock = Clock()
    limiter = RateLimiter(clock)
    taken = [limiter.take("a", 3) for _ in range(4)]
    assert [allowance.granted for allowance in taken] == [True, True, True, False]
    assert [allowance.remaining for allowance in taken] == [2, 1, 0, 0]
    assert [allowance.reset for allowance in taken] == [20, 40, 60, 60]
    assert taken[3].retry_after == 20
    clock.time += 19.9
    assert not limiter.take("a", 3).granted
    clock.time += 0.2
    assert limiter.take("a", 3).granted
    assert not limiter.take("a", 3).granted


def test_keys_have_buckets_of_their_own() -> None:
    limiter = RateLimiter(Clock())
    assert limiter.take("a", 1).granted
    assert not limiter.take("a", 1).granted
    assert limiter.take("b", 1).granted


@pytest.mark.parametrize("rate", [1, 7, 60, 1000])
def test_in_the_long_run_the_rate_is_kept(rate: int) -> None:
    clock = Clock()
    limiter = RateLimiter(clock)
    granted = 0
    step = WINDOW / rate / 7.3
    for _ in range(int(5 * WINDOW / step)):
        granted += limiter.take("a", rate).granted
        clock.time += step
    assert abs(granted - 6 * rate) <= 1, "a full bucket, and five windows"


def test_retry_after_is_true() -> None:
    clock = Clock()
    limiter = RateLimiter(clock)
    while (allowance := limiter.take("a", 7)).granted:
        clock.time += 0.1
    clock.time += allowance.retry_after
    assert limiter.take("a", 7).granted


def test_full_buckets_are_forgotten() -> None:
    clock = Clock()
    limiter = RateLimiter(clock)
    for number in range(50):
        limiter.take(f"{number}", 10)
    clock.time += WINDOW + 1.0
    limiter.take("a", 10)
    assert set(limiter._buckets) == {"a"}

"""Rates of requests: a bucket of tokens for each key, filled once a minute over."""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

#: Time in which an empty bucket is full again [s].
WINDOW = 60.0


class Allowance(NamedTuple):
    """The rest of a rate, and whether a request is within it.

    Args:
        granted: Whether the request may be answered.
        limit: Requests a window.
        remaining: Requests that may come at once now.
        reset: Time until the bucket is full [s].
        retry_after: Time until the next request is granted [s]; 0 if it would be at once.
    """

    granted: bool
    limit: int
    remaining: int
    reset: int
    retry_after: int


class RateLimiter:
    """Buckets of keys; those that are full again are forgotten.

    Args:
        clock: Tells the time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        # Of each key: tokens, and when they were counted.
        self._buckets: dict[str, tuple[float, float]] = {}
        self._swept = clock()

    def take(self, key: str, rate: int) -> Allowance:
        """Take a token of a key's bucket.

        Args:
            key: API key whose requests are counted.
            rate: Requests a window, and the size of the bucket.
        """
        now = self._clock()
        self._sweep(now)
        tokens, counted = self._buckets.get(key, (float(rate), now))
        tokens = min(float(rate), tokens + (now - counted) * rate / WINDOW)
        granted = tokens >= 1.0
        if granted:
            tokens -= 1.0
        self._buckets[key] = tokens, now
        missing = max(0.0, 1.0 - tokens) * WINDOW / rate
        return Allowance(
            granted,
            rate,
            int(tokens),
            math.ceil((rate - tokens) * WINDOW / rate),
            0 if tokens >= 1.0 else math.ceil(missing),
        )

    def _sweep(self, now: float) -> None:
        if now - self._swept < WINDOW:
            return
        self._swept = now
        # Untouched for a window: full.
        self._buckets = {
            key: bucket for key, bucket in self._buckets.items() if now - bucket[1] < WINDOW
        }

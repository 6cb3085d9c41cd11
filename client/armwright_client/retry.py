"""Rules for sending a refused request again."""

from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime

import httpx

#: Statuses that say "not now" rather than "no".
_NOT_NOW = (429, 503)


@dataclass(frozen=True, slots=True)
class Retry:
    """Number of retries and the wait between them, where the service says when to ask again.

    Only answers 429 and 503 with a Retry-After header are asked for again, and only requests that
    do the same when they are done twice.

    Args:
        attempts: How often a request is sent at most; 1 never asks again.
        longest_wait: Longest single wait [s]; where the service asks for more, its refusal is
            raised at once.
    """

    attempts: int = 3
    longest_wait: float = 10.0

    def wait(self, attempt: int, response: httpx.Response) -> float | None:
        """Time to wait [s] after the given attempt, counted from 1; None to give up."""
        if response.status_code not in _NOT_NOW or attempt >= self.attempts:
            return None
        seconds = retry_after(response)
        return seconds if seconds is not None and seconds <= self.longest_wait else None


def retry_after(response: httpx.Response) -> float | None:
    """Seconds of the header Retry-After; None where it is missing or unreadable."""
    value = response.headers.get("retry-after", "").strip()
    if value.isascii() and value.isdigit():
        return float(value)
    try:
        moment = parsedate_to_datetime(value)
    except ValueError:
        return None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return max(0.0, (moment - datetime.now(UTC)).total_seconds())

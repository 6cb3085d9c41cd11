"""Limits of request bodies: sizes announced and not, and bodies that stop arriving."""

import asyncio
import selectors
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any
from unittest import mock

import pytest

from service.http.errors import status_of
from service.http.layer import request_checks
from service.http.layer.request_checks import ARRIVAL, BodyLimits, read_body
from service.http.request_headers import FIELDS, first_values
from service.validation import ProblemError

SIZE = 10


class Waiting(selectors.SelectSelector):
    """Waits for nothing, and counts how long it would have waited [s]."""

    waited = 0.0

    def select(self, timeout: float | None = None) -> Any:
        self.waited += timeout or 0.0
        return super().select(0.0)


class Clockless(asyncio.SelectorEventLoop):
    """A loop whose time passes only while it waits, however busy the machine is."""

    def __init__(self) -> None:
        self._waiting = Waiting()
        super().__init__(self._waiting)

    def time(self) -> float:
        return self._waiting.waited


def run(parts: Sequence[bytes | float], length: str | None = None) -> bytes:
    """The body that arrives in parts; numbers are pauses [s]."""
    pending = list(parts)

    async def receive() -> dict[str, Any]:
        while pending and isinstance(pending[0], float):
            await asyncio.sleep(pending.pop(0))  # type: ignore[arg-type]
        if not pending:
            return {"type": "http.disconnect"}
        body = pending.pop(0)
        return {"type": "http.request", "body": body, "more_body": bool(pending)}

    headers = [] if length is None else [(b"content-length", length.encode())]
    with asyncio.Runner(loop_factory=Clockless) as runner:
        clock = SimpleNamespace(monotonic=runner.get_loop().time)
        scope = {"type": "http", FIELDS: first_values({"headers": headers}), ARRIVAL: 0.0}
        with mock.patch.object(request_checks, "time", clock):
            return runner.run(read_body(scope, receive, BodyLimits(SIZE, 0.05, 0.15)))


def refusal(*parts: bytes | float, length: str | None = None) -> ProblemError:
    with pytest.raises(ProblemError) as refused:
        run(parts, length)
    assert refused.value.headers == {"Connection": "close"}
    return refused.value


def test_a_body_of_the_largest_size_passes() -> None:
    assert run([b"x" * SIZE], str(SIZE)) == b"x" * SIZE
    assert run([b"xxxx"] * 2 + [b"yy"]) == b"xxxxxxxxyy"
    assert run([b""]) == b""


def test_a_larger_body_is_refused_as_soon_as_that_is_known() -> None:
    for problem in (
        refusal(b"x" * (SIZE + 1)),
        refusal(b"x" * SIZE, b"x"),
        refusal(b"", b"x" * 99),
    ):
        assert (problem.code, status_of(problem)) == ("PAYLOAD_TOO_LARGE", 413)
        assert problem.details == {"max_body_size": SIZE}


@pytest.mark.parametrize("length", ["11", "9" * 5000, "00000000000000000000000000011"])
def test_a_body_that_is_announced_too_large_is_not_read(length: str) -> None:
    assert refusal(b"", length=length).code == "PAYLOAD_TOO_LARGE"


@pytest.mark.parametrize("length", ["", "-1", "ten", "1e3", "²"])
def test_an_announcement_that_is_no_number_decides_nothing(length: str) -> None:
    assert run([b"xx"], length) == b"xx", "a header of any bytes is read"


def test_a_body_that_stops_arriving_is_given_up() -> None:
    problem = refusal(b"xx", 10.0, b"xx")
    assert (problem.code, status_of(problem)) == ("REQUEST_TIMEOUT", 408)
    assert "0.05 s" in problem.detail


def test_silence_begins_anew_with_each_part() -> None:
    parts: list[bytes | float] = []
    for _ in range(4):
        parts += [0.02, b"x"]
    assert run(parts) == b"xxxx"


def test_a_body_that_takes_too_long_is_given_up() -> None:
    parts: list[bytes | float] = []
    for _ in range(10):
        parts += [0.03, b"x"]
    problem = refusal(*parts)
    assert (problem.code, status_of(problem)) == ("REQUEST_TIMEOUT", 408)
    assert "within 0.15 s" in problem.detail

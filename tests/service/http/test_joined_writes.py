"""Writes that go out together: what is sent, in which order and when."""

import asyncio
from typing import Any

import numpy as np
import pytest

from service.http.joined_writes import JoinedWrites


class Recorded(asyncio.Transport):
    """A transport that keeps what is written to it."""

    def __init__(self) -> None:
        super().__init__()
        self.writes: list[bytes] = []
        self.closed = False

    def write(self, data: Any) -> None:
        assert not self.closed
        self.writes.append(bytes(data))

    def close(self) -> None:
        self.closed = True

    def abort(self) -> None:
        self.closed = True


def test_head_and_body_go_out_in_one_piece() -> None:
    async def scenario() -> None:
        wire = Recorded()
        joined = JoinedWrites(wire)
        for part in (b"head", b"body", b""):
            joined.write(part)
        assert wire.writes == [b"headbody"]
        await asyncio.sleep(0)
        assert wire.writes == [b"headbody"]

    asyncio.run(scenario())


def test_a_short_write_alone_goes_out_a_turn_later_or_before_the_end() -> None:
    async def scenario() -> None:
        wire = Recorded()
        joined = JoinedWrites(wire)
        joined.write(b"event")
        await asyncio.sleep(0)
        assert wire.writes == [b"event"]
        joined.write(b"last")
        joined.close()
        assert wire.writes == [b"event", b"last"]
        assert wire.closed
        await asyncio.sleep(0)

    asyncio.run(scenario())


def test_nothing_is_sent_after_an_abortion() -> None:
    async def scenario() -> None:
        wire = Recorded()
        joined = JoinedWrites(wire)
        joined.write(b"head")
        joined.abort()
        await asyncio.sleep(0)
        assert wire.writes == []

    asyncio.run(scenario())


@pytest.mark.parametrize("seed", range(20))
def test_bytes_keep_their_order_whatever_their_sizes(seed: int) -> None:
    async def scenario() -> None:
        rng = np.random.default_rng(seed)
        wire = Recorded()
        joined = JoinedWrites(wire)
        sent = b""
        for size in rng.choice([0, 1, 2048, 2049, 300_000], 40):
            part = rng.bytes(int(size))
            sent += part
            joined.write(part)
            if rng.random() < 0.3:
                await asyncio.sleep(0)
        joined.close()
        assert b"".join(wire.writes) == sent

    asyncio.run(scenario())

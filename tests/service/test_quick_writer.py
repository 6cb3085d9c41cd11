"""Writes that are sent at once: before the turn ends, in order, and never to another's file."""

import asyncio
import os
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import cast

import pytest
import uvloop

from service.quick_writer import QuickWriter

LOOPS: list[Callable[[], asyncio.AbstractEventLoop]] = [
    asyncio.new_event_loop,
    uvloop.new_event_loop,
]


async def transport_of(ours: socket.socket) -> asyncio.WriteTransport:
    ours.setblocking(False)
    loop = asyncio.get_running_loop()
    made, _ = await loop.create_unix_connection(asyncio.Protocol, sock=ours)
    return cast(asyncio.WriteTransport, made)


@pytest.mark.parametrize("make_loop", LOOPS)
def test_what_is_written_is_there_before_the_turn_ends(
    make_loop: Callable[[], asyncio.AbstractEventLoop],
) -> None:
    async def scenario() -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            theirs.setblocking(False)
            transport = await transport_of(ours)
            QuickWriter(transport).write(b"at once")
            assert theirs.recv(100) == b"at once"
            transport.close()
            await asyncio.sleep(0)

    with asyncio.Runner(loop_factory=make_loop) as runner:
        runner.run(scenario())


@pytest.mark.parametrize("make_loop", LOOPS)
def test_all_arrives_in_order(make_loop: Callable[[], asyncio.AbstractEventLoop]) -> None:
    parts = [bytes([number]) * size for number, size in enumerate((3, 2_000_000, 5, 300_000, 1))]

    async def scenario() -> bytes:
        ours, theirs = socket.socketpair()
        with theirs:
            theirs.setblocking(False)
            transport = await transport_of(ours)
            writer = QuickWriter(transport)
            for part in parts:
                writer.write(part)
            transport.write(b"last")
            loop, received = asyncio.get_running_loop(), b""
            while not received.endswith(b"last"):
                received += await loop.sock_recv(theirs, 1 << 20)
            transport.close()
            await asyncio.sleep(0)
        return received

    with asyncio.Runner(loop_factory=make_loop) as runner:
        assert runner.run(scenario()) == b"".join(parts) + b"last"


@pytest.mark.parametrize("make_loop", LOOPS)
def test_nothing_is_written_to_a_file_that_has_its_number_later(
    make_loop: Callable[[], asyncio.AbstractEventLoop],
) -> None:
    async def scenario() -> None:
        ours, theirs = socket.socketpair()
        number = ours.fileno()
        transport = await transport_of(ours)
        writer = QuickWriter(transport)
        transport.abort()
        for _ in range(3):
            await asyncio.sleep(0)
        theirs.close()
        inner, outer = os.pipe()
        files = [inner, outer]
        while outer != number and len(files) < 64:
            files.append(outer := os.dup(outer))
        assert number in files, "the number is in use again"
        os.set_blocking(inner, False)
        with suppress(RuntimeError):  # what uvloop says of all that is written then
            writer.write(b"lost")
        with pytest.raises(BlockingIOError):
            os.read(inner, 100)
        for file in files:
            os.close(file)

    with asyncio.Runner(loop_factory=make_loop) as runner:
        runner.run(scenario())


def test_transports_without_a_socket_write_as_ever() -> None:
    class Kept(asyncio.Transport):
        written = b""

        def write(self, data: object) -> None:
            assert isinstance(data, bytes)
            self.written += data

    kept = Kept()
    writer = QuickWriter(kept)
    writer.write(b"a")
    writer.close()
    writer.write(b"b")
    assert kept.written == b"ab"

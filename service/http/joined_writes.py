"""Writes to a connection that go out together: the head of an answer and its body."""

import asyncio
from typing import Any

from service.quick_writer import QuickWriter

#: Writes up to this wait for the next one: heads of answers are shorter [byte].
_SHORT_BYTES = 2048
#: Writes up to this are copied behind what waited, longer ones follow it [byte].
_COPIED_BYTES = 256 * 1024


class JoinedWrites(asyncio.Transport):
    """A transport that sends a short write together with the next one, or by itself a turn later.

    The head of an answer and its body are written apart; sent apart they cost two system calls and
    wake the client twice.

    Args:
        transport: What it writes to.
    """

    def __init__(self, transport: asyncio.Transport) -> None:
        super().__init__()
        self._transport = transport
        self._writer = QuickWriter(transport)
        self._held = b""

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send bytes, at the latest in the next turn of the event loop."""
        if self._held or len(data) > _SHORT_BYTES:
            held, self._held = self._held, b""
            if held and len(data) > _COPIED_BYTES:
                self._transport.write(held)
                held = b""
            self._transport.write(held + data if held else data)
        elif data:
            self._held = bytes(data)
            asyncio.get_running_loop().call_soon(self._flush)

    def write_whole(self, data: bytes) -> None:
        """Send a whole answer at once: nothing is going to follow it."""
        held, self._held = self._held, b""
        self._writer.write(held + data if held else data)

    def _flush(self) -> None:
        held, self._held = self._held, b""
        if held:
            self._transport.write(held)

    def close(self) -> None:
        """Send what is left and close."""
        self._flush()
        self._writer.close()
        self._transport.close()

    def abort(self) -> None:
        """Close at once."""
        self._held = b""
        self._writer.close()
        self._transport.abort()

    def is_closing(self) -> bool:
        """Whether it is closed or about to be."""
        return self._transport.is_closing()

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """A detail of the connection, such as the address of its client."""
        return self._transport.get_extra_info(name, default)

    def pause_reading(self) -> None:
        """Take no more bytes for now."""
        self._transport.pause_reading()

    def resume_reading(self) -> None:
        """Take bytes again."""
        self._transport.resume_reading()

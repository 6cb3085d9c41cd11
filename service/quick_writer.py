"""Writes to streams at once: event loops write when their turn ends, behind all else in it."""

import asyncio
import os


class QuickWriter:
    """Writes to the stream of a transport before the turn of the event loop ends.

    Whoever waits at the other end begins that much sooner. Where something waits to be written
    already, or the system does not take all, the transport has the rest.

    Args:
        transport: Of a socket; of all others it writes as ever.
    """

    def __init__(self, transport: asyncio.WriteTransport) -> None:
        self._transport = transport
        socket = transport.get_extra_info("socket")
        is_plain = socket is not None and transport.get_extra_info("sslcontext") is None
        self._file = socket.fileno() if is_plain else -1

    def write(self, data: bytes) -> None:
        """Write some bytes."""
        transport = self._transport
        if self._file >= 0 and not (transport.is_closing() or transport.get_write_buffer_size()):
            try:
                sent = os.write(self._file, data)
            except OSError:  # it takes no more now, or never: the transport finds that out
                sent = 0
            if sent == len(data):
                return
            data = data[sent:]
        transport.write(data)

    def close(self) -> None:
        """Leave all to the transport: the number of its file may soon be that of another."""
        self._file = -1

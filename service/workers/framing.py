"""Length-prefixed messages over a stream socket, as they pass between server and workers."""

import socket
import struct
from collections.abc import Iterator

_LENGTH = struct.Struct("!Q")
#: One gibibyte: far above any request (bodies are capped), so only garbage is longer.
_MAX_LENGTH = 1 << 30


def encode(payload: bytes) -> bytes:
    """The payload with its length in front."""
    return _LENGTH.pack(len(payload)) + payload


def prefix(length: int) -> bytes:
    """Bytes in front of a payload of a length [byte]."""
    return _LENGTH.pack(length)


class FrameDecoder:
    """Cuts a stream of bytes, arriving in any pieces, back into the payloads that were sent."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take what arrived and give each payload that is now complete.

        Raises:
            ValueError: The length is impossible, so the stream is not ours.
        """
        if not self._buffer and len(data) > _LENGTH.size:
            (length,) = _LENGTH.unpack_from(data)
            if len(data) == _LENGTH.size + length:  # as nearly all arrive
                yield data[_LENGTH.size :]
                return
        self._buffer += data
        while len(self._buffer) >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._buffer)
            if length > _MAX_LENGTH:
                raise ValueError(f"a frame of {length} bytes")
            end = _LENGTH.size + length
            if len(self._buffer) < end:
                return
            with memoryview(self._buffer) as view:  # one copy, not two
                payload = bytes(view[_LENGTH.size : end])
            del self._buffer[:end]
            yield payload


def receive(channel: socket.socket) -> bytes:
    """Wait for one payload.

    Raises:
        EOFError: The other side is gone.
    """
    (length,) = _LENGTH.unpack(_read(channel, _LENGTH.size))
    return _read(channel, length)


def _read(channel: socket.socket, length: int) -> bytes:
    buffer = bytearray(length)
    view = memoryview(buffer)
    while view:
        count = channel.recv_into(view)
        if count == 0:
            raise EOFError("the other side closed the channel")
        view = view[count:]
    return bytes(buffer)

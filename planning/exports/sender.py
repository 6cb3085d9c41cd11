"""Positions for a controller's axes, sent over UDP: one in answer to each of its messages."""

import argparse
import math
import re
import socket
import struct
import sys
from collections.abc import Iterator, Sequence

#: Axes that messages tell apart from the external ones.
AXES = 6


class Egm:
    """Messages of ABB's Externally Guided Motion: protobuf, angles in degrees.

    The controller sends EgmRobot and takes EgmSensor: header 1 (seqno 1, tm 2 [ms], mtype 3),
    planned 2 (joints 1, externalJoints 3); feedBack 2 has the same two.
    """

    port = 6510

    def __init__(self) -> None:
        self._count = 0

    def axes(self, message: bytes) -> list[float]:
        """Axes of the arm as the controller measures them [degrees]."""
        feedback = dict(_fields(dict(_fields(message)).get(2, b"")))
        return [
            value
            for number in (1, 3)
            for _, item in _fields(feedback.get(number, b""))
            for (value,) in struct.iter_unpack("<d", item)
        ]

    def reply(self, message: bytes, axes: Sequence[float], start: Sequence[float]) -> bytes:  # noqa: ARG002
        """Message that sends the axes to absolute positions [degrees]."""
        self._count += 1
        own = [*axes[:AXES], *[0.0] * (AXES - len(axes))]
        header = b"\x08" + _varint(self._count) + b"\x10" + _varint(4 * self._count) + b"\x18\x03"
        planned = _field(1, _doubles(own))
        if len(axes) > AXES:
            planned += _field(3, _doubles(axes[AXES:]))
        return _field(1, header) + _field(2, planned)


class Rsi:
    """Messages of KUKA's RobotSensorInterface: XML, absolute corrections in degrees."""

    port = 49152

    def axes(self, message: bytes) -> list[float]:
        """Axes of the arm as the controller measures them [degrees]."""
        found = re.findall(r"<(?:AIPos|EIPos)\s([^>]*)>", message.decode("ascii"))
        return [float(value) for part in found for value in re.findall(r'"([^"]*)"', part)]

    def reply(self, message: bytes, axes: Sequence[float], start: Sequence[float]) -> bytes:
        """Message that corrects the axes by how far they are to be from the start [degrees]."""
        stamp = re.search(rb"<IPOC>\s*(\d+)\s*</IPOC>", message)
        if stamp is None:
            raise ValueError("a message of the controller has no IPOC")
        off = [f'="{axis - first:.6f}"' for axis, first in zip(axes, start, strict=True)]
        own, extra = (
            " ".join(f"{name}{k}{value}" for k, value in enumerate(values, 1))
            for name, values in (("A", off[:AXES]), ("E", off[AXES:]))
        )
        text = f"<AK {own}/>" + (f"<EK {extra}/>" if extra else "")
        return f'<Sen Type="ImFree">{text}<IPOC>{stamp[1].decode()}</IPOC></Sen>'.encode()


def _varint(number: int) -> bytes:
    low = bytes([number & 0x7F | (0x80 if number > 0x7F else 0)])
    return low if number <= 0x7F else low + _varint(number >> 7)


def _field(number: int, content: bytes) -> bytes:
    return bytes([number << 3 | 2]) + _varint(len(content)) + content


def _doubles(values: Sequence[float]) -> bytes:
    return b"".join(b"\x09" + struct.pack("<d", value) for value in values)


def _fields(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Number and bytes of each field of a protobuf message but of those that are varints."""
    at = 0

    def varint() -> int:
        nonlocal at
        value, shift = 0, 0
        while True:
            byte = data[at]
            at, value, shift = at + 1, value | (byte & 0x7F) << shift, shift + 7
            if byte <= 0x7F:
                return value

    while at < len(data):
        key = varint()
        kind = key & 7
        if kind == 0:
            varint()
            continue
        size = {1: 8, 5: 4}.get(kind) or varint()
        at += size
        yield key >> 3, data[at - size : at]


def send(
    protocol: Egm | Rsi,
    positions: Sequence[Sequence[float]],
    tolerance: float,
    host: str,
    port: int,
) -> str:
    """Send positions until the controller stops asking; what went wrong, empty where nothing did.

    An arm within the tolerance is first led to the first position, by little at each message; to
    one that is farther off nothing is sent. The last position is repeated.

    Args:
        protocol: Messages.
        positions: Axes at each message [degrees].
        tolerance: How far each axis may be off the first position [degrees].
        host: Address to listen at.
        port: UDP port to listen at.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind((host, port))
        message, controller = link.recvfrom(65536)
        start, first = protocol.axes(message), positions[0]
        off = [b - a for a, b in zip(start, first, strict=False)]
        if len(off) < len(first) or max(map(abs, off)) > tolerance:
            return f"The arm is at {start}, not at the start of the motion, {first}."
        start = start[: len(first)]
        # Degrees of an axis at each message.
        steps = math.ceil(max(map(abs, off)) / 0.01)
        lead = [[a + k / steps * d for a, d in zip(start, off, strict=True)] for k in range(steps)]
        rows, count, peer = [*lead, *positions], 0, controller
        link.settimeout(1.0)
        while True:
            if peer == controller:
                row = rows[min(count, len(rows) - 1)]
                link.sendto(protocol.reply(message, row, start), peer)
                count += 1
            try:
                message, peer = link.recvfrom(65536)
            except TimeoutError:
                if count >= len(rows):
                    return ""
                return f"The controller fell silent at position {count} of {len(rows)}."


def main(protocol: Egm | Rsi, positions: Sequence[Sequence[float]], tolerance: float) -> None:
    """Send positions to the controller that asks at an address."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--host", default="0.0.0.0", help="address to listen at")
    parser.add_argument("--port", type=int, default=protocol.port, help="UDP port to listen at")
    chosen = parser.parse_args()
    sys.exit(send(protocol, positions, tolerance, chosen.host, chosen.port) or None)

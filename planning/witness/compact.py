"""Compact form of a witness: the document in bytes, each number in as few as tell it exactly.

The form is defined in docs/witness.md. What is the same in many witnesses is packed once.
"""

import math
import struct
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import directly, kernel
from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache

Bytes = NDArray[np.uint8]
MAGIC = b"AWTN"
_NONE, _TEXT, _LIST, _OBJECT, _NUMBERS = range(5)
#: First bytes of numbers: small whole ones, larger ones, m / 10^k with k = 0 on, none, any.
_WHOLE, _LARGE, _DECIMAL, _NULL, _DOUBLE = 64, 128, 192, 254, 255
_DECIMALS = 15
#: Bytes that a number takes at most.
_WIDEST = 9


class Packed(NamedTuple):
    """A part of a document that is packed already.

    Args:
        value: The part.
        content: Its bytes.
    """

    value: Any
    content: bytes


class Witness(NamedTuple):
    """A witness by its fields; numbers are in arrays, where NaN stands for none."""

    fields: dict[str, Any]

    @property
    def compact(self) -> bytes:
        """The compact form."""
        return MAGIC + packed(self.fields)

    @property
    def document(self) -> dict[str, Any]:
        """The document, as JSON has it."""
        answer: dict[str, Any] = _plain(self.fields)
        return answer

    def document_of(self, name: str) -> Any:
        """One field of the document."""
        return _plain(self.fields[name])


def packed(value: Any) -> bytes:
    """A value of a document in bytes.

    Args:
        value: None, a text, a number, an array or a list of numbers, None among them or not, or
            dicts and lists of such.
    """
    parts = list[Any]()
    _collect(value, parts)
    tables = [(k, part) for k, part in enumerate(parts) if type(part) is np.ndarray]
    if tables:
        # All numbers at once: a call for each of many small tables costs the most.
        flat = np.concatenate([table for _, table in tables], dtype=np.float64)
        out, ends = np.empty(_WIDEST * len(flat), np.uint8), np.empty(len(flat) + 1, np.int64)
        used = directly(write_numbers, flat, flat.view(np.uint8), out, ends)
        stops = ends[np.cumsum([len(table) for _, table in tables])].tolist()
        content, begin = out[:used].tobytes(), 0
        for (k, _), stop in zip(tables, stops, strict=True):
            parts[k], begin = content[begin:stop], stop
    return b"".join(parts)


def _collect(value: Any, parts: list[Any]) -> None:
    """Add a value to parts of a packed one, numbers of tables as they are."""
    kind = type(value)
    if kind is dict:
        parts.append(_head(_OBJECT, len(value)))
        for name, item in value.items():
            parts.append(_name(name))
            _collect(item, parts)
    elif kind is np.ndarray:
        parts += (_head(_NUMBERS, value.ndim, *value.shape), value.ravel())
    elif kind is str:
        parts += (_head(_TEXT), _text(value))
    elif kind is Packed:
        parts.append(value.content)
    elif value is None:
        parts.append(_head(_NONE))
    elif kind is list or kind is tuple:
        table = _table(value)
        if table is None:
            parts.append(_head(_LIST, len(value)))
            for item in value:
                _collect(item, parts)
        else:
            _collect(table, parts)
    elif -_WHOLE <= value < _LARGE - _WHOLE and value % 1 == 0:
        parts.append(_head(_NUMBERS, 0, int(value) + _WHOLE))
    else:
        parts += (_head(_NUMBERS, 0), np.array([value], dtype=np.float64))


@bounded_cache(maxsize=256, weigh=len)
def _head(kind: int, *counts: int) -> bytes:
    return bytes([kind]) + b"".join(map(_count, counts))


def unpacked(content: bytes) -> Any:
    """The document of a compact form that this service made."""
    reader = BytesIO(content)
    reader.seek(len(MAGIC))
    return _value(reader)


def _value(reader: BytesIO) -> Any:
    kind = reader.read(1)[0]
    if kind == _NONE:
        return None
    if kind == _TEXT:
        return reader.read(_next_count(reader)).decode()
    if kind == _LIST:
        return [_value(reader) for _ in range(_next_count(reader))]
    if kind == _OBJECT:
        names = range(_next_count(reader))
        return {reader.read(_next_count(reader)).decode(): _value(reader) for _ in names}
    shape = [_next_count(reader) for _ in range(reader.read(1)[0])]
    values = np.array([_number(reader) for _ in range(math.prod(shape))], dtype=object)
    return values.reshape(shape).tolist()


def _next_count(reader: BytesIO) -> int:
    part = reader.read(1)[0]
    return part if part < 128 else part - 128 + 128 * _next_count(reader)


def _number(reader: BytesIO) -> float | int | None:
    first = reader.read(1)[0]
    if first < _LARGE:
        return first - _WHOLE
    if first < _DECIMAL:
        return 256 * (first - _LARGE) + reader.read(1)[0]
    if first == _NULL:
        return None
    if first == _DOUBLE:
        value: float = struct.unpack("<d", reader.read(8))[0]
        return value
    zigzag, k = _next_count(reader), first - _DECIMAL
    whole = zigzag // 2 if zigzag % 2 == 0 else -(zigzag // 2) - 1
    return whole / 10.0**k if k else whole


def _table(value: Any) -> Array | None:
    """Numbers as an array, None where there are others or rows differ in length."""
    if isinstance(value, list | tuple):
        leaves = list(value)
        for item in leaves:
            if isinstance(item, list | tuple):
                leaves += item
            elif isinstance(item, bool) or not isinstance(item, int | float | None):
                return None
    try:
        table = np.ascontiguousarray(value, dtype=np.float64).reshape(np.shape(value))
    except ValueError:
        return None
    return None if 0 in table.shape[1:] else table


def _text(value: str) -> bytes:
    content = value.encode()
    return _count(len(content)) + content


@bounded_cache(maxsize=128, weigh=len)
def _name(value: str) -> bytes:
    return _text(value)


def _count(value: int) -> bytes:
    """A whole number in groups of 7 bits, the lowest first, with 128 added to all but the last."""
    if value < 128:
        return bytes([value])
    return bytes([128 + value % 128]) + _count(value // 128)


@kernel
def write_numbers(values: Array, raw: Bytes, out: Bytes, ends: Indices) -> int:
    """Write numbers one after the other, and tell how many bytes they take.

    Args:
        values: The numbers, NaN for none, shape (n,).
        raw: The same in bytes, the lowest first, shape (8 n,).
        out: Filled, shape (9 n,).
        ends: Filled with the bytes that the first numbers take, of none to all, shape (n + 1,).
    """
    at = 0
    for i in range(len(values)):
        x = values[i]
        ends[i] = at
        if math.isnan(x):
            out[at] = _NULL
            at += 1
            continue
        whole = abs(x) < 2.0**47 and np.rint(x) == x
        if whole and -_WHOLE <= x < _LARGE - _WHOLE:
            out[at] = int(x) + _WHOLE
            at += 1
            continue
        if whole and 0 <= x < (_DECIMAL - _LARGE) * 256:
            out[at], out[at + 1] = _LARGE + int(x) // 256, int(x) % 256
            at += 2
            continue
        # With as many digits as there are: where these do not do, fewer would not either.
        k, power = 0, 1.0
        while k < _DECIMALS and abs(x * power) < 2.0**43:
            k += 1
            power *= 10.0
        if abs(x) < 2.0**47 and np.rint(x * power) / power == x:
            k, power = 0, 1.0
            while np.rint(x * power) / power != x:
                k += 1
                power *= 10.0
            m = int(np.rint(x * power))
            m = 2 * m if m >= 0 else -2 * m - 1
            out[at] = _DECIMAL + k
            at += 1
            while m >= 128:
                out[at] = 128 + m % 128
                m //= 128
                at += 1
            out[at] = m
            at += 1
            continue
        out[at] = _DOUBLE
        out[at + 1 : at + 9] = raw[8 * i : 8 * i + 8]
        at += 9
    ends[len(values)] = at
    return at


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, Packed):
        return _plain(value.value)
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "f" and (nothing := np.isnan(value)).any():
            value = value.astype(object)
            value[nothing] = None
        return value.tolist()
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value

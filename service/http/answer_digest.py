"""Digests of answers without the times that were measured, and differences between two answers."""

import hashlib
import json
from collections.abc import Iterator
from itertools import islice
from typing import Any

#: Fields that hold measured times or names of this one answer: they differ from run to run.
_MEASURED = frozenset({"milliseconds", "plan_id", "instance"})


def answer_digest(content: bytes) -> str:
    """SHA-256 of an answer or problem without measured times, in hexadecimal digits.

    Args:
        content: JSON.
    """
    # Keys keep their order and floats their shortest form: equal digests are equal bytes.
    text = json.dumps(_reproducible(json.loads(content)), separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def differences(first: bytes, second: bytes, limit: int) -> list[str]:
    """JSON pointers (RFC 6901) to the first values that two answers do not have in common.

    Args:
        first: JSON.
        second: JSON.
        limit: How many at most.
    """
    values = _reproducible(json.loads(first)), _reproducible(json.loads(second))
    return list(islice(_pointers(*values, ""), limit))


def _reproducible(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _reproducible(item) for name, item in value.items() if name not in _MEASURED}
    if isinstance(value, list):
        return [_reproducible(item) for item in value]
    return value


def _pointers(first: Any, second: Any, at: str) -> Iterator[str]:
    if isinstance(first, dict) and isinstance(second, dict):
        for name in [*first, *(name for name in second if name not in first)]:
            pointer = f"{at}/{name.replace('~', '~0').replace('/', '~1')}"
            if name in first and name in second:
                yield from _pointers(first[name], second[name], pointer)
            else:
                yield pointer
    elif isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        for index, pair in enumerate(zip(first, second, strict=True)):
            yield from _pointers(*pair, f"{at}/{index}")
    elif first != second:
        yield at

"""Lists of entries by their fields, as the API has them: stages and constraints."""

from collections.abc import Mapping
from typing import Any, TypeAlias

#: Entries in order; each has a field that names its kind.
Entries: TypeAlias = tuple[Mapping[str, Any], ...]


def moved(entries: Entries, number: int, steps: int) -> Entries:
    """The entries with one of them moved, as far as there is room.

    Args:
        entries: Entries in order.
        number: Number of the entry, from 0.
        steps: Towards the end, negative towards the beginning.
    """
    rest = [*entries[:number], *entries[number + 1 :]]
    place = min(max(number + steps, 0), len(rest))
    return (*rest[:place], entries[number], *rest[place:])


def without(entries: Entries, number: int) -> Entries:
    """The entries without one of them.

    Args:
        entries: Entries in order.
        number: Number of the entry, from 0.
    """
    return (*entries[:number], *entries[number + 1 :])


def with_field(entries: Entries, number: int, name: str, value: Any) -> Entries:
    """The entries with a field of one of them changed.

    Args:
        entries: Entries in order.
        number: Number of the entry, from 0.
        name: Name of the field.
        value: New value; None leaves the field to the service.
    """
    entry = {key: item for key, item in entries[number].items() if key != name}
    if value is not None:
        entry[name] = value
    return (*entries[:number], entry, *entries[number + 1 :])

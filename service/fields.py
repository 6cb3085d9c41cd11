"""Fields by name: of requests for values of the domain, and of values for answers."""

from dataclasses import fields
from typing import Any


def picked(part: object, *names: str) -> dict[str, Any]:
    """Attributes of an object by their names, in this order."""
    return {name: getattr(part, name) for name in names}


def shared(part: object, kind: type, without: tuple[str, ...] = ()) -> dict[str, Any]:
    """Attributes of an object that a dataclass has as fields of the same names.

    Args:
        part: The object.
        kind: The dataclass.
        without: Fields that are left out.
    """
    names = (item.name for item in fields(kind))
    return picked(part, *(name for name in names if hasattr(part, name) and name not in without))


def listed(part: object, *names: str) -> dict[str, Any]:
    """Arrays of an object as lists, by their names, in this order."""
    return {name: getattr(part, name).tolist() for name in names}

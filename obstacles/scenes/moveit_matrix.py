"""MoveIt's allowed collision matrix: which pairs of names may touch."""

from itertools import combinations
from typing import NamedTuple

from kinematics.errors import InvalidScene
from kinematics.readers.yaml_reader import Node
from obstacles.scenes.scene import checked_name

_WHERE = "allowed_collision_matrix"
_FIELDS = ("entry_names", "entry_values", "default_entry_names", "default_entry_values")


class Permissions(NamedTuple):
    """Pairs that may touch.

    Attributes:
        pairs: Pairs of names.
        free: Names that may touch everything, each with those that it may not.
        halves: Pairs that one half of the matrix allows, and the other does not.
    """

    pairs: frozenset[tuple[str, str]]
    free: dict[str, frozenset[str]]
    halves: tuple[tuple[str, str], ...]


def permissions(node: Node) -> Permissions:
    """Read ``moveit_msgs/AllowedCollisionMatrix``.

    The entry of a pair counts, else the defaults of its names: where both have one, both must be
    true (``AllowedCollisionMatrix::getAllowedCollision``).

    Args:
        node: The message; None where it is left out.

    Raises:
        InvalidScene: The matrix is not square, or values are missing.
    """
    matrix = {} if node is None else node
    if not isinstance(matrix, dict) or not matrix.keys() <= set(_FIELDS):
        raise InvalidScene(f"{_WHERE}: needed are the fields {', '.join(_FIELDS)}")
    names, defaults = (_names(matrix.get(key), key) for key in _FIELDS[::2])
    rows = _list(matrix.get("entry_values"), "entry_values")
    if len(rows) != len(names):
        raise InvalidScene(f"{_WHERE}: {len(names)} entry_names, but {len(rows)} entry_values")
    flags = [_flags(row, len(names), f"entry_values[{i}]") for i, row in enumerate(rows)]
    values = _flags(matrix.get("default_entry_values"), len(defaults), "default_entry_values")
    pairs, halves = set(), []
    for i, j in combinations(range(len(names)), 2):
        # Half an allowance is a mistake, and this side of it is the safe one.
        if flags[i][j] and flags[j][i]:
            pairs.add((names[i], names[j]))
        elif flags[i][j] or flags[j][i]:
            halves.append((names[i], names[j]))
    given = dict(zip(defaults, values, strict=True))
    apart = frozenset(name for name, flag in given.items() if not flag)
    named = frozenset(names)
    free = {
        name: apart | (named if name in named else frozenset())
        for name, flag in given.items()
        if flag
    }
    return Permissions(frozenset(pairs), free, tuple(halves))


def _names(node: Node, key: str) -> list[str]:
    entries = _list(node, key)
    whole = (str(entry) if type(entry) is int else entry for entry in entries)
    return [checked_name(entry, f"{_WHERE}.{key}[{i}]") for i, entry in enumerate(whole)]


def _list(node: Node, key: str) -> list[Node]:
    if node is None:
        return []
    if not isinstance(node, list):
        raise InvalidScene(f"{_WHERE}.{key}: needed is a list")
    return node


def _flags(row: Node, count: int, key: str) -> list[bool]:
    flags = _list(row.get("enabled") if isinstance(row, dict) else row, key)
    if len(flags) != count or not all(isinstance(flag, bool) for flag in flags):
        raise InvalidScene(f"{_WHERE}.{key}: needed are {count} values true or false")
    return flags

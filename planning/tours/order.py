"""Order that goals need: groups that stay together, goals that come before others."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from kinematics.arrays import Indices
from kinematics.errors import InvalidGoal
from planning.tours.network import Precedence

Pairs = Sequence[tuple[str, str]]


def check_order(names: Sequence[str], groups: Sequence[str | None], precedence: Pairs) -> None:
    """Check that there is an order of the goals that keeps all rules.

    Args:
        names: Of the goals, shape (m,).
        groups: Group of each goal, shape (m,).
        precedence: Pairs of goals or groups, the first before the second.

    Raises:
        InvalidGoal: A name stands twice or is unknown, or the rules contradict each other; the
            message names the goals of the cycle.
    """
    numbers: dict[str, int] = {}
    for i, name in enumerate(names):
        if name in numbers:
            raise InvalidGoal(
                f"goals[{numbers[name]}] and goals[{i}] have the same id {name!r}",
                hint="Give every goal an id of its own, or leave the ids out.",
                id=name,
                indices=[numbers[name], i],
            )
        numbers[name] = i
    for group in groups:
        if group is not None and group in numbers:
            raise InvalidGoal(
                f"{group!r} is the id of goals[{numbers[group]}] and the name of a group",
                hint="Rename one of them: precedence names both.",
            )
    known = {*names, *(group for group in groups if group is not None)}
    for i, pair in enumerate(precedence):
        for name in pair:
            if name not in known:
                raise InvalidGoal(
                    f"precedence[{i}] names {name!r}, which is neither a goal nor a group",
                    hint="Name goals by their id, or by their number as a string without ids.",
                )
    cycle = find_cycle(_contracted(names, groups, goal_pairs(names, groups, precedence)))
    if cycle:
        raise InvalidGoal(
            f"no order keeps the precedence: {' before '.join(cycle)}",
            hint="Remove one pair of the cycle; goals of a group are visited one after another.",
            cycle=cycle,
        )


def goal_pairs(
    names: Sequence[str], groups: Sequence[str | None], precedence: Pairs
) -> list[tuple[int, int]]:
    """Pairs of goals, the first before the second, with groups replaced by their goals.

    Args:
        names: Of the goals, shape (m,).
        groups: Group of each goal, shape (m,).
        precedence: Pairs of goals or groups.
    """
    members: dict[str, list[int]] = {}
    for i, (name, group) in enumerate(zip(names, groups, strict=True)):
        members.setdefault(name, []).append(i)
        if group is not None:
            members.setdefault(group, []).append(i)
    pairs = {(a, b) for x, y in precedence for a in members[x] for b in members[y]}
    return sorted(pairs)


def find_cycle(followers: Mapping[str, Iterable[str]]) -> list[str]:
    """Names along a cycle, its first one again at the end; empty where there is none.

    Args:
        followers: Names that come after each name.
    """
    finished: set[str] = set()
    for root in followers:
        path: list[str] = []
        on_path: set[str] = set()
        stack = [(root, False)]
        while stack:
            name, leaves = stack.pop()
            if leaves:
                path.pop()
                on_path.discard(name)
                finished.add(name)
                continue
            if name in on_path:
                return [*path[path.index(name) :], name]
            if name in finished:
                continue
            path.append(name)
            on_path.add(name)
            stack.append((name, True))
            stack.extend((other, False) for other in followers.get(name, ()))
    return []


def precedence_table(pairs: Sequence[tuple[int, int]], stops: int) -> Precedence:
    """Followers of each stop in rows of one array.

    Args:
        pairs: Numbers of stops, the first before the second.
        stops: How many stops there are, start and end among them.
    """
    rows = sorted(pairs)
    count = np.bincount(np.array([a for a, _ in rows], dtype=np.int64), minlength=stops)
    first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    return Precedence(first, np.array([b for _, b in rows], dtype=np.int64))


def group_numbers(groups: Sequence[str | None]) -> Indices:
    """Number of each goal's group, a number of its own for a goal without one, shape (m,)."""
    numbers: dict[str, int] = {}
    count = len(groups)
    answer = []
    for i, group in enumerate(groups):
        answer.append(i if group is None else numbers.setdefault(group, count + len(numbers)))
    return np.array(answer, dtype=np.int64)


def _contracted(
    names: Sequence[str], groups: Sequence[str | None], pairs: Sequence[tuple[int, int]]
) -> dict[str, list[str]]:
    """Followers of goals inside their groups, and of groups among each other, by name."""
    followers: dict[str, list[str]] = {}
    for a, b in pairs:
        if groups[a] is not None and groups[a] == groups[b]:
            before, after = names[a], names[b]
        else:
            before, after = groups[a] or names[a], groups[b] or names[b]
        followers.setdefault(before, []).append(after)
    return followers

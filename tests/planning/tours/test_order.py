"""Rules about the order of goals: names, groups, cycles."""

import numpy as np
import pytest

from kinematics.errors import InvalidGoal
from planning.tours.problem import (
    check_order,
    find_cycle,
    goal_pairs,
    group_numbers,
    precedence_table,
)


@pytest.mark.parametrize(
    ("names", "groups", "pairs", "words"),
    [
        ("aba", (None, None, None), [], "goals[0] and goals[2] have the same id 'a'"),
        ("abc", ("a", None, None), [], "name of a group"),
        ("abc", (None, None, None), [("a", "z")], "precedence[0] names 'z'"),
        ("abc", (None, None, None), [("a", "a")], "a before a"),
        ("abc", (None, None, None), [("a", "b"), ("b", "c"), ("c", "a")], "before a"),
        ("abc", ("g", None, "g"), [("a", "b"), ("b", "c")], "g before b before g"),
        ("abc", ("g", None, "g"), [("g", "b"), ("b", "g")], "g before b before g"),
    ],
)
def test_contradictions_are_named(
    names: str, groups: tuple[str | None, ...], pairs: list[tuple[str, str]], words: str
) -> None:
    with pytest.raises(InvalidGoal) as refusal:
        check_order(list(names), groups, pairs)
    assert words in refusal.value.message


def test_orders_that_exist_are_taken() -> None:
    check_order(list("abcd"), ("g", None, "g", None), [("a", "c"), ("g", "b"), ("d", "a")])


def test_the_cycle_is_one_of_the_rules() -> None:
    followers = {"a": ["b"], "b": ["c", "d"], "c": [], "d": ["e"], "e": ["b"]}
    cycle = find_cycle(followers)
    assert sorted(cycle[:-1]) == ["b", "d", "e"]
    assert cycle[0] == cycle[-1]
    assert find_cycle({"a": ["b", "c"], "b": ["c"], "c": []}) == []


def test_groups_stand_for_their_goals() -> None:
    pairs = goal_pairs(list("abcd"), ("g", "g", None, None), [("g", "c"), ("c", "d")])
    assert pairs == [(0, 2), (1, 2), (2, 3)]
    table = precedence_table(pairs, 6)
    assert table.first.tolist() == [0, 1, 2, 3, 3, 3, 3]
    assert table.followers.tolist() == [2, 2, 3]
    numbers = group_numbers(("g", None, "g", "h"))
    assert numbers[0] == numbers[2]
    assert len(np.unique(numbers)) == 3

"""Local search and bound beside all orders tried one by one, and rules about the order of goals."""

from itertools import pairwise, permutations

import numpy as np
import pytest

from kinematics.arrays import Indices
from kinematics.errors import InvalidGoal
from planning.timing.rest_to_rest import Times
from planning.tours.local_search import (
    Network,
    enqueue,
    make_network,
    nearest_neighbour_tour,
    search_kernel,
    search_work,
    tour_time,
)
from planning.tours.problem import (
    check_order,
    group_numbers,
    precedence_table,
)
from planning.tours.search import lower_bound

GOALS, BRANCHES = 6, 3


def instance(seed: int, goals: int = GOALS, branches: int = BRANCHES) -> tuple[Times, Indices]:
    """Distances of random points, the start and the end one point each, and first rows."""
    random = np.random.default_rng(seed)
    points = random.uniform(0.0, 1.0, (goals * branches + 2, 2))
    times = np.linalg.norm(points[:, None] - points[None], axis=2).astype(np.float32)
    first = np.concatenate([np.arange(goals + 1) * branches, goals * branches + np.array([1, 2])])
    return times, first.astype(np.int64)


def best_by_enumeration(
    times: Times, pairs: list[tuple[int, int]], groups: list[str | None]
) -> float:
    best = np.inf
    for order in permutations(range(GOALS)):
        if any(order.index(a) > order.index(b) for a, b in pairs):
            continue
        numbers = [groups[k] or k for k in order]
        if sum(a != b for a, b in pairwise(numbers)) > len(set(numbers)) - 1:
            continue
        value = times[-2, [BRANCHES * order[0] + k for k in range(BRANCHES)]].astype(float)
        for a, b in pairwise(order):
            block = times[BRANCHES * a : BRANCHES * (a + 1), BRANCHES * b : BRANCHES * (b + 1)]
            value = (value[:, None] + block).min(axis=0)
        last = BRANCHES * order[-1]
        best = min(best, float((value + times[last : last + BRANCHES, -1]).min()))
    return best


def search(network: Network, pairs: list[tuple[int, int]], groups: list[str | None], seed: int = 0,
           kicks: int = 300) -> tuple[float, list[int]]:  # fmt: skip
    state = nearest_neighbour_tour(network, group_numbers(groups), pairs)
    work = search_work(network, seed)
    for stop in range(len(state.order)):
        enqueue(work, stop)
    before = tour_time(network, state)
    total = search_kernel(network, state, work, kicks)
    assert total <= before + 1e-9
    assert total == pytest.approx(tour_time(network, state))
    assert (state.position[state.order] == np.arange(len(state.order))).all()
    assert ((network.first[:-1] <= state.choice) & (state.choice < network.first[1:])).all()
    assert state.order[0] == len(groups)
    assert state.order[-1] == len(groups) + 1
    return total, [int(k) for k in state.order]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("rules", [0, 1, 2])
def test_the_search_finds_the_best_tour_of_a_few_goals(seed: int, rules: int) -> None:
    times, first = instance(seed)
    pairs = [(0, 1), (2, 1), (4, 0)] if rules == 1 else []
    groups: list[str | None] = ["g", None, "g", "h", "g", "h"] if rules == 2 else [None] * GOALS
    numbers = np.concatenate([group_numbers(groups), [-1, -2]])
    rows = np.repeat(numbers, np.diff(first))
    apart = np.float32(100.0) * (rows[:, None] != rows[None])
    shown = times + apart if rules == 2 else times
    network = make_network(shown.astype(np.float32), first, precedence_table(pairs, GOALS + 2), 10)
    total, order = search(network, pairs, groups)
    for a, b in pairs:
        assert order.index(a) < order.index(b)
    borders = 100.0 * len({*groups, None} - {None}) + 200.0 if rules == 2 else 0.0
    wanted = best_by_enumeration(times, pairs, groups)
    assert total - borders == pytest.approx(wanted, abs=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_the_bound_is_below_the_best_tour(seed: int) -> None:
    times, first = instance(seed)
    best = best_by_enumeration(times, [], [None] * GOALS)
    bound = lower_bound(times, first, 1.1 * best)
    assert 0.6 * best <= bound <= best


def test_the_bound_of_single_configurations_is_tight() -> None:
    """Held and Karp: within a percent of the best tour on random points."""
    times, first = instance(0, goals=40, branches=1)
    network = make_network(times, first, precedence_table([], 42), 10)
    total, _ = search(network, [], [None] * 40, kicks=3000)
    assert 0.97 * total <= lower_bound(times, first, total) <= total


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

"""Orders of items: the shortest, by dynamic programming, and those left open, by permutations."""

from collections.abc import Sequence
from itertools import pairwise, permutations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.orders.blocks import Each, Fallback, Flat, plan_blocks, plan_work
from planning.sequence.result import SequenceFailure, SequencePlan, TaskOptions
from planning.sequence.stage import Stage
from planning.timing.rest_to_rest import motion_times
from tests.planning.sequence.workshop import DOWN, HOME, Z, gripping

ARM = aw.load_robot("planar_rr")


class Yard:
    """Items that begin and end somewhere; what plans a flat list of them in no time."""

    def __init__(self, count: int, random: np.random.Generator, *, by_place: bool = False) -> None:
        self.random, self.by_place, self.tries = random, by_place, 0
        self.begin, self.end = random.uniform(-2.0, 2.0, (2, count, ARM.chain.n))
        self.home = np.zeros(ARM.chain.n)
        self.before: dict[int, set[int]] = {}

    def ways(self, order: Sequence[int]) -> list[tuple[Array, Array]]:
        at, ways = self.home, []
        for place, item in enumerate(order):
            end = self.end[place if self.by_place else item]
            ways += [(at, self.begin[item]), (self.begin[item], end)]
            at = end
        return [*ways, (at, self.home)]

    def time(self, order: Sequence[int]) -> float:
        return sum(float(motion_times(ARM.chain, a, b[None])[0]) for a, b in self.ways(order))

    def least(self) -> float:
        """By dynamic programming over the items that are done (their number is the turn)."""
        n = len(self.begin)
        known: dict[tuple[frozenset[int], int], float] = {(frozenset(), -1): 0.0}
        for place in range(n):
            new: dict[tuple[frozenset[int], int], float] = {}
            for (done, last), total in known.items():
                at = self.home
                if last >= 0:
                    at = self.end[place - 1 if self.by_place else last]
                for item in set(range(n)) - done:
                    if not self.before.get(item, set()) <= done:
                        continue
                    end = self.end[place if self.by_place else item]
                    ends = np.array([self.begin[item]]), np.array([end])
                    more = motion_times(ARM.chain, at, ends[0])[0]
                    more += motion_times(ARM.chain, self.begin[item], ends[1])[0]
                    key = done | {item}, item
                    new[key] = min(new.get(key, np.inf), total + float(more))
            known = new
        return min(
            total + float(motion_times(
                ARM.chain, self.end[n - 1 if self.by_place else last], self.home[None])[0])
            for (_, last), total in known.items()
        )  # fmt: skip

    def attempt(self, flat: Sequence[Flat[Any]], _: TaskOptions) -> SequencePlan | SequenceFailure:
        self.tries += 1
        order = [one.stage[0] for one in flat if one.stage[1] == "begin"]
        for k, item in enumerate(order):
            if not self.before.get(item, set()) <= set(order[:k]):
                return SequenceFailure("", "", "", 2 * k, {}, (), reached=2 * k)
        stages: list[Any] = [
            SimpleNamespace(
                trajectory=SimpleNamespace(
                    start=a, end=b, duration=float(motion_times(ARM.chain, a, b[None])[0])
                ),
                after=SimpleNamespace(robot=ARM),
            )
            for a, b in self.ways(order)
        ]
        return SequencePlan(tuple(stages), self.time(order), (), (), exhausted=False)

    def block(self, order: Any = "shortest") -> Each[Any]:
        items = [str(k) for k in range(len(self.begin))]
        return Each(
            items, lambda order: [(order[-1], "begin"), (order[-1], "end")], order, self.by_place
        )


@pytest.mark.parametrize("by_place", [False, True])
@pytest.mark.parametrize("ruled", [False, True])
def test_no_order_takes_less_time(by_place: bool, ruled: bool) -> None:
    random, exact, saved = np.random.default_rng(38), 0, 0
    for _ in range(12):
        yard = Yard(int(random.integers(2, 11)), random, by_place=by_place)
        n = len(yard.begin)
        if ruled:
            hidden = random.permutation(n).tolist()
            yard.before = {b: {a} for a, b in pairwise(hidden) if random.random() < 0.4}
        blocks = [yard.block(), ("home", "home")]
        outcome, orders = plan_blocks(blocks, TaskOptions(60.0), yard.attempt)
        assert isinstance(outcome, SequencePlan)
        (found,) = orders
        order = [int(name) for name in found.items]
        assert found.duration == outcome.duration == pytest.approx(yard.time(order))
        able = yard.before.items()
        written = all(b < a for a, before in able for b in before)
        assert (found.saved is not None) is written
        if found.saved is not None:
            assert found.saved == pytest.approx(yard.time(range(n)) - found.duration)
            saved += found.saved > 0.1
        assert all(order.index(b) < order.index(a) for a, before in able for b in before)
        assert found.duration >= yard.least() - 1e-9
        exact += found.duration < yard.least() * (1.0 + 1e-9)
        assert yard.tries < 60
    assert exact >= (8 if ruled else 11)
    assert saved >= (1 if ruled else 8)


def test_many_items_take_little_more_than_the_least_of_many_orders() -> None:
    random = np.random.default_rng(3)
    yard = Yard(40, random)
    outcome, (found,) = plan_blocks([yard.block()], TaskOptions(20.0), yard.attempt)
    assert isinstance(outcome, SequencePlan)
    drawn = min(yard.time(random.permutation(40).tolist()) for _ in range(2_000))
    assert found.duration < 0.8 * drawn


def test_an_order_inside_of_another_is_refused() -> None:
    yard = Yard(3, np.random.default_rng(0))
    inner = yard.block()
    outer = Each(["a", "b"], lambda _: [inner])
    for blocks in ([outer], [Fallback([[inner]])]):
        with pytest.raises(InvalidOption, match="shortest"):
            plan_blocks(blocks, TaskOptions(5.0), yard.attempt)


def test_crates_are_carried_in_the_shortest_order() -> None:
    spots = [[0.4, 0.3], [0.4, -0.3], [0.5, 0.4], [0.5, -0.4]]
    crates = [f"c{k}" for k in range(4)]
    scene = aw.Scene([
        aw.Obstacle("bench", aw.Box((0.9, 1.6, 0.04)), aw.pose([0.55, 0.0, 0.0])),
        *(aw.Obstacle(name, aw.Box((0.04, 0.04, 0.06)), aw.pose([*spot, 0.05]))
          for name, spot in zip(crates, spots, strict=True)),
    ])  # fmt: skip
    grasp = np.diag([1.0, 1.0, 1.0, 1.0])
    grasp[:3, :3] = DOWN

    def stages(order: Sequence[int]) -> list[Stage]:
        k = order[-1]
        # Beside where it stood, so that each order takes its ways across the bench.
        place = aw.pose([spots[k][0] + 0.2, spots[k][1], 0.05])
        return [
            aw.Move(), aw.Straight("approach", Z, "tool", 0.04, 0.08),
            aw.Grasp(crates[k], grasp[None], ("jaw",), ("bench",)),
            aw.Gripper("close", until="contact"), aw.Attach(crates[k]),
            aw.Straight("lift", Z, "root", 0.05, 0.1), aw.Move(),
            aw.Straight("approach", -Z, "root", 0.02, 0.05),
            aw.Place(None, place[None], support="bench"),
            aw.Gripper("open"), aw.Detach(), aw.Straight("retreat", -Z, "tool", 0.05, 0.1),
        ]  # fmt: skip

    world = aw.World(gripping(), scene)
    times: dict[tuple[int, ...], float] = {}
    for order in ((0, 1, 2, 3), (0, 2, 1, 3), (0, 2, 3, 1), (1, 3, 2, 0)):
        flat = [stage for k in order for stage in stages([k])]
        found = plan_work(world, HOME, flat, TaskOptions(30.0))
        assert isinstance(found, SequencePlan)
        times[order] = found.duration
    best = plan_work(world, HOME, [Each(crates, stages, "shortest")], TaskOptions(60.0))
    assert isinstance(best, SequencePlan)
    (told,) = best.orders
    assert told.written == pytest.approx(times[0, 1, 2, 3])
    assert told.saved is not None
    assert told.saved > 0.5
    # Each order has configurations of its own, that no other one tells beforehand.
    assert best.duration <= 1.05 * min(times.values())
    assert all(stage.certificate.violation is None for stage in best.stages)


class Puzzle:
    """Items that can be taken once others are gone; what plans a flat list of them."""

    def __init__(self, before: dict[str, set[str]]) -> None:
        self.before, self.tries = before, 0

    def can(self, order: Sequence[str]) -> int | None:
        """The first place of an order at which it gets stuck."""
        for k, item in enumerate(order):
            if not self.before.get(item, set()) <= set(order[:k]):
                return k
        return None

    def attempt(self, flat: Sequence[Flat[str]], _: TaskOptions) -> SequencePlan | SequenceFailure:
        self.tries += 1
        stuck = self.can([one.stage for one in flat])
        if stuck is None:
            return SequencePlan((), float(len(flat)), (), (), exhausted=False)
        return SequenceFailure("PLANNING_FAILED", "", "", stuck, {}, (), reached=stuck)


def one_of(items: Sequence[str]) -> Each[str]:
    """Items as stages of their own, in any order."""
    return Each(items, lambda order: [items[order[-1]]], order="free")


def test_an_order_is_found_wherever_there_is_one() -> None:
    random, solved = np.random.default_rng(38), 0
    for _ in range(200):
        items = [f"i{k}" for k in range(int(random.integers(1, 6)))]
        before = {a: {b for b in items if b != a and random.random() < 0.25} for a in items}
        puzzle = Puzzle(before)
        blocks = [one_of(items)]
        found = plan_blocks(blocks, TaskOptions(60.0), puzzle.attempt).outcome
        possible = any(puzzle.can(order) is None for order in permutations(items))
        assert isinstance(found, SequencePlan) is possible
        solved += possible
    assert 80 < solved < 200


def test_six_in_a_stack_written_upside_down_take_few_tries() -> None:
    items = [f"i{k}" for k in range(6)]
    puzzle = Puzzle({items[k]: set(items[k + 1 :]) for k in range(6)})
    found = plan_blocks([one_of(items)], TaskOptions(60.0), puzzle.attempt).outcome
    assert isinstance(found, SequencePlan)
    assert puzzle.tries == 16


def test_alternatives_come_in_order_and_with_what_follows() -> None:
    puzzle = Puzzle({"end": {"b"}, "c": {"nothing"}})
    seen: list[list[tuple[str, str | None]]] = []

    def attempt(flat: Sequence[Flat[str]], options: TaskOptions) -> SequencePlan | SequenceFailure:
        seen.append([(one.stage, one.of) for one in flat])
        return puzzle.attempt(flat, options)

    blocks = [Fallback([["a"], ["c"], ["b"]]), "end"]
    assert isinstance(plan_blocks(blocks, TaskOptions(60.0), attempt).outcome, SequencePlan)
    assert seen[-1] == [("b", "alternative 2"), ("end", None)]
    assert len(seen) == 3
    blocks = [Fallback([["a"], ["c"]]), "end"]
    failure = plan_blocks(blocks, TaskOptions(60.0), puzzle.attempt).outcome
    assert isinstance(failure, SequenceFailure)
    assert failure.stage == 1


@pytest.mark.parametrize("free", [True, False])
def test_a_crate_below_another_is_taken_after_it(free: bool) -> None:
    scene = aw.Scene(
        [
            aw.Obstacle("bench", aw.Box((0.7, 1.0, 0.04)), aw.pose([0.55, 0.0, 0.0])),
            aw.Obstacle("low", aw.Box((0.04, 0.04, 0.06)), aw.pose([0.45, 0.2, 0.05])),
            aw.Obstacle("high", aw.Box((0.04, 0.04, 0.06)), aw.pose([0.45, 0.2, 0.11])),
        ]
    )
    names = ["low", "high"]

    def stages(order: Sequence[int]) -> list[Stage]:
        name, turn = names[order[-1]], np.diag([1.0, 1.0, 1.0, 1.0])
        turn[:3, :3] = DOWN
        return [
            aw.Move(), aw.Straight("approach", Z, "tool", 0.04, 0.08),
            aw.Grasp(name, turn[None], ("jaw",), ("bench",) if name == "low" else ("low",)),
            aw.Gripper("close", until="contact"), aw.Attach(name),
            aw.Straight("lift", Z, "root", 0.05, 0.1), aw.Move(),
            aw.Straight("approach", -Z, "root", 0.02, 0.05),
            aw.Place(None, np.array([aw.pose([0.45, -0.2 - 0.1 * len(order), 0.05])]),
                     support="bench"),
            aw.Gripper("open"), aw.Detach(), aw.Straight("retreat", -Z, "tool", 0.05, 0.1),
        ]  # fmt: skip

    found = plan_work(
        aw.World(gripping(), scene),
        HOME,
        [Each(names, stages, "free" if free else "written")],
        TaskOptions(30.0),
    )
    if not free:
        assert isinstance(found, SequenceFailure)
        assert "high" in found.message or "high" in str(found.details)
        return
    assert isinstance(found, SequencePlan)
    held = [stage.certificate.premises.attached for stage in found.stages]
    assert [name for (name,) in filter(None, held)] == ["high"] * 6 + ["low"] * 6
    ys = [found.stages[-1].after.scene.obstacle(n).T_world_obstacle[1, 3] for n in names]
    assert ys == pytest.approx([-0.4, -0.3], abs=1e-3)

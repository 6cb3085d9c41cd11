"""Orders and alternatives that are left open: against all permutations, and on stacked crates."""

from collections.abc import Sequence
from itertools import permutations

import numpy as np
import pytest

import armwright as aw
from planning.orders.blocks import Each, Fallback, Flat, plan_blocks, plan_work
from planning.sequence.result import SequenceFailure, SequencePlan, TaskOptions
from planning.sequence.stage import Stage
from tests.planning.sequence.workshop import DOWN, HOME, Z, gripping


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

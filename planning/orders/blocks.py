"""Blocks of stages whose order or alternative is left open, planned one flat list after another.

The choices that a flat list makes are digits, in the order of its stages. Where a list gets stuck
at a stage, all lists with the same digits up to that stage get stuck there too: the last digit
before it is the next to change. An order that is to be the shortest one is a list like any other:
the first that can be done is made shorter by lists with other digits.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from planning.orders.shortest import OrderSearch, Visit
from planning.sequence.result import FoundOrder, SequenceFailure, SequencePlan, TaskOptions
from planning.sequence.search import plan_task
from planning.sequence.stage import (
    Attach,
    Detach,
    Grasp,
    Gripper,
    Move,
    Place,
    Stage,
    Straight,
)
from planning.sequence.task import Task
from planning.sequence.world import World
from planning.values.deadline import Deadline

T = TypeVar("T")
#: Stages of a flat list, and lists that are tried, at most.
_MAX_STAGES, _MAX_LISTS = 2_000, 200
#: Orders that are planned beside the first at most, and in a row without a shorter one.
_MAX_ORDERS, _PATIENCE = 20, 4
Order = Literal["written", "free", "shortest"]


@dataclass(frozen=True, slots=True)
class Each(Generic[T]):
    """Stages once for each of several items.

    Args:
        items: Names of the items, in the order that is tried first.
        stages: Maker of the blocks for one item; the argument has the numbers of all items up to
            this one, in the order that is tried.
        order: Order of the items: as written; "free" for another one where this one can't be done;
            or the "shortest" that is found in time.
        by_place: Whether places go by the number of items before, not by item.
    """

    items: Sequence[str]
    stages: Callable[[Sequence[int]], "Sequence[Block[T]]"]
    order: Order = "written"
    by_place: bool = False


@dataclass(frozen=True, slots=True)
class Fallback(Generic[T]):
    """Alternatives in order; the first that can be done with all that follows is taken.

    Args:
        alternatives: Blocks of each.
    """

    alternatives: "Sequence[Sequence[Block[T]]]"


Block: TypeAlias = T | Each[T] | Fallback[T]


class Flat(NamedTuple, Generic[T]):
    """A stage of a flat list.

    Args:
        stage: The stage.
        of: The item or alternative that it is for; None outside of blocks.
    """

    stage: T
    of: str | None


class _Choice(NamedTuple):
    first: int
    taken: int
    among: int


class _Ordered(NamedTuple):
    """A block in its order, with its stages in the flat list.

    Args:
        block: The block.
        digit: Number of its first choice.
        visits: Items in their order, each with its stages.
    """

    block: Each[Any]
    digit: int
    visits: tuple[Visit, ...]

    def digits_of(self, order: Sequence[int]) -> list[int]:
        """Digits that an order of its items is."""
        left = [*range(len(order))]
        digits = []
        for item in order:
            digits.append(left.index(item))
            left.remove(item)
        return digits


class _Expansion(Generic[T]):
    """One flat list with the choices that it makes."""

    def __init__(self, digits: Sequence[int]) -> None:
        self._digits = digits
        self.flat: list[Flat[T]] = []
        self.choices: list[_Choice] = []
        self.ordered: list[_Ordered] = []

    @property
    def digits(self) -> list[int]:
        """Digits of all its choices."""
        return [one.taken for one in self.choices]

    def add(self, blocks: "Sequence[Block[T]]", of: str | None) -> None:
        """Add blocks that are for an item or alternative."""
        for block in blocks:
            if isinstance(block, Each):
                self._add_each(block, of)
            elif isinstance(block, Fallback):
                taken = self._take(len(block.alternatives))
                self.add(block.alternatives[taken], _label(of, f"alternative {taken}"))
            else:
                self.flat.append(Flat(block, of))
        if len(self.flat) > _MAX_STAGES:
            raise InvalidOption(f"there are more than {_MAX_STAGES} stages in all")

    def _add_each(self, block: Each[T], of: str | None) -> None:
        left, order, visits = [*range(len(block.items))], list[int](), list[Visit]()
        digit, shortest = len(self.choices), block.order == "shortest"
        while left:
            order.append(left.pop(0 if block.order == "written" else self._take(len(left))))
            first, choices = len(self.flat), len(self.choices)
            self.add(block.stages(order), _label(of, block.items[order[-1]]))
            visits.append(Visit(order[-1], first, len(self.flat)))
            if shortest and (of is not None or len(self.choices) > choices):
                raise InvalidOption(
                    'order "shortest" is for items whose stages have no alternatives, and that are '
                    "none of an item or alternative",
                    hint='Take order "free", or put the block by itself.',
                )
        if shortest:
            self.ordered.append(_Ordered(block, digit, tuple(visits)))

    def _take(self, count: int) -> int:
        k = len(self.choices)
        taken = self._digits[k] if k < len(self._digits) else 0
        self.choices.append(_Choice(len(self.flat), taken, count))
        return taken


def _label(of: str | None, own: str) -> str:
    return own if of is None else f"{of}, {own}"


@typed
def regrasp(
    before: Sequence[Stage],
    poses: ArrayLike,
    supports: Sequence[str] = (),
    grasps: ArrayLike | None = None,
    most: int = 1,
    distance: tuple[float, float] = (0.02, 0.08),
) -> Fallback[Stage]:
    """Alternatives that put a held object down and grasp it again, where one grasp does not do.

    Args:
        before: Stages before it, from the grasp of the object on or longer, with its attachment.
        poses: T_root_object where it may be put down, such as ``resting_places``, shape (k, 4, 4).
        supports: Obstacles that it stands on there.
        grasps: T_object_tool of the grasps after, shape (k, 4, 4); those before where None.
        most: How often at most.
        distance: Shortest and longest way down to the place, and of the tool off it [m].

    Raises:
        InvalidOption: No grasp and attachment of one object are before, or it is let go again.
    """
    numbers = [k for k, one in enumerate(before) if isinstance(one, Grasp)]
    held = [one for one in before if isinstance(one, Attach | Detach)]
    if not numbers or not held or not isinstance(held[-1], Attach):
        raise InvalidOption(
            "regrasp: nothing is grasped and attached before it",
            hint="Give the stages from the grasp to the attachment or the lift of the object.",
        )
    k, support = numbers[-1], tuple(supports)
    grasp = before[k]
    assert isinstance(grasp, Grasp)
    again = replace(grasp, support=support)
    if grasps is not None:
        again = replace(again, frames=np.asarray(grasps, dtype=np.float64))
    first = k - 2 if k > 1 and isinstance(before[k - 1], Straight) else k
    opened = [one for one in before[:k] if isinstance(one, Gripper) and one.kind == "open"]
    own: list[Stage] = [*before[first:k], again, *before[k + 1 :]]
    stages: list[Stage] = [
        Move(),
        Straight("approach", [0.0, 0.0, -1.0], "root", *distance),
        Place(held[-1].object, np.asarray(poses, dtype=np.float64), support=support),
        *(opened[-1:] or [Gripper("open")]),
        Detach(),
        Straight("retreat", [0.0, 0.0, -1.0], "tool", *distance),
        *(replace(one, settings=replace(one.settings, name="")) for one in own),
    ]
    return Fallback([stages * count for count in range(most + 1)])


Attempt: TypeAlias = Callable[[Sequence[Flat[T]], TaskOptions], SequencePlan | SequenceFailure]


class BlocksPlan(NamedTuple):
    """The plan of a flat list.

    Args:
        outcome: The plan, or the failure that came farthest.
        orders: Orders that were to be the shortest, as they were found.
    """

    outcome: SequencePlan | SequenceFailure
    orders: tuple[FoundOrder, ...] = ()


def plan_blocks(
    blocks: Sequence[Any], options: TaskOptions, attempt: Attempt[T], seed: int = 0
) -> BlocksPlan:
    """The plan of the first flat list that can be done; else the failure that came farthest.

    Args:
        blocks: Stages of the type T, and blocks of them, in order.
        options: Timeout of everything, and options of each list.
        attempt: Plans one flat list within the timeout that its options have.
        seed: Seed of the search for the shortest order.

    Raises:
        InvalidOption: There are too many stages, or a shortest order is asked for inside of items.
    """
    deadline, digits, failed = Deadline.after(options.timeout), list[int](), None
    for _ in range(_MAX_LISTS):
        expansion = _Expansion[T](digits)
        expansion.add(blocks, None)
        choices = expansion.choices
        others = any(one.taken + 1 < one.among for one in choices)
        # A list that has others after it leaves them half of the time.
        left = max(deadline.remaining, 1e-3) * (0.5 if others else 1.0)
        found = attempt(expansion.flat, replace(options, timeout=left))
        failure = found.failure if isinstance(found, SequencePlan) else found
        if failure is None:
            assert isinstance(found, SequencePlan)
            return _shortened(blocks, (expansion, found), options, attempt, deadline, seed)
        if failed is None or failure.reached > failed[0]:
            failed = failure.reached, found
        ready = [
            k for k, one in enumerate(choices)
            if one.first <= failure.reached and one.taken + 1 < one.among
        ]  # fmt: skip
        if not ready or deadline.passed:
            break
        k = ready[-1]
        digits = [*(one.taken for one in choices[:k]), choices[k].taken + 1]
    assert failed is not None
    return BlocksPlan(failed[1])


def _shortened(
    blocks: Sequence[Any], first: tuple[_Expansion[T], SequencePlan], options: TaskOptions,
    attempt: Attempt[T], deadline: Deadline, seed: int,
) -> BlocksPlan:  # fmt: skip
    """Other orders in place of those that can be done, as long as they take less time.

    Args:
        blocks: Stages, and blocks of them, in order.
        first: The first flat list that can be done, and its plan.
        options: Options of each list.
        attempt: Plans one flat list.
        deadline: The end of everything.
        seed: Seed of the search.
    """
    (best, found), orders = first, []
    for number, begun in enumerate(best.ordered):
        names, end = begun.block.items, begun.digit + len(begun.visits)
        written = None if any(best.digits[begun.digit : end]) else found.duration
        search = OrderSearch(len(names), begun.block.by_place, seed)
        search.learn(begun.visits, found.stages)
        since = 0
        for _ in range(_MAX_ORDERS):
            order = search.propose(deadline)
            if order is None or since == _PATIENCE or deadline.passed:
                break
            digits = best.digits
            digits[begun.digit : end] = begun.digits_of(order)
            other = _Expansion[T](digits)
            other.add(blocks, None)
            left = replace(options, timeout=max(deadline.remaining, 1e-3))
            tried, visits = attempt(other.flat, left), other.ordered[number].visits
            if isinstance(tried, SequenceFailure) or not tried.complete:
                stage = tried.reached if isinstance(tried, SequenceFailure) else len(tried.stages)
                search.rule_out(visits, stage)
                continue
            since += 1
            search.learn(visits, tried.stages)
            if tried.duration < found.duration:
                best, found, since = other, tried, 0
        taken = tuple(names[visit.item] for visit in best.ordered[number].visits)
        orders.append(FoundOrder(taken, found.duration, written))
    return BlocksPlan(found, tuple(orders))


def plan_work(
    world: World,
    start: Array,
    blocks: "Sequence[Block[Stage]]",
    options: TaskOptions,
    seed: int = 0,
) -> SequencePlan | SequenceFailure:
    """Find, time and prove the motions of stages, some of them in an order that is left open.

    Args:
        world: The robot and the scene at the start.
        start: Configuration of the arm, shape (n,) [rad or m].
        blocks: Stages, and blocks of them, in order.
        options: Timeout and time to improve.
        seed: Seed of everything random.

    Raises:
        ArmwrightError: As ``Task`` and ``plan_task``.
    """

    def attempt(flat: Sequence[Flat[Stage]], own: TaskOptions) -> SequencePlan | SequenceFailure:
        return plan_task(Task(world, start, tuple(one.stage for one in flat), seed), own)

    found = plan_blocks(blocks, options, attempt, seed)
    if isinstance(found.outcome, SequencePlan):
        return replace(found.outcome, orders=found.orders)
    return found.outcome

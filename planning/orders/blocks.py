"""Blocks of stages whose order or alternative is left open, planned one flat list after another.

The choices that a flat list makes are digits, in the order of its stages. Where a list gets stuck
at a stage, all lists with the same digits up to that stage get stuck there too: the last digit
before it is the next to change.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.sequence.result import SequenceFailure, SequencePlan, TaskOptions
from planning.sequence.search import plan_task
from planning.sequence.stage import Stage
from planning.sequence.task import Task
from planning.sequence.world import World
from planning.values.deadline import Deadline

T = TypeVar("T")
#: Stages of a flat list, and lists that are tried, at most.
_MAX_STAGES, _MAX_LISTS = 2_000, 200


@dataclass(frozen=True, slots=True)
class Each(Generic[T]):
    """Stages once for each of several items.

    Args:
        items: Names of the items, in the order that is tried first.
        stages: Maker of the blocks for one item; the argument has the numbers of all items up to
            this one, in the order that is tried.
        free: Whether another order may be taken.
    """

    items: Sequence[str]
    stages: Callable[[Sequence[int]], "Sequence[Block[T]]"]
    free: bool = False


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


class _Expansion(Generic[T]):
    """One flat list with the choices that it makes."""

    def __init__(self, digits: Sequence[int]) -> None:
        self._digits = digits
        self.flat: list[Flat[T]] = []
        self.choices: list[_Choice] = []

    def add(self, blocks: "Sequence[Block[T]]", of: str | None) -> None:
        """Add blocks that are for an item or alternative."""
        for block in blocks:
            if isinstance(block, Each):
                left, order = [*range(len(block.items))], list[int]()
                while left:
                    order.append(left.pop(self._take(len(left)) if block.free else 0))
                    self.add(block.stages(order), _label(of, block.items[order[-1]]))
            elif isinstance(block, Fallback):
                taken = self._take(len(block.alternatives))
                self.add(block.alternatives[taken], _label(of, f"alternative {taken}"))
            else:
                self.flat.append(Flat(block, of))
        if len(self.flat) > _MAX_STAGES:
            raise InvalidOption(f"there are more than {_MAX_STAGES} stages in all")

    def _take(self, count: int) -> int:
        k = len(self.choices)
        taken = self._digits[k] if k < len(self._digits) else 0
        self.choices.append(_Choice(len(self.flat), taken, count))
        return taken


def _label(of: str | None, own: str) -> str:
    return own if of is None else f"{of}, {own}"


def plan_blocks(
    blocks: Sequence[Any],
    options: TaskOptions,
    attempt: Callable[[Sequence[Flat[T]], TaskOptions], SequencePlan | SequenceFailure],
) -> SequencePlan | SequenceFailure:
    """The plan of the first flat list that can be done; else the failure that came farthest.

    Args:
        blocks: Stages of the type T, and blocks of them, in order.
        options: Timeout of everything, and options of each list.
        attempt: Plans one flat list within the timeout that its options have.

    Raises:
        InvalidOption: There are too many stages.
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
            return found
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
    return failed[1]


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

    return plan_blocks(blocks, options, attempt)

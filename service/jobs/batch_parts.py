"""Parts of a batch, each planned by a worker in one go: problems that begin alike."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from service.tasks.chunk_sizes import TURN
from service.tasks.result import BatchItem

#: Problems of a part at most: quicker ones than half a millisecond there are not.
_LARGEST = 64
#: Size of the problems of a part at most, unless it is one alone [byte].
_BYTES = 256 * 1024
#: Parts that each worker gets of what is left: the last ones are small, so that all workers end at
#: about the same time.
_TURNS = 2
#: Problems of a part, by those that a worker plans in its turn: what it does not come to was sent
#: and validated in vain, and a part that is too short ends its turn early.
_SPARE = 1.5


@dataclass(frozen=True, slots=True)
class Part:
    """Problems of a batch for one worker.

    Args:
        indices: Which of the batch, at least one.
        contents: What the batch says of each alone, JSON.
    """

    indices: Sequence[int]
    contents: Sequence[bytes]

    def request(self, head: bytes) -> bytes:
        """The part as a batch of its own, JSON.

        Args:
            head: The fields of the batch that stand beside its problems, each with a comma.
        """
        return b'{%s"problems":[%s]}' % (head, b",".join(self.contents))


class Parts:
    """The problems of a batch that wait.

    Args:
        items: All problems.
    """

    def __init__(self, items: Sequence[BatchItem]) -> None:
        self._items = items
        self._waiting = deque(range(len(items)))
        self._alone: set[int] = set()

    def take(self, workers: int, mean: float = 0.0) -> Part | None:
        """The next problems for one of some workers; None if none wait.

        They have the same robot, scene and timeout.

        Args:
            workers: That share what is left.
            mean: Time of a problem, if it is known [s].
        """
        if not self._waiting:
            return None
        largest = min(_LARGEST, math.ceil(len(self._waiting) / (_TURNS * workers)))
        if mean > 0.0:
            largest = min(largest, math.ceil(_SPARE * TURN / mean))
        first = self._waiting.popleft()
        indices, size = [first], len(self._items[first].content)
        if first not in self._alone:
            while self._waiting and len(indices) < largest:
                index = self._waiting[0]
                size += len(self._items[index].content)
                if size > _BYTES or index in self._alone or not self._begin_alike(first, index):
                    break
                indices.append(self._waiting.popleft())
        return Part(indices, [self._items[index].content for index in indices])

    def put_back(self, indices: Sequence[int], *, alone: bool = False) -> None:
        """Have problems wait again, before all others.

        Args:
            indices: In order.
            alone: Whether each is to be a part of its own from then on.
        """
        self._waiting.extendleft(reversed(indices))
        if alone:
            self._alone.update(indices)

    def _begin_alike(self, one: int, other: int) -> bool:
        first, second = self._items[one], self._items[other]
        return (first.robot, first.scene, first.shared, first.timeout) == (
            second.robot,
            second.scene,
            second.shared,
            second.timeout,
        )

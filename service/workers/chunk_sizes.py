"""Sizes of the chunks into which a batch is cut, so that each takes a few seconds."""

import math
from dataclasses import dataclass

#: Time that a chunk takes at most [s]: what is lost with a machine, and what others wait for.
LONGEST = 3.0
#: Time that a chunk takes at least [s]: some ten times what it costs the engine. Agents end as far
#: apart as the last chunks last.
SHORTEST = 0.1
#: A batch that one agent does within this stays whole [s].
_WHOLE = 0.5
#: Time after which a worker begins with no further problem of a part [s]: to hand out a part costs
#: as much as half a plan, and what somebody waits for takes the worker if this lasts much longer.
TURN = 0.04
#: Chunks that each worker gets while there is enough left: the last ones are small, so that all
#: workers end at about the same time.
_TURNS = 2


@dataclass(frozen=True, slots=True)
class Pace:
    """Speed at which problems are worked on.

    Args:
        mean: Mean duration of one problem in one worker [s].
        workers: Workers of one agent.
        all_workers: Workers of all agents together.
    """

    mean: float
    workers: int
    all_workers: int


def chunk_sizes(count: int, pace: Pace) -> list[int]:
    """Numbers of problems in the chunks of a batch, which become smaller towards its end.

    Each chunk is the rest's share of one agent in `_TURNS` turns, and takes from `SHORTEST` to
    `LONGEST` (guided self-scheduling, Polychronopoulos and Kuck 1987).

    Args:
        count: Problems of the batch.
        pace: Pace of the agents.
    """
    rate = pace.workers / max(pace.mean, 1e-6)
    share = pace.workers / (_TURNS * max(pace.all_workers, pace.workers))
    smallest = max(math.ceil(SHORTEST * rate), pace.workers)
    largest = max(math.ceil(LONGEST * rate), smallest)
    if count <= math.ceil(_WHOLE * rate):
        return [count]
    sizes = []
    while count > 0:
        size = min(max(math.ceil(count * share), smallest), largest, count)
        sizes.append(size)
        count -= size
    return sizes

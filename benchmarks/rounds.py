"""Processor times of calls that take turns, so that a busy machine disturbs all of them alike."""

import time
from collections.abc import Callable, Mapping

import numpy as np

from kinematics.arrays import Array


def rounds(
    calls: Mapping[str, Callable[[], object]], count: int, each: Mapping[str, int] | None = None
) -> dict[str, Array]:
    """Processor times of each call, one a round, after a call that is not counted [us].

    Args:
        calls: Calls by name, in the order of their turns.
        count: Number of the rounds.
        each: Number of times that calls are made in their turns, by name, 1 if left out; the mean
            is the time of the turn.
    """
    spent = {name: np.empty(count) for name in calls}
    for call in calls.values():
        call()
    for number in range(count):
        for name, call in calls.items():
            times = (each or {}).get(name, 1)
            began = time.process_time()
            for _ in range(times):
                call()
            spent[name][number] = 1e6 * (time.process_time() - began) / times
    return spent


def once(call: Callable[[], object], count: int = 5) -> float:
    """Median processor time of a call, all of its threads together [us]."""
    return float(np.median(rounds({"": call}, count)[""]))

"""Garbage in cycles, collected while the server has nothing else to do.

Whoever looks for garbage looks at everything that lives, and nobody is answered meanwhile. What is
loaded at the start takes a tenth of a second each time, requests that wait with hundreds of poses
half of that. All of it lives on, so that it is looked at in vain.
"""

import asyncio
import gc
import time
from collections.abc import Callable

#: Between two looks whether there is time to collect [s].
_PERIOD = 1.0
#: Under load that never ends everything is collected after this nevertheless [s].
_LONGEST = 30.0
#: Collections of young objects after which the interpreter collects everything by itself: never.
_NEVER = 1_000_000_000


def leave_out_what_is_loaded() -> None:
    """Look for garbage among what is made from now on, and by itself among the young only."""
    gc.freeze()
    young, middle, _ = gc.get_threshold()
    gc.set_threshold(young, middle, _NEVER)


async def collect_when_idle(
    has_work: Callable[[], bool], period: float = _PERIOD, longest: float = _LONGEST
) -> None:
    """Collect everything while nobody waits for an answer, for ever.

    Args:
        has_work: Whether somebody waits.
        period: Between two looks [s].
        longest: Time after which everything is collected though somebody waits [s].
    """
    collected = time.monotonic()
    while True:
        await asyncio.sleep(period)
        is_free, now = not has_work(), time.monotonic()
        # Without collections of the young nothing has grown old.
        if (is_free or now - collected >= longest) and gc.get_count()[2]:
            gc.collect()
            collected = now
        elif is_free:
            collected = now

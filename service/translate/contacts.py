"""Pairs that may touch, as requests give them and answers tell them."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

from armwright_wire.scenes.scene import AllowedItem, LimitedPair
from obstacles.robots.allowed_pairs import Overlap
from obstacles.robots.robot_geometry import sorted_pair
from obstacles.scenes.scene import AllowedContact, Pair


def touch_depth(given: float | None) -> float:
    """A depth of a request [m]; null allows any."""
    return math.inf if given is None else given


def contacts(items: Sequence[AllowedItem] | None, reason: str) -> dict[Pair, AllowedContact]:
    """The pairs that a request or a scene allows to touch.

    Args:
        items: Pairs of names, or such pairs with a depth.
        reason: Reason: who allows the pairs.
    """
    made = {}
    for item in items or ():
        pair, depth = (
            (item.pair, touch_depth(item.touch_depth))
            if isinstance(item, LimitedPair)
            else (item, math.inf)
        )
        made[sorted_pair(pair[0], pair[1])] = AllowedContact(reason, depth)
    return made


def allowed_answer(told: Iterable[Overlap]) -> list[dict[str, Any]]:
    """Pairs that were not kept apart, as answers tell them."""
    return [
        {"pair": list(item.pair), "reason": item.reason, "overlap": item.overlap} for item in told
    ]

"""Preferred clearance: distances that paths keep wherever there is room for them.

The margin of a problem is a condition, which the certificate proves. The preferred clearance is a
wish: paths, shortcuts and blends keep it where they can, and then a half of it, before they
come as near as the margin allows.
"""

from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from obstacles.checker import Checker
from planning.preferred_clearance import PreferredClearance

#: Parts of the preferred clearance that are tried in turn.
_SHARES = (1.0, 0.5)


def clearance_levels(checker: Checker, preferred: PreferredClearance) -> tuple[Checker, ...]:
    """Checkers of falling clearance: the preferred one, a half of it, and what is needed.

    Args:
        checker: The robot in its scene, with the margins and the slack that have to be kept.
        preferred: Distances to be kept where there is room.

    Returns:
        The checkers, the last of them ``checker`` itself.
    """
    model = checker.model
    levels: list[Checker] = []
    for share in _SHARES:
        distance = share * preferred.obstacles
        if distance > model.margin + checker.slack:
            own = max(share * preferred.own_links, model.own_margin + checker.slack)
            levels.append(Checker(model.with_margins(distance, own)))
    return (*levels, checker)


def highest_level(
    levels: Sequence[Checker], start: Array, goals: Sequence[Array]
) -> tuple[Checker, list[Array]] | None:
    """The highest level above the last that the start and a goal keep, with the goals that do.

    Args:
        levels: As ``clearance_levels`` gives them.
        start: Shape (n,) [rad or m].
        goals: Configurations (n,).
    """
    for level in levels[:-1]:
        if len(goals) == 1:
            if level.all_valid(np.array([start, goals[0]])):
                return level, list(goals)
        elif level.valid(start):
            kept = [np.asarray(goal) for goal in goals if level.valid(goal)]
            if kept:
                return level, kept
    return None

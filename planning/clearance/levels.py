"""Preferred clearance: distances that paths keep wherever there is room for them.

The margin of a problem is a condition, which the certificate proves. The preferred clearance is a
wish: paths, shortcuts and blends keep it where they can, and then a half of it, before they
come as near as the margin allows.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.caches.bounded_cache import bounded_cache
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.values.preferred_clearance import PreferredClearance

#: Parts of the preferred clearance that are tried in turn.
_SHARES = (1.0, 0.5)
#: What paths keep beyond the preferred clearance where they can, for rounded corners and splines:
#: a share of it, and at most so much [m].
_RESERVE = 0.16, 5e-3
#: What motions keep beyond it, so that bounds of the certificate show it, likewise.
_SPARE = 0.06, 1.5e-3
#: Random configurations in which own links are looked at that are nearer than preferred in all.
_LOOKS = 8
#: Share that is preferred of the most that such links are apart: the rest is rounding.
_KEPT = 0.98


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
    among_links = preferred.own_links
    if preferred.obstacles > model.margin + checker.slack and among_links > 0.0:
        among_links = min(among_links, _own_room(model.robot, among_links))
    for share in _SHARES:
        distance = share * preferred.obstacles
        if distance > model.margin + checker.slack:
            own = max(share * among_links, model.own_margin + checker.slack)
            levels.append(Checker(model.with_margins(distance, own)))
    return (*levels, checker)


@bounded_cache(maxsize=256)
def _own_room(robot: RobotGeometry, wanted: float) -> float:
    """Distance between own links that can be preferred where ``wanted`` [m] is not to be had.

    Some links are built nearer to each other than that, and stay so wherever the arm is, as those
    of a wrist about one axis do: to retreat from them would be in vain. What they are apart at most
    bounds what is preferred, the reserve counted.
    """
    room = wanted + min(_RESERVE[0] * wanted, _RESERVE[1])
    checker, random = Checker.of(robot, Scene()), np.random.default_rng(0)
    low, high = robot.chain.sampling_bounds()

    def look() -> dict[int, float]:
        pairs, distances, _ = checker.gradient(random.uniform(low, high), room)
        return dict(zip(pairs.tolist(), distances.tolist(), strict=True))

    apart = look()
    for _ in range(_LOOKS - 1):
        if not apart:
            break
        near = look()
        apart = {pair: max(d, near[pair]) for pair, d in apart.items() if pair in near}
    if not apart:
        return wanted
    return max(_KEPT * min(apart.values()) / (1.0 + _RESERVE[0]), 0.0)


class Room(NamedTuple):
    """A preferred clearance that a whole path is to keep.

    Args:
        look: With a reserve for rounded corners and splines: paths are looked for with it.
        kept: What paths are proved to keep, and motions where they can.
        preferred: The preferred clearance.
    """

    look: Checker
    kept: Checker
    preferred: Checker


def rooms(levels: Sequence[Checker]) -> Iterator[Room]:
    """The preferred clearance with that between own links, and then with what is needed there.

    Args:
        levels: As ``clearance_levels`` gives them, two at least.
    """
    kept, least = levels[0], levels[-1]
    yield _room(kept)
    own = least.model.own_margin + least.slack
    if len(kept.model.robot.self_pairs) and own < kept.model.own_margin:
        yield _room(Checker(kept.model.with_margins(kept.model.margin, own), kept.slack))


def _room(level: Checker) -> Room:
    return Room(_with_more(level, *_RESERVE), _with_more(level, *_SPARE), level)


def _with_more(level: Checker, share: float, most: float) -> Checker:
    margin, own = level.model.margin, level.model.own_margin
    margin, own = margin + min(share * margin, most), own + min(share * own, most)
    return Checker(level.model.with_margins(margin, own), level.slack)


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

"""Preferred clearance: distances that paths keep wherever there is space for them.

The margin of a problem is a condition, which the certificate proves. The preferred clearance is a
wish: paths, shortcuts and blends keep it where they can, and then a half of it, before they
come as near as the margin allows.

A search for a path that keeps it all along is lost time where there is none. So it is short where
checks of states show beforehand that it mostly leads nowhere: where self-collision pairs are in the
way, and where the straight motion comes near something that it does not meet, which trees rarely
find a way around.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.caches.bounded_cache import bounded_cache
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.values.preferences import PreferredClearance

#: Edges that a search may check after which others follow: most paths are found within many, and
#: those that few do not find are rarely there.
MANY_EDGES, FEW_EDGES = 2000, 500
#: Distance that paths keep beyond the preferred clearance where they can, for rounded corners and
#: splines: a share of it, and at most so much [m].
_RESERVE = 0.16, 5e-3
#: Shares of a straight leg at which its states are checked, shape (24, 1).
_SHARES = np.linspace(0.0, 1.0, 24)[:, None]


def clearance_levels(checker: Checker, preferred: PreferredClearance) -> tuple[Checker, ...]:
    """Checkers of falling clearance: the preferred one, a half of it, and what is needed.

    Args:
        checker: The robot in its scene, with the margins and the slack that have to be kept.
        preferred: Distances to be kept where there is space.

    Returns:
        The checkers, the last of them ``checker`` itself.
    """
    model = checker.model
    levels: list[Checker] = []
    among_links = preferred.own_links
    if preferred.obstacles > model.margin + checker.slack and among_links > 0.0:
        among_links = min(among_links, _own_clearance(model.robot, among_links))
    for share in (1.0, 0.5):
        distance = share * preferred.obstacles
        if distance > model.margin + checker.slack:
            own = max(share * among_links, model.own_margin + checker.slack)
            levels.append(Checker(model.with_margins(distance, own)))
    return (*levels, checker)


@bounded_cache(maxsize=256)
def _own_clearance(robot: RobotGeometry, wanted: float) -> float:
    """Distance of self-collision pairs that can be preferred where not all keep ``wanted`` [m].

    Some links are built nearer to each other than that, and stay so wherever the arm is, as those
    of a wrist about one axis do: to retreat from them would be in vain. The most that they are
    apart in some random configurations bounds what is preferred, the reserve counted.
    """
    within = wanted + min(_RESERVE[0] * wanted, _RESERVE[1])
    checker, random = Checker.of(robot, Scene()), np.random.default_rng(0)
    low, high = robot.chain.sampling_bounds()

    def draw() -> dict[int, float]:
        pairs, distances, _ = checker.gradient(random.uniform(low, high), within)
        return dict(zip(pairs.tolist(), distances.tolist(), strict=True))

    apart = draw()
    for _ in range(7):
        if not apart:
            break
        near = draw()
        apart = {pair: max(d, near[pair]) for pair, d in apart.items() if pair in near}
    if not apart:
        return wanted
    # Two hundredths are for rounding.
    return max(0.98 * min(apart.values()) / (1.0 + _RESERVE[0]), 0.0)


class ClearanceLevel(NamedTuple):
    """Preferred clearance that a whole path is to keep.

    Args:
        planned: Checks paths, with a reserve for rounded corners and splines.
        kept: Checks that paths are proved to keep, and motions where they can.
        preferred: Checks the preferred clearance itself.
    """

    planned: Checker
    kept: Checker
    preferred: Checker


def path_levels(levels: Sequence[Checker]) -> Iterator[ClearanceLevel]:
    """The preferred clearance of all pairs, then with what self-collision pairs need alone.

    Args:
        levels: As ``clearance_levels`` gives them, two at least.
    """
    kept, least = levels[0], levels[-1]
    yield _path_level(kept)
    own = least.model.own_margin + least.slack
    if len(kept.model.robot.self_pairs) and own < kept.model.own_margin:
        yield _path_level(Checker(kept.model.with_margins(kept.model.margin, own), kept.slack))


def _path_level(level: Checker) -> ClearanceLevel:
    # Motions keep somewhat more too, so that bounds of the certificate show it.
    planned, kept = _with_more(level, *_RESERVE), _with_more(level, 0.06, 1.5e-3)
    with_margins, slack = level.model.with_margins, level.slack
    return ClearanceLevel(
        Checker(with_margins(*planned), slack), Checker(with_margins(*kept), slack), level
    )


def _with_more(level: Checker, share: float, most: float) -> tuple[float, float]:
    margin, own = level.model.margin, level.model.own_margin
    return margin + min(share * margin, most), own + min(share * own, most)


class ClearanceTrial(NamedTuple):
    """Search for a path that keeps a clearance all along.

    Args:
        level: The clearance.
        max_edges: Edges that trees may check.
    """

    level: ClearanceLevel
    max_edges: int


def clearance_trials(
    levels: Sequence[Checker], start: Array, goal: Array
) -> Iterator[ClearanceTrial]:
    """Searches for a path that keeps the preferred clearance all along, until one finds it.

    Where self-collision pairs are too near on the straight way between ends at which they are not,
    they are mostly so on every way: such pairs move by a joint or two.

    Args:
        levels: As ``clearance_levels`` gives them, two at least.
        start: Shape (n,) [rad or m].
        goal: Shape (n,).
    """
    following = path_levels(levels)
    level = next(following)
    states = leg_states(np.array([start, goal]))
    close = states[~level.planned.each_valid(states)]
    is_free = len(close) > 0 and levels[-1].all_valid(close)
    max_edges = FEW_EDGES if is_free else MANY_EDGES
    lower = next(following, None) if len(close) else None
    if lower is not None and lower.planned.each_valid(close).any():
        yield ClearanceTrial(level, FEW_EDGES)
        yield ClearanceTrial(lower, max_edges)
    else:
        yield ClearanceTrial(level, max_edges)


def leg_states(path: Array) -> Array:
    """States of each leg of a path (k, n), its ends among them, shape (24 (k - 1), n)."""
    legs: Array = path[:-1, None] + _SHARES * (path[1:] - path[:-1])[:, None]
    return legs.reshape(-1, path.shape[1])

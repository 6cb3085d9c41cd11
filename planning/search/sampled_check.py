"""Looks at states of straight motions, which cost a fraction of a proof and mostly tell as much."""

import math
from typing import NamedTuple

from compiled.kernel import kernel
from compiled.simd import LANES, on_stack
from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.lanes.check import blocked_between, blocked_lanes, write_states
from obstacles.collision.model.kernel_work import Workspace
from obstacles.collision.model.model_arrays import ModelArrays, at_margins

#: States of a leg that are looked at are this far apart at most, Euclidean in
#: joint space, as far as so many parts of it go. A link of a metre goes 3 cm between two of them:
#: the preferred clearance is mostly 2 cm, and corners of obstacles would reach into wider gaps.
_SPACING = 0.03
_MAX_PARTS = 64


class Look(NamedTuple):
    """Distances that states which are looked at keep.

    Args:
        margin: Margin from obstacles, beyond their own margins [m].
        own_margin: Distance between the robot's own pieces [m].
        slack: Distance from everything, beyond these [m].
    """

    margin: float
    own_margin: float
    slack: float


def look_of(checker: Checker, slack: float | None = None) -> Look:
    """Distances that a checker keeps; ``slack`` in place of its own [m]."""
    model = checker.model
    spare = checker.slack if slack is None else slack
    return Look(float(model.margin), float(model.own_margin), float(spare))


@kernel(allocates=False)
def looks_free(model: ModelArrays, work: Workspace, look: Look, a: Array, b: Array) -> bool:
    """Whether all states are free that are looked at between a and b, both (n,)."""
    parts, length = 2, distance(a, b)
    while parts < _MAX_PARTS and parts * _SPACING < length:
        parts *= 2
    looked = at_margins(model, look.margin, look.own_margin)
    return not blocked_between(looked, work, a, b, look.slack, 2, parts)


@kernel(allocates=False)
def all_look_free(
    model: ModelArrays, work: Workspace, look: Look, points: Array, first: int, last: int
) -> bool:
    """Whether all states are free that are looked at on the legs from row ``first`` to ``last``.

    They are those of ``looks_free`` on each leg, and the waypoints between. All legs are looked at
    coarsely before any is more finely, eight states at once: what is not free shows soon.
    """
    looked, shares = at_margins(model, look.margin, look.own_margin), on_stack(LANES)
    lane, parts, going = 0, 1, True
    while going:
        going = False
        for k in range(first, last):
            coarse = 0.5 * parts * _SPACING < distance(points[k], points[k + 1])
            if parts > _MAX_PARTS or (parts > 2 and not coarse) or (parts == 1 and k == last - 1):
                continue
            going, part = True, 1
            while part <= parts:
                begin = lane
                while part <= parts and lane < LANES:
                    shares[lane] = part / parts
                    lane, part = lane + 1, part + 2
                write_states(work, points[k], points[k + 1], shares, begin, lane)
                if lane == LANES:
                    if blocked_lanes(looked, work, look.slack, 0xFF, 0xFF, 0) != 0:
                        return False
                    lane = 0
        going, parts = going or parts == 1, 2 * parts
    if lane == 0:
        return True
    every = (1 << lane) - 1
    return blocked_lanes(looked, work, look.slack, every, every, 0) == 0


@kernel(allocates=False)
def distance(a: Array, b: Array) -> float:
    """Euclidean distance of two configurations (n,)."""
    square = 0.0
    for k in range(a.shape[0]):
        square += (b[k] - a[k]) ** 2
    return math.sqrt(square)

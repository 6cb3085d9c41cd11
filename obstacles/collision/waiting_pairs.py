"""Pairs that wait until the intervals of a motion are shorter, and groups of own pairs that do.

Nodes of a tree and groups stand for all pairs below them: to part them pays once the motion over an
interval is no longer than they are.
"""

from typing import NamedTuple

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.collision.model.kernel_work import Workspace, pair_stray, place
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_groups import BALL, FIRST_PAIR, OTHER_BALL, PARTED, SIZE
from obstacles.distance.bounds import balls_apart
from obstacles.distance.bvh import FIRST
from obstacles.distance.piece_set import RADIUS

#: What floating point may have cost a distance of a few metres [m], with room to spare.
ROUNDING_ERROR = 1e-9
#: A node is entered once the motion is less than this many times its size: above, halving the
#: interval settles more than going down.
COARSE = 1.0

# Places in Workspace.tally: of an interval, but for the looks, which are those of an edge.
CLEARANCE, SHARE, STOPPED, LOOKS = 0, 1, 2, 3


class Entries(NamedTuple):
    """Pairs that are not settled yet.

    Args:
        pairs: Pairs as ``ModelArrays.roots`` has them, shape (e, 2).
        axes: Axes across which they part, 0 where none is known, shape (e, 3).
    """

    pairs: Indices
    axes: Array


@kernel(allocates=False)
def pair_of(model: ModelArrays, entry: Indices) -> int:
    """A pair that an entry stands for."""
    p, m = model.skipped.shape[0], model.scene.shape[0]
    i, k = entry[0], entry[1]
    if i < 0:
        group = -1 - i
        while model.groups[group, PARTED] < 0:
            group += 1
        return int(p * m + model.groups[group, FIRST_PAIR])
    if i >= p:
        return int(p * m + i - p)
    if k >= 0:
        return int(i * m + k)
    node = -1 - k
    while model.nodes[node, FIRST] < 0.0:
        node += 1
    return int(i * m + model.items[int(model.nodes[node, FIRST])])


@kernel(allocates=False)
def next_group(
    model: ModelArrays, work: Workspace, margin: float, group: int, after: int, left: Entries,
    kept: int,
) -> tuple[int, int]:  # fmt: skip
    """The next of some groups that no other parts, without those that are apart or wait.

    Args:
        model: The packed robot and scene.
        work: The workspace, at an interval.
        margin: Asked for on top of the pairs' own margins [m].
        group: The first group.
        after: The one behind the last.
        left: Stack of groups that wait.
        kept: How many entries wait there.

    Returns:
        The group, ``after`` where there is none, and how many wait then, -1 where there is no room.
    """
    placed, tally, extra = work.placed, work.tally, model.own_margin + margin
    while group < after and model.groups[group, PARTED] < 0:
        a, b = model.groups[group, BALL], model.groups[group, OTHER_BALL]
        place(model, work, a)
        place(model, work, b)
        most = pair_stray(model.chain, model.joints, work.strays, a, b)
        proved = balls_apart(placed, a, b) - most - extra
        if proved > ROUNDING_ERROR:
            tally[CLEARANCE] = min(tally[CLEARANCE], proved)
        elif most > COARSE * max(placed[a, RADIUS], placed[b, RADIUS]):
            if kept == left.pairs.shape[0]:
                return after, -1
            left.pairs[kept, 0], left.pairs[kept, 1] = -1 - group, 0
            kept += 1
            tally[SHARE] = 0.0
        else:
            group += 1
            continue
        group += model.groups[group, SIZE]
    return group, kept

"""Pairs of pieces on an interval of a motion: is one apart all over it, or only on a share?

``edge_check`` says what counts as far enough apart.
"""

from compiled.kernel import kernel
from kinematics.arrays import Array
from obstacles.collision.model.kernel_work import Workspace, pair_drift, pair_stray
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_grid import grid_bound
from obstacles.collision.waiting_pairs import CLEARANCE, LOOKS, ROUNDING_ERROR, SHARE, STOPPED
from obstacles.distance.bounds import balls_apart, quick_bound
from obstacles.distance.gjk import BETWEEN, CLOSER, FARTHER, STILL, allowance, separation
from obstacles.distance.piece_set import NODE_STOP, Pair, Shapes
from obstacles.distance.triangles.distance import LOOKS as LOOKED_AT
from obstacles.distance.triangles.motion import surface_share

#: A bound this small [m] that still does not separate a pair is contact within its margin.
_RESOLUTION = 1e-6
#: Share of a pair's proved surroundings of the middle that is used: the rest is clearance left.
_TRUSTED = 0.9
#: A cover that is apart by less than this share of the motion hardly is.
_GRAZING = 0.1


@kernel(allocates=False, inline="always")
def compare_pair(
    model: ModelArrays, work: Workspace, pair: Pair, own: bool, apart: float, axes: Array, at: int
) -> int:
    """Compare a pair of pieces on the interval visited.

    Args:
        model: The packed robot and scene.
        work: The workspace, its second piece placed.
        pair: The pieces; the second is one of ``work.placed``.
        own: Whether the first is the robot's too, and not of the scene.
        apart: Margin of the pair [m].
        axes: Axes across which pairs part, shape (e, 3).
        at: The row of this pair's.

    Returns:
        FARTHER (apart all over it), CLOSER (at most ``apart`` in the middle) or BETWEEN.
    """
    a, i, placed, j = pair
    twists, strays, tally, seen = work.twists, work.strays, work.tally, i if own else -1
    enough, most = apart + ROUNDING_ERROR, pair_stray(model.chain, model.joints, strays, seen, j)
    lower, n = quick_bound(a, i, placed, j, enough + most)
    lost, verdict = most, FARTHER
    if not lower > enough + most:
        moving = STILL
        if most > 0.0:
            moving = pair_drift(model.chain, model.joints, twists, placed, strays, seen, j)
        if lower > enough:
            lost = allowance(n, moving)
        if not lower > enough + lost:
            axis = axes[at]
            if axis[0] == 0.0 and axis[1] == 0.0 and axis[2] == 0.0:
                axis[0], axis[1], axis[2] = n
            verdict, lower, _ = separation(
                pair, model.corners, model.tables, apart, enough, moving, axis, work.room
            )
            lost = allowance((axis[0], axis[1], axis[2]), moving)
            # A cover that touches proves nothing: its triangles decide, as where halving ends.
            touching = verdict == CLOSER or lower - enough < _GRAZING * lost or lost < _RESOLUTION
            covers = a[i, NODE_STOP] > 0.0 or placed[j, NODE_STOP] > 0.0
            if verdict != FARTHER and touching and covers:
                apart_in_middle, share = surface_share(
                    pair, Shapes(model.corners, model.tables, model.surfaces), apart, enough,
                    moving, axis, work.room, work.stack,
                )  # fmt: skip
                tally[LOOKS] += work.stack[0, LOOKED_AT]
                verdict = CLOSER if not apart_in_middle else FARTHER if share >= 1.0 else BETWEEN
                lower, lost = enough + share * most, most
    if verdict == BETWEEN:
        share = _TRUSTED * max(lower - enough, 0.0) / lost if lost > 0.0 else 0.0
        tally[SHARE] = min(tally[SHARE], share)
        tally[STOPPED] += lost < _RESOLUTION
        lost *= share
    if verdict == FARTHER or (verdict == BETWEEN and lost > 0.0):
        tally[CLEARANCE] = min(tally[CLEARANCE], lower - lost - apart)
    return verdict


@kernel(allocates=False, inline="always")
def own_bound(model: ModelArrays, work: Workspace, s: int, reach: float, apart: float) -> float:
    """Lower bound of the distance of pair s of the robot over the interval, margins off [m].

    Args:
        model: The packed robot and scene.
        work: The workspace, both pieces placed.
        s: The pair.
        reach: How far balls about them stray and their margin, inf where that is not known [m].
        apart: Margin of the pair [m].
    """
    a, b = model.self_pairs[s, 0], model.self_pairs[s, 1]
    proved = balls_apart(work.placed, a, b) - reach  # no piece strays as far as what it is part of
    if not proved > ROUNDING_ERROR and model.grid_axes[s, 0, 2] > 0.0:
        still = model.joints[a]
        proved = grid_bound(
            model.grid_axes, model.grid_starts, model.grid_values, s, still, work.joints
        )
        proved -= work.strays[b, 3 * still + 3] + apart
    return proved

"""The verdict on a robot's own pairs where some groups of them are parted, for there are many.

What met twice in turn is asked first: where a search is stuck, or a robot is built so, it is that
again.
"""

from compiled.kernel import kernel
from kinematics.arrays import Indices
from obstacles.collision.edge_check import COLLIDING, FREE
from obstacles.collision.exact_verdict import exact_verdict, place_whole
from obstacles.collision.model.kernel_work import LAST_GROUP, MET_TWICE, Workspace, place_ball_once
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_grid import grid_bound
from obstacles.collision.model.pair_groups import (
    BALL,
    FIRST_PAIR,
    LAST_PAIR,
    OTHER_BALL,
    PARTED,
    SIZE,
)
from obstacles.collision.waiting_pairs import ROUNDING_ERROR
from obstacles.distance.bounds import balls_apart


@kernel(allocates=False)
def group_verdict(model: ModelArrays, work: Workspace, apart: float, asked: Indices) -> int:
    """The verdict on all groups but the one that was ``asked_again``."""
    groups, group, verdict, tally = model.groups, 0, FREE, work.tally
    asked_before = int(tally[LAST_GROUP]) - 1 if tally[MET_TWICE] > 0.0 else -1
    while group < groups.shape[0]:
        here, parted = group, groups[group, PARTED] < 0
        one, other = groups[here, BALL], groups[here, OTHER_BALL]
        place_ball_once(model, work, one)
        place_ball_once(model, work, other)
        if balls_apart(work.placed, one, other) > apart + ROUNDING_ERROR:
            group += groups[here, SIZE] if parted else 1
            continue
        group += 1
        if parted or here == asked_before:
            continue
        found = _whole_verdict(model, work, here, apart, asked)
        if found == COLLIDING:
            tally[MET_TWICE] = 1.0 if tally[LAST_GROUP] == here + 1 else 0.0
            tally[LAST_GROUP] = here + 1
            return found
        verdict = max(verdict, found)
    return verdict


@kernel(allocates=False)
def asked_again(model: ModelArrays, work: Workspace, apart: float, asked: Indices) -> int:
    """The verdict on the group that met twice in turn, if one did."""
    group = int(work.tally[LAST_GROUP]) - 1
    # A workspace may be shared by parts of a model, whose groups have other numbers.
    if group < 0 or group >= model.groups.shape[0] or model.groups[group, PARTED] < 0:
        work.tally[LAST_GROUP], work.tally[MET_TWICE] = 0.0, 0.0
        return FREE
    if work.tally[MET_TWICE] == 0.0:
        return FREE
    return int(_whole_verdict(model, work, group, apart, asked))


@kernel(allocates=False)
def _whole_verdict(
    model: ModelArrays, work: Workspace, group: int, apart: float, asked: Indices
) -> int:
    """The verdict on the pairs of a group that is not parted, by their balls, grids and solids."""
    first_pair, verdict = model.skipped.shape[0] * model.scene.shape[0], FREE
    for s in range(model.groups[group, FIRST_PAIR], model.groups[group, LAST_PAIR]):
        i, j = model.self_pairs[s, 0], model.self_pairs[s, 1]
        place_ball_once(model, work, i)
        place_ball_once(model, work, j)
        if balls_apart(work.placed, i, j) > apart + ROUNDING_ERROR:
            continue
        if model.grid_axes[s, 0, 2] > 0.0:
            proved = grid_bound(
                model.grid_axes, model.grid_starts, model.grid_values, s, model.joints[i],
                work.joints,
            )  # fmt: skip
            if proved > apart + ROUNDING_ERROR:
                continue
        place_whole(model, work, i)
        found = exact_verdict(model, work, work.placed, i, j, apart, asked, first_pair + s)
        if found == COLLIDING:
            return found
        verdict = max(verdict, found)
    return verdict

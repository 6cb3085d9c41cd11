"""The exact verdict on two pieces of a configuration: by their covers, then by their triangles."""

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.collision.edge_check import COLLIDING, FREE, UNDECIDED
from obstacles.collision.model.kernel_work import Workspace, place_row
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.waiting_pairs import ROUNDING_ERROR
from obstacles.distance.bounds import quick_bound
from obstacles.distance.gjk import CLOSER, FARTHER, STILL, separation
from obstacles.distance.piece_set import NODE_STOP, Pair, Shapes
from obstacles.distance.triangles.distance import surface_distance


@kernel(allocates=False)
def exact_verdict(
    model: ModelArrays, work: Workspace, rows: Array, k: int, i: int, apart: float, asked: Indices,
    number: int,
) -> int:  # fmt: skip
    """The exact verdict on piece i of the robot and piece k of ``rows``, or a flag for it."""
    asked[0] += 1
    if asked.shape[0] > 1:
        if asked[0] < asked.shape[0]:
            asked[asked[0]] = number
        return UNDECIDED
    place_whole(model, work, i)
    enough, axis = apart + ROUNDING_ERROR, work.room[8]
    pair = Pair(rows, k, work.placed, i)
    lower, n = quick_bound(rows, k, work.placed, i, enough)
    if lower > enough:
        return FREE
    axis[0], axis[1], axis[2] = n
    verdict, _, _ = separation(
        pair, model.corners, model.tables, apart, enough, STILL, axis, work.room
    )
    if verdict != FARTHER and (rows[k, NODE_STOP] > 0.0 or work.placed[i, NODE_STOP] > 0.0):
        shapes = Shapes(model.corners, model.tables, model.surfaces)
        verdict, _ = surface_distance(pair, shapes, apart, enough, axis, work.room, work.stack)
    if verdict == FARTHER:
        return FREE
    return COLLIDING if verdict == CLOSER else UNDECIDED


@kernel(allocates=False)
def place_whole(model: ModelArrays, work: Workspace, i: int) -> None:
    """Bring piece i into the base frame if it is not there yet."""
    if work.stamps[i] != work.stamps[-1]:
        work.stamps[i] = work.stamps[-1]
        place_row(work.placed, i, model.robot, work.frames, model.joints[i])

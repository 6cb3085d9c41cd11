"""Distances of self-collision pairs that depend on one or two joints, proved on a grid of them.

A wrist's links are built close together and are near each other wherever the arm is, so no ball or
box ever parts them; but how far they are apart is a function of the joints between them alone. On a
cell of the grid the distance is at least that in its middle less what the pair can move within it.
"""

import hashlib
import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.forward import joint_frames
from kinematics.model.chain import Chain
from obstacles.collision.model.kernel_work import Workspace, place, visit, workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_groups import GROUP_WIDTH
from obstacles.convex.piece import Piece
from obstacles.distance.gjk import STILL, separation
from obstacles.distance.piece_set import Pair, PieceSet
from obstacles.kept_files import kept_array

#: Cells for a joint: where two matter, and where one does. Filling takes a microsecond a cell.
_SIDE, _LINE = 32, 512
#: A cell that loses more than this share of its distance is divided into so many parts a side.
_LOST, _PARTS = 0.5, 4
#: What rounding may have cost a distance [m].
_ROUNDING = 1e-9
#: Places between its limits at which a joint is sampled, to find the pairs that need a grid.
_SAMPLED = (0.05, 0.35, 0.65, 0.95)
#: Pairs that get a grid: a robot of many pieces has more of them than are worth the wait.
_MOST = 64


class PairGrid(NamedTuple):
    """Distances of k pairs on grids.

    Args:
        axes: Grid of each pair and each of two joints: its lowest value, cells for one unit of it,
            and the number of cells, 0 where there is no grid; shape (k, 2, 3).
        starts: Index at which each pair's distances start, shape (k,).
        values: Proved distances [m], the second joint running fastest.
    """

    axes: Array
    starts: Indices
    values: Array


@kernel(allocates=False)
def grid_bound(
    axes: Array, starts: Indices, values: Array, s: int, still: int, joints: Array
) -> float:
    """Lower bound of the distance of pair ``s``, from the grid [m].

    Args:
        axes: Axes of ``PairGrid``, as are the next two.
        starts: Index at which each pair's distances start.
        values: The distances.
        s: The pair.
        still: The joint that carries its first piece.
        joints: The configuration in its first row.
    """
    cell = 0
    for k in range(2):
        count = axes[s, k, 2]
        if count == 1.0:
            continue
        at = (joints[0, still + 1 + k] - axes[s, k, 0]) * axes[s, k, 1]
        if not 0.0 <= at < count:
            return -np.inf
        cell = cell * int(count) + int(at)
    return float(values[starts[s] + cell])


@kernel
def _fill(model: ModelArrays, axes: Array, values: Array) -> None:
    """Write the distances of the only pair of pieces there is into ``values``."""
    work, axis = workspace(model), np.zeros(3)
    middles, halves, inner, smaller = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    count = int(axes[1, 2])
    sides = (_PARTS if axes[0, 2] > 1.0 else 1, _PARTS if axes[1, 2] > 1.0 else 1)
    for cell in range(values.shape[0]):
        for k, at in enumerate((cell // count, cell % count)):
            if axes[k, 2] > 1.0:
                halves[k] = 0.5 / axes[k, 1]
                middles[k] = axes[k, 0] + (2.0 * at + 1.0) * halves[k]
        lower, lost = _proved(model, work, axis, middles, halves)
        least = lower - lost
        if lower > 0.0 and lost > _LOST * lower:
            least = np.inf
            for part in range(sides[0] * sides[1]):
                for k, at in enumerate((part // sides[1], part % sides[1])):
                    smaller[k] = halves[k] / sides[k]
                    inner[k] = middles[k] - halves[k] + (2.0 * at + 1.0) * smaller[k]
                lower, lost = _proved(model, work, axis, inner, smaller)
                least = min(least, lower - lost)
                if least <= 0.0:
                    break
        values[cell] = least - _ROUNDING


@kernel
def _proved(
    model: ModelArrays, work: Workspace, axis: Array, middles: Array, halves: Array
) -> tuple[float, float]:
    """Distance in the middle of a cell, and how much of it is lost to motion within the cell."""
    first = model.joints[0] + 1
    work.joints[:] = 0.0
    for k in range(2):
        if halves[k] > 0.0:
            work.joints[0, first + k], work.joints[1, first + k] = middles[k], halves[k]
    visit(model, work)
    place(model, work, 0)
    place(model, work, 1)
    _, lower, _ = separation(
        Pair(work.placed, 0, work.placed, 1), model.corners, model.tables, -np.inf, np.inf, STILL,
        axis, work.buffer,
    )  # fmt: skip
    return lower, work.shifts[1, 3 * first]


def pair_grid(chain: Chain, pieces: Sequence[Piece], joints: Indices, pairs: Indices) -> PairGrid:
    """The grids of all pairs (k, 2) that depend on one or two joints with limits.

    Args:
        chain: The robot.
        pieces: Pieces of the robot, each in the frame of its joint.
        joints: The joint that carries each piece.
        pairs: Two pieces each, the second one carried farther out.
    """
    axes, starts = np.zeros((len(pairs), 2, 3)), np.zeros(len(pairs), dtype=np.int64)
    chosen, length = list[_Chosen](), 0
    # The number goes up when the same pairs get other distances.
    digest = hashlib.sha256(b"pair grid 1" + chain.content_hash.encode())
    for s in _choose_pairs(chain, pieces, joints, pairs):
        i, j = pairs[s]
        first, last = int(joints[i]) + 1, int(joints[j])
        own = _axes(chain, first, last)
        assert own is not None
        axes[s], starts[s] = own, length
        length += int(own[:, 2].prod())
        chosen.append(_Chosen(pieces[i], pieces[j], first, last))
        digest.update(np.array([first, last]).tobytes() + _bytes(pieces[i]) + _bytes(pieces[j]))

    def computed() -> Array:
        return np.concatenate([np.zeros(0), *(_values(chain, *pair) for pair in chosen)])

    return PairGrid(axes, starts, kept_array(digest.hexdigest(), (length,), computed))


class _Chosen(NamedTuple):
    """A pair of pieces that gets a grid, and the joints between them."""

    a: Piece
    b: Piece
    first: int
    last: int


def _bytes(piece: Piece) -> bytes:
    """All that the cover of a piece is made of."""
    sizes = [piece.kind, len(piece.vertices), piece.radius, piece.half_height, piece.offset_radius]
    numbers = np.array(sizes, dtype=np.float64)
    return numbers.tobytes() + piece.vertices.tobytes() + piece.T_owner_piece.tobytes()


def _choose_pairs(
    chain: Chain, pieces: Sequence[Piece], joints: Indices, pairs: Indices
) -> list[int]:
    """Pairs that get a grid: those whose balls part them least, none that they always part."""
    if not len(pairs):
        return []
    balls = [piece.bounding_sphere() for piece in pieces]
    centers, radii = np.array([ball[0] for ball in balls]), np.array([ball[1] for ball in balls])
    spans = np.column_stack([joints[pairs[:, 0]] + 1, joints[pairs[:, 1]]])
    gaps = list[tuple[float, int]]()
    for first, last in np.unique(spans, axis=0):
        poses = _poses(chain, int(first), int(last))
        if not poses:
            continue
        own = np.flatnonzero((spans[:, 0] == first) & (spans[:, 1] == last))
        i, j = pairs[own].T
        least, total = np.full(len(own), np.inf), np.zeros(len(own))
        for A, B in poses:
            away = centers[i] @ A[:3, :3].T + A[:3, 3] - centers[j] @ B[:3, :3].T - B[:3, 3]
            apart = np.sqrt((away**2).sum(axis=1))
            least, total = np.minimum(least, apart), total + apart
        reach = radii[i] + radii[j]
        near = np.flatnonzero(least < reach)
        gap = total[near] / len(poses) - reach[near]
        gaps += zip(gap.tolist(), own[near].tolist(), strict=True)
    return sorted(s for _, s in sorted(gaps)[:_MOST])


def _poses(chain: Chain, first: int, last: int) -> list[tuple[Array, Array]]:
    """Poses of the two bodies of pairs that joints ``first`` to ``last`` move, all over them.

    None where they get no grid.
    """
    if _axes(chain, first, last) is None:
        return []
    lower, upper = chain.limits.lower, chain.limits.upper
    poses = []
    for shares in itertools.product(_SAMPLED, repeat=last - first + 1):
        q = np.zeros(chain.n)
        for k, share in enumerate(shares, start=first):
            q[k] = lower[k] + share * (upper[k] - lower[k])
        frames = np.concatenate([np.eye(4)[None], joint_frames(chain, q)])
        poses.append((frames[first], frames[last + 1]))
    return poses


def _axes(chain: Chain, first: int, last: int) -> Array | None:
    """``PairGrid.axes`` of a pair that joints ``first`` to ``last`` move; None for no grid."""
    if last >= chain.n:
        return None  # What hangs on a mimic joint moves with other joints than those between.
    span = slice(first, last + 1)
    lower, upper = chain.limits.lower[span], chain.limits.upper[span]
    if len(lower) > 2 or not np.isfinite(upper - lower).all() or not (upper > lower).all():
        return None
    side = _LINE if len(lower) == 1 else _SIDE
    axes = np.array([[0.0, 0.0, 1.0]] * 2)
    # A hair wider than the limits, which belong to them.
    buffer = 1e-9 * (upper - lower)
    axes[: len(lower)] = np.column_stack(
        [lower - buffer, side / (upper - lower + 2.0 * buffer), np.full(len(lower), side)]
    )
    return axes


@bounded_cache(maxsize=256)
def _values(chain: Chain, a: Piece, b: Piece, first: int, last: int) -> Array:
    axes = _axes(chain, first, last)
    assert axes is not None
    # By their covers alone: a grid can't hold what is inside of what.
    pieces = PieceSet.of([replace(piece, surface=None) for piece in (a, b)])
    none, nothing = np.zeros((0, 2), dtype=np.int64), np.zeros((0, 0))
    model = ModelArrays(
        chain=chain.model,
        joints=np.array([first - 1, last], dtype=np.int64),
        robot=pieces.rows,
        scene=nothing,
        corners=pieces.corners,
        tables=pieces.tables,
        surfaces=pieces.surfaces,
        self_pairs=none,
        groups=np.zeros((0, GROUP_WIDTH), dtype=np.int64),
        grid_axes=np.zeros((0, 2, 3)),
        grid_starts=none[:, 0],
        grid_values=np.zeros(0),
        nodes=nothing,
        items=none[:, 0],
        skipped=np.zeros((0, 0), dtype=np.bool_),
        spheres=nothing,
        sphere_starts=none[:, 0],
        bodies=none,
        carried=none[:, 0],
        halfspaces=none[:, 0],
        roots=none,
        margin=0.0,
        own_margin=0.0,
    )
    values = np.empty(int(axes[:, 2].prod()))
    _fill(model, axes, values)
    values.setflags(write=False)
    return values

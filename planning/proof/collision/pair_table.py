"""Pairs that must stay apart, packed for the proof's own kernels: solids, and what holds them.

Everything is an element: a convex solid, or something that holds those below it. A tree of boxes
holds the obstacles; the cover of a part of a mesh holds its triangles, by way of a tree of boxes. A
pair of elements that can be proved apart settles all pairs below it.

Elements of a robot among pieces that stand still are packed by one kernel: most scenes that were
never seen hold no mesh, and a call for each step of packing would cost more than the step.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import directly, kernel
from kinematics.arrays import Array, Indices, frozen
from kinematics.caches.bounded_cache import array_bytes, bounded_cache
from kinematics.model.chain import Chain
from obstacles.convex.piece import Piece, PieceArrays, PieceKind
from obstacles.distance.bvh import DEEPEST, LEAF, NODE_WIDTH, Tree, grow_kernel
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from obstacles.shapes.primitives import Primitives, primitive_columns_kernel
from planning.proof.collision.box_tree import (
    CONTAINED,
    WRONG_BOXES,
    extents_kernel,
    refuse_broken,
    solid_boxes_kernel,
)
from planning.proof.collision.elements import (
    HOLDER,
    Elements,
    Scratch,
    SolidBoxes,
    append,
    boxes_over,
    hold_kernel,
    join,
    solids,
)
from planning.proof.collision.mesh_solids import link_parts, part_pairs, with_link_boxes
from planning.proof.collision.proposals import (
    STOP_NODE,
    PackedPieces,
    ProposalRows,
    Rows,
    any_rows,
    packed_pieces,
    rows_before,
)
from planning.proof.motion_bounds import PARENT, TYPE


class PieceColumns(NamedTuple):
    """The columns of ``PieceArrays``, for kernels."""

    kinds: Indices
    starts: Indices
    vertices: Array
    sizes: Array
    poses: Array
    centers: Array
    radii: Array
    boxes: Array

    @classmethod
    def of(cls, arrays: PieceArrays) -> "PieceColumns":
        """Rows of some pieces."""
        return cls(*[getattr(arrays, name) for name in cls._fields])


def join_pieces(
    own: Elements, arrays: PieceArrays, owners: Indices, margins: Array, row: int
) -> tuple[Elements, int]:
    """``join`` of a robot's elements with a scene's pieces, none a cover, and the tree over them.

    Args:
        own: The robot's.
        arrays: The scene's pieces.
        owners: The obstacle that each belongs to, shape (p,).
        margins: Margins of the scene's pieces, shape (p,) [m].
        row: First row in what is packed for GJK.

    Returns:
        The elements, and how many of them are nodes of the tree.

    Raises:
        BrokenTree: The tree lacks a piece or holds one twice.
    """
    pieces = PieceColumns.of(arrays)
    joined, found, nodes = directly(join_pieces_kernel, own, pieces, owners, margins, row)
    refuse_broken(found)
    return joined, nodes


def join_primitives(
    own: Elements, primitives: Primitives, margins: Array, row: int
) -> tuple[Elements, int]:
    """``join_pieces`` of a scene's primitives, each an obstacle of its own.

    Args:
        own: The robot's.
        primitives: The obstacles.
        margins: Margins of the scene's pieces [m].
        row: Row as in ``join_pieces``.
    """
    joined, found, nodes = directly(join_primitives_kernel, own, primitives, margins, row)
    refuse_broken(found)
    return joined, nodes


@kernel(unlocks=False)
def join_primitives_kernel(
    own: Elements, primitives: Primitives, margins: Array, row: int
) -> tuple[Elements, int, int]:
    """``join_pieces_kernel`` of primitives."""
    pieces = PieceColumns(*primitive_columns_kernel(primitives))
    owners = np.arange(0, margins.shape[0])
    return join_pieces_kernel(own, pieces, owners, margins, row)


@kernel(unlocks=False)
def join_pieces_kernel(
    own: Elements, pieces: PieceColumns, owners: Indices, margins: Array, row: int
) -> tuple[Elements, int, int]:
    """Elements of ``join_pieces``, what was found of the tree, and how many nodes it has."""
    base, p = own.kinds.shape[0], pieces.kinds.shape[0]
    around = _as_elements(pieces, owners, margins, row)
    numbers, low, high = np.empty(p, np.int64), np.empty((p, 3)), np.empty((p, 3))
    m = solid_boxes_kernel(pieces.kinds, pieces.poses, pieces.boxes, numbers, low, high)
    solids = SolidBoxes(numbers[:m], low[:m], high[:m], margins)
    items, middles = np.empty(m, np.int64), np.empty((m + DEEPEST, 3))
    nodes = np.empty((max(2 * m - 1, 0), NODE_WIDTH))
    t = grow_kernel(solids.low, solids.high, LEAF, items, middles, nodes)
    scratch = Scratch(np.empty((t, 6)), np.zeros(1 + 2 * m + 3 * t, np.int64))
    boxed = _rows_of_elements(t, 0, max(m + t - 1, 0))
    found = hold_kernel(Tree(nodes[:t], items), solids, base, base + p, scratch, boxed)
    corners = own.vertices.shape[0] + pieces.vertices.shape[0]
    joined = _columns_of_elements(base + p + t, corners, own.kids.shape[0] + max(m + t - 1, 0))
    joined.starts[0], joined.below[0] = 0, 0
    append(own, 0, joined)
    append(around, base, joined)
    if found in (CONTAINED, WRONG_BOXES):
        append(boxed, base + p, joined)
    return joined, found, t


@kernel
def _as_elements(pieces: PieceColumns, owners: Indices, margins: Array, row: int) -> Elements:
    """``solids`` of pieces that cover nothing and stand still."""
    p = pieces.kinds.shape[0]
    none, far = np.zeros(p + 1, np.int64), np.empty(p)
    still = np.full(p, -1, np.int64)
    extents_kernel(pieces.boxes, pieces.poses, pieces.sizes, far)
    return Elements(
        still, pieces.kinds, pieces.starts, pieces.vertices, pieces.sizes, pieces.poses,
        pieces.centers, pieces.radii, pieces.boxes, far, none, none[:0], owners,
        np.arange(row, row + p), still, margins,
    )  # fmt: skip


@kernel
def _rows_of_elements(e: int, corners: int, kids: int) -> Elements:
    """``empty_elements`` of elements whose corners lie in rows."""
    return _elements(e, np.empty((corners, 3)), kids)


@kernel
def _columns_of_elements(e: int, corners: int, kids: int) -> Elements:
    """``empty_elements`` of elements whose corners lie in columns."""
    return _elements(e, np.empty((3, corners)), kids)


@kernel
def _elements(e: int, vertices: Array, kids: int) -> Elements:
    return Elements(
        np.empty(e, np.int64), np.empty(e, np.int64), np.empty(e + 1, np.int64), vertices,
        np.empty((e, 3)), np.empty((e, 4, 4)), np.empty((e, 3)), np.empty(e), np.empty((e, 6)),
        np.empty(e), np.empty(e + 1, np.int64), np.empty(kids, np.int64), np.empty(e, np.int64),
        np.empty(e, np.int64), np.empty(e, np.int64), np.empty(e),
    )  # fmt: skip


__all__ = ["HOLDER", "PairArrays", "PairTable"]

_HALFSPACE = int(PieceKind.HALFSPACE)


class PairArrays(NamedTuple):
    """Arrays that the proof's kernels read (n joints, b bodies, e elements, v vertices).

    The joints of the chain come first, then those that follow them; each moves a body.

    Elements of the robot come first: its pieces, then what is below them; then those of the scene
    alike, and at last the tree over the scene's pieces.

    Args:
        bodies: Type of the joint that moves each body, 0 revolute, 1 prismatic, and the body before
            it, shape (2, b).
        offsets: Offsets of every joint at 0 in the frame of the body before, shape (b, 4, 4).
        leads: Multiplier and offset of the joints that follow others, shape (b - n, 2).
        leaders: The joints that these follow, shape (b - n,).
        roots: Pairs that everything hangs below; the second is the robot's and moves against the
            first; shape (k, 2).
        moving: How many elements are the robot's.
        asked: Whether a pair asks how each of these moves seen from body k - 1, shape (r, b).
        margins: Distance that each element of the scene is to be kept away, of a holder the most of
            those below it, shape (e,) [m].
        margin: Margin from obstacles beyond that [m].
        joints: Body that each element is part of, -1 for what stands still, shape (e,).
        kinds: Kinds of the elements' cores, as ``PieceKind``, or HOLDER, shape (e,).
        starts: Vertices of element i are ``vertices[starts[i]:starts[i + 1]]``, shape (e + 1,).
        columns: The vertices in their elements' frames, shape (3, v): so loops compile to vectors.
        sizes: Radius, half height, rounding; shape (e, 3).
        poses: Frame of each element in that of its joint, shape (e, 4, 4).
        centers: Centres of a ball that holds each element, in the frame of its joint, shape (e, 3).
        radii: Radii of the elements' balls, shape (e,).
        boxes: Centre and half sizes of a box that holds each element, in its own frame, (e, 6).
        extents: Size of the largest numbers that an element's place is summed from, shape (e,) [m].
        below: Index of the children: those of element i are ``kids[below[i]:below[i + 1]]``, shape
            (e + 1,).
        kids: Elements.
        parts: The robot's piece or the obstacle that an element belongs to, -1 for several, (e,).
        skipped: Whether a piece of the robot may touch an obstacle, shape (p, obstacles).
        proposals: The elements as GJK reads them.
    """

    bodies: Indices
    offsets: Array
    leads: Array
    leaders: Indices
    roots: Indices
    moving: int
    asked: NDArray[np.bool_]
    margins: Array
    margin: float
    joints: Indices
    kinds: Indices
    starts: Indices
    columns: Array
    sizes: Array
    poses: Array
    centers: Array
    radii: Array
    boxes: Array
    extents: Array
    below: Indices
    kids: Indices
    parts: Indices
    skipped: NDArray[np.bool_]
    proposals: ProposalRows


#: Where the margin is, the one number that is not kept.
_MARGIN = PairArrays._fields.index("margin")


def any_pairs() -> PairArrays:
    """Pairs that stand for all of them where a kernel is looked up by its arguments' types."""
    numbers, rows = np.zeros(1, dtype=np.int64), np.zeros((1, 2), dtype=np.int64)
    values, columns, poses = np.zeros(1), np.zeros((1, 3)), np.zeros((1, 4, 4))
    mask = np.zeros((1, 1), dtype=np.bool_)
    return PairArrays(
        bodies=rows, offsets=poses, leads=columns, leaders=numbers, roots=rows, moving=1,
        asked=mask, margins=values, margin=0.0, joints=numbers, kinds=numbers, starts=numbers,
        columns=columns, sizes=columns, poses=poses, centers=columns, radii=values,
        boxes=columns, extents=values, below=numbers, kids=numbers, parts=numbers, skipped=mask,
        proposals=any_rows(),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class PairTable:
    """The pairs of a robot in a scene.

    Args:
        arrays: Packed.
        robot: Robot whose elements come first.
        scene: Scene around the robot.
        opened: Covers whose triangles are elements too, None for all.
    """

    arrays: PairArrays
    robot: RobotGeometry
    scene: Scene
    opened: Rows = None

    @classmethod
    def of(
        cls, robot: RobotGeometry, scene: Scene, margin: float, opened: Rows = None
    ) -> "PairTable":
        """All pairs that neither robot nor scene allows to touch.

        What stands still with the base can't be moved away from obstacles and is not compared with
        them.

        Args:
            robot: The robot.
            scene: Scene around the robot.
            margin: Margin from obstacles beyond their own [m].
            opened: Pieces, the robot's and then the scene's, whose triangles are elements too, if
                they are covers, None for all; other covers are solids, which hold what they cover.
        """
        kept = _arrays(robot, scene, opened)
        # As ``_replace``, which takes three times as long.
        arrays = PairArrays._make((*kept[:_MARGIN], float(margin), *kept[_MARGIN + 1 :]))
        return cls(arrays, robot, scene, opened)

    def names(self, i: int, j: int) -> tuple[str, str]:
        """The link, and the obstacle or other link, of a pair of elements."""
        arrays = self.arrays
        while arrays.parts[i] < 0:  # of several it names the first
            i = int(arrays.kids[arrays.below[i]])
        first = self.robot.links if i < arrays.moving else self.scene.ids
        return self.robot.links[arrays.parts[j]], first[arrays.parts[i]]

    def closed_cover(self, k: int) -> int | None:
        """The piece that element ``k`` is, where it is a cover that was not opened."""
        row = int(self.arrays.proposals.row[k])
        if self.opened is None or row < 0 or row in self.opened:
            return None
        robots = len(self.robot.pieces)
        piece = self.robot.pieces[row] if row < robots else self.scene.piece(row - robots)
        return None if piece.surface is None else row

    def solid(self, k: int) -> Piece:
        """Element ``k``, which holds nothing, as a piece in the frame of its joint."""
        arrays = self.arrays
        row, robots = int(arrays.proposals.row[k]), len(self.robot.pieces)
        piece = self.robot.pieces[row] if row < robots else self.scene.piece(row - robots)
        if arrays.proposals.first[k] < 0:
            return piece
        corners = arrays.columns[:, arrays.starts[k] : arrays.starts[k + 1]].T
        return replace(piece, vertices=corners, offset_radius=0.0, surface=None)


@bounded_cache(maxsize=8, weigh=array_bytes)
def _arrays(robot: RobotGeometry, scene: Scene, opened: Rows) -> PairArrays:
    scene.check_placed()
    packed, p = packed_pieces(robot, scene, opened), len(robot.pieces)
    own, _, corners = _own(robot, rows_before(opened, p))
    # The scene's corners come first in what is packed.
    ahead = len(packed.corners) - corners
    if ahead:
        own = own._replace(first=np.where(own.first >= 0, own.first + ahead, -1))
    moving = len(own.kinds)
    if len(scene.primitives.kinds) == len(scene.obstacles):
        margins = np.array([obstacle.margin for obstacle in scene.obstacles], dtype=np.float64)
        joined, nodes = join_primitives(own, scene.primitives, margins, p)
        kinds = joined.kinds[moving : moving + len(margins)]
    else:
        still, owners, margins = scene.pieces()
        kinds = still.kinds
        if (packed.rows[p:, STOP_NODE] > 0.0).any():
            around = _around(packed, still, owners, margins, moving)
            boxed = boxes_over(still, margins, moving, moving + len(around.kinds))
            joined, nodes = join(own, around, boxed), len(boxed.kinds)
        else:
            joined, nodes = join_pieces(own, still, owners, margins, p)
    skipped = _pairs_that_may_touch(robot, scene.ids, scene.allowed_collisions)
    tops = [len(joined.kinds) - nodes] if nodes else []
    tops += [moving + k for k, kind in enumerate(kinds.tolist()) if kind == _HALFSPACE]
    return PairArrays(
        *joints_of(robot.chain),
        roots=_roots(
            robot, rows_before(opened, p), scene.ids, scene.allowed_collisions, tuple(tops)
        ),
        moving=moving,
        asked=_asked_rows(robot, rows_before(opened, p)),
        margins=joined.margins,
        margin=0.0,
        joints=joined.joints,
        kinds=joined.kinds,
        starts=joined.starts,
        columns=joined.vertices,
        sizes=joined.sizes,
        poses=joined.poses,
        centers=joined.centers,
        radii=joined.radii,
        boxes=joined.boxes,
        extents=joined.extents,
        below=joined.below,
        kids=joined.kids,
        parts=joined.parts,
        skipped=skipped,
        proposals=ProposalRows(
            packed.rows, joined.row, joined.first, packed.corners, packed.tables
        ),
    )


def _around(
    packed: PackedPieces, still: PieceArrays, owners: Indices, margins: Array, moving: int
) -> Elements:
    """The scene's elements but the tree over them, some of them below covers."""
    p = len(packed.rows) - len(still)
    nodes = int(packed.rows[p:, STOP_NODE].max())
    around = solids(still, packed, slice(p, None), slice(0, nodes), moving)
    placed = around.row - p
    return around._replace(parts=owners[placed], margins=margins[placed])


@bounded_cache(maxsize=8, weigh=array_bytes)
def joints_of(chain: Chain) -> tuple[Indices, Array, Array, Indices]:
    """How bodies hang on each other: the first columns of ``PairArrays``."""
    n, mimic_joints = chain.n, chain.mimic_joints
    bodies = np.empty((2, n + len(mimic_joints)), dtype=np.int64)
    bodies[TYPE, :n], bodies[PARENT, :n] = chain.joint_types, np.arange(-1, n - 1)
    for k, mimic in enumerate(mimic_joints, start=n):
        bodies[:, k] = mimic.joint_type, mimic.parent
    own = np.array([f.T_parent_joint for f in mimic_joints]).reshape(-1, 4, 4)
    leads = np.array([[f.multiplier, f.offset] for f in mimic_joints]).reshape(-1, 2)
    leaders = np.array([f.leader for f in mimic_joints], dtype=np.int64)
    offsets = frozen(np.concatenate([chain.offsets, own]))
    return bodies, offsets, leads, leaders


#: Scenes that differ in where things are often have the same names.
@bounded_cache(maxsize=8, weigh=array_bytes)
def _pairs_that_may_touch(
    robot: RobotGeometry, ids: tuple[str, ...], allowed: frozenset[tuple[str, str]]
) -> NDArray[np.bool_]:
    """Mask of the pieces of a robot and the obstacles that may touch, shape (p, obstacles).

    Those that stand still with the base may, and those whose link the scene allows to. The planner
    chooses its own pairs elsewhere: written twice on purpose, a pair dropped there is found here.

    Args:
        robot: The robot.
        ids: Names of the obstacles.
        allowed: Pairs of names that may touch.
    """
    skipped = np.zeros((len(robot.pieces), len(ids)), dtype=np.bool_)
    skipped[robot.joints < 0] = True
    if allowed:
        columns, rows = {name: k for k, name in enumerate(ids)}, _pieces_by_name(robot)
        for pair in allowed:
            if pair[0] not in columns and pair[1] not in columns:  # as most that scenes allow
                continue
            for link, name in (pair, pair[::-1]):
                if link in rows and name in columns:
                    skipped[rows[link], columns[name]] = True
    skipped.setflags(write=False)
    return skipped


@bounded_cache(maxsize=8)
def _pieces_by_name(robot: RobotGeometry) -> dict[str, list[int]]:
    """Pieces of each link and attached object."""
    rows: dict[str, list[int]] = {}
    for row, link in enumerate(robot.links):
        rows.setdefault(link, []).append(row)
    return rows


class _Own(NamedTuple):
    """A robot's elements alone.

    Args:
        elements: The elements.
        tops: Elements that hold all of each of ``link_parts``.
        corners: How many are packed with them.
    """

    elements: Elements
    tops: Indices
    corners: int


@bounded_cache(maxsize=8)
def _own(robot: RobotGeometry, opened: Rows) -> _Own:
    packed = packed_pieces(robot, Scene(()), opened)
    own = solids(robot.arrays, packed, slice(None), slice(None), 0)
    own = own._replace(parts=own.row, joints=robot.joints[own.row])
    elements, tops = with_link_boxes(robot, own)
    return _Own(elements, tops, len(packed.corners))


@bounded_cache(maxsize=8)
def _asked_rows(robot: RobotGeometry, opened: Rows) -> NDArray[np.bool_]:
    """``PairArrays.asked``: seen from the base all is, the rest by the robot's own pairs."""
    return _asked_of_pieces(robot)[_own(robot, opened).elements.parts]


@bounded_cache(maxsize=8)
def _asked_of_pieces(robot: RobotGeometry) -> NDArray[np.bool_]:
    bodies, starts = joints_of(robot.chain)[0], link_parts(robot)
    asked = np.zeros((len(starts) - 1, bodies.shape[1]), dtype=np.bool_)
    asked[:, :1] = True
    joints = robot.joints[starts[:-1]]
    for a, b in part_pairs(robot)[0].tolist():
        before = {-1, body := int(joints[a])}
        while body >= 0:
            before.add(body := int(bodies[PARENT, body]))
        meeting = int(joints[b])
        while meeting not in before:
            meeting = int(bodies[PARENT, meeting])
        # Neither may hang on the other: then both are seen from where they meet.
        asked[b, meeting + 1] = True
        if joints[a] > meeting:
            asked[a, meeting + 1] = True
    return np.repeat(asked, np.diff(starts), axis=0)


#: Scenes of as many things by the same names often have the same.
@bounded_cache(maxsize=16, weigh=array_bytes)
def _roots(
    robot: RobotGeometry,
    opened: Rows,
    ids: tuple[str, ...],
    allowed: frozenset[tuple[str, str]],
    tops: tuple[int, ...],
) -> Indices:
    """Pairs that everything hangs below: robot and scene, and the robot's own.

    Args:
        robot: The robot.
        opened: Covers whose triangles are elements too.
        ids: Names of the obstacles.
        allowed: Pairs of names that may touch.
        tops: Elements of the scene that all others hang below.
    """
    skipped = _pairs_that_may_touch(robot, ids, allowed)
    own, names = part_pairs(robot)
    parts, first = _own(robot, opened).tops, link_parts(robot)[:-1]
    met = np.zeros(0, dtype=np.int64)
    if skipped.size:  # pieces of one part may all touch the same
        met = parts[~skipped[first].all(axis=1)]
    if not names.isdisjoint(allowed):
        links = [robot.links[k] for k in first]
        pairs = ((links[a], links[b]) for a, b in own.tolist())
        own = own[[(min(pair), max(pair)) not in allowed for pair in pairs]]
    against = len(met) * len(tops)
    roots = np.empty((against + len(own), 2), dtype=np.int64)
    roots[against:] = parts[own]
    around = roots[:against].reshape(len(met), len(tops), 2)
    around[:, :, 0], around[:, :, 1] = tops, met[:, None]
    roots.setflags(write=False)
    return roots

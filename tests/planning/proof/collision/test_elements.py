"""Elements of the proof: pieces as they are, and boxes over them that hold all that is below."""

import itertools

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.convex.piece import PieceArrays, PieceKind
from obstacles.distance.bvh import Tree, tree
from obstacles.scenes.scene import Scene
from planning.proof.collision import elements
from planning.proof.collision.box_tree import BrokenTree
from planning.proof.collision.elements import HOLDER, Elements, boxes_over, join, solids
from planning.proof.collision.joined_pieces import join_pieces, join_primitives
from planning.proof.collision.pair_table import PairTable
from planning.proof.collision.proposals import packed_pieces
from tests.obstacles.collision.model.test_collision_model import mixed
from tests.obstacles.shapes.test_primitives import random_scene
from tests.planning.proof.collision.test_proposals import scattered
from tests.planning.scenes import builtin

SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
SCENES = [*map(mixed, range(3)), *map(scattered, range(2)), random_scene(5, 12), random_scene(6, 1)]


def reach(arrays: PieceArrays, k: int) -> Array:
    """Corners of the turned box of a piece, shape (8, 3)."""
    T, box = arrays.poses[k], arrays.boxes[k]
    return np.asarray((box[:3] + SIGNS * box[3:]) @ T[:3, :3].T + T[:3, 3])


@pytest.mark.parametrize("scene", SCENES)
def test_pieces_of_a_scene_are_elements_as_they_are(scene: Scene) -> None:
    robot = builtin("panda")
    table = PairTable.of(robot, scene, 0.01).arrays
    still, owners, margins = scene.pieces()
    p, moving = len(robot.pieces), table.moving
    found = moving + np.arange(len(still))
    for own, first, pieces in ((robot.arrays, 0, p), (still, moving, len(still))):
        chosen = slice(first, first + pieces)
        for name in ("kinds", "sizes", "poses", "centers", "radii", "boxes"):
            np.testing.assert_array_equal(getattr(table, name)[chosen], getattr(own, name))
        for k in range(pieces):
            columns = table.columns[:, table.starts[first + k] : table.starts[first + k + 1]]
            vertices = own.vertices[own.starts[k] : own.starts[k + 1]]
            np.testing.assert_array_equal(columns.T, vertices)
    np.testing.assert_array_equal(table.parts[found], owners)
    np.testing.assert_array_equal(table.margins[found], margins)
    np.testing.assert_array_equal(table.proposals.row[found], p + np.arange(len(still)))
    assert (table.proposals.first[found] == -1).all()
    assert (table.joints[moving:] == -1).all()
    np.testing.assert_array_equal(table.joints[:p], robot.joints)


@pytest.mark.parametrize("scene", SCENES)
def test_boxes_hold_what_is_below_them(scene: Scene) -> None:
    still, _, margins = scene.pieces()
    boxed = boxes_over(still, margins, 100, 500)
    solid = set(np.flatnonzero(still.kinds != PieceKind.HALFSPACE).tolist())
    assert (boxed.kinds == HOLDER).all()
    assert len(boxed.kinds) > 0 or not solid

    def held(node: int) -> set[int]:
        kids = boxed.kids[boxed.below[node] : boxed.below[node + 1]].tolist()
        pieces = {kid - 100 for kid in kids if kid < 500}
        return pieces.union(*(held(kid - 500) for kid in kids if kid >= 500))

    for node in range(len(boxed.kinds)):
        below, box = held(node), boxed.boxes[node]
        assert boxed.margins[node] == max(margins[k] for k in below)
        corners = np.vstack([reach(still, k) for k in below])
        assert (np.abs(corners - box[:3]) <= box[3:] + 1e-12).all()
        assert boxed.radii[node] == pytest.approx(np.linalg.norm(box[3:]), rel=1e-15)
        np.testing.assert_array_equal(boxed.centers[node], box[:3])
    assert (held(0) if len(boxed.kinds) else set()) == solid


@pytest.mark.parametrize("seed", range(5))
def test_joined_blocks_stand_one_behind_the_other_as_numpy_puts_them(seed: int) -> None:
    blocks = [
        boxes_over(*random_scene(10 * seed + k, 2 + 5 * k).pieces()[::2], 0, 0) for k in range(3)
    ]
    random = np.random.default_rng(seed)
    for at, block in enumerate(blocks):
        counts = random.integers(0, 4, len(block.kinds))
        blocks[at] = block._replace(
            starts=np.concatenate([[0], counts.cumsum()]),
            vertices=random.normal(size=(counts.sum(), 3)),
        )
    joined = join(*blocks)
    for name in set(Elements._fields) - {"starts", "below", "vertices"}:
        expected = np.concatenate([getattr(block, name) for block in blocks])
        np.testing.assert_array_equal(getattr(joined, name), expected)
    vertices = np.concatenate([block.vertices for block in blocks])
    np.testing.assert_array_equal(joined.vertices, vertices.T)
    for name in ("starts", "below"):
        counts = np.concatenate([np.diff(getattr(block, name)) for block in blocks])
        np.testing.assert_array_equal(np.diff(getattr(joined, name)), counts)
        assert getattr(joined, name)[0] == 0


def _elsewhere(low: Array, high: Array) -> Tree:
    up = np.array([0.0, 0.0, 50.0])
    return tree(low + up, high + up)


def _without_one(low: Array, high: Array) -> Tree:
    return tree(low[1:], high[1:])


def _one_twice(low: Array, high: Array) -> Tree:
    grown = tree(low, high)
    items = grown.items.copy()
    items[0] = items[-1]
    return Tree(grown.nodes, items)


def test_boxes_of_a_lying_tree_become_right_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    still, _, margins = mixed(1).pieces()
    right = boxes_over(still, margins, 0, 100)
    monkeypatch.setattr(elements, "tree", _elsewhere)
    mended = boxes_over(still, margins, 0, 100)
    for name in set(Elements._fields) - {"boxes", "centers", "radii", "extents"}:
        np.testing.assert_array_equal(getattr(mended, name), getattr(right, name))
    np.testing.assert_allclose(mended.boxes, right.boxes, atol=1e-13)


@pytest.mark.parametrize("lie", [_without_one, _one_twice])
def test_a_tree_that_lacks_a_solid_is_refused(monkeypatch: pytest.MonkeyPatch, lie: object) -> None:
    still, _, margins = mixed(1).pieces()
    monkeypatch.setattr(elements, "tree", lie)
    with pytest.raises(BrokenTree):
        boxes_over(still, margins, 0, 100)


@pytest.mark.parametrize("scene", [*SCENES, Scene(), random_scene(8, 400)])
def test_one_kernel_joins_what_several_do(scene: Scene) -> None:
    robot = builtin("panda")
    own = solids(robot.arrays, packed_pieces(robot, Scene()), slice(None), slice(None), 0)
    own = own._replace(parts=own.row, joints=robot.joints[own.row])
    still, owners, margins = scene.pieces()
    p, moving = len(robot.pieces), len(own.kinds)
    packed = packed_pieces(robot, scene)
    around = solids(still, packed, slice(p, None), slice(0, 0), moving)
    around = around._replace(parts=owners, margins=margins)
    boxed = boxes_over(still, margins, moving, moving + len(still))
    expected = join(own, around, boxed)
    found, nodes = join_pieces(own, still, owners, margins, p)
    assert nodes == len(boxed.kinds)
    for name in Elements._fields:
        one, other = getattr(found, name), getattr(expected, name)
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other, name)


@pytest.mark.parametrize("scene", [*SCENES, Scene(), random_scene(8, 400)])
def test_primitives_are_joined_as_their_pieces_are(scene: Scene) -> None:
    scene = Scene(o for o in scene.obstacles if o.is_primitive)
    robot = builtin("panda")
    own = solids(robot.arrays, packed_pieces(robot, Scene()), slice(None), slice(None), 0)
    own = own._replace(parts=own.row, joints=robot.joints[own.row])
    still, owners, margins = scene.pieces()
    expected, expected_nodes = join_pieces(own, still, owners, margins, len(robot.pieces))
    found, nodes = join_primitives(own, scene.primitives, margins, len(robot.pieces))
    assert nodes == expected_nodes
    for name in Elements._fields:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)

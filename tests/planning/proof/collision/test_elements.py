"""Elements of pairs, and the boxes above pieces: they hold what is below them."""

import itertools
from itertools import product

import numpy as np
import pytest

from kinematics.arrays import Array, Indices
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.convex.piece import PieceArrays, PieceKind
from obstacles.distance.bvh import BOX, FIRST, SKIP, Tree, tree
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.proof.collision import elements, mesh_solids, pair_table
from planning.proof.collision.box_tree import (
    BrokenTree,
    check_nodes,
    leaf_boxes_kernel,
    refuse_broken,
)
from planning.proof.collision.collision_proof import CollisionProof
from planning.proof.collision.elements import HOLDER, Elements, boxes_over, join, solids
from planning.proof.collision.pair_table import PairTable, join_pieces, join_primitives
from planning.proof.collision.proposals import packed_pieces
from tests.obstacles.arms import cut_arm
from tests.obstacles.collision.model.test_collision_model import mixed
from tests.obstacles.shapes.test_shape import random_scene
from tests.planning.proof.collision.test_separating_direction import scattered
from tests.planning.scenes import builtin

SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
SCENES = [*map(mixed, range(3)), *map(scattered, range(2)), random_scene(5, 12), random_scene(6, 1)]


def leaf_boxes(nodes: Array, items: Indices, low: Array, high: Array) -> Array:
    """Boxes (t, 6) of the solids in each leaf; inf and -inf of nodes that are no leaves."""
    boxes, seen = np.empty((len(nodes), 6)), np.zeros(len(low), dtype=np.int64)
    refuse_broken(leaf_boxes_kernel(nodes, items, low, high, seen, boxes))
    return boxes


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


ROOT = np.zeros(1, dtype=np.int64)


def boxes(seed: int, m: int) -> tuple[Array, Array]:
    """Lowest and highest corners of random boxes, shape (m, 3)."""
    rng = np.random.default_rng(seed)
    middle, half = rng.normal(size=(m, 3)), rng.uniform(0.01, 0.3, size=(m, 3))
    return middle - half, middle + half


@pytest.mark.parametrize("m", [1, 2, 3, 7, 64, 501])
def test_a_right_tree_is_taken_as_it_is(m: int) -> None:
    low, high = boxes(m, m)
    grown = tree(low, high)
    of_leaves = leaf_boxes(grown.nodes, grown.items, low, high)
    assert check_nodes(grown.nodes, 0, ROOT, of_leaves)[0] is grown.nodes


@pytest.mark.parametrize("m", [1, 3, 64])
@pytest.mark.parametrize("seed", range(10))
def test_wrong_boxes_become_boxes_that_contain_everything(seed: int, m: int) -> None:
    low, high = boxes(seed, m)
    grown = tree(low, high)
    rng = np.random.default_rng(seed)
    lying = grown.nodes.copy()
    k = int(rng.integers(len(lying)))
    lying[k, BOX + 2] += 50.0
    lying[k, BOX + 5] += 50.0
    of_leaves = leaf_boxes(lying, grown.items, low, high)
    right, _ = check_nodes(lying, 0, ROOT, of_leaves)
    assert np.allclose(right[0, BOX : BOX + 3], low.min(axis=0))
    assert np.allclose(right[0, BOX + 3 : BOX + 6], high.max(axis=0))
    assert np.allclose(right[:, BOX : BOX + 6], grown.nodes[:, BOX : BOX + 6])


def test_a_node_below_none_is_refused() -> None:
    low, high = boxes(0, 40)
    grown = tree(low, high)
    nodes = grown.nodes.copy()
    inner = int(np.flatnonzero(nodes[:, FIRST] < 0.0)[0])
    nodes[inner + 1, SKIP] = len(nodes) - 1
    of_leaves = leaf_boxes(nodes, grown.items, low, high)
    with pytest.raises(BrokenTree, match="below none or several"):
        check_nodes(nodes, 0, ROOT, of_leaves)


ARM = cut_arm()
SCENE = Scene((Obstacle("box", Box(np.full(3, 0.2)), np.eye(4) + np.eye(4, k=3) * 0.9),))


def forget() -> None:
    """Forget what was packed with boxes about links, or without."""
    kept = (
        mesh_solids.link_parts, mesh_solids.part_pairs, pair_table._own, pair_table._asked_rows,
        pair_table._asked_of_pieces, pair_table._roots, pair_table._arrays,
    )  # fmt: skip
    for function in kept:
        function.cache_clear()


def below(table: PairTable, k: int) -> list[int]:
    """The elements that hold nothing below one."""
    arrays = table.arrays
    if arrays.kinds[k] != HOLDER:
        return [k]
    kids = arrays.kids[arrays.below[k] : arrays.below[k + 1]]
    return [leaf for kid in kids for leaf in below(table, int(kid))]


@pytest.mark.parametrize("allowed", [frozenset(), frozenset({("base", "two"), ("box", "one")})])
def test_every_pair_of_pieces_hangs_below_one_root(allowed: frozenset[tuple[str, str]]) -> None:
    scene = Scene(SCENE.obstacles, allowed)
    table = PairTable.of(ARM, scene, 0.0)
    pieces, pairs = len(ARM.pieces), list[tuple[int, int]]()
    assert len(table.arrays.roots) < 12
    for i, j in table.arrays.roots.tolist():
        pairs += product(below(table, i), below(table, j))
    own = [(min(p), max(p)) for p in pairs if max(p) < pieces]
    expected = {
        (int(min(p)), int(max(p)))
        for p in ARM.self_pairs
        if not scene.allows(ARM.links[p[0]], ARM.links[p[1]])
    }
    assert len(own) == len(set(own))
    assert set(own) == expected
    against = [j for i, j in pairs if i >= table.arrays.moving]
    met = [
        k for k, link in enumerate(ARM.links) if link != "base" and not scene.allows(link, "box")
    ]
    assert sorted(against) == met


@pytest.mark.parametrize("length", [0.2, 1.0, 4.0])
def test_motions_are_proved_as_without_boxes(
    length: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Short and long ones, that are free or not, among them some whose ends are just free."""
    random, checker = np.random.default_rng(11), Checker.of(ARM, SCENE)
    world, outcomes = FclWorld(ARM, SCENE), set()
    starts = [q for q in random.uniform(-np.pi, np.pi, (120, 3)) if checker.valid(q)][:14]
    for q in starts:
        step = random.normal(size=3)
        end = q + length * step / np.linalg.norm(step)
        coefficients = np.stack([q, (end - q) / 2.0], axis=1)[None]
        motion = Trajectory(ARM.chain.joint_names, np.array([0.0, 2.0]), coefficients)
        proof = CollisionProof(motion, ARM, SCENE, 0.0, None)
        proof.run()
        forget()
        with monkeypatch.context() as without:
            without.setattr(mesh_solids, "_FEW", len(ARM.pieces))
            plain = CollisionProof(motion, ARM, SCENE, 0.0, None)
            plain.run()
        forget()
        assert (proof.violation is None) == (plain.violation is None)
        outcomes.add(proof.violation is None)
        if proof.violation is None:
            for share in np.linspace(0.0, 1.0, 60):
                world.set_configuration(q + share * (end - q))
                assert not world.collisions(q + share * (end - q))
            least = min(proof.clearances)
            assert least >= 0.9 * min(plain.clearances) - 1e-9
        else:
            assert plain.violation is not None
            assert proof.violation.time == pytest.approx(plain.violation.time, abs=1e-3)
    assert True in outcomes

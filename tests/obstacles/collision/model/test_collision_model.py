"""The packed robot and scene: which pairs are compared, by which margins, under which names."""

import itertools

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from obstacles.collision.checker import Checker
from obstacles.collision.model.collision_model import CollisionModel
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.signed_distance import halfspace_distance, signed_distance
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace, PointCloud, Sphere
from tests.obstacles.arms import builtin, gantry, obstacle
from tests.obstacles.outline import convex_shapes
from tests.obstacles.solids import random_transform

BALL = '<sphere radius="0.1"/>'
UP = np.array([0.0, 0.0, 1.0])


def mixed(seed: int) -> Scene:
    """Solids of every convex kind with margins, two clouds and two half-spaces, mixed."""
    random = np.random.default_rng(seed)
    shapes = [
        *convex_shapes(random), HalfSpace(UP, -0.7), PointCloud(random.normal(size=(5, 3)), 0.05),
        HalfSpace(-UP, -1.5), PointCloud(random.normal(size=(3, 3)), 0.02),
    ]  # fmt: skip
    names = random.permutation(len(shapes))
    return Scene(
        Obstacle(f"o{k}", shapes[k], random_transform(random, 0.8), 0.01 * k) for k in names
    )


def pairs_of(robot: RobotGeometry, scene: Scene) -> list[tuple[int, int, int]]:
    """Every pair that must stay apart as (pair number, piece, other piece), by definition."""
    owners, p = scene.pieces()[1], len(robot.pieces)
    m = len(owners)
    pairs = [
        (i * m + k, i, p + k)
        for i, k in itertools.product(range(p), range(m))
        if robot.joints[i] >= 0 and not scene.allows(robot.links[i], scene.ids[owners[k]])
    ]
    own = CollisionModel(robot, scene).arrays.self_pairs
    return pairs + [(p * m + s, int(i), int(j)) for s, (i, j) in enumerate(own)]


def distances(robot: RobotGeometry, scene: Scene, margin: float, q: Array) -> dict[int, float]:
    """Upper bounds of signed distances of all pairs less their margins, by Qhull."""
    frames = np.concatenate([np.eye(4)[None], joint_frames(robot.chain, q)])[robot.joints + 1]
    placed = [piece.placed(T) for piece, T in zip(robot.pieces, frames, strict=True)]
    placed += [scene.piece(k) for k in range(len(scene.pieces()[1]))]
    margins = np.concatenate([np.zeros(len(frames)), scene.pieces()[2] + margin])
    return {pair: apart(placed[i], placed[j]) - margins[j] for pair, i, j in pairs_of(robot, scene)}


def apart(a: Piece, b: Piece) -> float:
    """Signed distance of two pieces by Qhull [m], b perhaps a half-space."""
    if b.kind == PieceKind.HALFSPACE:
        return halfspace_distance(a, a.T_owner_piece, b.T_owner_piece)
    return signed_distance(a, a.T_owner_piece, b, b.T_owner_piece)[1]


@pytest.mark.parametrize(("name", "seed"), [("planar_rr", 0), ("scara", 1), ("kr6_sixx", 2)])
def test_near_pairs_are_all_that_are_near_with_their_margins_off(name: str, seed: int) -> None:
    """Each pair by itself, against an independent distance of each two pieces."""
    robot, scene, random = builtin(name), mixed(seed), np.random.default_rng(seed)
    checker = Checker.of(robot, scene, 0.02)
    q = random.uniform(*robot.chain.sampling_bounds())
    expected = distances(robot, scene, 0.02, q)
    near = checker.gradient(q, 0.3)
    told = dict(zip(near.pairs.tolist(), near.distances.tolist(), strict=True))
    assert len(told) == len(near.pairs) > 3
    assert {k for k, d in expected.items() if d < 0.3 - 1e-5} <= set(told)
    for pair, distance in told.items():
        assert distance == pytest.approx(expected[pair], abs=1e-5)


@pytest.mark.parametrize("name", ["planar_rr", "scara", "ur5e", "panda"])
def test_own_pairs_are_those_of_the_robot_but_for_what_the_scene_allows(name: str) -> None:
    robot = builtin(name)
    all_own = {frozenset(map(int, pair)) for pair in robot.self_pairs}
    packed = CollisionModel(robot, Scene()).arrays.self_pairs
    assert {frozenset(map(int, pair)) for pair in packed} == all_own
    assert len(packed) == len(robot.self_pairs)
    names = sorted({tuple(sorted((robot.links[i], robot.links[j]))) for i, j in robot.self_pairs})
    for a, b in names[:12]:
        fewer = CollisionModel(robot, Scene((), {(b, a)})).arrays
        left = {frozenset(map(int, pair)) for pair in fewer.self_pairs}
        assert left == {pair for pair in all_own if {robot.links[k] for k in pair} != {a, b}}
        # Groups still cover them one behind the other, each of two bodies.
        spans = [tuple(group[:2]) for group in fewer.groups]
        assert [first for first, _ in spans] == [0, *(last for _, last in spans)][: len(spans)]
        assert not spans or spans[-1][1] == len(fewer.self_pairs)
        for first, last, *_ in fewer.groups:
            joints = robot.joints[fewer.self_pairs[first:last]]
            assert (joints == joints[0]).all()


def test_a_link_and_an_obstacle_of_one_name_are_two() -> None:
    """A pair of a scene's names means both ways to read them."""
    robot = gantry(BALL)
    scene = Scene((obstacle("tool", Sphere(0.1), np.zeros(3)),))
    assert not Checker.of(robot, scene).valid(np.zeros(3))
    assert Checker.of(robot, Scene(scene.obstacles, {("tool", "tool")})).valid(np.zeros(3))


def test_margins_add_up() -> None:
    robot = gantry(BALL)
    scene = Scene((obstacle("ball", Sphere(0.1), [1.0, 0.0, 0.0], margin=0.05),
                   Obstacle("floor", HalfSpace(UP, -1.0), margin=0.25)))  # fmt: skip
    model = CollisionModel(robot, scene, 0.02)
    assert Checker(model).clearance(np.zeros(3))[0] == pytest.approx(0.9 - 0.25 - 0.02)
    assert Checker(model, 0.1).clearance(np.zeros(3))[0] == pytest.approx(0.53)
    # At x = 0.2 the ball is nearer than the floor.
    clearance, pair = Checker(model).clearance(np.array([0.2, 0.0, 0.0]))
    assert clearance == pytest.approx(0.6 - 0.07)
    assert pair == ("tool", "ball")


def test_a_margin_is_not_kept_between_links() -> None:
    """Links may be built close together: they only have to stay apart."""
    robot, q = builtin("ur5e"), np.array([0.0, -1.2, 1.9, -0.7, 1.57, 0.0])
    clearances = [Checker.of(robot, Scene(), margin).clearance(q)[0] for margin in (0.0, 0.2)]
    assert clearances[0] == clearances[1] > 0.0
    assert Checker(Checker.of(robot, Scene()).model, 0.2).clearance(q)[0] < clearances[0]


def test_a_bare_chain_hits_nothing() -> None:
    model = CollisionModel.bare(builtin("ur5e").chain)
    assert model.robot.links == model.scene.ids == ()
    assert model.robot.chain is builtin("ur5e").chain
    assert Checker(model).clearance(np.zeros(6)) == (np.inf, None)
    assert Checker(model).valid(np.zeros(6))
    assert Checker(model).segment(np.zeros(6), np.ones(6)).free


def test_arrays_are_packed_once_and_can_not_be_written_to() -> None:
    model = CollisionModel(builtin("ur5e"), mixed(10))
    arrays = model.arrays
    assert model.arrays is arrays
    for name, array in arrays._asdict().items():
        if isinstance(array, np.ndarray) and array.size:
            assert not array.flags.writeable, name


def test_a_link_may_be_in_a_halfspace_that_it_is_allowed_to_touch() -> None:
    robot, floor = gantry(BALL), Obstacle("floor", HalfSpace(UP, 0.0))
    below = np.array([0.0, 0.0, -0.5])
    assert not Checker.of(robot, Scene((floor,))).valid(below)
    allowed = Checker.of(robot, Scene((floor,), {("floor", "tool")}))
    assert allowed.valid(below)
    assert allowed.free(-below, below)
    assert allowed.clearance(below) == (np.inf, None)
    # With something else to meet, the floor still does not count.
    both = Scene((floor, obstacle("ball", Sphere(0.1), [1.0, 0.0, -0.5])), {("floor", "tool")})
    clearance, pair = Checker.of(robot, both).clearance(below)
    assert clearance == pytest.approx(0.8)
    assert pair == ("tool", "ball")
    assert Checker.of(robot, both).free(-below, below)

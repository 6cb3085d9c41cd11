"""Distances by FCL and their gradients: coal, Qhull, differences, and bounds without either."""

import itertools
from itertools import pairwise

import numpy as np
import pytest

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.model.chain import Chain, Limits, Link
from kinematics.pose import transform
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.collision.model.collision_model import ModelArrays
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.proximity import line_deficit
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.epa import contact
from obstacles.distance.piece_set import CENTER, PieceSet
from obstacles.distance.signed_distance import (
    ACCURACY,
    convex_distance,
    halfspace_distance,
    signed_distance,
)
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from tests.mimic_joints import MIMIC_JOINTS, mimic_robot
from tests.obstacles.arms import builtin
from tests.obstacles.collision.test_checker import few_solids
from tests.obstacles.solids import KINDS, coal_distance, random_solid, random_transform
from tests.planning.scenes import box

UP = np.array([0.0, 0.0, 1.0])


def slide(*pieces: Piece) -> RobotGeometry:
    """Solids on a rail along x."""
    one = np.array([1.0])
    limits = Limits(-5.0 * one, 5.0 * one, one, one, one, one)
    links = (Link("base", -1, np.eye(4)), Link("car", 0, np.eye(4)))
    along_x = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    chain = Chain(
        "slide", ("x",), np.array([1]), along_x[None], links, "base", "car", limits,
        np.zeros(1, dtype=bool),
    )  # fmt: skip
    back = np.linalg.inv(along_x)
    own = tuple(p.placed(back) for p in pieces)
    numbers = np.arange(len(own))
    return RobotGeometry(chain, own, ("car",) * len(own), 0 * numbers, numbers, {})


def alone(shape: Shape) -> RobotGeometry:
    return slide(*shape.pieces())


def distance(shape: Shape, other: Shape, T: Array, margin: float = 0.0) -> float:
    world = FclWorld(alone(shape), Scene((Obstacle("it", other, T, margin),)))
    return world.clearance(np.zeros(1)).distance


@pytest.mark.parametrize(("a", "b"), list(itertools.product(KINDS, KINDS)))
def test_distances_agree_with_coal(a: str, b: str) -> None:
    random = np.random.default_rng(21)
    apart = 0
    for _ in range(12):
        T_a, T_b = random_transform(random, 0.5), random_transform(random, 0.5)
        (one, its), (other, theirs) = random_solid(random, a, T_a), random_solid(random, b, T_b)
        expected = coal_distance(its, T_a, theirs, T_b)
        if expected <= 1e-6:
            continue
        apart += 1
        world = FclWorld(slide(one, other), Scene())
        world.pairs = np.array([[0, 1]])
        world.margins = np.zeros(1)
        world.set_configuration(np.zeros(1))
        assert world.distance(0) == pytest.approx(expected, abs=2e-7)
        assert convex_distance(one, T_a, other, T_b) == pytest.approx(expected, abs=1e-6)
        lower, upper = signed_distance(one, T_a, other, T_b)
        assert lower <= expected + 1e-7
        assert upper >= expected - 1e-7
        assert upper - lower <= 1e-7
    assert apart


SIZES = [0.005, 0.05, 0.5, 5.0]


@pytest.mark.parametrize("size", SIZES)
def test_what_is_answered_is_proved_at_every_size(size: float) -> None:
    """FCL alone misses penetrations of centimetre-sized solids."""
    random = np.random.default_rng(22)
    shapes: list[Shape] = [
        Box(size * np.array([1.0, 0.5, 0.3])),
        Sphere(0.4 * size),
        Cylinder(0.3 * size, size),
        Cone(0.4 * size, size),
        Capsule(0.2 * size, size),
        Convex(0.4 * size * random.normal(size=(20, 3))),
        Convex(size * random.normal(size=(6, 3)) * [1.0, 1.0, 0.0]),
    ]
    for one, other in itertools.product(shapes, shapes):
        T = random_transform(random, 0.6 * size)
        found = distance(one, other, T)
        (a,), (b,) = one.pieces(), other.pieces()
        lower, upper = signed_distance(a, np.eye(4), b, T)
        assert found <= upper + 1e-12
        assert found >= lower - 2.0 * ACCURACY


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6, 1e-8, 0.0, -1e-8, -1e-4])
def test_flush_faces(gap: float) -> None:
    """Where FCL by itself can be centimetres off."""
    random = np.random.default_rng(23)
    for _ in range(15):
        a, b = random.uniform(0.05, 1.0, 3), random.uniform(0.05, 1.0, 3)
        shift = [(a[0] + b[0]) / 2.0 + gap, *(0.2 * random.normal(size=2) * a[1:])]
        found = distance(Box(a), Box(b), transform(None, shift))
        assert gap - ACCURACY <= found <= gap + 1e-9
        (one,), (other,), T = Box(a).pieces(), Box(b).pieces(), random_transform(random)
        bounds = signed_distance(one, T, other, T @ transform(None, shift))
        assert bounds == pytest.approx((gap, gap), abs=1e-9)


@pytest.mark.parametrize("kind", ["box", "sphere", "capsule", "cylinder", "cone", "hull"])
def test_balls_and_points_of_clouds_are_as_deep_as_by_the_growing_polytope(kind: str) -> None:
    random = np.random.default_rng(8)
    for k in range(20):
        piece, _ = random_solid(random, kind, random_transform(random, 0.1))
        offset, T = random.normal(size=3) * 0.1, random_transform(random, 0.1)
        shape = PointCloud(offset[None], 0.05) if k % 2 else Sphere(0.05)
        world = FclWorld(slide(piece), Scene((Obstacle("ball", shape, T),)))
        world.set_configuration(np.zeros(1))
        ball = world.scene.piece(0)
        exact = signed_distance(piece, world._poses[0], ball, world._poses[1])[0]
        # Round solids are found to 1e-4 of their size by the polytope, too shallow by that.
        assert world.between(0, 1) == pytest.approx(exact, abs=2e-4)


def test_points_of_clouds_are_where_their_balls_are_beside_triangles() -> None:
    """A sheet is nothing but triangles: its cover never decides."""
    random = np.random.default_rng(17)
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0], [0.05, 0.05, 0.1]])
    sheet = alone(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3], [4, 3, 2]])))
    touching = 0
    for _ in range(40):
        T = random_transform(random, 0.05)
        points, radius = random.normal(0.0, 0.05, (12, 3)), float(random.uniform(0.005, 0.03))
        places = points @ T[:3, :3].T + T[:3, 3]
        balls = Scene(tuple(
            Obstacle(f"{k}", Sphere(radius), transform(np.eye(3), at))
            for k, at in enumerate(places)
        ))  # fmt: skip
        cloud = Scene((Obstacle("cloud", PointCloud(points, radius), T),))
        expected = FclWorld(sheet, balls).clearance(np.zeros(1)).distance
        found = FclWorld(sheet, cloud).clearance(np.zeros(1)).distance
        assert (found > 0.0) == (expected > 0.0)
        assert max(found, 0.0) == pytest.approx(max(expected, 0.0), abs=1e-9)
        touching += found <= 0.0
    assert 8 < touching < 32


def test_the_halfspace_is_exact() -> None:
    random = np.random.default_rng(24)
    for _ in range(20):
        floor = HalfSpace(random.normal(size=3), random.normal())
        shape = [Box(random.uniform(0.1, 1.0, 3)), Cylinder(0.2, 0.7), Cone(0.3, 0.5), Sphere(0.3)][
            random.integers(4)
        ]
        (piece,), (half,) = shape.pieces(), floor.pieces()
        expected = halfspace_distance(piece, np.eye(4), half.T_owner_piece)
        assert distance(shape, floor, np.eye(4)) == pytest.approx(expected, abs=1e-12)


def test_collisions_name_each_pair_once_deepest_first() -> None:
    cloud = PointCloud(np.array([[0.0, 0.3, 0], [0, 0.35, 0], [0, 9, 0]]), 0.1)
    scene = Scene((
        Obstacle("cloud", cloud),
        Obstacle("far", Sphere(0.1), transform(None, [3.0, 0, 0])),
        Obstacle("wall", Box(np.ones(3)), transform(None, [0.0, 0.0, 0.6])),
        Obstacle("pass", Sphere(0.5)),
    ), frozenset({("car", "pass")}))  # fmt: skip
    world = FclWorld(alone(Sphere(0.3)), scene)
    found = world.collisions(np.zeros(1))
    assert [c.pair for c in found] == [("car", "wall"), ("car", "cloud")]
    assert [c.depth for c in found] == pytest.approx([0.2, 0.1], abs=1e-7)
    assert world.collisions(np.array([1.5])) == []
    # Driven up to the one that was far.
    assert world.clearance(np.array([2.0])).pair == ("car", "far")
    assert world.clearance(np.array([2.0])).distance == pytest.approx(0.6, abs=1e-7)


def test_clearance_is_the_least_over_all_pairs() -> None:
    robot = builtin("panda")
    random = np.random.default_rng(25)
    shapes = [Box(np.array([0.2, 0.3, 0.4])), Cylinder(0.1, 0.5), Cone(0.2, 0.3), Sphere(0.1)]
    obstacles = [
        Obstacle(str(k), shapes[k % 4], random_transform(random, 0.6), 0.01 * (k % 2))
        for k in range(8)
    ]
    obstacles.append(Obstacle("floor", HalfSpace(UP, -0.2)))
    world = FclWorld(robot, Scene(tuple(obstacles)))
    lower, upper = robot.chain.sampling_bounds()
    for q in random.uniform(lower, upper, (20, robot.chain.n)):
        found = world.clearance(q)
        bounds = world.ball_bounds(*world.pairs.T) - world.margins
        every = np.array([world.distance(k) for k in range(len(world.pairs))])
        assert (bounds <= every + 1e-12).all()
        assert found.distance == pytest.approx(every.min(), abs=1e-12)
        assert found.pair == world.pair_names(int(every.argmin()))
        collisions = world.collisions(q)
        assert bool(collisions) == (every.min() <= 0.0)
        if collisions:
            assert collisions[0].depth == pytest.approx(-every.min(), abs=1e-12)


def found(a: Piece, b: Piece) -> tuple[float, Array, Array]:
    rows, corners, tables, _ = PieceSet.of([a, b])
    axis = rows[0, CENTER : CENTER + 3] - rows[1, CENTER : CENTER + 3]
    distance, normal, point = contact(rows, 0, rows, 1, corners, tables, axis)
    return distance, np.array(normal), np.array(point)


@pytest.mark.parametrize("kinds", list(itertools.combinations_with_replacement(KINDS, 2)))
def test_signed_distance_is_that_of_an_independent_expansion(kinds: tuple[str, str]) -> None:
    random = np.random.default_rng(31)
    apart = overlapping = 0
    for k in range(24):
        spread = 0.4 if k % 3 else 0.1
        Ts = random_transform(random, spread), random_transform(random, spread)
        (a, _), (b, _) = (random_solid(random, kind, T) for kind, T in zip(kinds, Ts, strict=True))
        lower, upper = signed_distance(a, Ts[0], b, Ts[1])
        distance, normal, _ = found(a, b)
        assert distance <= upper + 1e-9
        assert distance >= lower - 5e-6
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        apart += distance > 0.0
        overlapping += distance <= 0.0
    assert apart > 2
    assert overlapping > 2


def test_the_point_lies_on_the_second_piece_and_as_far_from_the_first() -> None:
    random = np.random.default_rng(32)
    for kinds in itertools.product(KINDS, repeat=2):
        for _ in range(6):
            Ts = random_transform(random, 0.5), random_transform(random, 0.5)
            (a, _), (b, _) = (
                random_solid(random, kind, T) for kind, T in zip(kinds, Ts, strict=True)
            )
            distance, normal, point = found(a, b)
            assert abs(off(point, b)) < 1e-5
            if distance > 1e-6:
                assert abs(off(point + distance * normal, a)) < 1e-5


def off(point: Array, piece: Piece) -> float:
    """Signed distance of a point from a piece, by an independent expansion."""
    tiny = Piece(PieceKind.POLYTOPE, transform(None, point), np.zeros((1, 3)))
    return signed_distance(tiny, tiny.T_owner_piece, piece, piece.T_owner_piece)[0]


@pytest.mark.parametrize("name", [*builtin_names(), "mimic joint"])
def test_gradients_are_those_of_differences(name: str) -> None:
    robot = mimic_robot() if name == "mimic joint" else builtin(name)
    random = np.random.default_rng(33)
    lower, upper = robot.chain.sampling_bounds()
    step, compared, jumps, negative, followed = 1e-6, 0, 0, 0, 0
    followers = {str(joint[3]) for joint in MIMIC_JOINTS}
    for _ in range(12):
        checker = Checker.of(robot, few_solids(random), 0.01)
        q = random.uniform(lower, upper)
        near = checker.gradient(q, 0.2)
        clearance, least = checker.clearance(q)[0], near.distances.min(initial=np.inf)
        if 0.0 < clearance < 0.2:
            assert least == pytest.approx(clearance, abs=1e-9)
        else:
            assert least <= 0.0 if clearance <= 0.0 else least > 0.2
        before = dict(zip(near.pairs.tolist(), near.distances, strict=True))
        for j in range(robot.chain.n):
            e = step * np.eye(robot.chain.n)[j]
            ahead, behind = (
                dict(zip(near.pairs.tolist(), near.distances, strict=True))
                for near in (checker.gradient(q + e, 0.21), checker.gradient(q - e, 0.21))
            )
            for row, pair in enumerate(near.pairs.tolist()):
                slope = (ahead[pair] - behind[pair]) / (2.0 * step)
                compared += 1
                followed += not followers.isdisjoint(checker.model.pair_name(pair))
                negative += before[pair] < 0.0
                jumps += abs(slope - near.gradients[row, j]) > 1e-3
    # Where the nearest feature changes inside the step, or is not unique, there is no gradient.
    assert jumps <= 0.02 * compared
    assert followed > 200 or name != "mimic joint"
    assert compared > 20 or name in ("planar_rr", "cart_pendulum", "scara")
    assert negative > 0 or name in ("planar_rr", "cart_pendulum", "scara", "elbow_wrist")


def test_only_what_is_near_is_answered() -> None:
    robot = builtin("ur5e")
    floor = Scene((Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.1), margin=0.02),))
    checker = Checker(Checker.of(robot, floor).model, slack=0.01)
    q = np.zeros(6)
    everything = checker.gradient(q, 10.0)
    some = checker.gradient(q, float(np.median(everything.distances)))
    assert len(some.pairs) < len(everything.pairs)
    assert set(some.pairs) <= set(everything.pairs)
    names = {checker.model.pair_name(int(pair)) for pair in everything.pairs}
    assert any("floor" in pair for pair in names)
    assert everything.gradients.shape == (len(everything.pairs), 6)


PREFERRED, SPACING = 0.3, 0.2
SCENE = Scene(
    (box("bar", (0.1, 1.0, 0.1), (1.3, 0.0, 0.4)), box("post", (0.1, 0.1, 0.6), (-1.2, 0.0, 0.3)))
)


@kernel
def shortfall_on(model: ModelArrays, a: Array, b: Array, spacing: float, most: float) -> float:
    return line_deficit(model, workspace(model), a, b, spacing, most)


def lines(count: int) -> Array:
    return np.random.default_rng(3).uniform(-2.5, 2.5, (count + 1, 2))


def test_it_is_the_mean_of_what_the_distances_lack() -> None:
    robot = builtin("planar_rr")
    model = Checker.of(robot, SCENE, PREFERRED).model.with_margins(PREFERRED, 0.0).arrays
    world, told, expected = FclWorld(robot, SCENE), [], []
    for a, b in pairwise(lines(40)):
        parts = max(1, int(np.ceil(np.linalg.norm(b - a) / SPACING)))
        states = a + ((np.arange(parts) + 0.5) / parts)[:, None] * (b - a)
        nearest = np.array([max(world.clearance(q).distance, 0.0) for q in states])
        if not (nearest > 0.0).all():
            continue  # how deep things overlap is not told exactly
        expected.append(np.maximum(PREFERRED - nearest, 0.0).mean())
        told.append(shortfall_on(model, a, b, SPACING, np.inf))
    assert len(told) > 10
    assert max(told) > 0.05
    np.testing.assert_allclose(told, expected, atol=1e-6)

"""Distances and contacts of solids and packed pieces beside coal, closed forms and Qhull."""

import itertools

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.fcl_solid import Separation, fcl_solid
from obstacles.distance.fcl_solid import separation as fcl_separation
from obstacles.distance.gjk import BETWEEN, CLOSER, FARTHER, STILL, separation
from obstacles.distance.piece_set import (
    CENTER,
    KIND,
    POSE,
    RADIUS,
    WIDTH,
    CoreKind,
    Pair,
    PieceSet,
)
from obstacles.distance.scene_set import scene_set
from obstacles.distance.signed_distance import (
    ACCURACY,
    convex_distance,
    proved_distance,
    signed_distance,
)
from obstacles.distance.triangles.distance import touching
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Convex,
    Cylinder,
    HalfSpace,
    PointCloud,
    Shape,
    Sphere,
)
from tests.obstacles.collision.test_fcl_distance import found as contact
from tests.obstacles.outline import convex_pieces
from tests.obstacles.solids import (
    KINDS,
    NO_VERTICES,
    coal_distance,
    random_solid,
    random_transform,
)


def compare(
    a: Piece, b: Piece, near: float = -np.inf, far: float = np.inf, axis: Array | None = None
) -> tuple[int, float, float]:
    rows, corners, tables, _ = PieceSet.of([a, b])
    towards = rows[0, CENTER : CENTER + 3] - rows[1, CENTER : CENTER + 3]
    if axis is not None:
        towards = np.array(axis)
    return separation(
        Pair(rows, 0, rows, 1), corners, tables, near, far, STILL, towards, np.empty((8, 3))
    )


@pytest.mark.parametrize("gap", [1e-9, 1e-6, 1e-3, 1.0, 100.0])
def test_box_face_to_box_face(gap: float) -> None:
    signs = np.array(list(itertools.product((-1, 1), repeat=3))) * 0.5
    a = Piece(PieceKind.POLYTOPE, np.eye(4), signs)
    b = Piece(PieceKind.POLYTOPE, transform(None, [1.0 + gap, 0.2, -0.1]), signs)
    _, lower, upper = compare(a, b)
    # The direction v / |v| is off by the digits of a metre over the gap; the bound then is by the
    # same angle times a metre, and always to the safe side.
    assert gap - (1e-15 / gap + 1e-13) <= lower <= gap + 1e-15
    assert upper == pytest.approx(gap, abs=1e-13, rel=1e-12)


@pytest.mark.parametrize("kinds", list(itertools.product(KINDS, repeat=2)))
def test_distance_is_that_of_coal_and_bounds_hold_from_any_direction(
    kinds: tuple[str, str],
) -> None:
    random = np.random.default_rng(3)
    apart = 0
    for _ in range(20):
        (a, coal_a), (b, coal_b) = (
            random_solid(random, kind, random_transform(random, 0.8)) for kind in kinds
        )
        truth = coal_distance(coal_a, a.T_owner_piece, coal_b, b.T_owner_piece)
        _, lower, upper = compare(a, b)
        if truth > 1e-7:
            apart += 1
            assert lower == pytest.approx(truth, abs=2e-8)
            assert upper == pytest.approx(truth, abs=2e-8)
        else:
            assert lower <= 1e-7
        threshold = random.uniform(0.0, 1.0)
        start = random.normal(size=3)
        verdict, lower, upper = compare(a, b, near=0.0, far=threshold, axis=start)
        assert lower <= max(truth, 0.0) + 1e-7
        if truth > 1e-7:
            assert upper >= truth - 1e-7
        if verdict == FARTHER:
            assert truth > threshold - 1e-7
        elif verdict == CLOSER:
            assert truth <= 1e-7
        else:
            assert verdict == BETWEEN
            assert -1e-7 < truth <= threshold + 1e-7
    assert apart > 2


def test_halfspace_distance_is_that_of_the_lowest_point() -> None:
    random = np.random.default_rng(4)
    for kind in KINDS:
        for _ in range(20):
            T_floor = random_transform(random)
            floor = Piece(PieceKind.HALFSPACE, T_floor, NO_VERTICES)
            solid, other = random_solid(random, kind, random_transform(random))
            # A very large box under the plane stands for the half-space.
            size = 200.0
            T_box = T_floor @ transform(None, [0.0, 0.0, -size / 2.0])
            expected = coal_distance(coal.Box(size, size, size), T_box, other, solid.T_owner_piece)
            for pair in ((floor, solid), (solid, floor)):
                _, lower, upper = compare(*pair)
                assert lower == upper
                if expected > 1e-6:
                    assert lower == pytest.approx(expected, abs=1e-6)
                else:
                    assert lower <= 1e-6


def test_deep_overlap_and_coincident_centres_are_closer() -> None:
    random = np.random.default_rng(5)
    for kinds in itertools.product(KINDS, repeat=2):
        T = random_transform(random)
        (a, _), (b, _) = (random_solid(random, kind, T) for kind in kinds)
        verdict, lower, _ = compare(a, b, near=0.0, far=1.0, axis=np.zeros(3))
        assert verdict == CLOSER
        assert lower <= 0.0


def test_flat_and_segment_like_polytopes() -> None:
    square = Piece(
        PieceKind.POLYTOPE, np.eye(4), np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    )
    segment = Piece(
        PieceKind.POLYTOPE, transform(None, [0.1, 0.2, 0.3]), np.array([[0, 0, 0], [0, 0, 1.0]])
    )
    assert compare(square, segment)[1:] == pytest.approx((0.3, 0.3))
    crossing = Piece(PieceKind.POLYTOPE, np.eye(4), np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    assert compare(square, crossing, near=0.0, far=1.0)[0] == CLOSER


def at(shape: Shape, place: list[float] | Array, T: Array | None = None) -> Piece:
    (piece,) = shape.pieces()
    return piece.placed(transform(None, place) @ (np.eye(4) if T is None else T))


def polytope_depth(a: Array, b: Array) -> float:
    """Signed distance of hulls that overlap, by all faces of their Minkowski difference."""
    differences = (a[:, None] - b[None]).reshape(-1, 3)
    return float(ConvexHull(differences).equations[:, 3].max())


def test_polytopes_are_as_deep_as_their_minkowski_difference() -> None:
    random = np.random.default_rng(2)
    for _ in range(20):
        a = at(Convex(random.normal(size=(12, 3))), random.normal(size=3) * 0.3)
        b = at(Convex(random.normal(size=(9, 3))), np.zeros(3), random_transform(random, 0.1))
        corners = [p.vertices @ p.T_owner_piece[:3, :3].T + p.T_owner_piece[:3, 3] for p in (a, b)]
        assert contact(a, b)[0] == pytest.approx(polytope_depth(*corners), abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_moved_out_by_its_depth_it_touches_no_more(seed: int) -> None:
    random = np.random.default_rng(10 + seed)
    overlaps = 0
    for a, b in itertools.combinations(convex_pieces(random), 2):
        near = a.placed(transform(None, 0.6 * (b.T_owner_piece[:3, 3] - a.T_owner_piece[:3, 3])))
        depth, n, _ = contact(near, b)
        if depth > -1e-3:
            continue
        overlaps += 1
        out = near.placed(transform(None, (-depth + 1e-6) * n))
        assert contact(out, b)[0] > -1e-9
        # Half of the way is not enough.
        assert contact(near.placed(transform(None, -0.5 * depth * n)), b)[0] < 0.0
    assert overlaps > 3


def test_concentric_solids_part_by_the_shortest_way() -> None:
    box, ball = Box(np.array([0.2, 0.4, 0.6])), Sphere(0.05)
    value, n, _ = contact(at(ball, np.zeros(3)), at(box, np.zeros(3)))
    assert value == pytest.approx(-0.15)
    assert np.abs(n) == pytest.approx([1.0, 0.0, 0.0])
    assert contact(at(ball, np.zeros(3)), at(ball, np.zeros(3)))[0] == pytest.approx(-0.1)


@pytest.mark.parametrize("height", [-0.05, 0.0, 0.05])
def test_a_halfspace_is_left_upwards(height: float) -> None:
    floor = at(HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0), np.zeros(3))
    for shape in (Sphere(0.1), Box(np.full(3, 0.2)), Cylinder(0.1, 0.2)):
        solid = at(shape, [0.3, 0.2, 0.1 + height])
        value, n, point = contact(solid, floor)
        assert value == pytest.approx(height, abs=1e-12)
        np.testing.assert_allclose(n, [0.0, 0.0, 1.0])
        assert point[2] == pytest.approx(0.0, abs=1e-12)
        value, n, point = contact(floor, solid)
        assert value == pytest.approx(height, abs=1e-12)
        np.testing.assert_allclose(n, [0.0, 0.0, -1.0])
        # The point is always of the second solid: its lowest one.
        assert point[2] == pytest.approx(height, abs=1e-12)


def test_flat_pieces_have_a_depth_where_their_difference_has_one() -> None:
    """A segment through a square is left sideways; a square in its own plane at once."""
    square = at(Convex(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])), np.zeros(3))
    needle = Convex(np.array([[0.4, 0.5, -1.0], [0.4, 0.5, 1.0]]))
    assert contact(at(needle, np.zeros(3)), square)[0] == pytest.approx(-0.4)
    assert contact(at(needle, [0, 0, 0.9]), square)[0] == pytest.approx(-0.1)
    assert contact(at(needle, [0, 0, 1.5]), square)[0] == pytest.approx(0.5)
    assert contact(square, square)[0] == pytest.approx(0.0, abs=1e-9)


def distance(a: Piece, b: Piece) -> float:
    return convex_distance(a, a.T_owner_piece, b, b.T_owner_piece)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_a_lower_bound_whichever_comes_first(seed: int) -> None:
    for a, b in itertools.combinations(convex_pieces(np.random.default_rng(seed)), 2):
        _, upper = signed_distance(a, a.T_owner_piece, b, b.T_owner_piece)
        assert distance(a, b) <= upper + 1e-12
        assert distance(a, b) == pytest.approx(distance(b, a), abs=1e-6)


def test_a_wrong_proposal_costs_time_and_no_truth() -> None:
    """Too large, in a wrong direction, or none: our own distance is answered instead."""
    (a,), (b,) = Sphere(0.1).pieces(), Box(np.full(3, 0.2)).pieces()
    T_a, T_b = np.eye(4), transform(None, [0.5, 0.0, 0.0])
    one, other = fcl_solid(a), fcl_solid(b)
    one.move(T_a)
    other.move(T_b)
    right = fcl_separation(one, other)
    assert right is not None
    lies = [
        right,
        None,
        right._replace(distance=right.distance + 0.1),
        Separation(right.distance, right.other, right.nearest),
        Separation(right.distance, np.zeros(3), np.array([0.0, 1.0, 0.0])),
        Separation(0.0, np.zeros(3), np.array([1.0, 1.0, 1.0])),
    ]
    for lie in lies:
        answer = proved_distance(lie, a, T_a, b, T_b)
        assert answer <= 0.3 + 1e-12
        assert answer == pytest.approx(0.3, abs=ACCURACY) or lie is lies[-1]
    # A distance that is proposed too small is believed where a plane proves as much: it is true.
    assert proved_distance(lies[-1], a, T_a, b, T_b) > 0.0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_boxes_right_beside_each_other_are_as_far_apart_as_their_faces(axis: int) -> None:
    """FCL may take two corners for the nearest points, 7 mm too far apart at 2.8 m."""
    (box,) = Box(np.full(3, 0.2)).pieces()
    moved = box.placed(transform(None, 3.0 * np.eye(3)[axis]))
    assert distance(box, moved) == pytest.approx(2.8, abs=1e-9)
    assert distance(moved, box) == pytest.approx(2.8, abs=1e-9)


def test_touching_is_a_signed_distance_of_at_most_zero() -> None:
    random = np.random.default_rng(10)
    seen = [0, 0]
    for _ in range(4):
        pieces = [p.placed(random_transform(random, 0.15)) for p in convex_pieces(random)]
        packed = PieceSet.of(pieces)
        for (i, a), (j, b) in itertools.combinations(enumerate(pieces), 2):
            lower, upper = signed_distance(a, a.T_owner_piece, b, b.T_owner_piece)
            if upper <= 0.0 or lower > 0.0:
                assert touching(packed, i, j) == (upper <= 0.0)
                assert touching(packed, j, i) == (upper <= 0.0)
                seen[int(upper <= 0.0)] += 1
    assert min(seen) > 10


POINTS = np.array([[0.0, 0.0, 0.3], [0.2, -0.1, 0.0]])
MIXED = Scene(
    (
        Obstacle("ball", Sphere(0.1), transform(None, [1.0, 2.0, 3.0])),
        Obstacle("cloud", PointCloud(POINTS, 0.02), transform(None, [0.5, 0.0, 0.0])),
        Obstacle("box", Box((0.2, 0.4, 0.6)), transform(None, [0.0, -1.0, 0.0])),
    )
)


def test_rows_are_where_the_obstacles_are() -> None:
    rows = scene_set(MIXED).rows
    assert rows.shape == (4, WIDTH)
    assert rows[:, KIND].tolist() == [*3 * [CoreKind.POINT], CoreKind.BOX]
    moved = POINTS + np.array([0.5, 0.0, 0.0])
    middles = np.vstack([[1.0, 2.0, 3.0], moved, [0.0, -1.0, 0.0]])
    np.testing.assert_allclose(rows[:, CENTER : CENTER + 3], middles, atol=1e-15)
    np.testing.assert_allclose(rows[:, POSE + 3 : POSE + 12 : 4], middles, atol=1e-15)
    radii = np.array([0.1, 0.02, 0.02, float(np.linalg.norm([0.1, 0.2, 0.3]))])
    np.testing.assert_allclose(rows[:, RADIUS], radii, rtol=1e-12)

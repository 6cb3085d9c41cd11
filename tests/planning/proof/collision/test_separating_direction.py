"""Directions that part pieces, how they are proposed, and which pairs are compared."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.trajectory.trajectory import stay
from obstacles.collision.fcl_distance import FclWorld
from obstacles.collision.model import collision_model
from obstacles.convex.piece import Piece, PieceArrays, PieceKind
from obstacles.distance.piece_set import GROUP, GROUP_STOP, POSE, PieceSet
from obstacles.distance.signed_distance import halfspace_distance, signed_distance
from obstacles.distance.triangles.distance import touching
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, HalfSpace, PointCloud, Sphere
from planning.proof.certificate import certify
from planning.proof.collision.interval_check import check_interval
from planning.proof.collision.pair_table import HOLDER, PairTable, any_pairs
from planning.proof.collision.proposals import (
    FIRST_NODE,
    STOP_NODE,
    empty_proposal,
    packed_pieces,
    propose,
)
from planning.proof.collision.separating_direction import direction, gap, highest, rounding_bound
from planning.proof.collision.sweep_state import Sweep, pop_interval
from planning.proof.limits.limit_uses import Violation
from tests.obstacles.arms import cup, cut_arm, mesh_shape
from tests.obstacles.collision.model.test_collision_model import mixed
from tests.obstacles.outline import convex_shapes
from tests.obstacles.shapes.test_shape import random_scene
from tests.obstacles.solids import KINDS, NO_VERTICES, coal_distance, random_solid, random_transform
from tests.planning.proof.sweeping import start_sweep, through
from tests.planning.proof.test_certificate import fork
from tests.planning.scenes import HOME, builtin
from tests.planning.slider import slider
from tests.properties import directions, numbers, transforms


def proved(pieces: list[Piece], u: Array) -> float:
    """What u proves of the first two pieces' distance; minus infinity where it is no direction."""
    arrays = PieceArrays.pack(pieces)
    columns = np.ascontiguousarray(arrays.vertices.T)
    some, n = direction(arrays.kinds, arrays.poses, 0, 1, (u[0], u[1], u[2]))
    if not some:
        return -np.inf
    found, _ = gap(arrays.kinds, arrays.sizes, columns, arrays.starts, arrays.poses, 0, 1, n)
    return float(found)


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations_with_replacement(KINDS, 2)))
def test_no_direction_proves_more_than_the_distance(one: str, other: str) -> None:
    random = np.random.default_rng(10 * KINDS.index(one) + KINDS.index(other))
    sharpest = -np.inf
    for _ in range(4):
        T_a, T_b = random_transform(random), random_transform(random)
        (a, coal_a), (b, coal_b) = random_solid(random, one, T_a), random_solid(random, other, T_b)
        distance = coal_distance(coal_a, T_a, coal_b, T_b)
        if distance <= 0.0:
            distance = signed_distance(a, T_a, b, T_b)[1]
        towards = T_b[:3, 3] - T_a[:3, 3]
        for spread in (0.0, 0.3, 3.0):
            for u in towards + spread * random.normal(size=(20, 3)):
                found = proved([a, b], u)
                assert found <= distance + 1e-7
                sharpest = max(sharpest, found - distance)
    assert sharpest > -0.05


def test_best_direction_proves_the_distance() -> None:
    ball = Piece(PieceKind.POLYTOPE, np.eye(4), np.zeros((1, 3)), offset_radius=0.1)
    T = transform(None, [3.0, 4.0, 0.0])
    other = Piece(PieceKind.POLYTOPE, T, np.zeros((1, 3)), offset_radius=0.2)
    assert proved([ball, other], np.array([3.0, 4.0, 0.0])) == pytest.approx(4.7)
    assert proved([ball, other], np.array([-3.0, -4.0, 0.0])) == pytest.approx(-5.3)


@pytest.mark.parametrize("kind", KINDS)
def test_halfspace_is_proved_from_its_normal_whatever_is_proposed(kind: str) -> None:
    random = np.random.default_rng(2)
    for _ in range(10):
        T, H = random_transform(random), random_transform(random)
        solid, _ = random_solid(random, kind, T)
        ground = Piece(PieceKind.HALFSPACE, H, NO_VERTICES)
        true = halfspace_distance(solid, T, H)
        assert proved([ground, solid], random.normal(size=3)) == pytest.approx(true, abs=1e-12)
        assert proved([solid, ground], random.normal(size=3)) == -np.inf


@pytest.mark.parametrize("u", [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0], [0, -np.inf, np.inf]])
def test_what_is_no_direction_proves_nothing(u: list[float]) -> None:
    ball = Piece(PieceKind.POLYTOPE, np.eye(4), np.zeros((1, 3)), offset_radius=0.1)
    T = np.eye(4)
    T[0, 3] = 1.0
    assert proved([ball, Piece(PieceKind.POLYTOPE, T, np.zeros((1, 3)))], np.array(u)) == -np.inf


def test_rounding_grows_with_lengths_and_stays_far_below_what_is_decided() -> None:
    assert 0.0 < rounding_bound(7, 3.0) < 1e-12
    assert rounding_bound(7, 6.0) == pytest.approx(2.0 * rounding_bound(7, 3.0))


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 15, 16, 17, 40, 133])
def test_the_highest_of_some_columns_is_that_of_all_their_products(count: int) -> None:
    random = np.random.default_rng(count)
    for _ in range(20):
        columns, (x, y, z) = random.normal(size=(3, count + 9)), random.normal(size=3)
        start = int(random.integers(0, 9))
        products = np.array([x, y, z]) @ columns[:, start : start + count]
        found = highest(columns, start, start + count, x, y, z)
        assert found == pytest.approx(products.max(initial=-np.inf), rel=1e-14, abs=1e-15)


LENGTHS = st.floats(1e-3, 1.0)


def _round(kind: PieceKind) -> st.SearchStrategy[Piece]:
    return st.builds(
        lambda T, radius, half: Piece(kind, T, np.zeros((0, 3)), radius, half),
        transforms, LENGTHS, LENGTHS,
    )  # fmt: skip


PIECES = st.one_of(
    st.builds(
        lambda T, points, rounding: Piece(PieceKind.POLYTOPE, T, points, offset_radius=rounding),
        transforms, st.integers(1, 6).flatmap(lambda k: numbers((k, 3))), st.floats(0.0, 0.5),
    ),
    _round(PieceKind.CYLINDER),
    _round(PieceKind.CONE),
)  # fmt: skip


@given(PIECES, PIECES, directions)
def test_the_other_way_round_the_same_is_proved(a: Piece, b: Piece, u: Array) -> None:
    assert proved([a, b], u) == pytest.approx(proved([b, a], -u), abs=1e-12)


@given(PIECES, PIECES, directions, transforms)
def test_a_rigid_motion_of_all_changes_nothing(a: Piece, b: Piece, u: Array, T: Array) -> None:
    moved = proved([a.placed(T), b.placed(T)], T[:3, :3] @ u)
    assert moved == pytest.approx(proved([a, b], u), abs=1e-12)


@given(PIECES, PIECES, directions, st.floats(1e-3, 1e3))
def test_only_the_direction_counts_not_its_length(a: Piece, b: Piece, u: Array, k: float) -> None:
    assert proved([a, b], k * u) == pytest.approx(proved([a, b], u), abs=1e-12)


@given(PIECES, PIECES, directions, st.floats(0.0, 5.0))
def test_moving_apart_along_the_direction_proves_as_much_more(
    a: Piece, b: Piece, u: Array, far: float
) -> None:
    T = transform(None, far * u)
    assert proved([a, b.placed(T)], u) == pytest.approx(proved([a, b], u) + far, abs=1e-12)


@given(PIECES, PIECES, directions, st.floats(0.0, 0.3))
def test_rounding_is_taken_off(a: Piece, b: Piece, u: Array, more: float) -> None:
    thick = Piece(
        b.kind, b.T_owner_piece, b.vertices, b.radius, b.half_height, b.offset_radius + more
    )
    assert proved([a, thick], u) == pytest.approx(proved([a, b], u) - more, abs=1e-12)


def scattered(seed: int) -> Scene:
    """Every convex shape, a cloud and a mesh around the ball, in random order."""
    random = np.random.default_rng(seed)
    shapes = [
        *convex_shapes(random),
        PointCloud(random.normal(size=(6, 3)), 0.05),
        mesh_shape(cup()),
    ]
    order = random.permutation(len(shapes))
    return Scene(Obstacle(f"o{k}", shapes[k], random_transform(random, 0.6)) for k in order)


def placed(scene: Scene) -> tuple[PairTable, Sweep]:
    """All elements where they are at the start of a motion."""
    trajectory = through([0.2, -0.1], [0.3, 0.0])
    table = PairTable.of(slider(), scene, 0.0)
    sweep = start_sweep(trajectory, table.arrays)
    pop_interval(trajectory.breaks, trajectory.coefficients, sweep)
    check_interval(table.arrays, sweep)
    arrays = table.arrays
    # The check places what it looks at: here all are wanted.
    for k in range(len(arrays.kinds)):
        T = np.eye(4) if arrays.joints[k] < 0 else sweep.frames[arrays.joints[k]]
        sweep.poses[k] = T @ arrays.poses[k]
        sweep.centers[k] = T[:3, :3] @ arrays.centers[k] + T[:3, 3]
    return table, sweep


def proposed(table: PairTable, sweep: Sweep, i: int, j: int) -> tuple[float, Array]:
    """What is proposed for elements i and j: their distance about, and the direction."""
    proposal = empty_proposal()
    proposal.axis[:] = sweep.centers[i] - sweep.centers[j] + [1e-3, 2e-3, 3e-3]
    upper = propose(table.arrays.proposals, i, j, sweep.poses, sweep.centers, np.inf, proposal)
    return float(upper), proposal.axis / np.linalg.norm(proposal.axis)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_apart_is_parted_by_the_proposal(seed: int) -> None:
    table, sweep = placed(scattered(seed))
    arrays, parted = table.arrays, 0
    for i in range(arrays.moving, len(arrays.kinds)):
        if arrays.kinds[i] == HOLDER:
            continue
        solid, ball = table.solid(i), table.solid(0)
        lower, upper = signed_distance(solid, sweep.poses[i], ball, sweep.poses[0])
        told, axis = proposed(table, sweep, i, 0)
        if lower < 1e-6:
            assert told <= max(upper, 0.0) + 1e-6
            continue
        # From the ball towards the solid: the proof checks it from the solid towards the ball.
        assert told == pytest.approx(upper, abs=1e-5)
        u = (float(-axis[0]), float(-axis[1]), float(-axis[2]))
        apart, _ = gap(
            arrays.kinds, arrays.sizes, arrays.columns, arrays.starts, sweep.poses, i, 0, u
        )
        assert apart == pytest.approx(lower, abs=1e-5)
        parted += 1
    assert parted > 5


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_rows_are_those_of_the_pieces_and_of_nothing_else(seed: int) -> None:
    """In the order of robot and scene: each two touch that touch when packed by themselves."""
    robot, scene = slider(), scattered(seed)
    count = len(scene.pieces()[1])
    packed = packed_pieces(robot, scene)
    alone = PieceSet.of([*robot.pieces, *(scene.piece(k) for k in range(count))])
    assert len(packed.rows) == len(robot.pieces) + count
    np.testing.assert_allclose(packed.rows[:, POSE : POSE + 12], alone.rows[:, POSE : POSE + 12])
    groups = slice(GROUP, GROUP_STOP + 1)
    np.testing.assert_array_equal(packed.rows[:, groups], alone.rows[:, groups])
    verdicts = [
        (touching(packed, i, j), touching(alone, i, j))
        for i, j in itertools.combinations(range(len(alone.rows)), 2)
    ]
    assert all(one == other for one, other in verdicts)
    assert 0 < sum(one for one, _ in verdicts) < len(verdicts)


def test_covers_are_told_by_their_nodes() -> None:
    robot, scene = slider(), scattered(6)
    packed = packed_pieces(robot, scene)
    for k in range(len(scene.pieces()[1])):
        row = packed.rows[len(robot.pieces) + k]
        surface = scene.piece(k).surface
        nodes = int(row[STOP_NODE] - row[FIRST_NODE])
        # A tree of t leaves has 2 t - 1 nodes.
        assert nodes == (0 if surface is None else 2 * len(surface.triangles) - 1)


def test_packing_twice_gives_rows_that_can_be_changed_without_harm() -> None:
    robot, scene = slider(), scattered(7)
    first = packed_pieces(robot, scene)
    before = first.rows.copy()
    first.rows[:] = 0.0
    np.testing.assert_array_equal(packed_pieces(robot, scene).rows, before)


def test_halfspaces_are_packed_as_such() -> None:
    floor = Scene((Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.4)),))
    table, sweep = placed(floor)
    last = len(table.arrays.kinds) - 1
    assert table.solid(last).kind == PieceKind.HALFSPACE
    assert proposed(table, sweep, last, 0)[0] == pytest.approx(0.35, abs=1e-6)


PANDA = builtin("panda")


def scene_of_each(allowed: frozenset[tuple[str, str]] = frozenset()) -> Scene:
    return Scene(
        (
            Obstacle("box", Box(np.array([0.1, 0.1, 0.1])), transform(None, [0.8, 0.0, 0.3]), 0.02),
            Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.3), np.eye(4)),
            Obstacle(
                "cloud",
                PointCloud(np.random.default_rng(0).normal(size=(40, 3)), 0.01),
                transform(None, [0.0, 2.0, 0.0]),
            ),
            Obstacle("mesh", mesh_shape(fork()), transform(None, [0.0, -1.0, 0.4])),
            Obstacle("ball", Sphere(0.1), transform(None, [-0.7, 0.0, 0.5])),
        ),
        allowed,
    )


def compared(table: PairTable) -> set[tuple[str, str]]:
    """Names of all pairs that hang below the roots, holders opened."""
    arrays, pairs = table.arrays, set()
    stack = [(int(i), int(j)) for i, j in arrays.roots]
    while stack:
        i, j = stack.pop()
        if arrays.kinds[i] == HOLDER:
            stack += [(int(k), j) for k in arrays.kids[arrays.below[i] : arrays.below[i + 1]]]
        elif i < arrays.moving or not arrays.skipped[arrays.parts[j], arrays.parts[i]]:
            a, b = table.names(i, j)
            pairs.add((min(a, b), max(a, b)))
    return pairs


def expected(scene: Scene) -> set[tuple[str, str]]:
    """Links that move against obstacles, and the robot's own pairs, but for what may touch."""
    moving = {
        name for name, joint in zip(PANDA.links, PANDA.joints, strict=True) if int(joint) >= 0
    }
    pairs = {(link, name) for link in moving for name in scene.ids}
    pairs |= {(PANDA.links[i], PANDA.links[j]) for i, j in PANDA.self_pairs}
    return {(min(p), max(p)) for p in pairs if not scene.allows(*p)}


@pytest.mark.parametrize(
    "allowed",
    [frozenset(), frozenset({("box", "panda_hand"), ("panda_link5", "panda_link7")})],
    ids=["none", "some"],
)
def test_every_pair_that_may_not_touch_is_compared(allowed: frozenset[tuple[str, str]]) -> None:
    scene = scene_of_each(allowed)
    assert compared(PairTable.of(PANDA, scene, 0.0)) == expected(scene)


def test_every_piece_and_triangle_hangs_below_the_roots() -> None:
    scene = scene_of_each()
    arrays = PairTable.of(PANDA, scene, 0.0).arrays
    seen, stack = set(), [int(i) for i, _ in arrays.roots]
    while stack:
        k = stack.pop()
        if k not in seen:
            seen.add(k)
            stack += arrays.kids[arrays.below[k] : arrays.below[k + 1]].tolist()
    around = {k for k in range(arrays.moving, len(arrays.kinds)) if arrays.kinds[k] != HOLDER}
    assert around <= seen
    triangles = [k for k in around if arrays.proposals.first[k] >= 0]
    pieces = scene.obstacle("mesh").pieces()
    corners = np.concatenate([p.surface.triangles for p in pieces if p.surface is not None])
    assert len(triangles) == len(corners)
    packed = {
        tuple(
            np.sort(arrays.columns[:, arrays.starts[k] : arrays.starts[k + 1]].T.ravel()).round(9)
        )
        for k in triangles
    }
    assert packed == {tuple(np.sort(triangle.ravel()).round(9)) for triangle in corners}


def test_balls_and_boxes_hold_what_is_below_them() -> None:
    for robot, scene in ((PANDA, scene_of_each()), (cut_arm(), Scene())):
        arrays = PairTable.of(robot, scene, 0.0).arrays
        for i in range(len(arrays.kinds)):
            for k in arrays.kids[arrays.below[i] : arrays.below[i + 1]]:
                assert arrays.joints[i] == arrays.joints[k]
                if np.isfinite(arrays.radii[i]):
                    for v in arrays.columns[:, arrays.starts[k] : arrays.starts[k + 1]].T:
                        p = arrays.poses[k, :3, :3] @ v + arrays.poses[k, :3, 3]
                        distance = float(np.linalg.norm(p - arrays.centers[i]))
                        assert distance <= arrays.radii[i] + 1e-12
                        local = arrays.poses[i, :3, :3].T @ (p - arrays.poses[i, :3, 3])
                        out = np.abs(local - arrays.boxes[i, :3]) - arrays.boxes[i, 3:]
                        assert out.max() <= 1e-12
                assert arrays.margins[i] >= arrays.margins[k]
    assert (arrays.kinds[: arrays.moving] == HOLDER).sum() > 20


def test_pairs_that_the_planner_drops_are_compared_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A motion at rest in a box: refused, though the planner's own model skips the pair."""
    real = collision_model.skipped_pairs
    monkeypatch.setattr(
        collision_model, "skipped_pairs", lambda robot, scene: np.ones_like(real(robot, scene))
    )
    hand = 0.3
    scene = Scene((Obstacle("block", Box(np.full(3, hand)), transform(None, [0.35, 0.0, 0.5])),))
    still = stay(PANDA.chain.joint_names, HOME)
    assert FclWorld(PANDA, scene).collisions(HOME)
    violation = certify(still, PANDA, scene).violation
    assert isinstance(violation, Violation)
    assert violation.kind == "collision"
    assert "block" in violation.details["pair"]


@pytest.mark.parametrize("name", ["panda", "ur5e", "planar_rr"])
def test_pairs_of_any_robot_have_the_types_that_kernels_are_looked_up_by(name: str) -> None:
    """The sweep is called without a look at its arguments: arrays must be laid out as expected."""

    def kinds(values: object) -> object:
        if isinstance(values, tuple):
            return [kinds(value) for value in values]
        if isinstance(values, np.ndarray):
            return values.dtype, values.ndim, values.flags.c_contiguous
        return type(values)

    expected = kinds(any_pairs())
    for scene in (Scene(), mixed(0), scattered(1), random_scene(3, 7)):
        for opened in (frozenset[int](), None):
            assert kinds(PairTable.of(builtin(name), scene, 0.01, opened).arrays) == expected

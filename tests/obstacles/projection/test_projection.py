"""Projection: against convex optimisation, and by what defines it."""

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from kinematics.pose import inverse, transform
from obstacles.projection.fcl_projection import FclProjector
from obstacles.projection.projection import Projector, pack_obstacles, project, without_points
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
from tests.obstacles.arms import mesh_shape
from tests.obstacles.bodies import hollow_box
from tests.obstacles.solids import random_transform

#: What the kernels are held to [m], for solids and points within a few metres.
EXACT = 1e-9

CONVEX: dict[str, Callable[[np.random.Generator], Shape]] = {
    "box": lambda random: Box(random.uniform(0.05, 1.0, 3)),
    "sphere": lambda random: Sphere(random.uniform(0.05, 0.5)),
    "cylinder": lambda random: Cylinder(*random.uniform(0.05, 0.5, 2)),
    "capsule": lambda random: Capsule(*random.uniform(0.05, 0.5, 2)),
    "cone": lambda random: Cone(*random.uniform(0.05, 0.5, 2)),
    "halfspace": lambda random: HalfSpace(random.normal(size=3), random.normal()),
    "hull": lambda random: Convex(0.3 * random.normal(size=(random.integers(4, 60), 3))),
    "plate": lambda random: Convex(random.normal(size=(20, 3)) * [0.3, 0.3, 0.0]),
    "needle": lambda random: Convex(random.normal(size=(2, 3))),
}


def support(shape: Shape, n: Array) -> float:
    """max n.x over the solid, by its definition rather than its pieces."""
    if isinstance(shape, Box):
        return float(np.abs(n) @ shape.size / 2.0)
    if isinstance(shape, Sphere):
        return float(shape.radius * np.linalg.norm(n))
    radial = float(np.hypot(n[0], n[1]))
    if isinstance(shape, Cylinder):
        return float(shape.radius * radial + abs(n[2]) * shape.height / 2.0)
    if isinstance(shape, Capsule):
        return float(shape.radius * np.linalg.norm(n) + abs(n[2]) * shape.height / 2.0)
    if isinstance(shape, Cone):
        up = float(n[2]) * shape.height / 2.0
        return max(up, shape.radius * radial - up)
    if isinstance(shape, HalfSpace):
        along = np.linalg.norm(n - shape.normal * (n @ shape.normal)) < 1e-9
        return shape.offset * float(n @ shape.normal) if along and n @ shape.normal > 0 else np.inf
    assert isinstance(shape, Convex)
    return float((shape.vertices @ n).max())


@pytest.mark.parametrize("kind", CONVEX)
def test_is_the_nearest_point_by_a_separating_plane(kind: str) -> None:
    """Outside, pi(p) is nearest if and only if the plane through it, across p - pi(p), separates.

    The distance then equals that of the plane, n.p - h(n), which is proved by the support h alone.
    """
    random = np.random.default_rng(3)
    outside = 0
    for _ in range(40):
        shape, T = CONVEX[kind](random), random_transform(random, 0.3)
        points = random.normal(size=(30, 3))
        pi, distance = project(points, [Obstacle("a", shape, T)])
        T_shape = inverse(T)
        for p, q, d in zip(points, pi[:, 0], distance[:, 0], strict=True):
            assert np.linalg.norm(p - q) == pytest.approx(abs(d), abs=EXACT)
            if d <= 1e-6:
                continue
            outside += 1
            n = T_shape[:3, :3] @ (p - q) / d
            local = T_shape[:3, :3] @ p + T_shape[:3, 3]
            assert n @ local - support(shape, n) == pytest.approx(d, abs=EXACT)
    assert outside > 100


@pytest.mark.parametrize("kind", CONVEX)
def test_projecting_again_changes_nothing(kind: str) -> None:
    random = np.random.default_rng(4)
    for _ in range(20):
        projector = Projector([Obstacle("a", CONVEX[kind](random), random_transform(random))])
        pi, _ = projector(random.normal(size=(30, 3)))
        again, distance = projector(pi[:, 0])
        assert np.abs(distance).max() <= EXACT
        np.testing.assert_allclose(again, pi, atol=EXACT)


@pytest.mark.parametrize("kind", [kind for kind in CONVEX if kind not in ("plate", "needle")])
def test_inside_the_boundary_is_that_far_in_every_direction(kind: str) -> None:
    """The depth of p in a convex solid is the least of h(n) - n.p over all directions n."""
    random = np.random.default_rng(5)
    inside = 0
    for _ in range(30):
        shape = CONVEX[kind](random)
        points = 0.15 * random.normal(size=(30, 3))
        pi, distance = project(points, [Obstacle("a", shape)])
        directions = random.normal(size=(200, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        supports = np.array([support(shape, u) for u in directions])
        for p, q, d in zip(points, pi[:, 0], distance[:, 0], strict=True):
            if d >= -1e-6:
                continue
            inside += 1
            n = (q - p) / -d
            assert support(shape, n) - n @ p == pytest.approx(-d, abs=EXACT)
            assert (supports - directions @ p).min() >= -d - EXACT
    assert inside > 50


@pytest.mark.parametrize("kind", CONVEX)
def test_points_on_axes_edges_and_centres_have_an_answer(kind: str) -> None:
    random = np.random.default_rng(7)
    shape = CONVEX[kind](random)
    grid = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    special = [1e-15, 1e-8, 0.05, 0.5, 3.0]
    points = np.vstack([scale * grid for scale in special])
    pi, distance = project(points, [Obstacle("a", shape)])
    assert np.isfinite(pi).all()
    np.testing.assert_allclose(
        np.linalg.norm(points - pi[:, 0], axis=1), np.abs(distance[:, 0]), atol=EXACT
    )


def ring(points: Array) -> Array:
    across = np.hypot(points[:, 0], points[:, 1])
    return np.asarray((across > 0.15) & (across < 0.3) & (np.abs(points[:, 2]) < 0.05))


def room(points: Array) -> Array:
    outer, inner = np.abs(points).max(axis=1) < 0.3, np.abs(points).max(axis=1) < 0.2
    return np.asarray(outer & ~inner)


@pytest.mark.parametrize(("body", "inside"), [
    (trimesh.creation.annulus(0.15, 0.3, 0.1, sections=256), ring),
    (trimesh.util.concatenate(hollow_box(0.6, 0.4)), room),
])  # fmt: skip
def test_hollows_of_meshes_are_not_filled(
    body: trimesh.Trimesh, inside: Callable[[Array], Array]
) -> None:
    random = np.random.default_rng(4)
    T = random_transform(random)
    own = random.uniform(-0.35, 0.35, (400, 3))
    points = own @ T[:3, :3].T + T[:3, 3]
    obstacle = Obstacle("mesh", Mesh(body.vertices, body.faces), T)
    pi, distance = project(points, [Obstacle("far", Sphere(0.1), T), obstacle])
    corners = np.array(body.triangles)
    closest = [trimesh.triangles.closest_point(corners, np.tile(p, (len(corners), 1))) for p in own]
    nearest = np.linalg.norm(np.array(closest) - own[:, None], axis=2).min(axis=1)
    np.testing.assert_allclose(np.abs(distance[:, 1]), nearest, atol=EXACT)
    np.testing.assert_allclose(
        np.linalg.norm(points - pi[:, 1], axis=1), np.abs(distance[:, 1]), atol=EXACT
    )
    # The ring has 256 sides where the test's is round.
    clear = np.abs(distance[:, 1]) > 1e-4
    assert np.array_equal(distance[clear, 1] < 0.0, inside(own)[clear])
    assert inside(own).sum() > 20


def test_every_obstacle_of_a_scene_gets_its_column() -> None:
    random = np.random.default_rng(10)
    obstacles = tuple(
        Obstacle(kind, build(random), random_transform(random)) for kind, build in CONVEX.items()
    )
    points = random.normal(size=(5, 3))
    projector = Projector(Scene(obstacles))
    assert projector.ids == tuple(CONVEX)
    pi, distance = projector(points)
    assert pi.shape == (5, len(CONVEX), 3)
    for k, obstacle in enumerate(obstacles):
        alone, d = project(points, [obstacle])
        np.testing.assert_array_equal(alone[:, 0], pi[:, k])
        np.testing.assert_array_equal(d[:, 0], distance[:, k])


def test_nothing_to_project_onto_or_from() -> None:
    pi, distance = project(np.zeros((3, 3)), Scene())
    assert pi.shape == (3, 0, 3)
    assert distance.shape == (3, 0)
    assert project(np.zeros((0, 3)), [Obstacle("a", Sphere(1.0))])[1].shape == (0, 1)


@pytest.mark.parametrize(
    "points", [[1.0, 2, 3], [[1.0, 2]], [[1.0, 2, np.nan]], "abc", [[None] * 3]]
)
def test_refuses_points(points: Array) -> None:
    with pytest.raises(InvalidScene, match="points"):
        project(points, Scene())


#: Distances by FCL are this exact [m].
_DISTANCE = 1e-8
#: Nearest points are worse, as a distance hardly changes along a surface [m].
_POINT = 2e-4


@pytest.mark.parametrize("kind", list(CONVEX))
def test_both_engines_agree(kind: str) -> None:
    random = np.random.default_rng(2)
    inside = 0
    for _ in range(10):
        obstacle = Obstacle("it", CONVEX[kind](random), random_transform(random, 0.5))
        exact, fcl = Projector([obstacle]), FclProjector([obstacle])
        points = random.uniform(-1.0, 1.0, (20, 3))
        on_surface = exact(points[:5])[0][:, 0]
        points = np.vstack([points, on_surface, on_surface + 1e-7 * random.normal(size=(5, 3))])
        pi, d = exact(points)
        found, distances = fcl(points)
        np.testing.assert_allclose(distances, d, atol=_DISTANCE)
        clear = d[:, 0] > 1e-6
        atol = 1e-8 if kind in {"box", "sphere", "capsule"} else _POINT
        np.testing.assert_allclose(found[clear], pi[clear], atol=atol)
        # Deep inside there may be several ways out that are as short.
        inside += int((d < -1e-6).sum())
    assert inside > 0 or kind in {"plate", "needle"}


def tube() -> Mesh:
    """A square tube, open at its ends: not convex."""
    turn = trimesh.transformations.rotation_matrix(np.pi / 4.0, [0.0, 0.0, 1.0])
    inner, outer = 0.2 * np.sqrt(2.0), 0.3 * np.sqrt(2.0)
    return mesh_shape(trimesh.creation.annulus(inner, outer, 1.0, transform=turn, sections=4))


def test_meshes_that_are_not_convex_are_asked_about_by_triangles() -> None:
    random = np.random.default_rng(4)
    obstacle = Obstacle("tube", tube(), random_transform(random, 0.3))
    local = np.vstack([random.uniform(-0.6, 0.6, (60, 3)), [[0.0, 0.0, 0.0], [0.25, 0.0, 0.1]]])
    T = obstacle.T_world_obstacle
    points = local @ T[:3, :3].T + T[:3, 3]
    _, d = Projector([obstacle])(points)
    found, distances = FclProjector([obstacle])(points)
    np.testing.assert_allclose(distances, d, atol=_DISTANCE)
    np.testing.assert_allclose(
        np.linalg.norm(found[:, 0] - points, axis=1), np.abs(d[:, 0]), atol=_DISTANCE
    )
    # In its hollow a point is outside, in its wall inside.
    assert distances[-2, 0] == pytest.approx(0.2, abs=_DISTANCE)
    assert distances[-1, 0] == pytest.approx(-0.05, abs=_DISTANCE)


def test_what_is_too_far_may_be_left_out() -> None:
    scene = Scene(
        (Obstacle("near", Sphere(0.1)), Obstacle("far", Sphere(0.1), transform(None, [3.0, 0, 0])))
    )
    projections, distances = FclProjector(scene)([[0.3, 0.0, 0.0]], np.array([0.5]))
    assert distances[0] == pytest.approx([0.2, np.inf], abs=1e-9)
    assert np.isnan(projections[0, 1]).all()


def test_points_are_checked() -> None:
    for points in ([[0.0, 0.0]], [[np.nan, 0.0, 0.0]]):
        with pytest.raises(InvalidScene):
            FclProjector([Obstacle("it", Sphere(0.1))])(points)


def test_points_on_an_object_are_left_out_of_a_cloud() -> None:
    random = np.random.default_rng(38)
    points = random.uniform(-0.3, 0.3, (4000, 3))
    T = random_transform(random, 0.05)
    half = np.array([0.05, 0.08, 0.1])
    scene = Scene(
        [
            Obstacle("cloud", PointCloud(points, 0.005), transform(None, [0.02, 0.0, 0.01])),
            Obstacle("crate", Box(2.0 * half), T),
        ]
    )
    for margin in (0.0, 0.03):
        left = without_points(scene, "cloud", "crate", margin).obstacle("cloud").shape
        assert isinstance(left, PointCloud)
        local = (points + np.array([0.02, 0.0, 0.01]) - T[:3, 3]) @ T[:3, :3]
        outside = np.linalg.norm(np.maximum(np.abs(local) - half, 0.0), axis=1)
        np.testing.assert_array_equal(left.points, points[outside > margin])
    assert without_points(scene, "cloud", "crate", 2.0).ids == ("crate",)


def test_loose_triangles_take_memory_by_their_number_not_its_square() -> None:
    random, count = np.random.default_rng(3), 2000
    middles = random.uniform(-1.0, 1.0, (count, 1, 3))
    corners = (middles + 0.01 * random.normal(size=(count, 3, 3))).reshape(-1, 3)
    scene = Scene(
        [Obstacle("loose", Mesh(corners, np.arange(3 * count).reshape(-1, 3)), np.eye(4))]
    )
    tracemalloc.start()
    try:
        arrays = pack_obstacles(scene.obstacles)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(arrays.triangles) >= count
    assert peak < 50e6, "a square matrix of its corners has 288 MB"

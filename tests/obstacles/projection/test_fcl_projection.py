"""Projection by FCL: against closed forms written here, and against the exact engine."""

from collections.abc import Callable

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from kinematics.pose import inverse
from obstacles.projection.fcl_projection import FclProjector
from obstacles.projection.projection import Projector
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Capsule, Mesh, Shape, Sphere
from tests.obstacles.projection.test_projection import CONVEX
from tests.obstacles.solids import random_transform

#: Distances by FCL are this exact [m].
_DISTANCE = 1e-8
#: Nearest points are worse, as a distance hardly changes along a surface [m].
_POINT = 2e-4


def in_frame(T: Array, p: Array) -> Array:
    return np.asarray(inverse(T)[:3, :3] @ p + inverse(T)[:3, 3])


def out_of_frame(T: Array, p: Array) -> Array:
    return np.asarray(T[:3, :3] @ p + T[:3, 3])


def onto_box(shape: Shape, p: Array) -> Array:
    assert isinstance(shape, Box)
    return np.clip(p, -shape.size / 2.0, shape.size / 2.0)


def onto_sphere(shape: Shape, p: Array) -> Array:
    assert isinstance(shape, Sphere)
    return np.asarray(shape.radius * p / np.linalg.norm(p))


def onto_capsule(shape: Shape, p: Array) -> Array:
    assert isinstance(shape, Capsule)
    core = np.array([0.0, 0.0, np.clip(p[2], -shape.height / 2.0, shape.height / 2.0)])
    return np.asarray(core + shape.radius * (p - core) / np.linalg.norm(p - core))


@pytest.mark.parametrize(
    ("shape", "closed_form"),
    [
        (Box((0.2, 0.7, 1.1)), onto_box),
        (Sphere(0.3), onto_sphere),
        (Capsule(0.15, 0.8), onto_capsule),
    ],
    ids=["box", "sphere", "capsule"],
)
def test_outside_it_is_the_closed_form(
    shape: Shape, closed_form: Callable[[Shape, Array], Array]
) -> None:
    random = np.random.default_rng(1)
    outside = 0
    for _ in range(40):
        obstacle = Obstacle("it", shape, random_transform(random, 1.0))
        p = random.uniform(-1.5, 1.5, 3)
        T = obstacle.T_world_obstacle
        expected = out_of_frame(T, closed_form(shape, in_frame(T, p)))
        projections, distances = FclProjector([obstacle])(p[None])
        if distances[0, 0] <= 0.0:
            continue
        outside += 1
        assert distances[0, 0] == pytest.approx(np.linalg.norm(p - expected), abs=1e-9)
        np.testing.assert_allclose(projections[0, 0], expected, atol=1e-8)
    assert outside > 25


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
        np.testing.assert_allclose(found[clear], pi[clear], atol=_POINT)
        # Deep inside there may be several ways out that are as short.
        inside += int((d < -1e-6).sum())
    assert inside > 0 or kind in {"plate", "needle"}


def tube() -> Mesh:
    """A square tube, open at its ends: not convex."""
    inner, outer = 0.2, 0.3
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], dtype=float)
    rings = [
        np.column_stack([size * square, np.full(4, z)])
        for size in (inner, outer)
        for z in (-0.5, 0.5)
    ]
    faces = []
    for i in range(4):
        j = (i + 1) % 4
        for a, b, turned in ((0, 4, True), (8, 12, False), (0, 8, False), (4, 12, True)):
            quad = [a + i, a + j, b + j, b + i]
            quad = quad[::-1] if turned else quad
            faces += [quad[:3], [quad[0], quad[2], quad[3]]]
    return Mesh(np.vstack(rings), np.array(faces))


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
    scene = Scene((Obstacle("near", Sphere(0.1)), Obstacle("far", Sphere(0.1), shifted(3.0))))
    projections, distances = FclProjector(scene)([[0.3, 0.0, 0.0]], np.array([0.5]))
    assert distances[0] == pytest.approx([0.2, np.inf], abs=1e-9)
    assert np.isnan(projections[0, 1]).all()


def shifted(x: float) -> Array:
    T = np.eye(4)
    T[0, 3] = x
    return T


def test_points_are_checked() -> None:
    for points in ([[0.0, 0.0]], [[np.nan, 0.0, 0.0]]):
        with pytest.raises(InvalidScene):
            FclProjector([Obstacle("it", Sphere(0.1))])(points)

"""Bodies cut into convex parts: all is covered, no triangle is lost, and hollows stay open."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from obstacles.convex.hull import convex_hull
from obstacles.meshes.convex_cover import ConvexPart, cut_bodies
from obstacles.meshes.plane_cut import triangle_areas
from tests.obstacles.arms import cup, in_cup

RING = trimesh.creation.annulus(0.5, 1.0, 0.4, sections=16)


def parts_of(*bodies: trimesh.Trimesh, filled: bool = True) -> list[ConvexPart]:
    whole = trimesh.util.concatenate(bodies)
    starts = np.cumsum([0, *(len(body.vertices) for body in bodies)])
    faces = [np.array(body.faces) + first for body, first in zip(bodies, starts, strict=False)]
    return cut_bodies(np.array(whole.vertices), faces, float(whole.scale), filled)


@cache
def cup_parts() -> list[ConvexPart]:
    return parts_of(cup())


def heights(part: ConvexPart, points: Array) -> Array:
    """How far points (m, 3) are beyond a part, by the highest of its planes [m], at most."""
    planes = convex_hull(part.vertices).planes
    outside = (points @ planes[:, :3].T - planes[:, 3]).max(axis=1)
    return np.asarray(outside - part.offset_radius)


def within(points: Array, body: trimesh.Trimesh) -> int:
    """How many of the points are in the box around a body."""
    low, high = body.bounds[0] - 1e-12, body.bounds[1] + 1e-12
    return int(((low <= points) & (points <= high)).all(axis=1).sum())


def covered(parts: list[ConvexPart], points: Array) -> Array:
    return np.asarray(np.min([heights(part, points) for part in parts], axis=0) <= 1e-9)


def total(parts: list[ConvexPart]) -> float:
    return sum(convex_hull(part.vertices).volume for part in parts)


@cache
def ring_parts() -> list[ConvexPart]:
    return parts_of(RING)


@pytest.mark.parametrize(("mesh", "parts"), [(cup(), cup_parts), (RING, ring_parts)])
def test_parts_hold_their_triangles_and_together_all_of_the_surface(
    mesh: trimesh.Trimesh, parts: Callable[[], list[ConvexPart]]
) -> None:
    assert 2 <= len(parts()) <= 12
    area = sum(triangle_areas(part.triangles).sum() for part in parts())
    assert area == pytest.approx(mesh.area, rel=1e-6)
    for part in parts():
        assert heights(part, part.triangles.reshape(-1, 3)).max() <= 1e-9
        assert part.filled


def test_the_solid_is_covered_and_the_hollow_is_not() -> None:
    parts = cup_parts()
    points = np.random.default_rng(1).uniform(-0.2, 0.2, (3000, 3))
    solid = in_cup(points)
    assert covered(parts, points[solid]).all()
    # Cuts are tried at twelve places a side, not at the walls themselves.
    assert covered(parts, points[~solid]).mean() < 0.15
    assert total(parts) < 1.2 * cup().volume


def test_a_ring_is_cut_although_no_single_cut_helps() -> None:
    parts = ring_parts()
    assert len(parts) > 2
    assert total(parts) < 0.8 * convex_hull(RING.vertices).volume
    assert not covered(parts, np.zeros((1, 3))).any()


def test_every_body_of_a_part_has_an_anchor_on_it() -> None:
    small = [
        trimesh.creation.box(bounds=[[0.01 * k, 0.0, 0.0], [0.01 * k + 0.009, 1.0, 1.0]])
        for k in range(4)
    ]
    for part in parts_of(*small):
        anchored = [within(part.anchors, body) for body in small]
        there = [within(part.triangles.reshape(-1, 3), body) for body in small]
        assert [count > 0 for count in anchored] == [count > 0 for count in there]
        assert max(anchored) == 1


def test_a_hull_of_many_corners_is_thinned_and_grown_to_hold_them_all() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    (part,) = parts_of(ball)
    assert len(ball.vertices) > 128 + 8
    # It gets eight corners at once until it has 128.
    assert len(part.vertices) < 128 + 8
    assert part.offset_radius > 0.0
    assert heights(part, np.array(ball.vertices)).max() <= 1e-9
    assert part.offset_radius < 0.06


def test_an_open_surface_is_covered_without_what_is_in_it() -> None:
    parts = parts_of(cup(), filled=False)
    assert not any(part.filled for part in parts)
    corners = np.array(cup().triangles).reshape(-1, 3)
    assert covered(parts, corners).all()

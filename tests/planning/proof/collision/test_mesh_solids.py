"""Solids of meshes as the proof sees them, against where they are known to be."""

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from planning.proof.collision.mesh_solids import mesh_solids
from tests.obstacles.arms import cup, in_cup
from tests.obstacles.bodies import HOSTS, assembly, bowl, cracked, ell, hollow_box, moved, sheet


def turned_at_random(triangles: Array, random: np.random.Generator) -> Array:
    turned = random.random(len(triangles)) < 0.3
    return np.where(turned[:, None, None], triangles[:, ::-1], triangles)


def test_points_of_a_cup_are_inside_its_walls_and_not_in_its_hollow() -> None:
    random = np.random.default_rng(1)
    triangles = np.array(cup().triangles)
    for written in (triangles, triangles[:, ::-1], turned_at_random(triangles, random)):
        points = random.uniform(-0.25, 0.25, (600, 3))
        np.testing.assert_array_equal(mesh_solids(written).hold(points), in_cup(points))


def test_the_volume_of_all_bodies_is_that_of_the_solids() -> None:
    outer, inner = hollow_box()
    for bodies, volume, opened in (
        ([ell(1.0)], ell(1.0).volume, 0),
        ([outer, inner], outer.volume + inner.volume, 0),
        ([outer, inner, bowl(2.0), sheet(0.1)], outer.volume + inner.volume, 2),
        ([bowl(1.0)], 0.0, 1),
    ):
        found = mesh_solids(np.array(trimesh.util.concatenate(bodies).triangles))
        a, b, c = (found.triangles[:, k] for k in range(3))
        assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(volume)
        assert (len(found.points), found.opened) == (len(bodies), opened)


def test_holes_are_closed_by_cones_so_that_winding_numbers_are_whole() -> None:
    ball = trimesh.creation.icosphere(3)
    holed = mesh_solids(np.array(ball.triangles)[10:])
    assert (len(holed.low), holed.opened) == (1, 0)
    points = np.random.default_rng(2).uniform(-1.2, 1.2, (500, 3))
    away = np.linalg.norm(points, axis=1)
    clear = np.abs(away - 1.0) > 0.06
    np.testing.assert_array_equal(holed.hold(points)[clear], (away < 1.0)[clear])
    assert mesh_solids(np.array(ball.triangles)[100:]).opened == 1
    cylinder = mesh_solids(np.array(cracked().triangles))
    assert (len(cylinder.low), cylinder.opened) == (1, 0)
    assert cylinder.hold(np.array([[0.0, 0.0, z] for z in (-0.2, 0.05, 0.4)])).tolist() == [
        True,
        True,
        False,
    ]


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize("seed", range(4))
def test_whatever_else_a_mesh_has_its_closed_bodies_keep_their_inside(host: str, seed: int) -> None:
    made = assembly(np.random.default_rng(seed), host)
    found = mesh_solids(made.vertices[made.faces])
    random = np.random.default_rng(seed + 100)
    near = random.uniform(-0.02, 0.02, (20, 3))
    assert found.hold(made.inside + near).all()
    assert not found.hold(made.free + near).any()


def test_overlapping_bodies_are_solid_whichever_way_round_they_are() -> None:
    """The winding numbers of the two would cancel each other where they overlap."""
    one, other = trimesh.creation.box([1.0] * 3), trimesh.creation.box([1.0] * 3)
    other.invert()
    both = trimesh.util.concatenate([one, moved(other, [0.5, 0.0, 0.0])])
    x = np.linspace(-0.9, 1.4, 47)
    points = np.column_stack([x, np.full_like(x, 0.1), np.full_like(x, 0.2)])
    held = mesh_solids(np.array(both.triangles)).hold(points)
    np.testing.assert_array_equal(held, (x > -0.5) & (x < 1.0))


def test_no_points_are_inside_of_anything() -> None:
    assert mesh_solids(np.array(cup().triangles)).hold(np.zeros((0, 3))).shape == (0,)
    assert not mesh_solids(np.array(sheet(1.0).triangles)).hold(np.zeros((3, 3))).any()

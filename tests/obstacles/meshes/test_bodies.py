"""Bodies of meshes: how many, which are closed, which are cavities; winding numbers."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from kinematics.arrays import Array, Indices
from obstacles.meshes.bodies import Body, mesh_bodies
from obstacles.meshes.winding import oriented, winding_numbers
from tests.obstacles.bodies import bowl, ell, hollow_box, moved, sheet


def bodies_of(mesh: trimesh.Trimesh) -> list[Body]:
    return mesh_bodies(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64))


def kinds(mesh: trimesh.Trimesh) -> list[tuple[bool, bool]]:
    """Whether each body is closed, and a cavity; the largest body first."""
    found = sorted(bodies_of(mesh), key=lambda b: -np.ptp(mesh.vertices[b.faces], (0, 1)).max())
    return [(body.closed, body.cavity) for body in found]


SOLID, CAVITY, OPEN = (True, False), (True, True), (False, False)
BOX = trimesh.creation.box([1.0] * 3)
BALL = trimesh.creation.icosphere(3)


def with_faces(mesh: trimesh.Trimesh, faces: Array) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, faces, process=False)


def joined(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    """Meshes in one, with one vertex for corners that lie in one place."""
    mesh = trimesh.util.concatenate(meshes)
    mesh.merge_vertices()
    return mesh


def test_closed_bodies_are_solids_and_open_ones_are_not() -> None:
    for mesh in (BOX, BALL, ell(1.0), trimesh.creation.torus(0.5, 0.1)):
        assert kinds(mesh) == [SOLID]
        assert kinds(with_faces(mesh, mesh.faces[:, ::-1])) == [SOLID]
    tube = trimesh.creation.annulus(0.2, 0.21, 1.0)
    assert kinds(with_faces(tube, tube.faces[np.abs(tube.face_normals[:, 2]) < 0.5])) == [OPEN] * 2
    for mesh in (bowl(1.0), sheet(1.0)):
        assert kinds(mesh) == [OPEN]


@pytest.mark.parametrize(("missing", "expected"), [(10, SOLID), (100, OPEN)])
def test_small_holes_do_not_matter(missing: int, expected: tuple[bool, bool]) -> None:
    assert kinds(with_faces(BALL, BALL.faces[missing:])) == [expected]


def test_a_cavity_is_a_body_turned_unlike_the_one_around_it() -> None:
    outer, inner = hollow_box()
    core = trimesh.creation.box([0.2] * 3)
    assert kinds(joined(outer, inner)) == [SOLID, CAVITY]
    assert kinds(joined(outer, inner, core)) == [SOLID, CAVITY, SOLID]
    inside_out = joined(outer, inner)
    inside_out.invert()
    assert kinds(inside_out) == [SOLID, CAVITY]
    # Two shells that are turned alike are one in the other; one beside the other is no cavity.
    assert kinds(joined(outer, trimesh.creation.box([0.6] * 3))) == [SOLID, SOLID]
    assert kinds(joined(outer, moved(inner, [2.0, 0.0, 0.0]))) == [SOLID, SOLID]
    assert kinds(joined(outer, moved(inner, [0.5, 0.0, 0.0]))) == [SOLID, SOLID]


def test_triangles_turned_at_random_or_there_twice_do_not_open_a_body() -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        faces = np.array(BALL.faces)
        turned = random.random(len(faces)) < random.uniform(0.0, 0.4)
        faces[turned] = faces[turned][:, ::-1]
        again = faces[random.random(len(faces)) < random.uniform(0.0, 1.0)]
        again = again if random.random() < 0.5 else again[:, ::-1]
        assert kinds(with_faces(BALL, np.vstack([faces, again]))) == [SOLID]


def test_walls_within_take_no_inside_away() -> None:
    """Two boxes with one wall between them, which is there once or twice; or an edge in common."""
    beside = joined(BOX, moved(BOX, [1.0, 0.0, 0.0]))
    assert kinds(beside) == [SOLID]
    wall = (np.abs(beside.triangles_center[:, 0] - 0.5) < 1e-9) & (beside.face_normals[:, 0] > 0.0)
    assert wall.sum() == 2
    assert kinds(with_faces(beside, beside.faces[~wall]))[0] == SOLID
    by_an_edge = joined(BOX, moved(BOX, [1.0, 1.0, 0.0]))
    assert kinds(by_an_edge) == [SOLID]


@pytest.mark.parametrize("count", [63, 66, 300])
def test_every_body_is_one_however_many_there_are(count: int) -> None:
    random = np.random.default_rng(count)
    small = [moved(trimesh.creation.box([0.02] * 3), [0.1 * k, 3.0, 0.0]) for k in range(count)]
    some_open = random.random(count) < 0.3
    for k in np.flatnonzero(some_open):
        small[k] = moved(sheet(0.01), [0.1 * k, 3.0, 0.0])
    found = bodies_of(trimesh.util.concatenate([BOX, *small, sheet(40.0)]))
    assert len(found) == count + 2
    assert sum(body.closed for body in found) == 1 + count - some_open.sum()


def hull(random: np.random.Generator) -> tuple[Array, Indices, Array]:
    """Corners, triangles turned outward and planes of a random hull."""
    points = random.normal(size=(30, 3))
    found = ConvexHull(points)
    faces = found.simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return points, faces.astype(np.int64), found.equations


def numbers_of(points: Array, vertices: Array, faces: Indices) -> Array:
    numbers = np.empty(len(points))
    winding_numbers(points, vertices, faces, numbers)
    return numbers


def test_it_is_one_inside_of_a_hull_and_none_outside() -> None:
    random = np.random.default_rng(1)
    for _ in range(5):
        vertices, faces, planes = hull(random)
        points = random.normal(size=(200, 3)) * 1.5
        heights = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        numbers = numbers_of(points, vertices, faces)
        np.testing.assert_allclose(numbers[heights < -1e-3], 1.0, atol=1e-9)
        np.testing.assert_allclose(numbers[heights > 1e-3], 0.0, atol=1e-9)
        backwards = numbers_of(points, vertices, faces[:, ::-1])
        np.testing.assert_allclose(backwards, -numbers, atol=1e-9)


def test_triangles_are_turned_alike() -> None:
    random = np.random.default_rng(3)
    vertices, faces, _ = hull(random)
    mixed = faces.copy()
    turned = random.random(len(faces)) < 0.5
    mixed[turned] = mixed[turned][:, ::-1]
    inside = vertices.mean(axis=0)[None]
    assert abs(numbers_of(inside, vertices, mixed)[0]) < 0.9
    assert abs(numbers_of(inside, vertices, oriented(mixed))[0]) == pytest.approx(1.0)


def test_triangles_of_two_bodies_are_turned_alike_in_each() -> None:
    random = np.random.default_rng(4)
    first, second = hull(random), hull(random)
    vertices = np.vstack([first[0], second[0] + 10.0])
    faces = np.vstack([first[1], second[1] + len(first[0])])
    for share in (0.2, 0.8):
        mixed = faces.copy()
        turned = random.random(len(faces)) < share
        mixed[turned] = mixed[turned][:, ::-1]
        inside = np.array([first[0].mean(axis=0), second[0].mean(axis=0) + 10.0])
        numbers = numbers_of(inside, vertices, oriented(mixed))
        np.testing.assert_allclose(numbers, 1.0 if share < 0.5 else -1.0, atol=1e-9)

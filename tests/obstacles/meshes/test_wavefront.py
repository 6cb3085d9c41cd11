"""OBJ text: indices that count back, tabs, and what is refused."""

import numpy as np
import pytest

from kinematics.errors import InvalidScene
from obstacles.meshes.mesh import load_mesh, plain_obj

SQUARE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
ABOVE = b"v 0 0 1\nv 1 0 1\nv 1 1 1\n"


def corners(data: bytes) -> set[tuple[tuple[float, ...], ...]]:
    vertices, faces = load_mesh(data, "obj")
    return {tuple(sorted(tuple(vertices[i]) for i in face)) for face in faces}


@pytest.mark.parametrize(
    ("relative", "absolute"),
    [
        (SQUARE + b"f -4 -3 -2\n" + ABOVE + b"f -3 -2 -1\n", b"f 1 2 3\nf 5 6 7\n"),
        (SQUARE + b"f -4 -3 -2 -1\n" + ABOVE + b"f 5 -2 7\n", b"f 1 2 3 4\nf 5 6 7\n"),
        (SQUARE + ABOVE + b"vt 0 0\nvn 0 0 1\nf -7/-1/-1 -6/1/-1 -5/-1/1\n", b"f 1 2 3\n"),
        (SQUARE + b"f -4 -3 \\\n -2\n" + ABOVE, b"f 1 2 3\n"),
        ((SQUARE + b"f -4 -3 -2\n" + ABOVE).replace(b"\n", b"\r\n"), b"f 1 2 3\n"),
        ((SQUARE + ABOVE + b"f 1 2 3\n").replace(b" ", b"\t"), b"f 1 2 3\n"),
    ],
)  # fmt: skip
def test_corners_are_those_that_the_face_means(relative: bytes, absolute: bytes) -> None:
    assert corners(relative) == corners(SQUARE + ABOVE + absolute)


@pytest.mark.parametrize("face", [b"f 0 1 2\n", b"f 1 2 0/1\n", b"f -1 -2 -5\n", b"f -1 -2 -x\n"])
def test_indices_that_name_no_vertex_are_refused(face: bytes) -> None:
    whole = SQUARE + b"f 1 2 3 4\n" + face
    with pytest.raises(InvalidScene, match="obj"):
        load_mesh(whole, "obj")


def test_vertices_and_faces_are_left() -> None:
    text = (
        b"# f -1\nmtllib m\n o part\n" + SQUARE + b"vt 0 -0.5\nusemtl m\n f 1/1 2/0/1 3/1\nf 10 2 3"
    )
    assert plain_obj(text, 9) == SQUARE + b"f 1 2 3\nf 10 2 3\n"


def test_triangles_are_counted_before_polygons_are_cut() -> None:
    polygons = b"".join(b"f " + b"1 2 3 " * k + b"\n" for k in range(1, 600))
    assert len(plain_obj(SQUARE + polygons, 600_000)) > len(polygons)
    with pytest.raises(InvalidScene, match="at most 200000"):
        load_mesh(SQUARE + polygons, "obj")


def test_a_mesh_written_backwards_is_the_same_body() -> None:
    random = np.random.default_rng(5)
    points = random.normal(size=(30, 3))
    faces = np.array([random.permutation(30)[:3] for _ in range(40)])
    head = b"".join(b"v %.17g %.17g %.17g\n" % tuple(p) for p in points)
    forward = b"".join(b"f %d %d %d\n" % tuple(f + 1) for f in faces)
    backward = b"".join(b"f %d %d %d\n" % tuple(f - 30) for f in faces)
    assert corners(head + forward) == corners(head + backward)

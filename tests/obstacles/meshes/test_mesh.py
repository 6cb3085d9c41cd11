"""Mesh files: read from bytes beside what assimp reads, everything malformed refused."""

import importlib.metadata
import io
import time
import zipfile
from pathlib import Path

import coal
import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from obstacles.convex.triangles import Triangles, join, piece_triangles
from obstacles.meshes import mesh as mesh_module
from obstacles.meshes.mesh import (
    FILE_TYPES,
    checked_mesh,
    is_bare_header,
    load_mesh,
    plain_obj,
    scaled,
)
from obstacles.meshes.writer import glb, stl
from obstacles.shapes.shape import Box


def exported(body: trimesh.Trimesh, file_type: str) -> bytes:
    data = body.export(file_type=file_type)
    return data.encode() if isinstance(data, str) else bytes(data)


@pytest.mark.parametrize("file_type", FILE_TYPES)
def test_reads_every_type(file_type: str) -> None:
    body = trimesh.creation.cylinder(0.3, 1.0, sections=16)
    for name in (file_type, "." + file_type.upper()):
        vertices, faces = load_mesh(exported(body, file_type), name)
        assert not vertices.flags.writeable
        assert not faces.flags.writeable
        assert trimesh.Trimesh(vertices, faces).volume == pytest.approx(body.volume, rel=1e-5)


def test_reads_ascii_stl() -> None:
    data = exported(trimesh.creation.box([1.0, 2.0, 3.0]), "stl_ascii")
    vertices, faces = load_mesh(data, "stl")
    assert trimesh.Trimesh(vertices, faces).volume == pytest.approx(6.0)


def test_joins_the_bodies_of_one_file() -> None:
    text = ""
    for body in range(3):
        text += f"o body_{body}\nusemtl paint_{body}\n"
        text += "".join(f"v {x + 2 * body} {y} 0\n" for x, y in ((0, 0), (1, 0), (0, 1)))
        text += f"f {3 * body + 1} {3 * body + 2} {3 * body + 3}\n"
    vertices, faces = load_mesh(text.encode(), "obj")
    assert len(faces) == 3
    assert np.ptp(vertices[faces][:, :, 0]) == pytest.approx(5.0)


@pytest.mark.parametrize("file_type", ["zip", "3mf", "glb", "", "stl.zip", "../x"])
def test_refuses_other_types_by_name(file_type: str) -> None:
    with pytest.raises(InvalidScene) as error:
        load_mesh(b"whatever", file_type)
    assert "stl, obj, ply, off, dae" in str(error.value.hint)


def stl_of(triangles: Array) -> bytes:
    record = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + record.tobytes()


def archive() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a.stl", stl_of(np.zeros((10, 3, 3))))
    return buffer.getvalue()


HUGE_PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n"
    b"property float x\nproperty float y\nproperty float z\nend_header\n"
)
TRIANGLE = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])


@pytest.mark.parametrize(("data", "file_type"), [
    (b"", "stl"),
    (b"", "obj"),
    (b"", "ply"),
    (b"", "off"),
    (b"\xff\xfe\x00garbage", "obj"),
    (b"\xff\xfe\x00garbage", "stl"),
    (archive(), "stl"),
    (archive(), "ply"),
    (stl_of(TRIANGLE)[:-20], "stl"),
    (stl_of(TRIANGLE * np.nan), "stl"),
    (stl_of(np.where(TRIANGLE > 0.0, np.inf, 0.0)), "stl"),
    (stl_of(TRIANGLE[:0]), "stl"),
    (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "obj"),
    (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "obj"),
    (b"v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "obj"),
    (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "off"),
    (b"OFF\n99999999 99999999 0\n", "off"),
    (HUGE_PLY, "ply"),
])  # fmt: skip
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_refuses_what_is_malformed(data: bytes, file_type: str) -> None:
    with pytest.raises(InvalidScene, match="mesh"):
        load_mesh(data, file_type)


def test_refuses_what_is_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_module, "MAX_BYTES", 100)
    with pytest.raises(InvalidScene, match="at most"):
        load_mesh(stl_of(TRIANGLE), "stl")
    monkeypatch.setattr(mesh_module, "MAX_FACES", 3)
    body = trimesh.creation.box([1.0, 1.0, 1.0])
    with pytest.raises(InvalidScene, match="at most 3"):
        checked_mesh(body.vertices, body.faces)


@pytest.mark.parametrize("scale", [(2.0, 3.0, 0.5), (-2.0, 3.0, 0.5), (-1.0, -1.0, -1.0)])
def test_scaled_meshes_still_face_out(scale: tuple[float, float, float]) -> None:
    body = trimesh.creation.icosphere(2)
    vertices, faces = scaled(*checked_mesh(body.vertices, body.faces), scale)
    expected = body.volume * abs(float(np.prod(scale)))
    assert trimesh.Trimesh(vertices, faces).volume == pytest.approx(expected)


@pytest.mark.parametrize("scale", [(0.0, 1.0, 1.0), (np.nan, 1.0, 1.0), (1.0, 1.0)])
def test_refuses_a_scale(scale: tuple[float, ...]) -> None:
    body = trimesh.creation.box([1.0, 1.0, 1.0])
    with pytest.raises(InvalidScene, match="scale"):
        scaled(*checked_mesh(body.vertices, body.faces), scale)


STL = """solid Kühler
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 0 2 0
endloop
endfacet
endsolid Kühler
"""
PLY = """ply
format ascii 1.0
comment Kühler
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 2 0
3 0 1 2
"""
OBJ = "# Kühler\nv 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"
OFF = "OFF\n# Kühler\n3 1 0\n0 0 0\n1 0 0\n0 2 0\n3 0 1 2\n"


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8"])
@pytest.mark.parametrize(
    ("text", "file_type"), [(STL, "stl"), (PLY, "ply"), (OBJ, "obj"), (OFF, "off")]
)
def test_names_may_be_in_any_encoding(text: str, file_type: str, encoding: str) -> None:
    vertices, faces = load_mesh(text.encode(encoding), file_type)
    assert trimesh.Trimesh(vertices, faces).area == pytest.approx(1.0)


def test_binary_stl_may_begin_as_text_does() -> None:
    data = stl_of(np.array([[[0.0, 0, 0], [1, 0, 0], [0, 2, 0]]]))
    header = "solid Kühler".encode("latin-1")
    vertices, faces = load_mesh(header + data[len(header) :], "stl")
    assert trimesh.Trimesh(vertices, faces).area == pytest.approx(1.0)


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0, 0], [0, 0, 0], [0, 0, 0]],
        [[3, 4, 5], [3, 4, 5], [6, 8, 10]],
        [[0, 0, 0], [1, 2, 3], [2, 4, 6]],
        [[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.7, 0.7, 0.7]],
    ],
)
def test_points_and_lines_are_no_solids(corners: list[list[float]]) -> None:
    for size in (1e-6, 1.0, 1e5):
        with pytest.raises(InvalidScene, match="a point or a line"):
            checked_mesh(size * np.array(corners), [[0, 1, 2], [2, 1, 0]])


def test_one_triangle_with_an_area_is_enough() -> None:
    corners = np.array([[0, 0, 0], [1, 2, 3], [2, 4, 6], [2, 4, 6.001]])
    for size in (1e-6, 1.0, 1e5):
        checked_mesh(size * corners, [[0, 1, 2], [0, 1, 3]])


@pytest.mark.parametrize(
    ("data", "kind", "is_bare"),
    [
        (bytes(80), "stl", True),
        (bytes(84), "STL", True),
        (b"exported".ljust(84, b"\0"), "stl", True),
        (bytes(80) + b"\1\0\0\0", "stl", False),
        (bytes(79), "stl", False),
        (b"", "stl", False),
        (bytes(134), "stl", False),
        (bytes(84), "obj", False),
    ],
)
def test_headers_of_stl_files_without_triangles(data: bytes, kind: str, is_bare: bool) -> None:
    assert is_bare_header(data, kind) == is_bare


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


def test_triangles_are_counted_before_polygons_are_cut() -> None:
    polygons = b"".join(b"f " + b"1 2 3 " * k + b"\n" for k in range(1, 600))
    assert len(plain_obj(SQUARE + polygons, 600_000)) > len(polygons)
    with pytest.raises(InvalidScene, match="at most 200000"):
        load_mesh(SQUARE + polygons, "obj")


BOX = join(piece_triangles(piece) for piece in Box([0.1, 0.2, 0.3]).pieces())
SHIFTED = Triangles(BOX.vertices + np.array([1.0, 2.0, 3.0]), BOX.faces)


def test_an_stl_comes_back_with_its_normals() -> None:
    mesh = trimesh.load(io.BytesIO(stl(SHIFTED)), file_type="stl")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(0.006, rel=1e-5)
    assert mesh.bounds == pytest.approx(np.array([[0.95, 1.9, 2.85], [1.05, 2.1, 3.15]]), abs=1e-6)
    normals = np.frombuffer(stl(SHIFTED)[84:], np.uint8).reshape(-1, 50)[:, :12]
    assert normals.copy().view("<f4") == pytest.approx(mesh.face_normals, abs=1e-6)


def test_a_glb_comes_back_with_y_up() -> None:
    content = glb(SHIFTED, "box")
    assert len(content) % 4 == 0
    loaded = trimesh.load(io.BytesIO(content), file_type="glb", process=False)
    (mesh,) = loaded.geometry.values()
    assert mesh.volume == pytest.approx(0.006, rel=1e-5)
    x, y, z = SHIFTED.vertices.T
    np.testing.assert_allclose(mesh.vertices, np.column_stack([x, z, -y]), rtol=1e-6)
    np.testing.assert_array_equal(mesh.faces, SHIFTED.faces)


#: A tetrahedron of edge 1, moved by a node, and its looks: paint that is not there.
TETRAHEDRON = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset>{unit}<up_axis>{axis}</up_axis></asset>
  <library_effects><effect id="paint"><profile_COMMON><newparam sid="s"><sampler2D>
    <source>gone-surface</source></sampler2D></newparam></profile_COMMON></effect></library_effects>
  <library_geometries><geometry id="body"><mesh>
    <source id="points"><float_array id="numbers" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
      <technique_common><accessor source="#numbers" count="4" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
      </accessor></technique_common></source>
    <vertices id="corners"><input semantic="POSITION" source="#points"/></vertices>
    {faces}
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="scene"><node>
    <translate>5 0 0</translate><rotate>0 0 1 90</rotate><scale>2 2 2</scale>
    <instance_geometry url="#body"><bind_material><technique_common>
      <instance_material symbol="m" target="#gone"/></technique_common></bind_material>
    </instance_geometry>
  </node></visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>
"""
_INPUT = '<input semantic="VERTEX" source="#corners" offset="0"/>'
TRIANGLES = f'<triangles count="4" material="m">{_INPUT}<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>'
POLYGONS = (
    f'<polylist count="4" material="m">{_INPUT}'
    "<vcount>3 3 3 3</vcount><p>0 2 1 0 1 3 0 3 2 1 2 3</p></polylist>"
)
LINES = f'<lines count="1">{_INPUT}<p>0 1</p></lines>'


def written(unit: str = "", axis: str = "Z_UP", faces: str = TRIANGLES) -> bytes:
    return TETRAHEDRON.format(unit=unit, axis=axis, faces=faces).encode()


@pytest.mark.parametrize("end", [
    "panda_description/meshes/visual/link5.dae",
    "panda_description/meshes/visual/finger.dae",
    "ur_description/meshes/ur5/visual/forearm.dae",
    "anymal_b_simple_description/meshes/foot/anymal_foot.dae",
])  # fmt: skip
def test_real_links_are_read_as_assimp_reads_them(end: str) -> None:
    files = importlib.metadata.files("example-robot-data") or []
    path = Path(str(next(file.locate() for file in files if file.as_posix().endswith(end))))
    vertices, faces = load_mesh(path.read_bytes(), "dae")
    theirs = coal.MeshLoader().load(str(path), np.ones(3))
    other = np.array(theirs.vertices())
    np.testing.assert_allclose(vertices.min(axis=0), other.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(vertices.max(axis=0), other.max(axis=0), atol=1e-6)
    # assimp leaves out triangles without area.
    assert 0 <= len(faces) - theirs.num_tris < 0.01 * len(faces)


@pytest.mark.parametrize("faces", [TRIANGLES, POLYGONS, LINES + TRIANGLES])
@pytest.mark.parametrize("axis", ["Z_UP", "Y_UP"])
@pytest.mark.parametrize(("unit", "metres"), [
    ("", 1.0), ('<unit name="mm" meter="0.001"/>', 1e-3), ('<unit meter="0.0254"/>', 0.0254),
])  # fmt: skip
def test_unit_and_node_are_applied_and_the_up_axis_is_not(
    faces: str, axis: str, unit: str, metres: float
) -> None:
    vertices, triangles = load_mesh(written(unit, axis, faces), "dae")
    assert len(triangles) == 4
    expected = metres * np.array([[5.0, 0, 0], [5, 2, 0], [3, 0, 0], [5, 0, 2]])
    # pycollada's numbers have 24 bits.
    found = vertices[np.lexsort(vertices.round(4).T)]
    np.testing.assert_allclose(found, expected[np.lexsort(expected.T)], atol=1e-6 * metres)


BOMB = b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaa">]><COLLADA>&a;</COLLADA>'


@pytest.mark.parametrize("data", [
    b"", b"<COLLADA/>", b"<COLLADA", b"AAAA", BOMB, written(faces=LINES), written(faces=""),
    written(faces=TRIANGLES.replace("1 2 3</p>", "1 2 99</p>")),
    written(faces=TRIANGLES.replace("1 2 3</p>", "1 2 x</p>")),
    written('<unit meter="nan"/>'), written('<unit meter="a mile"/>'), written('<unit meter="0"/>'),
    written(faces=TRIANGLES + TRIANGLES.replace("#corners", "#gone")),
])  # fmt: skip
def test_what_is_malformed_is_refused(data: bytes) -> None:
    with pytest.raises(InvalidScene, match="mesh"):
        load_mesh(data, "dae")


def doubled(times: int, fan: int = 2) -> bytes:
    """Nodes that each stand ``fan`` times in the next one, ``times`` times over."""
    inner = '<instance_geometry url="#body"/>'
    nodes = [f'<node id="n0">{inner}</node>']
    nodes += [
        f'<node id="n{k}">{fan * f"""<instance_node url="#n{k - 1}"/>"""}</node>'
        for k in range(1, times + 1)
    ]
    library = f"<library_nodes>{''.join(nodes)}</library_nodes><library_visual_scenes>"
    text = written().decode().replace("<library_visual_scenes>", library)
    return text.replace("<node>", f'<node><instance_node url="#n{times}"/>', 1).encode()


@pytest.mark.parametrize("times", [14, 40, 20_000])
def test_what_references_multiply_is_counted_before_it_is_there(times: int) -> None:
    began = time.process_time()
    with pytest.raises(InvalidScene, match="too often"):
        load_mesh(doubled(times), "dae")
    assert time.process_time() - began < 2.0


def test_a_node_within_itself_is_refused() -> None:
    text = written().replace(b"<node>", b'<node id="own"><instance_node url="#own"/>', 1)
    with pytest.raises(InvalidScene, match="refers to itself"):
        load_mesh(text, "dae")

"""COLLADA files beside what assimp reads; units, transforms, looks, attacks."""

import importlib.metadata
import time
from pathlib import Path

import coal
import numpy as np
import pytest

from kinematics.errors import InvalidScene
from obstacles.meshes.mesh import load_mesh

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


def test_nodes_that_are_referred_to_are_there_as_often() -> None:
    _, faces = load_mesh(doubled(5, fan=3), "dae")
    assert len(faces) == 4 * (3**5 + 1)


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

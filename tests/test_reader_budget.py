"""Readers of damaged and hostile files: an error that says so, in little time and memory."""

import io
import random
import re
import resource
import time
import zipfile
from collections.abc import Callable

import pytest
import trimesh

from kinematics.errors import ArmwrightError
from kinematics.readers.yaml_reader import UnreadableYaml, read_yaml
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.visuals import read_visuals
from obstacles.meshes.mesh import load_mesh
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.robots.visual_geometry import visual_geometry
from obstacles.scenes.moveit import scene_from_moveit
from service.translate.robots.archive import read_archive
from tests.obstacles.meshes.test_mesh import POLYGONS, TRIANGLES, written

#: Of one small file, with all the load of other tests [s of the processor], [MiB].
SECONDS, MEMORY = 5.0, 300.0
CASES = 40
BOX = trimesh.creation.box([1.0, 2.0, 3.0])
STL = bytes(BOX.export(file_type="stl"))
URDF = b"""<?xml version="1.0"?><robot name="r"><link name="a"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial><collision>
<origin xyz="0 0 1" rpy="0 1 0"/><geometry><box size="1 1 1"/></geometry></collision></link>
<link name="b"><visual><geometry><mesh filename="m.stl" scale="1 1 1"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
SRDF = b"""<robot name="r"><group name="arm"><chain base_link="a" tip_link="b"/></group>
<group name="all"><group name="arm"/><joint name="j"/></group>
<group_state name="home" group="arm"><joint name="j" value="0.5"/></group_state>
<disable_collisions link1="a" link2="b" reason="Adjacent"/></robot>"""
SCENE = b"""name: s
world:
  collision_objects:
    - id: box
      header: {frame_id: base}
      pose: &pose {position: [0, 0, 0], orientation: [0, 0, 0, 1]}
      primitives: [{type: box, dimensions: [1, 1, 1]}]
      primitive_poses: [*pose]
    - id: mesh
      meshes: [{vertices: [[0,0,0],[1,0,0],[0,1,0],[0,0,1]], triangles: [[0,1,2],[0,1,3]]}]
      mesh_poses: [*pose]
"""


def archive(files: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in files.items():
            packed.writestr(name, data)
    return stream.getvalue()


def text_of(data: bytes) -> str:
    return data.decode("utf-8", "replace")


def exported(kind: str, **how: str) -> bytes:
    data = BOX.export(file_type=kind, **how)
    return data.encode() if isinstance(data, str) else bytes(data)


#: Small files of each kind, and what reads them.
READERS: dict[str, tuple[list[bytes], Callable[[bytes], object]]] = {
    "stl": ([STL, exported("stl_ascii")], lambda data: load_mesh(data, "stl")),
    "obj": ([exported("obj") + b"usemtl m\nf -1/1 -2 -3\nf 1 2 3 4\n"],
            lambda data: load_mesh(data, "obj")),
    "ply": ([exported("ply"), exported("ply", encoding="ascii")],
            lambda data: load_mesh(data, "ply")),
    "off": ([exported("off")], lambda data: load_mesh(data, "off")),
    "dae": ([written(), written(faces=POLYGONS)], lambda data: load_mesh(data, "dae")),
    "urdf": ([URDF], lambda data: parse_urdf(text_of(data))),
    "srdf": ([SRDF], lambda data: parse_srdf(text_of(data))),
    "yaml": ([SCENE, b"a: &x [1, 2.5]\nb: *x\n<<: {c: !!str 1}\nd: |\n  text\n"], read_yaml),
    "moveit": ([SCENE], scene_from_moveit),
    "zip": ([archive({"r/r.urdf": URDF, "r/m.stl": STL, "r/r.srdf": SRDF})], read_archive),
}  # fmt: skip
NUMBERS = (b"0", b"-1", b"1e308", b"1e999", b"nan", b"4294967295", b"999999999", b"9" * 400, b"")


def damaged(data: bytes, draw: random.Random) -> bytes:
    """A file with some bytes changed, left out or repeated, or a number replaced."""
    for _ in range(draw.choice([1, 1, 2, 4])):
        i = draw.randrange(len(data) or 1)
        j = i + draw.choice([1, 4, 32, 256])
        way = draw.randrange(6)
        if way == 0:
            data = data[:i] + draw.randbytes(draw.choice([1, 4, 16])) + data[i + 1 :]
        elif way == 1:
            data = data[:i] + data[j:]
        elif way == 2:
            data = data[:i] + data[i:j] * draw.choice([2, 20, 500]) + data[j:]
        elif way == 3:
            data = data[:i]
        elif way == 4 and (numbers := list(re.finditer(rb"-?\d+(\.\d+)?", data))):
            found = draw.choice(numbers)
            data = data[: found.start()] + draw.choice(NUMBERS) + data[found.end() :]
        else:
            separator = draw.choice([b"\n", b">", b" "])
            words = data.split(separator)
            k = draw.randrange(len(words))
            words[k:k] = [words[k]] * draw.choice([1, 5, 300])
            data = separator.join(words)
    return data


def read_within_budget(kind: str, data: bytes) -> bool:
    """Whether a file is read; errors of ours mean that it is not."""
    began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        READERS[kind][1](data)
        is_read = True
    except (ArmwrightError, UnreadableYaml):
        is_read = False
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
    assert time.process_time() - began < SECONDS, data[:2000]
    assert grown < MEMORY, data[:2000]
    return is_read


@pytest.mark.parametrize("kind", READERS)
def test_damaged_files_are_read_or_refused(kind: str) -> None:
    files, _ = READERS[kind]
    assert all(read_within_budget(kind, data) for data in files)
    draw, refused = random.Random(kind), 0
    for _ in range(CASES):
        refused += not read_within_budget(kind, damaged(draw.choice(files), draw))
    assert 0 < refused <= CASES


_DAE = written().decode()
_TRIANGLE = TRIANGLES.replace('count="4"', 'count="1"').replace("0 2 1 0 1 3 0 3 2 1 2 3", "0 2 1")
_VERTICES = b"".join(b"v %d %d %d\n" % (k % 100, k // 100, k % 7) for k in range(9000))
_LIST = b"property list uint int vertex_indices\n"
_XYZ = b"property float x\nproperty float y\nproperty float z\n"


def ply(header: bytes, body: bytes) -> bytes:
    return b"ply\nformat binary_little_endian 1.0\n" + header + b"end_header\n" + body


#: What a few bytes of would take much: counts that lie, references, many small parts, one long one.
HOSTILE: dict[str, tuple[str, str | bytes]] = {
    "corners that are not there": ("dae", POLYGONS.replace("3 3 3 3", "1000000000 3 3 3")),
    "as many surfaces as triangles": ("dae", 30_000 * _TRIANGLE),
    "vertices that are not there": (
        "ply", ply(b"element vertex 999999999\n" + _XYZ + b"element face 1\n" + _LIST, b"\0" * 99),
    ),
    "a face that is not there": (
        "ply", ply(b"element vertex 3\n" + _XYZ + b"element face 1\n" + _LIST,
                   b"\0" * 36 + b"\xff\xff\xff\x7f\0\0\0\0"),
    ),
    "a triangle count that is not true": ("stl", STL[:80] + b"\xff" * 4 + STL[84:]),
    "triangles of polygons": (
        "obj", _VERTICES + b"".join(b"f " + b"1 2 3 " * k + b"\n" for k in range(1, 600)),
    ),
    "groups in groups": ("srdf", SRDF.replace(b'<group name="arm">', b"".join(
        b'<group name="g%d">%b</group>' % (k, 2 * (b'<group name="g%d"/>' % (k + 1)))
        for k in range(40)
    ) + b'<group name="g40"><joint name="j"/></group><group name="arm">')),
    "aliases of aliases": ("yaml", b"a0: &a0 [1, 1]\n" + b"".join(
        b"a%d: &a%d [%b]\n" % (k, k, b", ".join(9 * [b"*a%d" % (k - 1)])) for k in range(1, 12)
    )),
    "merged keys of merged keys": ("yaml", b"a0: &a0 {a: 1}\n" + b"".join(
        b"a%d: &a%d {<<: [%b]}\n" % (k, k, b", ".join(9 * [b"*a%d" % (k - 1)]))
        for k in range(1, 12)
    )),
    "a number to the base of 60": ("yaml", b"a: " + b":".join(200_000 * [b"59"])),
    "a number of many digits": ("yaml", b"a: " + 1_000_000 * b"9"),
    "lists in lists": ("yaml", 100_000 * b"["),
    "an archive that unpacks to much": ("zip", archive({"r.urdf": URDF, "m.stl": 2**25 * b"\0"})),
}  # fmt: skip
#: Many parts that are rightly read, in time that grows with their number only.
LONG: dict[str, tuple[str, bytes]] = {
    "materials": ("obj", _VERTICES + b"".join(
        b"usemtl m%d\nf %d %d %d\n" % (k, k + 1, k + 2, k + 150) for k in range(8000)
    )),
    "one polygon": ("obj", _VERTICES + b"f " + b" ".join(b"%d" % (k + 1) for k in range(9000))),
    "turns": ("dae", _DAE.replace("<node>", "<node>" + 9000 * "<rotate>0 0 1 90</rotate>")
              .encode()),
    "bodies": ("dae", _DAE.replace("</node>", 2000 * '<instance_geometry url="#body"/>' + "</node>")
               .encode()),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_what_a_file_multiplies_is_refused_before_it_is_there(name: str) -> None:
    kind, data = HOSTILE[name]
    whole = data if isinstance(data, bytes) else written(faces=data)
    is_read = read_within_budget(kind, whole)
    # Groups are names, which nothing multiplies.
    assert is_read == (kind == "srdf")


@pytest.mark.parametrize("name", LONG)
def test_many_parts_are_read(name: str) -> None:
    assert read_within_budget(*LONG[name])


def arm(kind: str, solid: str, count: int) -> str:
    """Two links, the last one of which has so many solids that are alike."""
    solids = count * f"<{kind}><geometry>{solid}</geometry></{kind}>"
    return (
        f'<robot name="r"><link name="a"/><link name="b">{solids}</link>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )


FINE = bytes(trimesh.creation.icosphere(5, radius=0.1).export(file_type="stl"))
MESH = '<mesh filename="m.stl"/>'


def robot_of(text: str) -> RobotGeometry:
    description = parse_urdf(text)
    return robot_geometry(serial_chain(description), description, {"m.stl": FINE})


def test_a_mesh_that_many_solids_refer_to_is_read_once() -> None:
    began = time.process_time()
    assert len(robot_of(arm("collision", MESH, 30)).pieces) == 30
    assert time.process_time() - began < SECONDS


@pytest.mark.parametrize(
    ("solid", "count"), [(MESH, 4_000), ('<box size="1 1 1"/>', 6_000)], ids=["mesh", "box"]
)
def test_solids_of_a_robot_are_counted(solid: str, count: int) -> None:
    began = time.process_time()
    with pytest.raises(ArmwrightError, match="at most 4000 pieces and 2000000 triangles"):
        robot_of(arm("collision", solid, count))
    assert time.process_time() - began < SECONDS


def test_visual_elements_are_counted_before_they_are_there() -> None:
    visuals = read_visuals(arm("visual", MESH, 4_000))
    began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    made = visual_geometry(visuals, ["b"], {"m.stl": FINE}.__getitem__)
    assert dict(made.missing) == {"b": "with the links before it more than 4000000 triangles"}
    assert time.process_time() - began < SECONDS
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0 < MEMORY

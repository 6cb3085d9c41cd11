"""Robot archives: what is read of them, and what is refused."""

import io
import json
import struct
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import trimesh

from kinematics.errors import InvalidRobotDescription
from service.endpoints.robots import task
from service.endpoints.robots.task import unpack_robot
from service.translate.robots import archive
from service.translate.robots.archive import read_archive
from tests.obstacles.meshes.test_mesh import written

URDF = "<robot/>"
MESH = '<mesh filename="package://arm/{}"/>'
ONE_JOINT = """<robot name="arm"><link name="base"/><link name="arm">{}</link>
  <joint name="swing" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


def packed(files: Mapping[str, bytes | str], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as made:
        for name, content in files.items():
            made.writestr(name, content)
    return stream.getvalue()


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_reads_what_a_robot_is_made_of(method: int) -> None:
    found = read_archive(
        packed(
            {
                "arm/urdf/arm.urdf": "\ufeff" + URDF,
                "arm/arm.SRDF": "<robot name='s'/>",
                "arm/meshes/": b"",
                "arm/meshes/a.STL": b"solid",
                "arm/meshes/b.obj": b"v 0 0 0",
                "arm/meshes/picture.png": b"\x00",
                "arm/README.md": b"\xff\xff",
                "__MACOSX/arm.urdf": b"\x00",
            },
            method,
        )
    )
    assert found.urdf == URDF
    assert found.srdf == "<robot name='s'/>"
    assert found.meshes == {"arm/meshes/a.STL": b"solid", "arm/meshes/b.obj": b"v 0 0 0"}


@pytest.mark.parametrize(
    "name",
    [
        "../arm.stl",
        "a/../../arm.stl",
        "a/..",
        "/etc/arm.stl",
        "~root/arm.stl",
        "c:arm.stl",
        "a\\..\\arm.stl",
        "a\nb.stl",
        "x" * 2000 + ".stl",
    ],
)
def test_names_that_lead_out_of_it(name: str) -> None:
    with pytest.raises(InvalidRobotDescription, match="entr"):
        read_archive(packed({"arm.urdf": URDF, name: b""}))


@pytest.mark.parametrize("name", ["meshes.zip", "a/meshes.tar.gz", "a.7z", "A.ZIP"])
def test_archives_inside(name: str) -> None:
    with pytest.raises(InvalidRobotDescription, match="archive itself"):
        read_archive(packed({"arm.urdf": URDF, name: b""}))


def test_an_archive_that_is_called_a_mesh() -> None:
    inner = packed({"x": b"y"})
    with pytest.raises(InvalidRobotDescription, match="archive itself"):
        read_archive(packed({"arm.urdf": URDF, "arm.stl": inner}))


def test_a_bomb_is_refused_before_it_is_unpacked() -> None:
    bomb = packed({"arm.urdf": URDF, "arm.stl": bytes(50 * 2**20)})
    assert len(bomb) < 100_000
    with pytest.raises(InvalidRobotDescription, match="densely"):
        read_archive(bomb)


def test_many_files_that_are_too_much_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_UNPACKED", 1000)
    files: dict[str, bytes | str] = {f"{i}.stl": bytes(200) for i in range(6)}
    with pytest.raises(InvalidRobotDescription, match="unpacks to"):
        read_archive(packed(files | {"arm.urdf": URDF}))


def test_too_many_entries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_ENTRIES", 3)
    with pytest.raises(InvalidRobotDescription, match="4 entries"):
        read_archive(packed({"arm.urdf": URDF} | {f"{i}.txt": b"" for i in range(3)}))


def test_a_directory_of_many_entries_is_refused_before_it_is_read() -> None:
    content = b"PK\x01\x02" + bytes(42) + b"PK\x05\x06" + bytes(18)
    with pytest.raises(InvalidRobotDescription, match="600000 entries"):
        read_archive(content[:46] * 600_000 + content[46:])


def test_a_size_that_is_a_lie() -> None:
    content = bytearray(packed({"arm.urdf": URDF, "arm.stl": bytes(range(200)) * 50}))
    directory = content.rfind(b"PK\x01\x02")
    assert content[directory + 46 :].startswith(b"arm.stl")
    struct.pack_into("<I", content, directory + 24, 10)
    with pytest.raises(InvalidRobotDescription):
        read_archive(bytes(content))


def test_every_cut_and_every_flipped_byte_is_refused_or_read() -> None:
    content = packed({"arm.urdf": URDF, "arm.stl": b"solid " * 20})
    for length in range(len(content)):
        with pytest.raises(InvalidRobotDescription):
            read_archive(content[:length])
    for place in range(len(content)):
        changed = bytearray(content)
        changed[place] ^= 0xFF
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                read_archive(bytes(changed))
            except InvalidRobotDescription:
                continue


@pytest.mark.parametrize(
    ("files", "match"),
    [
        ({"arm.stl": b""}, "no .urdf"),
        ({"a.urdf": URDF, "b.urdf": URDF}, "which .urdf file is meant is open"),
        ({"a.urdf": URDF, "b.srdf": "", "c.srdf": ""}, "which .srdf file is meant is open"),
        ({"a.urdf": b"\xff\xfe"}, "UTF-8"),
    ],
)
def test_not_exactly_one_robot(files: dict[str, bytes | str], match: str) -> None:
    with pytest.raises(InvalidRobotDescription, match=match):
        read_archive(packed(files))


def test_a_package_of_xacro_files_tells_how_to_expand_them() -> None:
    files: dict[str, bytes | str] = {"arm/urdf/arm_macro.xacro": URDF, "arm/arm.urdf.xacro": URDF}
    with pytest.raises(InvalidRobotDescription, match="only xacro files") as raised:
        read_archive(packed(files))
    assert "`xacro arm/arm.urdf.xacro > robot.urdf`" in (raised.value.hint or "")


LIMITS = "joint_limits: {swing: {has_acceleration_limits: true, max_acceleration: 3.5}}"


def model_of(files: dict[str, bytes | str], folder: Path, **fields: object) -> Any:
    """The model of an archive's robot."""
    _, model = unpack_robot(packed(files), {"name": "z", **fields}, str(folder))
    return json.loads(model)


def test_limits_of_moveit_in_an_archive_are_obeyed_and_told(tmp_path: Path) -> None:
    arm: dict[str, bytes | str] = {"arm.urdf": ONE_JOINT.format("")}
    one = model_of({**arm, "config/joint_limits.yaml": LIMITS}, tmp_path)
    assert one["limits"]["acceleration"] == [3.5]
    assert any("archive's joint_limits.yaml" in line for line in one["lint"])
    given = {"swing": {"acceleration": 2.0}}
    own = model_of({**arm, "joint_limits.yaml": LIMITS}, tmp_path, joint_limits=given)
    assert own["limits"]["acceleration"] == [2.0]
    assert any("joint_limits.yaml is not read" in line for line in own["lint"])
    several = {**arm, "a/joint_limits.yaml": LIMITS, "b/joint_limits.yml": LIMITS}
    none = model_of(several, tmp_path)
    assert none["limits"]["acceleration"] == [None]
    assert any("a/joint_limits.yaml" in x and "none is read" in x for x in none["lint"])


def test_an_srdf_that_is_not_expanded_is_told() -> None:
    files: dict[str, bytes | str] = {"arm.urdf": URDF, "config/arm.srdf.xacro": URDF}
    (note,) = read_archive(packed(files)).notes
    assert "`xacro config/arm.srdf.xacro > robot.srdf`" in note
    assert read_archive(packed({**files, "arm.srdf": URDF})).notes == ()


def test_links_and_encrypted_entries() -> None:
    link = zipfile.ZipInfo("arm.stl")
    link.external_attr = 0o120777 << 16
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made:
        made.writestr("arm.urdf", URDF)
        made.writestr(link, "/etc/passwd")
    with pytest.raises(InvalidRobotDescription, match="regular"):
        read_archive(stream.getvalue())
    content = bytearray(packed({"arm.urdf": URDF}))
    content[content.rfind(b"PK\x01\x02") + 8] |= 1
    with pytest.raises(InvalidRobotDescription, match="encrypted"):
        read_archive(bytes(content))


def test_the_same_name_twice() -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made.writestr("arm.urdf", URDF)
        made.writestr("arm.urdf", URDF)
    with pytest.raises(InvalidRobotDescription, match="twice"):
        read_archive(stream.getvalue())


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("../meshes/a.stl", "package://arm/meshes/a.stl"),
        ("./../meshes/./a.stl", "package://arm/meshes/a.stl"),
        ("../../other/a.stl", "package://other/a.stl"),
        ("../../../a.stl", "../../../a.stl"),
        ("package://arm/meshes/a.stl", "package://arm/meshes/a.stl"),
        ("meshes/../../a.stl", "meshes/../../a.stl"),
    ],
)
@pytest.mark.parametrize("quote", ['"', "'"])
def test_names_that_go_up_inside_the_archive(uri: str, expected: str, quote: str) -> None:
    urdf = f"<robot><mesh scale={quote}1 1 1{quote} filename = {quote}{uri}{quote}/></robot>"
    found = read_archive(packed({"arm/urdf/arm.urdf": urdf, "arm/meshes/a.stl": b"solid"}))
    assert found.urdf == urdf.replace(uri, expected)


def test_only_what_collides_or_is_seen_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solid = f"<collision><geometry>{MESH.format('collision/a.dae')}</geometry></collision>"
    names = ("visual/b.stl", "visual/fine.stl")
    seen = "".join(f"<visual><geometry>{MESH.format(n)}</geometry></visual>" for n in names)
    small, fine = (
        trimesh.creation.icosphere(subdivisions=k).export(file_type="stl") for k in (0, 3)
    )
    monkeypatch.setattr(task, "MAX_VISUAL_BYTES", len(fine))
    content = packed(
        {
            "arm/urdf/arm.urdf": ONE_JOINT.format(solid + seen),
            "arm/collision/a.dae": written(),
            "arm/visual/b.stl": small,
            "arm/visual/fine.stl": fine,
            "arm/other/c.stl": small,
        }
    )
    document, model = unpack_robot(content, {"name": "z"}, str(tmp_path))
    # Both together go beyond the bound: the small one stays, and what is left out is told.
    assert list(json.loads(document)["meshes"]) == ["arm/collision/a.dae", "arm/visual/b.stl"]
    assert any("visual meshes of" in line for line in json.loads(model)["lint"])

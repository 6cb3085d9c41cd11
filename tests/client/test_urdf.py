"""Meshes and xacro files are found where descriptions keep them."""

import base64
import io
import json
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

import armwright as aw
from armwright_client import InvalidArgument, JointLimits, RobotArchive, RobotUpload
from command_line.parameters import RobotSource
from command_line.robot_files import robot_document
from kinematics.errors import InvalidRobotDescription
from kinematics.readers.mesh_uri import resolve_mesh
from kinematics.urdf.urdf import parse_urdf
from service.validation import ProblemError
from studio.requests import robot_upload
from tests.service.robots import BOX_OBJ

LINK = '<link name="l{0}"><collision><geometry><mesh filename={1}/></geometry></collision></link>'
VISUAL = '<link name="v"><visual><geometry><mesh filename="gone.dae"/></geometry></visual></link>'


def write(path: Path, *uris: str, quote: str = '"') -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    links = "".join(LINK.format(i, f"{quote}{uri}{quote}") for i, uri in enumerate(uris))
    path.write_text(f'<robot name="arm">{links}{VISUAL}</robot>')
    return path


def mesh(path: Path) -> bytes:
    path.parent.mkdir(parents=True, exist_ok=True)
    content = f"solid {path.name}".encode()
    path.write_bytes(content)
    return content


def uris_of(urdf: str) -> list[str]:
    from xml.etree import ElementTree as ET

    found = ET.fromstring(urdf).iterfind(".//collision/geometry/mesh")
    return [element.get("filename", "") for element in found]


def assert_sent(upload: RobotUpload, *contents: bytes) -> None:
    """Every mesh of the text is found among what is sent, by the service's own rules."""
    assert upload.urdf is not None
    files = {uri: base64.b64decode(text) for uri, text in (upload.meshes or {}).items()}
    assert tuple(resolve_mesh(uri, files) for uri in uris_of(upload.urdf)) == contents


def test_meshes_beside_the_description(tmp_path: Path) -> None:
    content = mesh(tmp_path / "meshes" / "a b.stl")
    upload = RobotUpload.from_urdf(write(tmp_path / "arm.urdf", "meshes/a b.stl"))
    assert upload.name == "arm"
    assert_sent(upload, content)
    assert upload.meshes == {"meshes/a b.stl": base64.b64encode(content).decode()}


@pytest.mark.parametrize("root", ["", "share"])
def test_meshes_of_a_package(tmp_path: Path, root: str) -> None:
    package = tmp_path / root / "arm_description"
    content = mesh(package / "meshes" / "a.OBJ")
    uri = "package://arm_description/meshes/a.OBJ"
    # The description is inside the package; nothing else needs to be said.
    assert_sent(RobotUpload.from_urdf(write(package / "urdf" / "arm.urdf", uri)), content)
    # It is elsewhere: the package is given, or the folder that holds it.
    lone = write(tmp_path / "elsewhere" / "deep" / "arm.urdf", uri)
    for folder in (package, package.parent):
        assert_sent(RobotUpload.from_urdf(lone, package_dirs=[folder]), content)


def test_a_package_is_known_by_its_manifest_whatever_its_folder_is_called(tmp_path: Path) -> None:
    clone, uri = tmp_path / "A_Clone", "package://arm_description/meshes/a.stl"
    content, urdf = mesh(clone / "meshes" / "a.stl"), write(clone / "urdf" / "arm.urdf", uri)
    with pytest.raises(InvalidArgument, match="package_dirs"):
        RobotUpload.from_urdf(urdf)
    (clone / "package.xml").write_text("<package><name>arm_description</name></package>")
    assert_sent(RobotUpload.from_urdf(urdf), content)


def test_a_package_of_another_name_is_not_taken(tmp_path: Path) -> None:
    mesh(tmp_path / "meshes" / "a.stl")
    urdf = write(tmp_path / "arm.urdf", "package://other/meshes/a.stl")
    with pytest.raises(InvalidArgument, match=r"not there: package://other/meshes/a\.stl"):
        RobotUpload.from_urdf(urdf)


@pytest.mark.parametrize("quote", ['"', "'"])
def test_meshes_above_the_description_are_renamed(tmp_path: Path, quote: str) -> None:
    inner = mesh(tmp_path / "urdf" / "meshes" / "a&b.stl")
    outer = mesh(tmp_path / "meshes" / "a&b.stl")
    outermost = mesh(tmp_path.parent / "meshes" / "a&b.stl")
    uris = [f"{up}meshes/a&amp;b.stl" for up in ("", "../", "../../", "x/../../")]
    (tmp_path / "urdf" / "x").mkdir()
    upload = RobotUpload.from_urdf(write(tmp_path / "urdf" / "arm.urdf", *uris, quote=quote))
    assert_sent(upload, inner, outer, outermost, outer)
    assert not any(".." in uri for uri in upload.meshes or {})


def test_every_missing_mesh_is_named(tmp_path: Path) -> None:
    mesh(tmp_path / "here.stl")
    urdf = write(tmp_path / "arm.urdf", "here.stl", "a.stl", "package://p/b.ply")
    with pytest.raises(InvalidArgument, match=r"a\.stl, package://p/b\.ply.*package_dirs"):
        RobotUpload.from_urdf(urdf)


@pytest.mark.parametrize(
    "uri", ["/etc/hosts.stl", "file:///etc/hosts.stl", "http://host/a.stl", "C:\\a.stl"]
)
def test_other_places_are_never_read(tmp_path: Path, uri: str) -> None:
    with pytest.raises(InvalidArgument, match="neither package:// nor relative"):
        RobotUpload.from_urdf(write(tmp_path / "arm.urdf", uri))


@pytest.mark.parametrize("uri", ["../../../etc/passwd", "a.glb", "a"])
def test_only_meshes_are_sent(tmp_path: Path, uri: str) -> None:
    mesh(tmp_path / "a.glb")
    with pytest.raises(InvalidArgument, match="can't be sent"):
        RobotUpload.from_urdf(write(tmp_path / "arm.urdf", uri))


def test_what_is_no_xml_is_told(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text("<robot")
    with pytest.raises(InvalidArgument, match=r"arm\.urdf is not XML"):
        RobotUpload.from_urdf(path)
    with pytest.raises(FileNotFoundError):
        RobotUpload.from_urdf(tmp_path / "none.urdf")


def test_all_else_goes_along(tmp_path: Path) -> None:
    (tmp_path / "arm.srdf").write_text("<robot name='arm'/>")
    limits = {"j": JointLimits(velocity=1.0)}
    upload = RobotUpload.from_urdf(
        write(tmp_path / "arm.urdf"),
        name="mine",
        srdf=tmp_path / "arm.srdf",
        tip_link="v",
        joint_limits=limits,
    )
    assert (upload.name, upload.srdf, upload.tip_link) == ("mine", "<robot name='arm'/>", "v")
    assert upload.meshes is None
    assert upload.joint_limits == limits


def test_an_archive_is_named_by_its_file(tmp_path: Path) -> None:
    path = tmp_path / "arm.zip"
    path.write_bytes(b"PK")
    archive = RobotArchive.from_file(path, tip_link="t", joint_limits={"j": JointLimits(jerk=2.0)})
    assert archive.content == b"PK"
    assert archive.fields() == {
        "name": "arm",
        "tip_link": "t",
        "joint_limits": '{"j": {"jerk": 2.0}}',
    }
    assert RobotArchive.from_file(path, name="other").fields() == {"name": "other"}


def test_three_slashes_name_the_same_mesh(tmp_path: Path) -> None:
    package = tmp_path / "arm_description"
    content = mesh(package / "meshes" / "a.stl")
    uri = "package:///arm_description/meshes/a.stl"
    assert_sent(RobotUpload.from_urdf(write(package / "urdf" / "arm.urdf", uri)), content)


XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
MAIN = f"""<robot {XACRO} name="bench">
<xacro:include filename="macro.xacro"/>
<xacro:include filename="$(find tool_description)/urdf/tool.xacro"/>
<xacro:arm reach="$(arg reach)"/><xacro:tool/>
</robot>"""
MACRO = f"""<robot {XACRO}><xacro:macro name="arm" params="reach">
<link name="base"><collision><geometry>
<mesh filename="file://$(find arm_description)/meshes/a.obj"/></geometry></collision></link>
<link name="lower"><collision><geometry>
<mesh filename="package://arm_description/meshes/a.obj"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="lower"/>
<origin xyz="0 0 ${{2 * reach}}"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></xacro:macro></robot>"""
TOOL = f"""<robot {XACRO}><xacro:macro name="tool" params=""><link name="tip"/>
<joint name="flange" type="fixed"><parent link="lower"/><child link="tip"/></joint>
</xacro:macro></robot>"""


#: A package of an arm beside that of its tool.
FILES = {
    "arm_description/package.xml": "<package><name>arm_description</name><license>MIT</license>"
    "</package>",
    "arm_description/urdf/bench.urdf.xacro": MAIN,
    "arm_description/urdf/macro.xacro": MACRO,
    "arm_description/meshes/a.obj": BOX_OBJ,
    "tool_description/urdf/tool.xacro": TOOL,
}


def xacro_write(folder: Path, files: Mapping[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return xacro_write(tmp_path, FILES) / "arm_description"


def heights(urdf: str | None) -> list[float]:
    assert urdf is not None
    joints = parse_urdf(urdf).joints.values()
    return [float(joint.T_parent_joint[2, 3]) for joint in joints if joint.type == "revolute"]


def test_the_client_expands_files_and_folders(package: Path) -> None:
    file = package / "urdf" / "bench.urdf.xacro"
    for source in (file, package):
        upload = RobotUpload.from_urdf(source, xacro_args={"reach": "0.25"})
        assert upload.name == "bench"
        assert heights(upload.urdf) == [0.5]
        sent = {base64.b64decode(text).decode() for text in (upload.meshes or {}).values()}
        assert sent == {BOX_OBJ}
        meshes = ET.fromstring(str(upload.urdf)).iterfind(".//mesh")
        assert {mesh.get("filename") for mesh in meshes} == set(upload.meshes or {})
        assert str(package.parent) not in str(upload.urdf), "no path of this machine is sent"


def test_a_package_elsewhere_is_given(package: Path) -> None:
    file = package / "urdf" / "bench.urdf.xacro"
    away = package.parent / "far" / "off"
    away.mkdir(parents=True)
    (package.parent / "tool_description").rename(away / "tool_description")
    with pytest.raises(InvalidArgument, match="needs the package 'tool_description'") as refused:
        RobotUpload.from_urdf(file, xacro_args={"reach": "1"})
    assert "package_dirs" in str(refused.value)
    for folder in (away, away / "tool_description"):
        upload = RobotUpload.from_urdf(file, package_dirs=[folder], xacro_args={"reach": "1"})
        assert heights(upload.urdf) == [2.0]


def test_what_cannot_be_expanded_is_refused_with_the_reason(package: Path) -> None:
    file = package / "urdf" / "bench.urdf.xacro"
    with pytest.raises(InvalidArgument, match="argument reach") as refused:
        RobotUpload.from_urdf(file)
    assert "name:=value" in str(refused.value)
    (package / "urdf" / "cut.xacro").write_text(MAIN[:200])
    with pytest.raises(InvalidArgument, match=r"cut\.xacro can't be expanded"):
        RobotUpload.from_urdf(package / "urdf" / "cut.xacro")
    with pytest.raises(FileNotFoundError):
        RobotUpload.from_urdf(package / "gone.xacro")
    (package / "arm.urdf").write_text("<robot name='x'><link name='l'/></robot>")
    with pytest.raises(InvalidArgument, match="takes no arguments"):
        RobotUpload.from_urdf(package / "arm.urdf", xacro_args={"reach": "1"})


def test_a_folder_of_several_says_which_there_are(package: Path) -> None:
    second = package / "urdf" / "second.urdf.xacro"
    second.write_text(MAIN)
    with pytest.raises(InvalidArgument, match=r"bench\.urdf\.xacro, .*second\.urdf\.xacro"):
        RobotUpload.from_urdf(package, xacro_args={"reach": "1"})
    with pytest.raises(InvalidArgument, match="it holds none"):
        RobotUpload.from_urdf(package.parent / "tool_description")


def test_the_extra_is_named_where_it_is_missing(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(InvalidArgument, match=r"xacrodoc.*not installed.*\[xacro\]"):
        RobotUpload.from_urdf(package, xacro_args={"reach": "1"})
    with pytest.raises(InvalidRobotDescription, match=r"\[xacro\]"):
        aw.load_robot(package)
    with pytest.raises(ProblemError, match="xacrodoc") as refused:
        robot_document(RobotSource(str(package)))
    assert "[xacro]" in str(refused.value.hint)


def test_the_library_reads_what_the_client_sends(package: Path) -> None:
    for source in (package, package / "urdf" / "bench.urdf.xacro"):
        robot = aw.load_robot(source, xacro_args={"reach": "0.25"})
        assert aw.fk(robot, [0.0])[2, 3] == 0.5
        assert robot.chain.joint_names == ("turn",)
    with pytest.raises(InvalidRobotDescription, match="argument reach"):
        aw.load_robot(package)


def test_the_shell_takes_arguments(package: Path) -> None:
    document = robot_document(RobotSource(str(package), xacro=["reach:=0.25"]))
    assert document["name"] == "bench"
    assert heights(document["urdf"]) == [0.5]
    assert json.dumps(document).count(base64.b64encode(BOX_OBJ.encode()).decode()) == 2
    with pytest.raises(ProblemError, match="--xacro"):
        robot_document(RobotSource(str(package), xacro=["reach=0.25"]))


def test_the_studio_expands_what_is_given_to_its_page(package: Path) -> None:
    (package / "urdf" / "bench.urdf.xacro").write_text(MAIN.replace("$(arg reach)", "0.25"))
    (package.parent / "tool_description").rename(package / "tool_description")
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as archive:
        for path in package.rglob("*.*"):
            archive.write(path, path.relative_to(package.parent))
    upload = robot_upload("my_arm.zip", held.getvalue(), "tip")
    assert isinstance(upload, RobotUpload)
    assert (upload.name, upload.tip_link) == ("my_arm", "tip")
    assert heights(upload.urdf) == [0.5]
    alone = f'<robot {XACRO} name="a"><link name="${{"x" * 3}}"/></robot>'.replace('"x"', "'x'")
    upload = robot_upload("one.urdf.xacro", alone.encode(), None)
    assert isinstance(upload, RobotUpload)
    assert upload.name == "one"
    assert set(parse_urdf(str(upload.urdf)).links) == {"xxx"}
    with pytest.raises(ValueError, match="can't be expanded"):
        robot_upload("one.xacro", b"<robot", None)
    assert isinstance(robot_upload("broken.zip", b"PK", None), RobotArchive), "the service refuses"

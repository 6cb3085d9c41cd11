"""xacro files, expanded on this machine: by the client, the library, the shell and the studio."""

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
from armwright_client import InvalidArgument, RobotArchive, RobotUpload
from command_line.parameters import RobotSource
from command_line.robot_files import robot_document
from kinematics.errors import InvalidRobotDescription
from kinematics.urdf.urdf import parse_urdf
from service.problem import ProblemError
from studio.workbench import robot_upload
from tests.service.robots import BOX_OBJ

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


def write(folder: Path, files: Mapping[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return write(tmp_path, FILES) / "arm_description"


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

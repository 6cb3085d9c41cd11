"""Meshes are found where descriptions keep them, and sent under names the service takes."""

import base64
from pathlib import Path

import pytest

from armwright_client import InvalidArgument, JointLimits, RobotArchive, RobotUpload
from kinematics.readers.mesh_uri import resolve_mesh

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

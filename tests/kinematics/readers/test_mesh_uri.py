"""Meshes are found among what was uploaded, and nowhere else."""

import pytest

from kinematics.errors import InvalidRobotDescription
from kinematics.readers.mesh_uri import resolve_mesh

UPLOADED = {
    "package://arm/meshes/visual/a.stl": b"visual a",
    "package://arm/meshes/collision/a.stl": b"collision a",
    "arm_description/meshes/collision/b.stl": b"b",
    "meshes/collision/link0.obj": b"link0",
    "c.stl": b"c",
    "left/d.stl": b"left d",
    "right/d.stl": b"right d",
    "my%20arm/e.stl": b"e",
}


@pytest.mark.parametrize(
    ("uri", "found"),
    [
        ("package://arm/meshes/collision/a.stl", b"collision a"),
        ("arm/meshes/visual/a.stl", b"visual a"),
        ("./arm//meshes/visual/../visual/a.stl", b"visual a"),
        ("meshes/visual/a.stl", b"visual a"),
        ("package://arm_description/meshes/collision/b.stl", b"b"),
        ("package://other_name/meshes/collision/b.stl", b"b"),
        ("package://meshes/collision/link0.obj", b"link0"),
        ("package://arm/meshes/collision/link0.obj", b"link0"),
        ("package://arm/deep/in/c.stl", b"c"),
        ("right/d.stl", b"right d"),
        ("package://arm/right/d.stl", b"right d"),
        ("my%20arm/e.stl", b"e"),
        ("package:///arm/meshes/collision/a.stl", b"collision a"),
        ("file:///opt/ros/share/arm/meshes/collision/a.stl", b"collision a"),
        ("file:////opt/ros/share/arm_description/meshes/collision/b.stl", b"b"),
        ("file:///home/me/src/other_name/meshes/collision/b.stl", b"b"),
        ("file:///home/me/c.stl", b"c"),
        ("model://arm/meshes/visual/a.stl", b"visual a"),
    ],
)
def test_found(uri: str, found: bytes) -> None:
    assert resolve_mesh(uri, UPLOADED) == found


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("package://arm/meshes/z.stl", ["was not uploaded", "left/d.stl"]),
        ("visual/b.stl", ["was not uploaded"]),
        ("d.stl", ["left/d.stl", "right/d.stl", "any of"]),
        ("package://arm/a.stl", ["any of", "visual", "collision"]),
        ("xc.stl", ["was not uploaded"]),
        ("file:///etc/passwd", ["was not uploaded"]),
        ("file:///home/me/visual/b.stl", ["was not uploaded"]),
        ("", ["was not uploaded"]),
        ("package://", ["was not uploaded"]),
    ],
)
def test_not_found(uri: str, words: list[str]) -> None:
    with pytest.raises(InvalidRobotDescription) as error:
        resolve_mesh(uri, UPLOADED)
    assert all(word in str(error.value) for word in [*words, uri])


@pytest.mark.parametrize(
    "uri",
    [
        "/etc/passwd",
        "~/a.stl",
        "../c.stl",
        "package://../c.stl",
        "package://arm/../../c.stl",
        "package:///../c.stl",
        "a/../../c.stl",
        "%2e%2e/c.stl",
        "%2Fc.stl",
        "..\\c.stl",
        "a\\c.stl",
        "C:/c.stl",
        "file:///../c.stl",
        "file://C:/c.stl",
        "file:c.stl",
        "http://localhost/c.stl",
        "https://localhost/c.stl",
        "model://arm/../../c.stl",
        "package://package://c.stl",
        "c.stl\0.obj",
        "c.stl%00",
    ],
)
def test_outside_is_refused(uri: str) -> None:
    with pytest.raises(InvalidRobotDescription, match=r"not allowed|leads out"):
        resolve_mesh(uri, UPLOADED)
    with pytest.raises(InvalidRobotDescription, match=r"not allowed|leads out"):
        resolve_mesh("c.stl", {**UPLOADED, uri: b"hostile"})


def test_the_longest_end_wins() -> None:
    uploaded = {"a.stl": b"short", "collision/a.stl": b"long"}
    assert resolve_mesh("package://arm/meshes/collision/a.stl", uploaded) == b"long"
    assert resolve_mesh("package://arm/meshes/visual/a.stl", uploaded) == b"short"


def test_the_same_path_twice_is_ambiguous() -> None:
    uploaded = {"package://arm/a.stl": b"one", "./arm/a.stl": b"two"}
    with pytest.raises(InvalidRobotDescription, match="any of"):
        resolve_mesh("arm/a.stl", uploaded)
    assert resolve_mesh("package://arm/a.stl", uploaded) == b"one"


def test_nothing_uploaded() -> None:
    with pytest.raises(InvalidRobotDescription, match="uploaded: nothing"):
        resolve_mesh("a.stl", {})

"""Robots by name, from files and from rows."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import armwright as aw
from kinematics.robots import builtin_srdf, builtin_urdf

TWO_ROWS: list[dict[str, Any]] = [
    {"type": "revolute", "a": 0.6, "lower": -3.0, "upper": 3.0},
    {"type": "revolute", "a": 0.4, "lower": -3.0, "upper": 3.0},
]
ONE_LINK = """<robot name="box_arm">
  <link name="base"/><link name="arm"><collision><geometry>
    <mesh filename="{mesh}"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>"""


@pytest.mark.parametrize("name", aw.builtin_names())
def test_every_built_in_robot_loads(name: str) -> None:
    robot = aw.load_robot(name)
    assert robot.chain.name == name
    assert robot.pieces


def test_a_file_is_the_same_robot_as_the_built_in_one(tmp_path: Path) -> None:
    (tmp_path / "panda.urdf").write_text(builtin_urdf("panda"))
    (tmp_path / "panda.srdf").write_text(builtin_srdf("panda"))
    loaded = aw.load_robot(tmp_path / "panda.urdf", srdf=tmp_path / "panda.srdf")
    assert loaded == aw.load_robot("panda")


def test_rows_are_a_robot_of_that_table() -> None:
    robot = aw.load_robot(TWO_ROWS)
    x = 0.6 * np.cos(0.3) + 0.4 * np.cos(0.7)
    y = 0.6 * np.sin(0.3) + 0.4 * np.sin(0.7)
    assert np.allclose(aw.fk(robot, [0.3, 0.4])[:3, 3], [x, y, 0.0])


def test_rows_may_be_values() -> None:
    rows = [aw.DhRow(**row) for row in TWO_ROWS]
    table = aw.DhTable("standard", tuple(rows))
    assert aw.load_robot(rows) == aw.load_robot(TWO_ROWS) == aw.load_robot(table)


def test_joint_limits_replace_those_of_the_file() -> None:
    robot = aw.load_robot("panda", joint_limits={"panda_joint1": {"velocity": 0.5}})
    assert robot.chain.limits.velocity[0] == 0.5


def test_a_name_that_is_neither_says_what_is_built_in() -> None:
    with pytest.raises(aw.ArmwrightError, match="neither a built-in robot nor a file") as caught:
        aw.load_robot("panda_with_seven_arms")
    assert "panda" in (caught.value.hint or "")


@pytest.mark.parametrize(
    ("mesh", "place"),
    [
        ("meshes/box.stl", "box_arm/meshes/box.stl"),
        ("package://box_arm/meshes/box.stl", "box_arm/meshes/box.stl"),
        ("package://box_meshes/box.stl", "box_meshes/box.stl"),
        ("package:///box_arm/meshes/box.stl", "box_arm/meshes/box.stl"),
    ],
)
def test_meshes_are_found_beside_the_file_and_in_packages(
    tmp_path: Path, mesh: str, place: str
) -> None:
    (tmp_path / "box_arm").mkdir()
    (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / place).write_bytes(trimesh.creation.box((0.1, 0.2, 0.3)).export(file_type="stl"))
    (tmp_path / "box_arm/arm.urdf").write_text(ONE_LINK.format(mesh=mesh))
    (piece,) = aw.load_robot(tmp_path / "box_arm/arm.urdf").pieces
    extent = np.ptp(piece.vertices, axis=0)
    assert np.isclose(np.linalg.norm(extent), np.linalg.norm([0.1, 0.2, 0.3]))


def test_a_missing_mesh_is_named(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ONE_LINK.format(mesh="meshes/none.stl"))
    with pytest.raises(aw.ArmwrightError, match=r"meshes/none\.stl"):
        aw.load_robot(tmp_path / "arm.urdf")


def test_limits_of_a_file_and_by_rule(tmp_path: Path) -> None:
    (tmp_path / "panda.urdf").write_text(builtin_urdf("panda"))
    (tmp_path / "panda.srdf").write_text(builtin_srdf("panda"))
    (tmp_path / "joint_limits.yaml").write_text(
        "joint_limits:\n  panda_joint1: {has_velocity_limits: true, max_velocity: 0.5}\n"
        "  panda_finger_joint1: {has_velocity_limits: true, max_velocity: 0.1}\n"
    )
    robot = aw.load_robot(
        tmp_path / "panda.urdf",
        srdf=tmp_path / "panda.srdf",
        joint_limits=tmp_path / "joint_limits.yaml",
    )
    assert robot.chain.limits.velocity[0] == 0.5
    assert any("panda_finger_joint1" in line for line in robot.lint)
    assert set(robot.states) >= {"home"}
    ruled = aw.load_robot(TWO_ROWS, default_limits={"acceleration": "10 x velocity"})
    assert np.isnan(ruled.chain.limits.acceleration).all()
    rows = [row | {"velocity": 2.0} for row in TWO_ROWS]
    ruled = aw.load_robot(rows, default_limits={"acceleration": "10 x velocity"})
    np.testing.assert_array_equal(ruled.chain.limits.acceleration, [20.0, 20.0])


def test_links_without_solids_may_collide_as_they_look(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    box = trimesh.creation.box((0.1, 0.2, 0.3)).export(file_type="stl")
    (tmp_path / "meshes/box.stl").write_bytes(box)
    text = ONE_LINK.format(mesh="meshes/box.stl").replace("collision>", "visual>")
    (tmp_path / "arm.urdf").write_text(text)
    assert not aw.load_robot(tmp_path / "arm.urdf").pieces
    robot = aw.load_robot(tmp_path / "arm.urdf", visual_solids=True)
    assert len(robot.pieces) == 1
    assert any("visual_solids" in line for line in robot.lint)

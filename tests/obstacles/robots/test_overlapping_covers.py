"""Solids whose covers get into each other: a rod that turns in a ring, and one beside it."""

from unittest import mock

import numpy as np
import trimesh

from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.robots import robot_geometry as robot_geometry_module
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.robots.touching_pairs import overlapping_covers
from obstacles.scenes.scene import Scene

#: A ring about the z axis, and a rod that two joints turn and slide in it.
ARM = """<robot name="arm"><link name="base"/>
<link name="ring"><collision><geometry><mesh filename="ring.stl"/></geometry></collision></link>
<link name="middle"/>
<link name="rod"><collision><origin xyz="{aside} 0 0"/><geometry>
<cylinder radius="0.097" length="0.3"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="ring"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="tilt" type="revolute"><parent link="ring"/><child link="middle"/><axis xyz="0 1 0"/>
<limit lower="-0.12" upper="0.12" velocity="1" effort="1"/></joint>
<joint name="slide" type="prismatic"><parent link="middle"/><child link="rod"/><axis xyz="0 0 1"/>
<limit lower="-0.05" upper="0.05" velocity="1" effort="1"/></joint></robot>"""


def ring() -> bytes:
    mesh = trimesh.creation.annulus(0.1, 0.13, 0.05, sections=64)
    return bytes(mesh.export(file_type="stl"))


def arm(aside: float = 0.0) -> RobotGeometry:
    description = parse_urdf(ARM.format(aside=aside))
    # Neighbours but for a link without a solid, which would be allowed to touch.
    with mock.patch.object(robot_geometry_module, "_adjacent", return_value=set()):
        return robot_geometry(serial_chain(description), description, {"ring.stl": ring()})


def coarse(aside: float = 0.0) -> RobotGeometry:
    with mock.patch.object(robot_geometry_module, "overlapping_covers", return_value=set()):
        return arm(aside)


def test_a_ring_about_a_rod_is_crowded_and_cut_more_finely() -> None:
    assert overlapping_covers(coarse()) == {0}
    assert arm().links.count("ring") > coarse().links.count("ring")
    assert arm().allowed == coarse().allowed


def test_solids_of_very_many_triangles_stay_as_they_are() -> None:
    with mock.patch("obstacles.robots.touching_pairs._MAX_TRIANGLES", 100):
        assert overlapping_covers(coarse()) == set()


def test_a_rod_beside_a_ring_is_not() -> None:
    assert overlapping_covers(coarse(0.5)) == set()
    assert arm(0.5) == coarse(0.5)


def test_verdicts_are_those_of_the_triangles_either_way() -> None:
    fine, plain = Checker.of(arm(), Scene()), Checker.of(coarse(), Scene())
    low, high = arm().chain.sampling_bounds()
    states = np.random.default_rng(0).uniform(low, high, (300, 3))
    told = [fine.valid(q) for q in states]
    assert told == [plain.valid(q) for q in states]
    assert 0 < sum(told) < len(told)
    for q in states[:30]:
        assert abs(fine.clearance(q)[0] - plain.clearance(q)[0]) < 1e-6

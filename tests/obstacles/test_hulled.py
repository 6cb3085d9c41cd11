"""The robot in its solids' hulls holds the robot."""

import numpy as np
import trimesh

from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry, hulled, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from tests.obstacles.solids import random_transform

URDF = """<robot name="hook"><link name="base"/><link name="arm">
  <collision><geometry><mesh filename="hook.stl"/></geometry></collision>
  <collision><origin xyz="0 0 -0.3"/><geometry><box size="0.1 0.1 0.2"/></geometry></collision>
  </link><joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
  <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>"""


def hook() -> bytes:
    """A U of three bars as a binary STL."""
    bars = [((0.0, 0.0), (0.05, 0.4)), ((0.35, 0.0), (0.4, 0.4)), ((0.0, 0.0), (0.4, 0.05))]
    boxes = [trimesh.creation.box(bounds=[[*low, 0.0], [*high, 0.1]]) for low, high in bars]
    return bytes(trimesh.util.concatenate(boxes).export(file_type="stl"))


def robot() -> RobotGeometry:
    description = parse_urdf(URDF)
    return robot_geometry(serial_chain(description), description, {"hook.stl": hook()})


def test_only_what_was_cut_is_put_in_a_hull() -> None:
    exact = robot()
    hulled.cache_clear()  # of a robot that is equal to this one
    whole = hulled(exact)
    assert len(exact.pieces) >= 4
    assert len(whole.pieces) == 2
    assert whole.pieces[1] is exact.pieces[-1]
    assert whole.links == ("arm", "arm")
    assert hulled(whole) is whole


def test_what_is_free_of_the_hulls_is_free() -> None:
    exact, random = robot(), np.random.default_rng(0)
    whole = hulled(exact)
    pockets = 0
    for _ in range(400):
        ball = Obstacle("ball", Sphere(random.uniform(0.01, 0.1)), random_transform(random, 0.2))
        q = random.uniform(-3.0, 3.0, 1)
        near, far = (Checker.of(r, Scene((ball,))).clearance(q)[0] for r in (whole, exact))
        # How deep what touches is the clearance does not tell.
        assert max(near, 0.0) <= max(far, 0.0) + 1e-9
        pockets += near <= 0.0 < far
    # The pocket of the U is what the hull has too much.
    assert pockets > 3

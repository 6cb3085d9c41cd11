"""Pairs that touch in sampled and named configurations, beside distances in closed form."""

import re

import numpy as np

from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.robots.touching_pairs import always_touching, suspected_pairs

#: Three links of balls on a line: the first and the third touch where the elbow is bent enough.
ARM = """<robot name="arm"><link name="base"/>
<link name="one"><collision><geometry><sphere radius="{one}"/></geometry></collision></link>
<link name="two"><collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.01"/></geometry>
</collision></link>
<link name="three"><collision><origin xyz="{at} 0 0"/><geometry><sphere radius="0.1"/></geometry>
</collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="b" type="revolute"><parent link="one"/><child link="two"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="c" type="revolute"><parent link="two"/><child link="three"/><axis xyz="0 0 1"/>
<origin xyz="1 0 0"/><limit lower="{low}" upper="3" velocity="1" effort="1"/></joint></robot>"""


def arm(one: float = 0.1, at: float = 1.0, low: float = -3.0) -> RobotGeometry:
    description = parse_urdf(ARM.format(one=one, at=at, low=low))
    return robot_geometry(serial_chain(description), description)


def test_a_pair_that_touches_in_the_zero_pose_is_suspected() -> None:
    # The third ball lies on the first one where the elbow is straight.
    assert suspected_pairs(arm(at=-1.0)) == {("one", "three"): "zero pose"}
    # Beyond a limit the configuration nearest to 0 counts.
    assert suspected_pairs(arm(at=-1.0, low=2.0)) == {}
    assert suspected_pairs(arm()) == {}


def test_a_pair_that_touches_in_a_named_state_is_suspected() -> None:
    robot = arm()
    folded = RobotGeometry(
        robot.chain, robot.pieces, robot.links, robot.joints, robot.solids, robot.allowed,
        robot.lint, {"folded": np.array([0.0, 0.0, 3.1])},
    )  # fmt: skip
    assert suspected_pairs(folded) == {("one", "three"): "state 'folded'"}


def test_pairs_that_touch_nearly_always_are_told_and_always_ones_allowed() -> None:
    # A large ball: the third one leaves it only where the elbow is nearly straight.
    nearly = arm(one=1.898)
    assert nearly.allowed.get(("one", "three")) is None
    assert suspected_pairs(nearly)[("one", "three")] == "nearly always"
    assert arm(one=2.0).allowed[("one", "three")] == "always"
    assert always_touching(arm(), {}) == set()


def test_pairs_that_touch_often_are_told_with_how_often() -> None:
    # The third ball is in the first one where |elbow| is above 2 acos((one + 0.1) / 2), of 3.
    for radius in (0.9, 1.3, 1.5):
        share = 1.0 - 2.0 * np.arccos(0.5 * (radius + 0.1)) / 3.0
        found = suspected_pairs(arm(one=radius))
        if share < 0.35:
            assert found == {}
            continue
        told = re.fullmatch(r"in (\d+) of 100 random configurations", found[("one", "three")])
        assert told is not None
        assert abs(int(told[1]) - 100.0 * share) < 15.0

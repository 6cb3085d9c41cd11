"""Looks of the built-in arms: closed shells that stand where the solids do, and no part of them."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import armwright as aw
from kinematics.model.robot_names import builtin_names
from kinematics.trajectory.trajectory import stay
from obstacles.robots.visual_geometry import built_in_looks
from obstacles.scenes.scene import Scene
from service.viewer.document import bodies, robot_document, visual_bodies

DRAWN = ("panda", "ur5e", "iiwa14", "kr6_sixx")
#: Of the box around a link: of its look beyond its solids, and of its solids beyond its look [m].
BEYOND, WITHIN = 0.01, 0.03


def test_arms_have_looks_and_robots_of_textbooks_have_none() -> None:
    found = [name for name in builtin_names() if built_in_looks(aw.load_robot(name).chain).bodies]
    assert found == [*DRAWN]


@pytest.mark.parametrize("name", DRAWN)
def test_looks_are_closed_and_stand_where_the_solids_do(name: str) -> None:
    robot = aw.load_robot(name)
    looks = built_in_looks(robot.chain)
    assert len({body.color for body in looks.bodies}) > 2
    shown: dict[str, list[np.ndarray]] = {}
    for body in visual_bodies(robot.chain, looks, [])[0]:
        shown.setdefault(body.name, []).append(body.surface.vertices)
        shell = trimesh.Trimesh(*body.surface)
        assert shell.is_watertight
        assert shell.volume > 0.0
    for solid in bodies(robot, Scene()):
        ours, theirs = np.vstack(shown.pop(solid.name)), solid.surface.vertices
        for beyond in (
            theirs.min(axis=0) - ours.min(axis=0),
            ours.max(axis=0) - theirs.max(axis=0),
        ):
            assert beyond.max() < BEYOND, solid.name
            assert beyond.min() > -WITHIN, solid.name
    assert not shown


def test_a_tool_keeps_the_looks_and_another_arm_of_the_name_has_none() -> None:
    chain = aw.load_robot("panda").chain
    assert built_in_looks(replace(chain, tip_link="panda_link8")).bodies
    longer = np.array(chain.offsets)
    longer[3, 0, 3] += 1e-6
    assert not built_in_looks(replace(chain, offsets=longer)).bodies
    assert not built_in_looks(replace(chain, name="mine")).bodies
    assert not built_in_looks(replace(chain, name="ur5e")).bodies


def test_pages_of_the_library_and_of_the_service_draw_them() -> None:
    robot = aw.load_robot("panda")
    looks = built_in_looks(robot.chain)
    document = robot_document(robot, Scene(), looks=looks)
    assert [item["kind"] for item in document["bodies"]].count("visual") == len(looks.bodies)
    assert {body.link for body in looks.bodies} == {item["name"] for item in document["bodies"]}
    page = aw.view(stay(robot.chain.joint_names, robot.states["home"]), robot).html
    assert '"visual"' in page

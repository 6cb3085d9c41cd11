"""Links without collision geometry that collide as they look."""

import numpy as np

from kinematics.tree.description import BoxGeometry, MeshGeometry, RobotDescription, SphereGeometry
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.visuals import read_visuals, with_visual_solids

BOX = '<geometry><box size="1 2 3"/></geometry>'
URDF = f"""<robot name="arm">
  <link name="base"><visual><origin xyz="0 0 0.5"/>{BOX}</visual>
    <visual><geometry><mesh filename="base.dae" scale="2 2 2"/></geometry></visual></link>
  <link name="solid"><visual>{BOX}</visual>
    <collision><geometry><sphere radius="1"/></geometry></collision></link>
  <link name="odd"><visual>{BOX}</visual><visual><geometry/></visual></link>
  <link name="frame"/>
  <joint name="a" type="fixed"><parent link="base"/><child link="solid"/></joint>
  <joint name="b" type="fixed"><parent link="base"/><child link="odd"/></joint>
  <joint name="c" type="fixed"><parent link="base"/><child link="frame"/></joint>
</robot>"""


def seen() -> RobotDescription:
    return with_visual_solids(parse_urdf(URDF), read_visuals(URDF))


def test_links_without_solids_are_given_what_they_look_like() -> None:
    links = seen().links
    box, mesh = links["base"].collisions
    assert box.geometry == BoxGeometry((1.0, 2.0, 3.0))
    np.testing.assert_array_equal(box.T_link_element[:3, 3], [0.0, 0.0, 0.5])
    assert mesh.geometry == MeshGeometry("base.dae", (2.0, 2.0, 2.0))
    (ball,) = links["solid"].collisions
    assert ball.geometry == SphereGeometry(1.0)


def test_half_a_link_is_no_solid() -> None:
    assert seen().links["odd"].collisions == ()


def test_what_was_done_is_told() -> None:
    lint = "\n".join(seen().lint)
    assert "links collide as they look, as visual_solids asks: 'base'" in lint
    assert "'base' has no collision geometry" not in lint
    assert "it gives link 'odd' no solids" in lint
    assert "link 'odd' has no collision geometry" in lint
    assert "link 'frame' has no collision geometry" in lint

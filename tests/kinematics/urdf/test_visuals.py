"""Visual geometry of URDFs beside what pinocchio reads; faults are told and never raised."""

from pathlib import Path

import numpy as np
import pinocchio
import pytest

from kinematics.tree.description import BoxGeometry, MeshGeometry
from kinematics.urdf.visuals import read_visuals

URDF = """<robot name="seen">
  <material name="blue"><color rgba="0 0 1 0.5"/></material>
  <link name="base">
    <visual><origin xyz="0.1 0.2 0.3" rpy="0.1 -0.2 0.3"/><geometry><box size="1 2 3"/></geometry>
      <material name="blue"/></visual>
    <visual><geometry><sphere radius="0.5"/></geometry>
      <material name="red"><color rgba="1 0 0 1"/></material></visual>
    {more}
  </link>
  <link name="arm"><visual><geometry><cylinder radius="0.1" length="2"/></geometry>
    <material name="red"/></visual></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>"""


def test_places_and_colours_are_those_of_pinocchio(tmp_path: Path) -> None:
    file = tmp_path / "seen.urdf"
    file.write_text(URDF.format(more=""))
    model = pinocchio.buildModelFromUrdf(str(file))
    theirs = pinocchio.buildGeomFromUrdf(model, str(file), pinocchio.GeometryType.VISUAL)
    found = read_visuals(file.read_text())
    ours = [item for link in ("base", "arm") for item in found.links[link]]
    assert not found.faults
    assert len(ours) == len(theirs.geometryObjects)
    for item, other in zip(ours, theirs.geometryObjects, strict=True):
        np.testing.assert_allclose(item.T_link_element, other.placement.homogeneous, atol=1e-12)
        assert item.color is not None
        np.testing.assert_allclose(item.color, other.meshColor, atol=1e-12)
    assert ours[0].geometry == BoxGeometry((1.0, 2.0, 3.0))


@pytest.mark.parametrize(("visual", "words"), [
    ("<visual/>", "must have one geometry"),
    ("<visual><geometry><torus/></geometry></visual>", "torus"),
    ("<visual><geometry><sphere radius='wide'/></geometry></visual>", "wide"),
    ("<visual><origin xyz='1 2'/><geometry><sphere radius='1'/></geometry></visual>", "xyz"),
])  # fmt: skip
def test_what_can_not_be_read_is_told(visual: str, words: str) -> None:
    found = read_visuals(URDF.format(more=visual))
    assert words in found.faults["base"]
    assert set(found.links) == {"base", "arm"}


@pytest.mark.parametrize(("rgba", "expected"), [
    ("2 -1 0.5 1", (1.0, 0.0, 0.5, 1.0)),
    ("0.25 0.5 0.75", (0.25, 0.5, 0.75, 1.0)),
    ("red", None),
    ("1 1 x 1", None),
])  # fmt: skip
def test_colours_that_are_odd(rgba: str, expected: tuple[float, ...] | None) -> None:
    mesh = f"""<visual><geometry><mesh filename="a.stl"/></geometry>
      <material name="odd"><color rgba="{rgba}"/></material></visual>"""
    last = read_visuals(URDF.format(more=mesh)).links["base"][-1]
    assert last.color == expected
    assert last.geometry == MeshGeometry("a.stl")

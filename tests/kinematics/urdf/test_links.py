"""Links of a URDF: origins, mass properties and solids, beside pinocchio and scipy."""

from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidRobotDescription
from kinematics.tree.description import BoxGeometry, LinkDescription, MeshGeometry
from kinematics.urdf.urdf import (
    MAX_INERTIA,
    MAX_LENGTH,
    MAX_MASS,
    PLATE,
    parse_urdf,
    read_origin,
)


def read(inside: str) -> tuple[LinkDescription, list[str]]:
    """A link "a" and what is odd about it."""
    robot = parse_urdf(f'<robot name="r"><link name="a">{inside}</link></robot>')
    return robot.links["a"], list(robot.lint)


def inertial(tensor: str, mass: str = "1") -> str:
    """<inertial> of a mass and the attributes of a tensor."""
    return f'<inertial><mass value="{mass}"/><inertia {tensor}/></inertial>'


def solid(geometry: str, origin: str = "") -> str:
    """<collision> of a geometry."""
    return f"<collision>{origin}<geometry>{geometry}</geometry></collision>"


def refused(inside: str, words: str) -> None:
    """See that a link is refused by its name and certain words."""
    with pytest.raises(InvalidRobotDescription, match=words) as error:
        read(inside)
    assert "link 'a'" in error.value.message


# ----------------------------------------------------------------------------------- origins


def test_angles_turn_about_fixed_axes_as_scipys_do() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        rpy, xyz = rng.uniform(-7.0, 7.0, (2, 3))
        row = fromstring(
            f'<x><origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/></x>'
        )
        T = read_origin(row, "x")
        np.testing.assert_allclose(
            T[:3, :3], Rotation.from_euler("xyz", rpy).as_matrix(), atol=1e-14
        )
        np.testing.assert_array_equal(T[:, 3], [*xyz, 1.0])
        quaternion = Rotation.from_euler("xyz", rpy).as_quat()
        row = fromstring(f'<x><origin quat_xyzw="{" ".join(map(str, quaternion))}"/></x>')
        np.testing.assert_allclose(read_origin(row, "x")[:3, :3], T[:3, :3], atol=1e-14)


def test_what_an_origin_leaves_out_is_zero() -> None:
    np.testing.assert_array_equal(read_origin(fromstring("<x/>"), "x"), np.eye(4))
    np.testing.assert_array_equal(read_origin(fromstring("<x><origin/></x>"), "x"), np.eye(4))
    T = read_origin(fromstring('<x><origin xyz="1 2 3"/></x>'), "x")
    np.testing.assert_array_equal(T[:3, :3], np.eye(3))
    np.testing.assert_array_equal(T[:, 3], [1.0, 2.0, 3.0, 1.0])


# ------------------------------------------------------------------------------------ inertia


def test_products_of_inertia_may_be_left_out_but_moments_may_not() -> None:
    link, _ = read(inertial('ixx="1" iyy="2" izz="3"'))
    assert link.inertia is not None
    np.testing.assert_array_equal(link.inertia.tensor, np.diag([1.0, 2.0, 3.0]))
    for missing in ("ixx", "iyy", "izz"):
        text = 'ixx="1" iyy="2" izz="3"'.replace(missing, "other")
        refused(inertial(text), f"'{missing}' of <inertia> of link 'a' is missing")


@pytest.mark.parametrize(
    ("moments", "word"),
    [
        ((1.0, 1.0, 2.0), None),
        ((1.0, 1.0, 2.0019), None),  # a thousandth of the largest is rounding
        ((1.0, 1.0, 2.0021), "principal moment"),
        ((0.0, 1.0, 1.0), None),
        ((-0.0009, 1.0, 1.0), None),
        ((-0.0011, 1.0, 1.0), "positive semi-definite"),
        ((0.0, 0.0, 0.0), None),
        ((0.0, 0.0, 1e-13), None),
        ((0.0, 0.0, 1e-11), "principal moment"),
    ],
)
def test_tensors_of_no_body_are_told(moments: tuple[float, ...], word: str | None) -> None:
    # In turned axes, so that the verdict cannot be read from the diagonal.
    R = Rotation.from_euler("xyz", [0.3, 0.5, -0.8]).as_matrix()
    entries = (R @ np.diag(moments) @ R.T)[np.triu_indices(3)]
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    tensor = " ".join(f'{n}="{float(v)!r}"' for n, v in zip(names, entries, strict=True))
    said = [line for line in read(inertial(tensor))[1] if "collision" not in line]
    assert (said == []) if word is None else (len(said) == 1 and word in said[0])


def test_mass_zero_with_an_inertia_is_odd_and_without_one_is_not() -> None:
    assert any("mass 0" in line for line in read(inertial('ixx="1" iyy="1" izz="1"', "0"))[1])
    zero = inertial('ixx="0" iyy="0" izz="0"', "0")
    assert not any("mass 0" in line for line in read(zero)[1])


def test_masses_and_moments_beyond_any_robot_are_refused() -> None:
    body = 'ixx="1" iyy="1" izz="1"'
    link, _ = read(inertial(body, f"{MAX_MASS:g}"))
    assert link.inertia is not None
    refused(inertial(body, f"{1.01 * MAX_MASS:g}"), "units")
    refused(inertial(body, "-1e-9"), "negative")
    refused(inertial(body, "nan"), "finite")
    refused(inertial(body.replace('ixx="1"', 'ixx="nan"')), "finite")
    refused(inertial(f'ixx="{1.01 * MAX_INERTIA:g}" iyy="1" izz="1"'), "units")
    refused(inertial(body.replace('izz="1"', f'izz="1" ixy="{-1.01 * MAX_INERTIA:g}"')), "units")


def test_half_of_an_inertial_is_refused() -> None:
    refused("<inertial/>", "no <mass>")
    refused('<inertial><mass value="1"/></inertial>', "no <inertia>")
    refused('<inertial><inertia ixx="1" iyy="1" izz="1"/></inertial>', "no <mass>")
    refused(inertial('ixx="1" iyy="1" izz="1"') * 2, "2 <inertial> elements")
    assert read("")[0].inertia is None


# ------------------------------------------------------------------------------------- solids


def test_a_link_without_solids_is_told() -> None:
    assert any("no collision geometry" in line for line in read("")[1])


@pytest.mark.parametrize(
    ("scale", "expected"),
    [("", (1.0, 1.0, 1.0)), ('scale="2"', (2.0, 2.0, 2.0)), ('scale="1 -2 3"', (1.0, -2.0, 3.0))],
)
def test_scales_of_meshes_are_one_number_or_three(
    scale: str, expected: tuple[float, float, float]
) -> None:
    link, _ = read(solid(f'<mesh filename="a.stl" {scale}/>'))
    assert link.collisions[0].geometry == MeshGeometry("a.stl", expected)


@pytest.mark.parametrize(
    ("geometry", "words"),
    [
        ('<mesh filename="a" scale=""/>', "3 number"),
        ('<mesh filename="a" scale="1 2"/>', "3 number"),
        ('<mesh filename="a" scale="0 1 1"/>', "is 0"),
        ('<mesh filename="a" scale="1 nan 1"/>', "finite"),
        ("<sphere/>", "'radius' of <sphere> of link 'a' is missing"),
        ('<mesh filename=" "/>', "no 'filename'"),
        ('<box size="1 1 -1"/>', "must be positive"),
        ('<box size="1 1"/>', "3 number"),
        (f'<box size="1 1 {2 * MAX_LENGTH}"/>', "units"),
        ('<sphere radius="-1"/>', "must be positive"),
        ('<sphere radius="nan"/>', "finite"),
        ('<cylinder radius="1" length="-1"/>', "must be positive"),
        ('<cylinder radius="-1" length="1"/>', "must be positive"),
        ('<capsule radius="1"/>', "'length' of <capsule> of link 'a' is missing"),
        ('<capsule length="1" radius="-1"/>', "must be positive"),
        ("<plane/>", "one geometry, got plane"),
        ('<sphere radius="1"/><plane/>', "one geometry, got sphere, plane"),
        ("", "one geometry, got none"),
    ],
)
def test_solids_that_cannot_be_built_are_refused(geometry: str, words: str) -> None:
    refused(solid(geometry), words)


def test_two_geometries_elements_of_one_collision_are_refused() -> None:
    sphere = '<geometry><sphere radius="1"/></geometry>'
    refused(f"<collision>{sphere}{sphere}</collision>", "2 <geometry> elements")
    refused("<collision/>", "geometry")


@pytest.mark.parametrize(
    "geometry",
    ['<box size="0 0 0"/>', '<sphere radius="0"/>', '<cylinder radius="0" length="1"/>',
     '<capsule radius="0" length="0"/>'],
)  # fmt: skip
def test_solids_without_extent_are_left_out_and_told(geometry: str) -> None:
    link, lint = read(solid(geometry) + solid('<sphere radius="1"/>'))
    assert len(link.collisions) == 1
    assert any("size 0" in line and "'a'" in line for line in lint)


def test_flat_solids_are_thin_plates() -> None:
    link, lint = read(solid('<box size="1 0 2"/>'))
    geometry = link.collisions[0].geometry
    assert isinstance(geometry, BoxGeometry)
    assert geometry.size == (1.0, PLATE, 2.0)
    assert any("flat" in line for line in lint)

"""Grasps found from shapes, against closed forms and coal's rays of thin boxes."""

import coal
import numpy as np
import pytest

from armwright.robot import load_robot
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.pose import from_rpy, transform
from obstacles.robots.grasps import (
    GraspKind,
    GraspSearch,
    JawSpan,
    find_grasps,
    jaw_span,
    object_down,
)
from obstacles.robots.tool import built_in_tool, mount
from obstacles.shapes.shape import Box, Convex, Cylinder, HalfSpace, Mesh, Shape, Sphere

DOWN = np.array([0.0, 0.0, -1.0])
SPAN = JawSpan(np.array([1.0, 0.0, 0.0]), 0.07)
#: An L of two boxes, which is not convex: outer sides 0.12 and 0.1 m, arms 0.04 m thick.
ELL = np.array([[0, 0], [0.12, 0], [0.12, 0.04], [0.04, 0.04], [0.04, 0.1], [0, 0.1]])


def ell() -> Mesh:
    vertices = np.vstack([np.c_[ELL, np.full(6, z)] for z in (0.0, 0.05)])
    cap = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    faces = [(c, b, a) for a, b, c in cap] + [(a + 6, b + 6, c + 6) for a, b, c in cap]
    for k in range(6):
        j = (k + 1) % 6
        faces += [(k, j, j + 6), (k, j + 6, k + 6)]
    return Mesh(vertices, np.array(faces))


def lines(grasps: Array) -> Array:
    """Direction between the fingers of each grasp."""
    return grasps[:, :3, 0]


def test_the_span_is_that_of_the_jaws_in_the_frame_of_the_tip() -> None:
    robot = load_robot("ur5e")
    span = jaw_span(mount(robot, built_in_tool("parallel_jaw", "jaw", opening=0.06)))
    assert span.widest == pytest.approx(0.06, abs=1e-12)
    np.testing.assert_allclose(np.abs(span.axis), [1.0, 0.0, 0.0], atol=1e-12)
    for arm in (robot, mount(robot, built_in_tool("three_jaw", "three"))):
        with pytest.raises(InvalidOption, match="no two fingers"):
            jaw_span(arm)


@pytest.mark.parametrize("kind", ["antipodal", "top", "side"])
def test_a_box_is_held_by_sides_that_the_jaws_span(kind: GraspKind) -> None:
    size = np.array([0.03, 0.06, 0.08])
    found = find_grasps(Box(size), DOWN, GraspSearch(kind), SPAN)
    assert len(found) >= 8
    for T in found:
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
        axis = int(np.abs(T[:3, 0]).argmax())
        assert abs(T[axis, 0]) == pytest.approx(1.0)
        assert size[axis] < 0.07  # 0.08 along z is wider than the jaws open
        assert T[axis, 3] == pytest.approx(0.0, abs=1e-12)
        assert np.all(np.abs(T[:3, 3]) <= 0.5 * size)
        if kind != "antipodal":
            assert T[:3, 2] @ DOWN == pytest.approx(1.0 if kind == "top" else 0.0, abs=1e-12)


def test_a_cylinder_and_a_ball_are_held_through_their_middle() -> None:
    for T in find_grasps(Cylinder(0.02, 0.06), DOWN, GraspSearch("top", friction=0.1), SPAN):
        np.testing.assert_allclose(T[:2, 3], 0.0, atol=2e-3)
    for T in find_grasps(Sphere(0.03), DOWN, GraspSearch("antipodal"), SPAN):
        np.testing.assert_allclose(T[:3, 3], 0.0, atol=3e-3)


@pytest.mark.parametrize("kind", ["antipodal", "top", "side"])
def test_jaws_come_to_both_sides_of_a_mesh_that_is_not_convex(kind: GraspKind) -> None:
    """Thin plates from far away to the two points pass nothing of the body, as coal has it."""
    parts = [((0.12, 0.04, 0.05), [0.06, 0.02, 0.025]), ((0.04, 0.1, 0.05), [0.02, 0.05, 0.025])]
    found = find_grasps(ell(), DOWN, GraspSearch(kind, count=40), SPAN)
    assert len(found) > 20
    for T in found:
        line = T[:3, 0]
        widths = []
        for side in (1.0, -1.0):
            # The first touch of a needle that comes along the line from outside.
            needle, asked = coal.Sphere(1e-6), coal.DistanceRequest()
            low, high = 0.0, 0.2
            for _ in range(60):
                if high - low < 1e-7:
                    break
                at = T[:3, 3] + side * high * line
                gap = min(
                    coal.distance(needle, coal.Transform3s(np.eye(3), at), coal.Box(*size),
                                  coal.Transform3s(np.eye(3), np.array(place)), asked,
                                  coal.DistanceResult())
                    for size, place in parts
                )  # fmt: skip
                if gap < 1e-6:
                    break
                high -= gap
            widths.append(high)
        assert sum(widths) < 0.07
        assert widths[0] == pytest.approx(widths[1], abs=1e-4)


@pytest.mark.parametrize("shape", [Box((0.1, 0.1, 0.02)), Cylinder(0.05, 0.03)])
def test_a_cup_sits_on_flat_places_with_its_rim(shape: Shape) -> None:
    found = find_grasps(shape, DOWN, GraspSearch("suction", radius=0.015), None)
    assert len(found) > 8
    half = 0.01 if isinstance(shape, Box) else 0.015
    for T in found:
        assert abs(T[2, 2]) == pytest.approx(1.0)
        assert T[2, 3] == pytest.approx(-half * T[2, 2])
        assert np.abs(T[:2, 3]).max() < 0.036
    assert len(find_grasps(Sphere(0.03), DOWN, GraspSearch("suction"), None)) == 0


def test_from_above_is_meant_as_the_object_lies() -> None:
    T = transform(from_rpy([0.5 * np.pi, 0.0, 0.3]), [0.4, 0.0, 0.1])
    found = find_grasps(Box((0.03, 0.04, 0.05)), object_down(T), GraspSearch("top"), SPAN)
    for grasp in found:
        np.testing.assert_allclose((T @ grasp)[:3, 2], DOWN, atol=1e-12)


def test_the_same_seed_finds_the_same_and_depth_goes_along_the_tool() -> None:
    shape = Convex(np.random.default_rng(3).normal(size=(30, 3)) * 0.02)
    one, other = (find_grasps(shape, DOWN, GraspSearch("top", seed=5), SPAN) for _ in range(2))
    np.testing.assert_array_equal(one, other)
    deep = find_grasps(shape, DOWN, GraspSearch("top", seed=5, depth=0.01), SPAN)
    np.testing.assert_allclose(deep[:, :3, 3] - one[:, :3, 3], 0.01 * one[:, :3, 2], atol=1e-15)


def test_what_is_too_wide_or_has_no_end_is_not_grasped() -> None:
    assert len(find_grasps(Box((0.1, 0.1, 0.1)), DOWN, GraspSearch("antipodal"), SPAN)) == 0
    with pytest.raises(InvalidOption, match="half-space"):
        find_grasps(HalfSpace([0.0, 0.0, 1.0], 0.0), DOWN, GraspSearch("top"), SPAN)

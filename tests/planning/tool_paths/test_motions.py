"""Lines and arcs that requests ask for, written with few decimals too."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal
from kinematics.pose import from_axis_angle, transform
from planning.options import CartesianOptions, ToolMotionOptions
from planning.tool_motions.tool_corner import part_of
from planning.tool_paths.planner import repairs, tool_motion, tool_motions

START = transform(None, [0.4, 0.0, 0.4])


def at(x: float, y: float) -> np.ndarray:
    return transform(None, [x, y, 0.4])


def test_each_motion_begins_where_the_one_before_ends() -> None:
    asked = CartesianOptions(
        motions=(
            ToolMotionOptions("lin", at(0.5, 0.0)),
            ToolMotionOptions("circ", at(0.4, 0.1), center=[0.4, 0.0, 0.4], normal=[0, 0, 1.0]),
            ToolMotionOptions("circ", at(0.3, 0.0), via=[0.4 - 0.1 * 2**-0.5, 0.1 * 2**-0.5, 0.4]),
        )
    )
    first, second, third = tool_motions(START, asked, at(9.0, 9.0))
    np.testing.assert_array_equal(first.pose(0.0), START)
    for one, other in ((first, second), (second, third)):
        np.testing.assert_allclose(one.pose(1.0), other.pose(0.0), atol=1e-12)
    assert first.length == pytest.approx(0.1)
    assert second.length == pytest.approx(0.1 * np.pi / 2.0)
    assert third.length == pytest.approx(0.1 * np.pi / 2.0)
    for s in (0.2, 0.7):
        for arc in (second, third):
            assert np.linalg.norm(arc.pose(s)[:3, 3] - [0.4, 0.0, 0.4]) == pytest.approx(0.1)


PLACES = np.linspace(0.0, 1.0, 33)
SEEDS = pytest.mark.parametrize("seed", range(15))
DECIMALS = pytest.mark.parametrize("decimals", [3, 4, 5, 6, 9])


class Arc(NamedTuple):
    """An exact arc about a centre, from a first spoke to a second one across it."""

    center: Array
    normal: Array
    first: Array
    second: Array
    sweep: float

    def points(self, places: Array) -> Array:
        """Points at places from 0 to 1."""
        angles = (self.sweep * places)[:, None]
        return self.center + np.cos(angles) * self.first + np.sin(angles) * self.second


def drawn(seed: int, decimals: int) -> Arc:
    random = np.random.default_rng([seed, decimals])
    normal, first = np.linalg.qr(random.normal(size=(3, 2)))[0].T
    radius = random.uniform(0.05, 0.4)
    sweep = (random.uniform(0.2, 2.8), np.pi, random.uniform(3.5, 5.0), 2.0 * np.pi)[seed % 4]
    center = random.uniform(-0.5, 0.5, 3)
    return Arc(center, normal, radius * first, radius * np.cross(normal, first), sweep)


def asked(arc: Arc, decimals: int, shift: float = 0.0) -> ToolMotionOptions:
    end = transform(None, np.round(arc.points(np.ones(1))[0], decimals))
    side = (arc.first + arc.second) / np.linalg.norm(arc.first) / np.sqrt(2.0)
    center = np.round(arc.center + shift * side, decimals).tolist()
    normal = None if arc.sweep < 2.9 else np.round(arc.normal, decimals).tolist()
    return ToolMotionOptions("circ", end, center=center, normal=normal)


def first_pose(arc: Arc) -> Array:
    return transform(None, arc.points(np.zeros(1))[0])


@SEEDS
@DECIMALS
def test_an_arc_written_with_few_decimals_is_the_arc_that_was_meant(
    seed: int, decimals: int
) -> None:
    arc, unit = drawn(seed, decimals), 10.0**-decimals
    motion = tool_motion(first_pose(arc), asked(arc, decimals), 0, 1e-7)
    assert motion.sweep == pytest.approx(arc.sweep, abs=0.05)
    meant = arc.points(PLACES)
    off = np.linalg.norm(motion.poses(PLACES)[:, :3, 3] - meant, axis=1)
    assert off.max() <= 4.0 * unit
    # It is a circle from the start to the end that it tells.
    np.testing.assert_allclose(motion.pose(0.0), motion.T_start, atol=1e-12)
    np.testing.assert_allclose(motion.pose(1.0), motion.T_end, atol=1e-9 + 1e-6 * motion.radius)


@SEEDS
@DECIMALS
def test_a_centre_that_is_off_by_more_than_rounding_is_refused(seed: int, decimals: int) -> None:
    arc = drawn(seed, decimals)
    wrong = asked(arc._replace(sweep=1.5 if arc.sweep > 2.9 else arc.sweep), decimals)
    error = max(12.0 * 10.0**-decimals, 1e-5)
    center = np.array(wrong.center) + error * arc.first / 0.05
    item = ToolMotionOptions("circ", wrong.T_base_tip, center=center.round(decimals).tolist())
    with pytest.raises(InvalidGoal, match=r"motions\[0\]: .*center"):
        tool_motion(first_pose(arc), item, 0, 1e-7)


def test_a_deviation_that_is_allowed_is_used_and_what_was_moved_is_told() -> None:
    arc = drawn(0, 16)
    item = asked(arc, 16, shift=2e-4)
    with pytest.raises(InvalidGoal, match="from its center"):
        tool_motion(first_pose(arc), item, 0, 1e-5)
    options = CartesianOptions((item,), max_deviation=1e-3)
    motions = tool_motions(first_pose(arc), options)
    assert len(repairs(options, motions)) == 1
    assert "its center was moved by 9.5e-05 m" in repairs(options, motions)[0]
    exact = CartesianOptions((asked(arc, 16),))
    assert repairs(exact, tool_motions(first_pose(arc), exact)) == ()


@pytest.mark.parametrize("decimals", [3, 4, 5, 6, 9])
def test_half_a_circle_has_no_plane_however_its_centre_is_rounded(decimals: int) -> None:
    for seed in range(1, 41, 4):
        arc = drawn(seed, decimals)
        assert arc.sweep == np.pi
        given = asked(arc, decimals)
        item = ToolMotionOptions("circ", given.T_base_tip, center=given.center)
        with pytest.raises(InvalidGoal, match="half a circle has no plane"):
            tool_motion(first_pose(arc), item, 0, 1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_the_longer_rotation_goes_the_other_way_round_about_the_same_axis(seed: int) -> None:
    random = np.random.default_rng(seed)
    R = Rotation.random(random_state=seed)
    axis, angle = random.normal(size=3), random.uniform(0.1, 3.0)
    axis /= np.linalg.norm(axis)
    end = transform(from_axis_angle(axis, angle) @ R.as_matrix(), [0.5, 0.1, 0.3])
    start = transform(R.as_matrix(), [0.4, 0.0, 0.4])
    options = ToolMotionOptions("lin", end, longer=True)
    motion = tool_motion(start, options, 0, 1e-4)
    assert motion.angle == pytest.approx(2.0 * np.pi - angle)
    for s in np.linspace(0.0, 1.0, 21):
        expected = Rotation.from_rotvec(s * (angle - 2.0 * np.pi) * axis) * R
        np.testing.assert_allclose(motion.pose(s)[:3, :3], expected.as_matrix(), atol=1e-9)
    for begin, stop in ((0.0, 0.3), (0.2, 0.9), (0.7, 1.0)):
        part = part_of(motion, begin, stop)
        assert part.angle == pytest.approx((stop - begin) * motion.angle)
        whole = motion.poses(np.linspace(begin, stop, 9))
        np.testing.assert_allclose(part.poses(np.linspace(0.0, 1.0, 9)), whole, atol=1e-9)


def test_a_tool_that_does_not_turn_has_no_longer_rotation() -> None:
    with pytest.raises(InvalidGoal, match="does not turn"):
        tool_motion(START, ToolMotionOptions("lin", at(0.5, 0.0), longer=True), 0, 1e-4)

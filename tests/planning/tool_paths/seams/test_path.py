"""Paths of seams: corners, arcs, and the places at which configurations are looked for."""

import math
from itertools import pairwise

import numpy as np
import pytest

from kinematics.errors import InvalidGoal
from kinematics.pose import from_axis_angle, transform
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance
from planning.tool_paths.seams.path import FLAT_CORNER, seam_places, seam_runs, through_spline

EXACT = ToolTolerance.of({})
FREE = ToolTolerance.of({}, ("rz",), tilt=0.2)


def at(*place: float, turn: float = 0.0) -> SeamWaypoint:
    return SeamWaypoint(transform(from_axis_angle([0.0, 0.0, 1.0], turn), list(place)))


def bend(angle: float) -> tuple[SeamWaypoint, ...]:
    """Two ways of 0.2 m with a corner of this angle."""
    return at(0, 0, 0), at(0.2, 0, 0), at(0.2 + 0.2 * math.cos(angle), 0.2 * math.sin(angle), 0)


@pytest.mark.parametrize(("factor", "count"), [(0.98, 1), (1.02, 2)])
def test_only_sharp_corners_part_the_runs(factor: float, count: int) -> None:
    runs = seam_runs(SeamOptions(bend(factor * FLAT_CORNER), EXACT, tool_speed=0.1), 0.0)
    assert len(runs) == count
    assert [asked for run in runs for asked in run.asked] == [0, 1]
    assert sum(run.length for run in runs) == pytest.approx(0.4)
    assert {run.name for run in runs} == {"seam"}
    assert {speed for run in runs for speed in run.tool_speeds} == {0.1}


def test_a_blend_joins_what_a_sharp_corner_parts() -> None:
    first, corner, last = bend(1.2)
    rounded = SeamWaypoint(corner.T_base_tip, blend=0.05)
    (run,) = seam_runs(SeamOptions((first, rounded, last), EXACT), 0.0)
    assert run.asked == (0, 0, 0, 1)
    assert run.blends == (False, True, True, False)
    (same,) = seam_runs(SeamOptions((first, corner, last), EXACT), 0.05)
    assert same.length == pytest.approx(run.length)
    # A circle of radius 0.05 / tan(0.6) for the two times 0.05 m.
    assert run.length == pytest.approx(0.3 + 1.2 * 0.05 / math.tan(0.6))


def test_an_arc_goes_through_its_point() -> None:
    end = SeamWaypoint(at(0.2, 0, 0).T_base_tip, via=np.array([0.1, 0.1, 0.0]))
    (run,) = seam_runs(SeamOptions((at(0, 0, 0), end), EXACT), 0.0)
    assert run.length == pytest.approx(0.1 * math.pi)
    np.testing.assert_allclose(run.pose(0.5)[:3, 3], [0.1, 0.1, 0.0], atol=1e-12)


def test_two_waypoints_at_a_place_and_an_arc_without_a_circle_are_refused_by_number() -> None:
    with pytest.raises(InvalidGoal, match=r"waypoints\[2\] is at the place of waypoints\[1\]"):
        seam_runs(SeamOptions((at(0, 0, 0), at(0.1, 0, 0), at(0.1, 0, 0, turn=1.0)), EXACT), 0.0)
    flat = SeamWaypoint(at(0.2, 0, 0).T_base_tip, via=np.array([0.1, 0.0, 0.0]))
    with pytest.raises(InvalidGoal, match=r"waypoints\[1\]: ") as refusal:
        seam_runs(SeamOptions((at(0, 0, 0), flat), EXACT), 0.0)
    assert refusal.value.details["waypoint"] == 1


def test_places_are_near_each_other_and_tell_where_they_are() -> None:
    points = tuple(at(0.1 * k, 0.01 * k * k, 0.0, turn=0.3 * k) for k in range(6))
    places = seam_places(seam_runs(SeamOptions(points, FREE), 0.0))
    assert len(places.runs) == 1
    np.testing.assert_array_equal(places.run, 0)
    corners = np.array([point.T_base_tip[:3, 3] for point in points])
    ways = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(ways)])
    assert places.length == pytest.approx(length[-1])
    for axis in range(3):
        expected = np.interp(places.along, length, corners[:, axis])
        np.testing.assert_allclose(places.nominal[:, axis, 3], expected, atol=1e-12)
    turns = np.interp(places.along, length, 0.3 * np.arange(6))
    angles = np.arctan2(places.nominal[:, 1, 0], places.nominal[:, 0, 0])
    np.testing.assert_allclose(angles, turns, atol=1e-12)
    np.testing.assert_allclose(places.turned, turns, atol=1e-12)
    np.testing.assert_allclose(places.s, places.along / length[-1], atol=1e-12)
    np.testing.assert_array_equal(
        places.waypoint, np.searchsorted(length, places.along + 1e-9, side="right") - 1
    )
    assert np.diff(places.along).max() <= 0.03 + 1e-9
    assert np.diff(places.turned).max() <= 0.15 + 1e-9
    assert places.ends == (len(places.s) - 1,)
    np.testing.assert_array_equal(places.layers(every=True), np.arange(len(places.s)))


def test_layers_skip_places_that_are_near_each_other() -> None:
    points = tuple(at(0.005 * k, 0, 0, turn=0.002 * k) for k in range(101))
    places = seam_places(seam_runs(SeamOptions(points, EXACT), 0.0))
    layers = places.layers()
    assert (layers[0], layers[-1]) == (0, len(places.s) - 1)
    ways = np.diff(places.along[layers])
    assert ways.max() <= 0.04 + 1e-9
    assert ways[:-1].min() >= 0.035 - 1e-9
    turning = tuple(at(0.005 * k, 0, 0, turn=0.05 * k) for k in range(101))
    places = seam_places(seam_runs(SeamOptions(turning, EXACT), 0.0))
    assert np.diff(places.turned[places.layers()]).max() <= 0.25 + 1e-9


def test_places_of_several_runs_share_the_corner() -> None:
    places = seam_places(seam_runs(SeamOptions(bend(2.0), EXACT), 0.0))
    assert len(places.ends) == 2
    corner = places.ends[0]
    assert (places.run[corner - 1], places.run[corner]) == (0, 1)
    assert places.s[corner] == 0.0
    np.testing.assert_allclose(places.nominal[corner, :3, 3], [0.2, 0.0, 0.0], atol=1e-12)


def great_circle(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """The point between two unit vectors on the great circle through them (Shoemake, 1985)."""
    angle = math.acos(float(np.clip(a @ b, -1.0, 1.0)))
    if angle < 1e-9:
        return a
    return np.asarray(math.sin((1.0 - share) * angle) * a + math.sin(share * angle) * b) / math.sin(
        angle
    )


def random_pose(random: np.random.Generator, place: np.ndarray) -> np.ndarray:
    axis = random.normal(size=3)
    return transform(from_axis_angle(axis / np.linalg.norm(axis), random.uniform(-1.2, 1.2)), place)


@pytest.mark.parametrize("seed", range(40))
def test_axes_alone_turn_along_the_great_circle(seed: int) -> None:
    random = np.random.default_rng(seed)
    places = np.array([[0.1 * k, 0.0, 0.0] for k in range(6)]) + random.uniform(-0.01, 0.01, (6, 3))
    alone = random.random(6) < 0.7
    points = tuple(
        SeamWaypoint(random_pose(random, place), tolerance=FREE if axis else EXACT, axis_only=axis)
        for place, axis in zip(places, alone.tolist(), strict=True)
    )
    runs = seam_runs(SeamOptions(points, EXACT), 0.0)
    motions = [motion for run in runs for motion in run.motions]
    assert len(motions) == 5
    for k, motion in enumerate(motions):
        given = [points[k + i].T_base_tip for i in (0, 1)]
        for share in (0.0, 0.3, 0.8, 1.0):
            T = motion.pose(share)
            if alone[k] or alone[k + 1]:
                axis = great_circle(given[0][:3, 2], given[1][:3, 2], share)
                np.testing.assert_allclose(T[:3, 2], axis, atol=1e-9)
        # What is given whole is kept whole, at either end of the way.
        for i, pose in enumerate((motion.T_start, motion.T_end)):
            if not alone[k + i]:
                np.testing.assert_allclose(pose, given[i], atol=1e-12)


def test_a_corner_that_is_rounded_turns_the_axis_alone_too() -> None:
    random = np.random.default_rng(1)
    corner = [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.2, 0.0]]
    points = [SeamWaypoint(random_pose(random, np.array(p)), axis_only=True) for p in corner]
    points[1] = SeamWaypoint(points[1].T_base_tip, blend=0.05, axis_only=True)
    (run,) = seam_runs(SeamOptions(tuple(points), FREE), 0.0)
    arcs = [motion for motion, blends in zip(run.motions, run.blends, strict=True) if blends]
    first, last = arcs[0].T_start[:3, 2], arcs[-1].T_end[:3, 2]
    plane = np.cross(first, last)
    for arc in arcs:
        for share in np.linspace(0.0, 1.0, 5):
            assert abs(arc.pose(float(share))[:3, 2] @ plane) < 1e-9


def test_opposite_axes_name_no_way() -> None:
    up = SeamWaypoint(transform(np.eye(3), [0.0, 0.0, 0.0]), axis_only=True)
    down = SeamWaypoint(transform(np.diag([1.0, -1.0, -1.0]), [0.1, 0.0, 0.0]), axis_only=True)
    with pytest.raises(InvalidGoal, match=r"waypoints\[0\] and waypoints\[1\].*opposite") as told:
        seam_runs(SeamOptions((up, down), FREE), 0.0)
    assert told.value.details["waypoint"] == 1


@pytest.mark.parametrize("step", [0.05, 0.15, 0.4])
def test_a_spline_through_points_of_a_circle_is_nearly_that_circle(step: float) -> None:
    radius, angles = 0.08, np.arange(0.0, 3.0, step)
    points = tuple(at(radius * math.cos(a), radius * math.sin(a), 0.0) for a in angles)
    seam, away = through_spline(SeamOptions(points, EXACT, through="spline"))
    # The sagitta of a chord; a cubic is off a circle by the fourth power of the step.
    sagitta = radius * (1.0 - math.cos(0.5 * step))
    assert away == pytest.approx(sagitta, rel=0.06)
    (run,) = seam_runs(seam, 0.0)
    off = np.abs(np.linalg.norm(run.poses(np.linspace(0.0, 1.0, 400))[:, :3, 3], axis=1) - radius)
    assert off.max() <= 0.06 * sagitta
    bends = [
        float(np.linalg.norm(one.direction(1.0) - other.direction(0.0)))
        for one, other in pairwise(run.motions)
    ]
    assert max(bends) <= 0.15 * step
    for point, waypoint in zip(points, seam.waypoints, strict=True):
        np.testing.assert_array_equal(point.T_base_tip, waypoint.T_base_tip)


def test_a_spline_leaves_corners_arcs_and_straight_ways_as_they_are() -> None:
    along = [(x, 0.0) for x in (0.0, 0.05, 0.1)] + [(0.1, 0.05), (0.1, 0.1)]
    points = [at(x, y, 0.0) for x, y in along]
    seam, away = through_spline(SeamOptions(tuple(points), EXACT, through="spline"))
    assert away == 0.0
    assert all(point.via is None for point in seam.waypoints)
    assert seam.through == "polyline"
    via = np.array([0.12, 0.125, 0.0])
    points.append(SeamWaypoint(at(0.1, 0.15, 0.0).T_base_tip, via=via))
    seam, _ = through_spline(SeamOptions(tuple(points), EXACT, through="spline"))
    np.testing.assert_array_equal(seam.waypoints[-1].via, via)

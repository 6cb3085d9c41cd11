"""Simplified paths: proved in a scene, and timed within their tolerance."""

import itertools

import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from planning.timing.path.blend import merge

HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def swing(k: int) -> Array:
    """A bow of the Panda's first joints, shape (k, 7) [rad]."""
    u = np.linspace(0.0, 1.0, k)[:, None]
    bow = np.sin(np.pi * u) * [0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0]
    return np.asarray(HOME + u * [1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] + bow)


def test_a_simplified_path_is_proved() -> None:
    robot, points = aw.load_robot("panda"), swing(300)
    found = aw.simplify(points, 1e-3, robot, aw.Scene())
    assert len(found.numbers) < 30
    np.testing.assert_array_equal(found.waypoints, points[found.numbers])
    assert found.certificate is not None
    assert found.certificate.verified
    assert found.certificate.proved.collisions
    bare = aw.simplify(points, 1e-3)
    assert bare.certificate is None
    np.testing.assert_array_equal(bare.numbers, found.numbers)


def test_nearer_lines_are_taken_where_lines_are_not_free() -> None:
    robot, points = aw.load_robot("panda"), swing(300)
    # The straight way hits what the bow goes round.
    tip = aw.fk(robot, 0.5 * (points[0] + points[-1]))
    scene = aw.Scene([aw.Obstacle("post", aw.Sphere(0.02), aw.pose(tip[:3, 3]))])
    assert not aw.simplify(points[[0, -1]], 0.0, robot, scene).certificate.verified  # type: ignore[union-attr]
    found = aw.simplify(points, 0.5, robot, scene)
    assert found.certificate is not None
    assert found.certificate.verified
    assert 2 < len(found.numbers) < 30
    assert "were proved free" in found.notes[0]
    # What is not free itself is told, with where.
    wrong = aw.simplify(points[::299], 0.5, robot, scene)
    assert wrong.certificate is not None
    assert wrong.certificate.violation is not None
    assert 0.0 < wrong.certificate.violation.time < 1.0


@pytest.mark.parametrize("method", ["toppra", "jerk_limited", None])
def test_a_timed_path_keeps_to_its_tolerance_in_every_joint(method: str | None) -> None:
    robot, points = aw.load_robot("panda"), swing(300) + 0.05 * np.sin(30.0 * swing(300))
    limits = {"jerk": np.full(7, 500.0)}
    timing = aw.TimingOptions(method)  # type: ignore[arg-type]
    found = aw.retime(points, robot, tolerance=5e-3, timing_options=timing, limits=limits)
    assert found.certificate.verified
    motion = found.trajectory
    places = motion.sample(np.linspace(0.0, motion.duration, 800))
    fine = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(points)])
    away = np.abs(places[:, None] - fine[None]).max(axis=2).min(axis=1)
    step = np.abs(np.diff(fine, axis=0)).max()
    assert 1e-3 < away.max() <= 5e-3 + step
    np.testing.assert_allclose(places[[0, -1]], points[[0, -1]], atol=1e-9)
    # The uncut curve by the same method takes as long.
    spline = aw.TimingOptions(method, interpolation="natural_spline")  # type: ignore[arg-type]
    uncut = aw.retime(points[::5], robot, timing_options=spline, limits=limits)
    assert motion.duration < 1.1 * uncut.trajectory.duration


def test_odd_requests_are_refused() -> None:
    robot = aw.load_robot("panda")
    for tolerance in (-1e-3, np.nan, np.inf):
        with pytest.raises(InvalidOption, match="the tolerance is"):
            aw.simplify(swing(5), tolerance)
    with pytest.raises(InvalidOption, match="needs a robot"):
        aw.simplify(swing(5), 1e-3, None, aw.Scene())
    with pytest.raises(InvalidTrajectory, match="waypoint 1 is not finite"):
        aw.simplify([[0.0], [np.nan]], 1e-3)
    with pytest.raises(InvalidTrajectory, match="3 value"):
        aw.simplify(swing(5)[:, :3], 1e-3, robot)
    with pytest.raises(InvalidOption, match="tolerance is -1"):
        aw.retime(swing(5), robot, tolerance=-1.0)
    both, spline = aw.TimingOptions(blend_tolerance=1e-3), aw.TimingOptions("spline")
    with pytest.raises(InvalidOption, match="blend_tolerance"):
        aw.retime(swing(5), robot, tolerance=1e-3, timing_options=both)
    with pytest.raises(InvalidOption, match="straight lines"):
        aw.retime(swing(5), robot, tolerance=1e-3, timing_options=spline)


def test_exact_copies_go_without_a_tolerance() -> None:
    points = np.repeat(swing(6), 3, axis=0)
    found = aw.simplify(points, 0.0)
    assert found.deviation == 0.0
    np.testing.assert_array_equal(found.waypoints, merge(points))


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara"])
def test_the_tool_stays_within_its_tolerance(name: str) -> None:
    robot, rng = aw.load_robot(name), np.random.default_rng(3)
    limits = robot.chain.limits
    low, high = np.clip(limits.lower, -2.0, 2.0), np.clip(limits.upper, -2.0, 2.0)
    for position, orientation in ((2e-3, 0.01), (5e-4, 0.02), (0.01, 0.002)):
        u = np.linspace(0.0, 1.0, 800)[:, None]
        middle, way = 0.5 * (low + high), 0.1 * (high - low)
        points = middle + way * np.sin(u * rng.uniform(1.0, 5.0, len(low)))
        tool = aw.TipTolerance(position, orientation)
        found = aw.simplify(points, None, robot, tool_tolerance=tool)
        assert len(found.numbers) < 0.9 * len(points)
        assert found.tool_use is not None
        assert 0.0 < found.tool_use <= 1.0
        # Each place of the path has one near it on the leg that stands for it.
        for first, last in itertools.pairwise(found.numbers.tolist()):
            given = np.linspace(points[first:last], points[first + 1 : last + 1], 5, axis=1)
            leg = np.linspace(points[first], points[last], 2000)
            there, line = aw.fk(robot, given.reshape(-1, points.shape[1])), aw.fk(robot, leg)
            apart = np.linalg.norm(there[:, None, :3, 3] - line[None, :, :3, 3], axis=2)
            trace = np.einsum("aij,bij->ab", there[:, :3, :3], line[:, :3, :3])
            angle = np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
            near = (apart <= position + 1e-9) & (angle <= orientation + 1e-7)
            assert near.any(axis=1).all()
        both = aw.simplify(points, 1e-5, robot, tool_tolerance=tool)
        assert both.deviation <= 1e-5
        assert len(both.numbers) >= len(found.numbers)
    for wrong in (aw.TipTolerance(), aw.TipTolerance(-1.0), aw.TipTolerance(np.nan, 0.1)):
        with pytest.raises(InvalidOption, match="tool's tolerance"):
            aw.simplify(points, None, robot, tool_tolerance=wrong)
    with pytest.raises(InvalidOption, match="needs a robot"):
        aw.simplify(points, 1e-3, tool_tolerance=tool)
    with pytest.raises(InvalidOption, match="the tolerance is None"):
        aw.simplify(points, None, robot)

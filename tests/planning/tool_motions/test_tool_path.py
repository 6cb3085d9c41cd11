"""Joint paths of tool motions: cuts, reports, timing, and when they pass their ends."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.timing.choice import chosen_parametrization
from planning.timing.options import TimingOptions
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.path import JointPath
from planning.tool_motions.passing_times import passing_times
from planning.tool_motions.tool_motion import line
from planning.tool_motions.tool_path import Stop, Tolerances, ToolPath, ToolRun, ToolSegment
from planning.tool_motions.tool_tolerance import ToolTolerance
from planning.tool_paths.tool_deviation import tool_deviations
from planning.tool_paths.tool_following import lead_tool
from planning.tool_paths.tool_timing import time_tool_path
from planning.values.deadline import Deadline
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
T = forward(CHAIN, HOME)
TOLERANCES = Tolerances(1e-4, 1e-3)
HERE = Stop(0.5, "collision", "something is in the way", {})


def bent() -> ToolSegment:
    """Three pieces of one joint: q = s^2 up to 0.6, the places of the motion its parameter."""
    breaks = np.array([0.0, 0.2, 0.5, 0.6])
    c = np.array([[[b * b, 2.0 * b, 1.0]] for b in breaks[:-1]])
    return ToolSegment(JointPath(c, np.diff(breaks)), np.zeros(1), np.array([0.36]), 0.6, None)


@pytest.mark.parametrize("at", [0.1, 0.2, 0.35, 0.5, 0.55])
def test_a_segment_that_is_cut_follows_the_same_curve_up_to_there(at: float) -> None:
    whole, part = bent(), bent().cut(at, HERE)
    assert part.path is not None
    assert whole.path is not None
    assert part.reached == at
    assert part.stop is HERE
    assert part.path.length == pytest.approx(at)
    np.testing.assert_allclose(part.end, [at**2], atol=1e-15)
    places = np.linspace(0.0, at, 23)
    np.testing.assert_allclose(
        part.path.sample(np.minimum(places, part.path.length)),
        whole.path.sample(places),
        atol=1e-14,
    )
    assert (part.path.lengths > 0.0).all()


def corner(stay: bool = False) -> ToolPath:
    """Two lines, a motion on the spot before them if asked for."""
    places = [T[:3, 3], T[:3, 3] + [0.0, 0.1, 0.0], T[:3, 3] + [0.0, 0.1, -0.1]]
    poses = [transform(T[:3, :3], place) for place in places]
    motions = [line(poses[0], poses[1]), line(poses[1], poses[2])]
    if stay:
        motions.insert(0, line(poses[0], poses[0]))
    checker = Checker.of(ROBOT, Scene())
    runs = [ToolRun.of(motion, k) for k, motion in enumerate(motions)]
    return lead_tool(CHAIN, checker, HOME, runs, TOLERANCES, Deadline.after(60.0))


def parametrization(method: str) -> TimeParametrization:
    timing = TimingOptions(method)  # type: ignore[arg-type]
    return chosen_parametrization(timing, CHAIN.joint_names, CHAIN.limits)


@pytest.mark.parametrize("method", ["toppra", "jerk_limited", "spline"])
def test_the_tool_rests_at_the_corner_and_keeps_to_its_lines(method: str) -> None:
    path, oracle = corner(), PinocchioArm()
    timed = time_tool_path(CHAIN, path, parametrization(method))
    motion = timed.trajectory(CHAIN)
    (first, second), turn = timed.reports, timed.parts[0].duration
    assert (first.begins, first.ends) == (0.0, turn)
    assert second.begins == turn
    assert second.ends == pytest.approx(motion.duration)
    for time in (0.0, turn, motion.duration):
        np.testing.assert_allclose(motion.sample([time], 1), 0.0, atol=1e-7)
    limits = CHAIN.limits
    assert (motion.peaks(1).value <= limits.velocity * (1.0 + 1e-9)).all()
    assert (motion.peaks(2).value <= limits.acceleration * (1.0 + 1e-9)).all()
    for report, axis in ((first, 1), (second, 2)):
        for time in np.linspace(report.begins, report.ends, 60):
            p = oracle.pose(motion.sample([min(time, motion.duration)])[0])[:3, 3]
            nominal = T[:3, 3] if axis == 1 else T[:3, 3] + [0.0, 0.1, 0.0]
            off = np.delete(p - nominal, axis)
            assert np.linalg.norm(off) <= TOLERANCES.position


def test_a_spline_of_time_gets_more_waypoints_until_it_keeps_to_its_line() -> None:
    tight = replace(corner(), tolerances=Tolerances(2e-6, 2e-5))
    timed = time_tool_path(CHAIN, tight, parametrization("spline"))
    for (run, path), part in zip(tight.moving, timed.parts, strict=True):
        (motion,) = run.motions
        assert part.pieces >= 2 * len(path.lengths)
        poses = forward(CHAIN, part.sample(np.linspace(0.0, part.duration, 1000)))
        assert (tool_deviations(motion, poses) <= tight.tolerances.pair).all()


def test_a_motion_on_the_spot_takes_no_time() -> None:
    timed = time_tool_path(CHAIN, corner(stay=True), parametrization("toppra"))
    assert len(timed.parts) == 2
    spot = timed.reports[0]
    assert spot.begins == spot.ends == 0.0
    assert timed.reports[1].begins == 0.0
    assert [report.fraction for report in timed.reports] == [1.0, 1.0, 1.0]
    assert timed.tool_motions.times.tolist() == [
        0.0, *(report.ends for report in timed.reports)]  # fmt: skip


def test_where_nothing_moves_the_robot_stays() -> None:
    checker = Checker.of(ROBOT, Scene())
    still = lead_tool(
        CHAIN, checker, HOME, [ToolRun.of(line(T, T))], TOLERANCES, Deadline.after(60.0)
    )
    timed = time_tool_path(CHAIN, still, parametrization("toppra"))
    assert timed.parts == ()
    motion = timed.trajectory(CHAIN)
    np.testing.assert_array_equal(motion.sample([0.0, motion.duration]), [HOME, HOME])


@pytest.mark.parametrize(("method", "kept"), [("spline", False), ("jerk_limited", True)])
def test_only_what_follows_the_path_keeps_a_jerk_limit_at_corners(method: str, kept: bool) -> None:
    chosen = parametrization(method)
    jerk = np.full(7, 1e3)
    limited = TimeParametrization(chosen.method, chosen.velocity, chosen.acceleration, jerk)
    timed = time_tool_path(CHAIN, corner(), chosen)
    assert timed.limits(limited).holds_jerk is kept


def test_a_motion_that_is_stopped_reports_how_far_it_came() -> None:
    path = corner()
    cut = path.segments[1].cut(0.25, HERE)
    part = ToolPath(path.runs, (path.segments[0], cut), 0.625, HERE, TOLERANCES)
    timed = time_tool_path(CHAIN, part, parametrization("toppra"))
    assert [report.fraction for report in timed.reports] == [1.0, 0.25]
    ends: Array = forward(CHAIN, timed.trajectory(CHAIN).end)[:3, 3]
    np.testing.assert_allclose(ends, T[:3, 3] + [0.0, 0.1, -0.025], atol=2e-4)


PLACES = np.array([0.0, 0.2, 0.45, 0.7, 1.0])


def curve() -> CubicSpline:
    """A joint path near a straight line of the tool: joints in proportion to the place."""
    q = np.array([HOME + s * np.array([0.3, 0.1, 0.0, 0.1, 0.0, 0.0, 0.2]) for s in PLACES])
    return CubicSpline(PLACES, q)


def as_path(spline: CubicSpline) -> JointPath:
    return JointPath(
        np.ascontiguousarray(np.moveaxis(spline.c[::-1], 0, 2)), np.diff(np.asarray(spline.x))
    )


def in_time(duration: float) -> Trajectory:
    """The path with s = 3 u^2 - 2 u^3, u = t / T, as one polynomial: joints are linear in s."""
    rate = np.array([0.3, 0.1, 0.0, 0.1, 0.0, 0.0, 0.2])
    c = np.zeros((1, 7, 4))
    c[0, :, 0] = HOME
    c[0, :, 2], c[0, :, 3] = 3.0 * rate / duration**2, -2.0 * rate / duration**3
    return Trajectory(CHAIN.joint_names, np.array([0.0, duration]), c)


def polyline(tolerant: bool) -> ToolRun:
    """The tool's poses at the places, joined by lines."""
    T = forward(CHAIN, curve()(PLACES))
    motions = tuple(line(a, b) for a, b in pairwise(T))
    boxes = (ToolTolerance.of({}),) * 4 if tolerant else ()
    return ToolRun(motions, tuple(range(4)), (False,) * 4, boxes)


def closed_form(duration: float, places: np.ndarray) -> np.ndarray:
    """Times of 3 u^2 - 2 u^3 = s."""
    u = [np.roots([-2.0, 3.0, 0.0, -s]) for s in places]
    inside = [r[(np.abs(r.imag) < 1e-9) & (r.real >= 0.0) & (r.real <= 1.0)] for r in u]
    return duration * np.array([float(r.real[0]) for r in inside])


@pytest.mark.parametrize("duration", [0.5, 2.0])
def test_a_tolerant_run_passes_the_plane_across_its_corners(duration: float) -> None:
    run, motion = polyline(tolerant=True), in_time(duration)
    times = passing_times(CHAIN, as_path(curve()), motion, run.parts)
    assert times[-1] == duration
    np.testing.assert_allclose(times[:-1], closed_form(duration, PLACES[1:-1]), rtol=1e-9)
    for part, other, time in zip(run.parts[:-1], run.parts[1:], times[:-1], strict=True):
        p = forward(CHAIN, motion.sample([time]))[0, :3, 3]
        across = part.motion.direction(1.0) + other.motion.direction(0.0)
        assert abs((p - part.motion.T_end[:3, 3]) @ across) < 1e-12


def test_beside_a_sharp_corner_the_plane_halves_the_angle() -> None:
    T = forward(CHAIN, HOME)
    motion = in_time(2.0)
    p = forward(CHAIN, motion.sample(np.linspace(0.0, 2.0, 3)))[:, :3, 3]
    # The corner lies beside the way of the tool, whose middle is in the plane that halves it.
    way = (p[2] - p[0]) / np.linalg.norm(p[2] - p[0])
    side = np.cross(way, [0.0, 0.0, 1.0])
    along = [way + 0.8 * side, way - 0.8 * side]
    corner = p[1] + 0.05 * side
    ends = [corner - 0.2 * along[0], corner, corner + 0.2 * along[1]]
    poses = [transform(T[:3, :3], end) for end in ends]
    lines = tuple(line(one, other) for one, other in pairwise(poses))
    boxes = (ToolTolerance.of({"x": (-0.1, 0.1)}),) * 2
    run = ToolRun(lines, (0, 1), (False,) * 2, boxes)
    time, _ = passing_times(CHAIN, as_path(curve()), motion, run.parts)
    assert time == pytest.approx(1.0, abs=1e-9)


def test_an_exact_run_ends_its_parts_where_the_joints_are_nearest() -> None:
    run, motion = polyline(tolerant=False), in_time(2.0)
    # Corners are looked for among the breaks of the joint path, in its own parameter.
    spline = CubicSpline(run.breaks, curve()(PLACES))
    times = passing_times(CHAIN, as_path(spline), motion, run.parts)
    np.testing.assert_allclose(times[:-1], closed_form(2.0, PLACES[1:-1]), rtol=1e-6)
    assert times[-1] == 2.0

"""Joint paths of tool motions: where they are cut, what is reported, how they are timed."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.timing.choice import chosen_parametrization
from planning.timing.options import TimingOptions
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_motion import ToolMotion, line
from planning.tool_motions.tool_path import Stop, Tolerances, ToolPath, ToolSegment
from planning.tool_paths.tool_deviation import piece_deviations
from planning.tool_paths.tool_following import lead_tool
from planning.tool_paths.tool_timing import time_tool_path
from planning.values.deadline import Deadline
from tests.planning.pinocchio_panda import PinocchioPanda
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


def test_a_cut_beyond_the_end_leaves_the_segment_with_its_stop() -> None:
    for at in (0.6, 0.9):
        part = bent().cut(at, HERE)
        assert (part.reached, part.stop) == (0.6, HERE)
        assert part.path is not None
        assert part.path.length == pytest.approx(0.6)


def test_a_cut_at_the_start_leaves_nothing_to_move() -> None:
    part = bent().cut(0.0, HERE)
    assert part.path is None
    assert part.reached == 0.0
    np.testing.assert_array_equal(part.end, part.start)


def test_a_free_orientation_has_no_tolerance() -> None:
    assert Tolerances(1e-3, None).pair == (1e-3, np.inf)
    assert Tolerances(1e-3, 0.1).pair == (1e-3, 0.1)


def corner(stay: bool = False) -> ToolPath:
    """Two lines, a motion on the spot before them if asked for."""
    places = [T[:3, 3], T[:3, 3] + [0.0, 0.1, 0.0], T[:3, 3] + [0.0, 0.1, -0.1]]
    poses = [transform(T[:3, :3], place) for place in places]
    motions = [line(poses[0], poses[1]), line(poses[1], poses[2])]
    if stay:
        motions.insert(0, line(poses[0], poses[0]))
    checker = Checker.of(ROBOT, Scene())
    return lead_tool(CHAIN, checker, HOME, motions, TOLERANCES, Deadline.after(60.0))


def parametrization(method: str) -> TimeParametrization:
    timing = TimingOptions(method)  # type: ignore[arg-type]
    return chosen_parametrization(timing, CHAIN.joint_names, CHAIN.limits)


def test_waypoints_are_where_the_pieces_meet() -> None:
    path = corner()
    counts = [len(segment.path.lengths) for segment in path.segments if segment.path is not None]
    assert path.waypoints.shape == (sum(counts) + 1, 7)
    np.testing.assert_array_equal(path.waypoints[0], HOME)
    np.testing.assert_array_equal(path.waypoints[-1], path.segments[-1].end)
    assert path.fraction == 1.0
    assert path.stop is None


@pytest.mark.parametrize("method", ["toppra", "jerk_limited", "spline"])
def test_the_tool_rests_at_the_corner_and_keeps_to_its_lines(method: str) -> None:
    path, oracle = corner(), PinocchioPanda()
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
    for (motion, path), part in zip(tight.moving, timed.parts, strict=True):
        assert isinstance(motion, ToolMotion)
        assert part.pieces >= 2 * len(path.lengths)
        _, fine, _ = piece_deviations(
            CHAIN, part.breaks, part.coefficients, motion, tight.tolerances.pair
        )
        assert fine.all()


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
    still = lead_tool(CHAIN, checker, HOME, [line(T, T)], TOLERANCES, Deadline.after(60.0))
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
    part = ToolPath(path.motions, (path.segments[0], cut), 0.625, HERE, TOLERANCES)
    timed = time_tool_path(CHAIN, part, parametrization("toppra"))
    assert [report.fraction for report in timed.reports] == [1.0, 0.25]
    ends: Array = forward(CHAIN, timed.trajectory(CHAIN).end)[:3, 3]
    np.testing.assert_allclose(ends, T[:3, 3] + [0.0, 0.1, -0.025], atol=2e-4)

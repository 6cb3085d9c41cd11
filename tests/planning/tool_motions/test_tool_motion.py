"""Motions of the tool and joint paths that follow them, beside scipy and closed forms."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import BPoly, CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption
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
from planning.tool_motions.timed_tool_motions import TimedToolMotions, joined_spans
from planning.tool_motions.tool_corner import ToolCorner, ToolCurve, rounded_corner
from planning.tool_motions.tool_motion import (
    ToolMotion,
    arc_about,
    arc_via,
    line,
)
from planning.tool_motions.tool_path import Stop, Tolerances, ToolPath, ToolRun, ToolSegment
from planning.tool_motions.tool_tolerance import ToolTolerance, rotations
from planning.tool_paths.tool_deviation import run_errors
from planning.tool_paths.tool_following import lead_tool
from planning.tool_paths.tool_timing import time_tool_path
from planning.values.deadline import Deadline
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin
from tests.planning.tool_boxes import deviations

RANDOM = np.random.default_rng(11)


def random_pose() -> np.ndarray:
    return transform(Rotation.random(random_state=RANDOM).as_matrix(), RANDOM.uniform(-1, 1, 3))


def check_orientation(motion: ToolMotion) -> None:
    """Slerp: at a constant rate about one axis, the shorter way."""
    ends = np.stack([motion.T_start[:3, :3], motion.T_end[:3, :3]])
    slerp = Slerp([0.0, 1.0], Rotation.from_matrix(ends))
    for s in np.linspace(0.0, 1.0, 9):
        error = slerp(s).inv() * Rotation.from_matrix(motion.pose(float(s))[:3, :3])
        assert error.magnitude() < 1e-9


@pytest.mark.parametrize("case", range(20))
def test_a_line_is_straight(case: int) -> None:
    start, end = random_pose(), random_pose()
    motion = line(start, end)
    for s in np.linspace(0.0, 1.0, 9):
        expected = (1.0 - s) * start[:3, 3] + s * end[:3, 3]
        np.testing.assert_allclose(motion.pose(float(s))[:3, 3], expected, atol=1e-12)
    assert motion.length == pytest.approx(np.linalg.norm(end[:3, 3] - start[:3, 3]))
    check_orientation(motion)


@pytest.mark.parametrize("case", range(30))
def test_an_arc_lies_on_its_circle(case: int) -> None:
    """Points of a known circle are put in: the arc goes through them in their order."""
    frame = Rotation.random(random_state=RANDOM).as_matrix()
    center, radius = RANDOM.uniform(-1, 1, 3), float(RANDOM.uniform(0.05, 2.0))

    def at(angle: float) -> np.ndarray:
        return np.asarray(
            center + radius * (np.cos(angle) * frame[:, 0] + np.sin(angle) * frame[:, 1])
        )

    sweep = float(RANDOM.uniform(0.2, 2.0 * np.pi - 0.2))
    middle = float(RANDOM.uniform(0.2, 0.8)) * sweep
    start = transform(Rotation.random(random_state=RANDOM).as_matrix(), at(0.0))
    end = transform(Rotation.random(random_state=RANDOM).as_matrix(), at(sweep))
    motions = [arc_via(start, end, at(middle)), arc_about(start, end, center, 3.0 * frame[:, 2])]
    if sweep < np.pi:
        motions.append(arc_about(start, end, center))
    for motion in motions:
        assert motion.sweep == pytest.approx(sweep, abs=1e-6)
        assert motion.length == pytest.approx(radius * sweep, rel=1e-6)
        for s in np.linspace(0.0, 1.0, 9):
            found = motion.pose(float(s))[:3, 3]
            np.testing.assert_allclose(found, at(float(s) * sweep), atol=1e-6)
        check_orientation(motion)


def test_half_and_whole_circles_need_a_normal() -> None:
    start = transform(None, [1.0, 0.0, 0.0])
    half = arc_about(start, transform(None, [-1.0, 0.0, 0.0]), np.zeros(3), [0, 0, 1])
    np.testing.assert_allclose(half.pose(0.5)[:3, 3], [0.0, 1.0, 0.0], atol=1e-12)
    other = arc_about(start, transform(None, [-1.0, 0.0, 0.0]), np.zeros(3), [0, 0, -1])
    np.testing.assert_allclose(other.pose(0.5)[:3, 3], [0.0, -1.0, 0.0], atol=1e-12)
    whole = arc_about(start, start, np.zeros(3), [0, 0, 1])
    assert whole.sweep == pytest.approx(2.0 * np.pi)
    np.testing.assert_allclose(whole.pose(0.25)[:3, 3], [0.0, 1.0, 0.0], atol=1e-12)
    through = arc_via(start, transform(None, [-1.0, 0.0, 0.0]), [0.0, 0.0, 1.0])
    assert through.sweep == pytest.approx(np.pi)
    np.testing.assert_allclose(through.pose(0.5)[:3, 3], [0.0, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize(
    ("end", "more", "words"),
    [
        ([-1.0, 0.0, 0.0], {"via": [0.2, 0.0, 0.0]}, "lie on one line"),
        ([-1.0, 0.0, 0.0], {"via": [1.0, 0.0, 0.0]}, "lie on one line"),
        ([-1.0, 0.0, 0.0], {"via": [-1.0, 0.0, 0.0]}, "lie on one line"),
        ([-1.0, 0.0, 0.0], {"via": [5.0, 0.0, 1e-9]}, "lie on one line"),
        ([1.0, 0.0, 0.0], {"via": [0.0, 1.0, 0.0]}, "start and end are the same"),
        ([-1.0, 0.0, 0.0], {"center": [0.0, 0.0, 0.0]}, "half a circle"),
        ([1.0, 0.0, 0.0], {"center": [0.0, 0.0, 0.0]}, "a full circle"),
        ([0.0, 2.0, 0.0], {"center": [0.0, 0.0, 0.0]}, "1 m from its center and ends 2 m"),
        ([0.0, 1.0, 0.0], {"center": [1.0, 0.0, 0.0]}, "0 m from its center"),
        ([0.0, 1.0, 0.0], {"center": [0.0, 0.0, 0.0], "normal": [0, 1, 1]}, "off the plane"),
        ([0.0, 1.0, 0.0], {"center": [0.0, 0.0, 0.0], "normal": [0, 0, 0]}, "no direction"),
    ],
)
def test_what_is_no_circle_is_refused_by_name(
    end: list[float], more: dict[str, list[float]], words: str
) -> None:
    start, last = transform(None, [1.0, 0.0, 0.0]), transform(None, end)
    with pytest.raises(InvalidGoal, match=words):
        arc_via(start, last, more["via"]) if "via" in more else arc_about(start, last, **more)


def test_motions_in_time_follow_at_once_or_later() -> None:
    pair = (line(random_pose(), random_pose()), line(random_pose(), random_pose()))
    times = np.array([1.0, 2.0, 4.0])
    at_once = TimedToolMotions(pair, times, 1e-4)
    later = TimedToolMotions(pair, times, 1e-4, begins=np.array([1.0, 2.5]))
    assert [row[1:] for row in at_once.exact] == [(1.0, 2.0), (2.0, 4.0)]
    assert [row[1:] for row in later.exact] == [(1.0, 2.0), (2.5, 4.0)]
    for begins in ([1.0, 1.9], [1.0, 4.1], [0.9, 2.0], [1.0]):
        with pytest.raises(InvalidGoal, match="begins before the one before ends"):
            TimedToolMotions(pair, times, 1e-4, begins=np.array(begins))


def test_spans_that_follow_at_once_are_joined() -> None:
    assert joined_spans([(0.0, 1.0), (1.0, 2.0), (2.5, 3.0)]) == ((0.0, 2.0), (2.5, 3.0))
    assert joined_spans([]) == ()


TURN = Rotation.from_rotvec([0.0, 0.3, 0.4]).as_matrix()
A = transform(None, [0.0, 0.0, 0.0])
B = transform(TURN, [0.3, 0.0, 0.0])
C = transform(TURN, [0.3, 0.2, 0.0])
#: A line of 0.3 m, then half a circle of radius 0.1 m.
RUN = ToolRun((line(A, B), arc_via(B, C, [0.4, 0.1, 0.0])), (3, 4), (False, True))
HALF = 0.1 * np.pi
BREAK = 0.3 / (0.3 + HALF)


def test_places_are_proportional_to_the_length_of_the_whole() -> None:
    assert RUN.length == pytest.approx(0.3 + HALF)
    assert RUN.angle == pytest.approx(0.5)
    np.testing.assert_allclose(RUN.breaks, [0.0, BREAK, 1.0])
    single = ToolRun.of(RUN.motions[1], 7)
    np.testing.assert_array_equal(single.breaks, [0.0, 1.0])
    assert single.asked == (7,)


def test_poses_are_those_of_the_motion_at_the_place() -> None:
    slerp = Slerp([0.0, BREAK], Rotation.from_matrix(np.stack([A[:3, :3], B[:3, :3]])))
    places = np.linspace(0.0, 1.0, 41)
    poses = RUN.poses(places)
    for s, T in zip(places, poses, strict=True):
        if s <= BREAK:
            point, R = [0.3 * s / BREAK, 0.0, 0.0], slerp(s).as_matrix()
        else:
            angle = np.pi * (s - BREAK) / (1.0 - BREAK) - 0.5 * np.pi
            point, R = [0.3 + 0.1 * np.cos(angle), 0.1 + 0.1 * np.sin(angle), 0.0], TURN
        np.testing.assert_allclose(T[:3, 3], point, atol=1e-12)
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-12)
        np.testing.assert_allclose(RUN.pose(float(s)), T, atol=1e-14)


def test_parts_tell_what_was_asked_and_the_box() -> None:
    box = ToolTolerance.of({"x": (-0.1, 0.1)})
    run = ToolRun(RUN.motions, RUN.asked, RUN.blends, (box, ToolTolerance.of({})))
    first, last = run.parts
    assert (first.begin, first.end, first.asked, first.blends) == (0.0, first.end, 3, False)
    assert (last.begin, last.end, last.asked, last.blends) == (first.end, 1.0, 4, True)
    assert first.end == pytest.approx(BREAK)
    assert first.tolerance is box
    assert [part.tolerance for part in RUN.parts] == [None, None]


DRAWS = np.random.default_rng(4)


def poses(count: int) -> np.ndarray:
    turns = Rotation.random(count, DRAWS).as_matrix()
    places = DRAWS.normal(size=(count, 3))
    return np.array([transform(R, p) for R, p in zip(turns, places, strict=True)])


@pytest.mark.parametrize("fixed", [False, True])
def test_deviations_are_those_that_poses_were_made_with(fixed: bool) -> None:
    axes = Rotation.random(random_state=1).as_matrix() if fixed else None
    box = ToolTolerance(
        np.array([-0.5] * 3 + [-1.3] * 3), np.array([0.5] * 3 + [1.3] * 3), axes=axes
    )
    nominal, d = poses(40), DRAWS.uniform(box.lower, box.upper, (40, 6))
    T = box.poses(nominal, d)
    np.testing.assert_allclose(deviations(box, nominal, T), d, atol=1e-9)
    D = Rotation.from_euler("XYZ", d[:, 3:]).as_matrix()
    np.testing.assert_allclose(rotations(d[:, 3:]), D, atol=1e-12)
    for k in range(40):
        N = nominal[k]
        A = N[:3, :3] if axes is None else axes
        np.testing.assert_allclose(T[k, :3, 3], N[:3, 3] + A @ d[k, :3], atol=1e-12)
        np.testing.assert_allclose(T[k, :3, :3], A @ D[k] @ A.T @ N[:3, :3], atol=1e-12)


def test_tolerances_that_make_no_sense_are_refused() -> None:
    for ranges, free, tilt, words in (
        ({"x": (0.1, -0.1)}, (), None, "above"),
        ({"x": (-2.0, 2.0)}, (), None, "at most 1 m"),
        ({}, ("x",), None, "can't be free"),
        ({}, (), -0.1, "above|positive"),
        ({"ry": (-1.5, 1.5)}, (), None, "not defined"),
        ({}, ("ry",), None, "free all"),
    ):
        with pytest.raises(InvalidOption) as caught:
            ToolTolerance.of(ranges, free, tilt)  # type: ignore[arg-type]
        text = f"{caught.value.message} {caught.value.hint}"
        assert any(word in text for word in words.split("|")), text
    assert ToolTolerance.of({}, ("rx", "ry", "rz")).lower[4] == -np.inf


def at(*place: float) -> Array:
    return transform(None, list(place))


def bend(angle: float, distance: float = 0.1) -> ToolCorner:
    """A corner of this angle at (1, 0, 0) between lines of one metre."""
    end = at(1.0 + math.cos(angle), math.sin(angle), 0.0)
    return rounded_corner(line(at(0, 0, 0), at(1, 0, 0)), line(at(1, 0, 0), end), distance)


def random_motions(random: np.random.Generator) -> tuple[ToolMotion, ToolMotion]:
    """Two motions that meet, lines or arcs, with turns of the tool."""
    poses = [
        transform(Rotation.from_rotvec(0.6 * random.normal(size=3)).as_matrix(), place)
        for place in random.normal(size=(3, 3))
    ]
    kinds = random.random(2) < 0.5
    first, second = (
        line(a, b) if straight else arc_via(a, b, random.normal(size=3))
        for straight, a, b in zip(kinds, poses[:-1], poses[1:], strict=True)
    )
    return first, second


def bezier(corner: ToolCorner) -> BPoly:
    """The curve between lines, as scipy has it."""
    p, c, r = (T[:3, 3] for T in (corner.T_start, corner.T_corner, corner.T_end))
    steps = [0.2 * corner.slope, 0.4 * corner.slope]
    points = [p, *(p + s * (c - p) for s in steps), *(r + s * (c - r) for s in steps[::-1]), r]
    return BPoly(np.array(points)[:, None, :], [0.0, 1.0])


@pytest.mark.parametrize("degrees", [0.5, 20.0, 90.0, 150.0, 169.0])
def test_between_lines_it_is_a_bezier_curve_run_through_by_its_length(degrees: float) -> None:
    corner = bend(math.radians(degrees))
    curve = bezier(corner)
    rate = curve.derivative()

    def speed(u: float) -> float:
        return float(np.linalg.norm(rate(u)))

    assert corner.length == pytest.approx(quad(speed, 0.0, 1.0, epsabs=1e-13)[0], rel=1e-10)
    for u in (0.03, 0.21, 0.5, 0.77, 0.99):
        place = quad(speed, 0.0, u, epsabs=1e-13)[0] / corner.length
        np.testing.assert_allclose(corner.pose(place)[:3, 3], curve(u), atol=1e-10)
        np.testing.assert_allclose(corner.direction(place), rate(u) / speed(u), atol=1e-7)


def test_no_part_is_farther_from_the_corner_than_the_blend_begins() -> None:
    random = np.random.default_rng(5)
    for _ in range(100):
        first, second = random_motions(random)
        distance = random.uniform(0.01, 0.5) * min(first.length, second.length)
        corner = rounded_corner(first, second, distance)
        away = corner.poses(np.linspace(0.0, 1.0, 101))[:, :3, 3] - first.T_end[:3, 3]
        assert np.linalg.norm(away, axis=1).max() <= distance * (1.0 + 1e-9)


def derivatives(motion: ToolCurve, s: float, h: float) -> list[Array]:
    """Tangent, curvature, angular velocity and its change by the length at an end, one-sided."""
    step = h / motion.length
    sign = 1.0 if s == 0.0 else -1.0
    T = motion.poses(np.asarray(s + sign * step * np.arange(6.0), dtype=np.float64))
    p = T[:, :3, 3]
    w = Rotation.from_matrix(T[1:, :3, :3] @ T[:-1, :3, :3].transpose(0, 2, 1)).as_rotvec()
    w = sign * w / h
    # One-sided differences of fourth order; angular velocities are those half a step on.
    first = (
        sign * (-25.0 * p[0] + 48.0 * p[1] - 36.0 * p[2] + 16.0 * p[3] - 3.0 * p[4]) / (12.0 * h)
    )
    second = (45.0 * p[0] - 154.0 * p[1] + 214.0 * p[2] - 156.0 * p[3] + 61.0 * p[4]
              - 10.0 * p[5]) / (12.0 * h * h)  # fmt: skip
    rate = (35.0 * w[0] - 35.0 * w[1] + 21.0 * w[2] - 5.0 * w[3]) / 16.0
    change = sign * (-71.0 * w[0] + 141.0 * w[1] - 93.0 * w[2] + 23.0 * w[3]) / (24.0 * h)
    return [first, second, rate, change]


def test_tangent_curvature_and_turning_join_both_motions_without_a_jump() -> None:
    random = np.random.default_rng(8)
    for _ in range(60):
        first, second = random_motions(random)
        distance = 0.4 * min(first.length, second.length)
        corner = rounded_corner(first, second, distance)
        h = 2e-3 * distance
        before, after = corner.first, corner.second
        for one, other, motion in ((corner, before, first), (corner, after, second)):
            s = 0.0 if other is before else 1.0
            mine = derivatives(one, s, h)
            place = 1.0 - distance / first.length if s == 0.0 else distance / second.length
            turn = motion.turn / motion.length
            curvature = (
                np.zeros(3)
                if motion.kind == "lin"
                else np.cross(motion.normal, motion.direction(place)) / motion.radius
            )
            wanted = [motion.direction(place), curvature, turn, np.zeros(3)]
            for value, known, order in zip(mine, wanted, (0, 1, 1, 2), strict=True):
                np.testing.assert_allclose(value * distance**order, known * distance**order,
                                           atol=5e-3)  # fmt: skip


def curvature_change(corner: ToolCorner) -> float:
    """Largest change of curvature by the length [1/m^2]."""
    p = corner.poses(np.linspace(0.0, 1.0, 4001))[:, :2, 3]
    h = corner.length / 4000.0
    t = np.diff(p, axis=0)
    angle = np.unwrap(np.arctan2(t[:, 1], t[:, 0]))
    return float(np.abs(np.diff(angle, 2)).max() / h**2)


@pytest.mark.parametrize("degrees", [5.0, 40.0, 75.0, 110.0, 145.0, 165.0])
def test_curvature_changes_little_faster_than_along_two_clothoids(degrees: float) -> None:
    """A pair of clothoids has the least largest change of curvature between two lines."""
    half = 0.5 * math.radians(degrees)
    # Of a clothoid of length 1 that turns by half of the corner.
    x, y = (quad(lambda s, f=f: f(half * s * s), 0.0, 1.0)[0] for f in (math.cos, math.sin))
    reach = x + y * math.tan(half)
    least = 2.0 * half * (reach / 0.1) ** 2
    assert curvature_change(bend(2.0 * half)) <= 1.2 * least


ROBOT = builtin("panda")
CHAIN = ROBOT.chain
T = forward(CHAIN, HOME)
TOLERANCES = Tolerances(1e-4, 1e-3)
HERE = Stop("collision", "something is in the way", {})


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


@pytest.mark.parametrize("seed", range(20))
def test_a_segment_of_many_pieces_is_cut_however_their_lengths_round(seed: int) -> None:
    random = np.random.default_rng(seed)
    path = JointPath(random.normal(size=(40, 1, 4)), random.uniform(0.01, 0.03, 40))
    whole = ToolSegment(path, path.sample(0.0)[0], path.sample(path.length)[0], path.length, None)
    part = whole.cut(float(random.uniform(0.1, 0.9)) * path.length, HERE)
    assert part.path is not None
    np.testing.assert_allclose(part.end, path.sample(part.reached)[0], atol=1e-12)


def corner(stay: bool = False) -> ToolPath:
    """Two lines, a motion on the spot before them if asked for."""
    places = [T[:3, 3], T[:3, 3] + [0.0, 0.1, 0.0], T[:3, 3] + [0.0, 0.1, -0.1]]
    poses = [transform(T[:3, :3], place) for place in places]
    motions = [line(poses[0], poses[1]), line(poses[1], poses[2])]
    if stay:
        motions.insert(0, line(poses[0], poses[0]))
    checker = Checker.of(ROBOT, Scene())
    runs = [ToolRun.of(motion, k) for k, motion in enumerate(motions)]
    return lead_tool(checker, HOME, runs, TOLERANCES, Deadline.after(60.0))


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
        assert part.pieces >= 2 * len(path.lengths)
        q = part.sample(np.linspace(0.0, part.duration, 1000))
        off = run_errors(CHAIN, run, np.zeros(1000, dtype=np.int64), forward(CHAIN, q), q)
        assert (off <= tight.tolerances.pair).all()


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
    still = lead_tool(checker, HOME, [ToolRun.of(line(T, T))], TOLERANCES, Deadline.after(60.0))
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

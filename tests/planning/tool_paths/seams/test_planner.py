"""Seams: plans with free and tolerant axes against dense samples of pinocchio's kinematics."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.pose import from_axis_angle, transform
from obstacles.scenes.scene import Scene
from planning.options import CartesianOptions, Options
from planning.pipeline import pipeline
from planning.pipeline.path_search import with_reserve
from planning.pipeline.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.proof.certificate import certify
from planning.proof.limits.limit_uses import Violation
from planning.result import Failure, Plan
from planning.timing.options import TimingOptions
from planning.tool_motions.tool_tolerance import (
    Axis,
    SeamOptions,
    SeamWaypoint,
    StraightOffset,
    ToolTolerance,
)
from planning.tool_paths.seams.failure import least_that
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, box, builtin, planning_failure
from tests.planning.tool_boxes import deviations as box_deviations
from tests.planning.tool_boxes import excess

ORACLE = PinocchioArm()
SPEED = 0.1
SPIN = ToolTolerance.of({}, ("rz",), tilt=0.2)
UP, DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])


def on_cylinder(count: int = 60, reach: float = 1.0) -> tuple[SeamWaypoint, ...]:
    """Waypoints on the near side of an upright cylinder, with the tool's z into it."""
    center, radius = np.array([0.75, 0.0, 0.4]), 0.3
    rows = []
    for angle in np.linspace(-reach, reach, count):
        out = np.array([-math.cos(angle), math.sin(angle), 0.0])
        p = center + radius * out + [0.0, 0.0, 0.08 * math.sin(2.0 * angle)]
        R = np.column_stack([UP, np.cross(-out, UP), -out])
        rows.append(SeamWaypoint(transform(R, p)))
    return tuple(rows)


def ask(
    waypoints: tuple[SeamWaypoint, ...],
    tolerance: ToolTolerance = SPIN,
    scene: Scene | None = None,
    start: Any = HOME,
    **more: Any,
) -> Plan | Failure:
    seam = SeamOptions(waypoints, tolerance, tool_speed=SPEED, **more)
    goal = PoseGoal(waypoints[-1].T_base_tip)
    problem = Problem(builtin("panda"), scene or Scene(), start, (goal,))
    how = CartesianOptions(seam=seam)
    return plan(problem, Options(planner="cartesian", cartesian=how, timeout=20.0))


def followed(answer: Plan | Failure) -> Plan:
    assert isinstance(answer, Plan), answer
    assert answer.certificate.verified
    return answer


def deviations(answer: Plan, count: int = 1500) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance [m], tilt and spin [rad] of the tool from a seam's polyline, by pinocchio."""
    parts = [report for report in answer.tool_motions if report.part == "seam"]
    starts, ends = (
        np.array([getattr(part.motion, name) for part in parts]) for name in ("T_start", "T_end")
    )
    ways = ends[:, :3, 3] - starts[:, :3, 3]
    turns = Rotation.from_matrix(ends[:, :3, :3] @ starts[:, :3, :3].mT).as_rotvec()
    times = np.linspace(parts[0].begins, parts[-1].ends, count)
    rows = []
    for q in answer.trajectory.sample(np.minimum(times, answer.trajectory.duration)):
        T = ORACLE.pose(q)
        since = T[:3, 3] - starts[:, :3, 3]
        shares = np.clip((since * ways).sum(axis=1) / (ways**2).sum(axis=1), 0.0, 1.0)
        apart = np.linalg.norm(since - shares[:, None] * ways, axis=1)
        k = int(np.argmin(apart))
        N = Rotation.from_rotvec(shares[k] * turns[k]).as_matrix() @ starts[k, :3, :3]
        D = N.T @ T[:3, :3]
        rows.append((apart[k], math.acos(min(1.0, D[2, 2])), math.atan2(-D[0, 1], D[0, 0])))
    away, tilt, spin = np.array(rows).T
    return away, tilt, spin


def tool_speeds(answer: Plan) -> np.ndarray:
    """Speeds of the tool along a seam by differences of pinocchio's kinematics [m/s]."""
    parts = [report for report in answer.tool_motions if report.part == "seam"]
    times = np.linspace(parts[0].begins, parts[-1].ends, 2001)
    joints = answer.trajectory.sample(np.minimum(times, answer.trajectory.duration))
    points = np.array([ORACLE.pose(q)[:3, 3] for q in joints])
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1) / (times[1] - times[0]))


def with_speeds(waypoints: tuple[SeamWaypoint, ...], speeds: dict[int, float]) -> Any:
    """Waypoints of which some have a speed of their own, from their number on."""
    rows, speed = [], None
    for k, waypoint in enumerate(waypoints):
        speed = speeds.get(k, speed)
        rows.append(replace(waypoint, tool_speed=speed))
    return tuple(rows)


def test_each_part_of_a_seam_has_the_speed_that_is_asked_for_it() -> None:
    waypoints = with_speeds(on_cylinder(), {20: 0.05, 40: 0.14})
    answer = followed(ask(waypoints))
    use = answer.certificate.tool_speed
    assert use is not None
    assert [band.low for band in use.bands] == pytest.approx([0.09, 0.045, 0.126])
    assert [band.high for band in use.bands] == pytest.approx([0.11, 0.055, 0.154])
    assert (use.low, use.high) == (use.bands[1].low, use.bands[2].high)
    assert use.share > 0.9
    for band in use.bands:
        assert band.share > 0.85
        assert band.most <= band.high
    assert sum(band.length for band in use.bands) == pytest.approx(use.length)
    # What the arm does, by pinocchio: part by part no faster than its band, and within it inside.
    parts = [report for report in answer.tool_motions if report.part == "seam"]
    for report in parts:
        asked = waypoints[report.asked + 1].tool_speed or SPEED
        times = np.linspace(report.begins, report.ends, 30)
        joints = answer.trajectory.sample(np.minimum(times, answer.trajectory.duration))
        points = np.array([ORACLE.pose(q)[:3, 3] for q in joints])
        speeds = np.linalg.norm(np.diff(points, axis=0), axis=1) / (times[1] - times[0])
        assert speeds.max() <= 1.1 * asked + 1e-6
        if report.asked in (10, 30, 50):
            assert speeds.min() >= 0.9 * asked


@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_no_part_is_faster_than_its_speed_at_corners_and_stops(method: Any) -> None:
    # A rectangle with a rest at two corners and arcs at the others.
    corners = np.array([[0.5, -0.15], [0.5, 0.15], [0.6, 0.15], [0.6, -0.15], [0.5, -0.14]])
    R = np.diag([1.0, -1.0, -1.0])
    speeds, blends = (None, 0.1, 0.05, 0.15, 0.03), (None, 0.0, 0.03, 0.0, None)
    waypoints = tuple(
        SeamWaypoint(transform(R, [*corner, 0.35]), blend=blend, tool_speed=speed)
        for corner, speed, blend in zip(corners, speeds, blends, strict=True)
    )
    seam = SeamOptions(waypoints, SPIN)
    problem = Problem(builtin("panda"), Scene(), HOME, (PoseGoal(waypoints[-1].T_base_tip),))
    how = CartesianOptions(seam=seam)
    timing = TimingOptions(method)
    answer = followed(plan(problem, Options(planner="cartesian", cartesian=how, timing=timing)))
    use = answer.certificate.tool_speed
    assert use is not None
    assert len(use.bands) == 4
    for band in use.bands:
        assert band.most <= band.high
    if method == "jerk_limited":
        assert min(band.share for band in use.bands) > 0.5


def test_speeds_of_some_ways_only_are_refused() -> None:
    waypoints = with_speeds(on_cylinder(10), {5: 0.1})
    with pytest.raises(InvalidOption, match=r"waypoints\[1\] has no tool_speed") as refused:
        SeamOptions(waypoints, SPIN)
    assert "options" in (refused.value.hint or "")
    assert SeamOptions(waypoints, SPIN, tool_speed=0.2).speeds == (0.2,) * 4 + (0.1,) * 5
    with pytest.raises(InvalidOption, match="positive"):
        SeamWaypoint(np.eye(4), tool_speed=0.0)


def test_a_seam_with_a_free_spin_and_a_tilt_is_followed_at_its_speed() -> None:
    answer = followed(ask(on_cylinder()))
    away, tilt, spin = deviations(answer, 300)
    assert away.max() <= 1.1e-4
    assert tilt.max() <= 0.2 + 1.1e-3
    assert np.ptp(spin) > 0.05
    speed = answer.certificate.tool_speed
    assert speed is not None
    assert speed.share > 0.98
    assert speed.most <= speed.high
    slow = tool_speeds(answer) < 0.9 * SPEED
    # Only a ramp at either end is slower.
    assert np.abs(np.diff(slow.astype(int))).sum() == 2
    use = answer.certificate.tool_box
    assert use is not None
    assert 0.0 < use.share <= 1.0


def test_exact_waypoints_keep_their_orientation() -> None:
    answer = followed(ask(on_cylinder(30, 0.6), ToolTolerance.of({})))
    away, tilt, spin = deviations(answer, 200)
    assert away.max() <= 1.1e-4
    assert max(tilt.max(), np.abs(spin).max()) <= 1.1e-3


def test_approach_and_retreat_are_straight_and_the_way_there_is_free() -> None:
    offset = StraightOffset(UP, 0.05), StraightOffset(DOWN, 0.08)
    answer = followed(ask(on_cylinder(), approach=offset[0], retreat=offset[1]))
    first, *seam, last = answer.tool_motions
    assert (first.part, last.part) == ("approach", "retreat")
    assert {report.part for report in seam} == {"seam"}
    assert (first.length, last.length) == pytest.approx((0.05, 0.08))
    assert first.begins > 0.0
    assert last.ends == pytest.approx(answer.trajectory.duration)
    chain, motion = builtin("panda").chain, answer.trajectory
    np.testing.assert_allclose(motion.start, HOME)
    T = forward(chain, motion.sample([first.begins, first.ends]))
    np.testing.assert_allclose(T[1, :3, 3] - T[0, :3, 3], 0.05 * T[1, :3, 2], atol=2e-4)
    for time in (first.begins, first.ends, last.begins):
        np.testing.assert_allclose(motion.sample([time], 1), 0.0, atol=1e-6)


def test_sharp_corners_are_rests_or_blends() -> None:
    R = from_axis_angle([1.0, 0.0, 0.0], math.pi)
    corners = [[0.4, -0.1, 0.4], [0.4, 0.1, 0.4], [0.55, 0.1, 0.4]]
    points = tuple(SeamWaypoint(transform(R, p)) for p in corners)
    still = followed(ask(points))
    rounded = followed(ask((points[0], SeamWaypoint(points[1].T_base_tip, blend=0.03), points[2])))
    assert [report.blends for report in still.tool_motions] == [False, False]
    assert [report.blends for report in rounded.tool_motions] == [False, True, True, False]
    rest = still.tool_motions[0].ends
    np.testing.assert_allclose(still.trajectory.sample([rest], 1), 0.0, atol=1e-6)
    corner, h = rounded.tool_motions[1].ends, 1e-5
    a, b = (ORACLE.pose(rounded.trajectory.sample([t])[0])[:3, 3] for t in (corner, corner + h))
    assert 0.9 * SPEED <= np.linalg.norm(b - a) / h <= 1.1 * SPEED


def test_a_box_in_fixed_axes_bounds_the_tool_there() -> None:
    yaw = ToolTolerance.of({"rz": (-0.4, 0.4)}, axes=np.eye(3))
    answer = followed(ask(on_cylinder(30, 0.6), yaw))
    for report in answer.tool_motions[1:]:
        T = ORACLE.pose(answer.trajectory.sample([report.begins])[0])
        turn = T[:3, :3] @ report.motion.T_start[:3, :3].T
        assert abs(turn[2, 2] - 1.0) < 1e-5
        assert abs(math.atan2(turn[1, 0], turn[0, 0])) <= 0.4 + 1.1e-3


def test_what_is_in_the_way_is_named_with_its_depth_and_the_waypoint() -> None:
    points = on_cylinder(30)
    wall = box("wall", (0.1, 0.02, 0.1), tuple(points[20].T_base_tip[:3, 3]))
    answer = ask(points, scene=Scene((wall,)))
    assert isinstance(answer, Failure)
    details = answer.details
    assert (answer.code, details["reason"]) == ("PLANNING_FAILED", "collision")
    assert 15 <= details["waypoint"] <= 22
    assert details["depth"] > 0.0
    assert 0.4 < details["fraction"] < 0.8
    assert details["longest"]["from_waypoint"] == 0


def test_a_tolerance_that_would_help_is_named() -> None:
    R = from_axis_angle([1.0, 0.0, 0.0], math.pi)
    turns = [from_axis_angle(UP, angle) @ R for angle in np.linspace(0.0, 6.0, 40)]
    places = [[0.45, y, 0.4] for y in np.linspace(-0.2, 0.2, 40)]
    points = tuple(SeamWaypoint(transform(T, p)) for T, p in zip(turns, places, strict=True))
    answer = ask(points, ToolTolerance.of({}))
    assert isinstance(answer, Failure)
    (spin,) = [one["rz"] for one in answer.details["would_help"] if "rz" in one]
    followed(ask(points, ToolTolerance.of({"rz": spin})))
    # What is told is the least that does, to a fifth.
    narrow = ToolTolerance.of({"rz": (0.6 * spin[0], 0.6 * spin[1])})
    assert isinstance(ask(points, narrow), Failure)


def test_a_seam_out_of_reach_tells_which_tilt_would_do() -> None:
    R = from_axis_angle([1.0, 0.0, 0.0], math.pi)
    places = [[0.74, y, 0.4] for y in np.linspace(-0.15, 0.15, 12)]
    points = tuple(SeamWaypoint(transform(R, place)) for place in places)
    answer = ask(points, ToolTolerance.of({}, ("rz",)))
    assert isinstance(answer, Failure)
    assert answer.details["reason"] in {"unreachable", "branch", "limit"}
    (tilt,) = [one["tilt"] for one in answer.details["would_help"] if "tilt" in one]
    followed(ask(points, ToolTolerance.of({}, ("rz",), tilt=tilt)))


@pytest.mark.parametrize("wanted", [0.012, 0.3, 1.9])
def test_the_least_size_that_suffices_is_found_to_a_fifth(wanted: float) -> None:
    found = least_that(lambda size: size >= wanted, 2.0, 0.01)
    assert found is not None
    assert wanted <= found <= 1.25 * wanted
    assert least_that(lambda size: size >= 3.0, 2.0, 0.01) is None


def test_a_spline_through_the_waypoints_is_followed_and_told() -> None:
    points = on_cylinder(24)
    answer = followed(ask(points, through="spline"))
    assert {report.kind for report in answer.tool_motions if report.part == "seam"} == {"circ"}
    assert any("leaves the lines by" in note for note in answer.notes)


def test_a_proof_that_misses_is_tried_again_with_a_reserve(monkeypatch: pytest.MonkeyPatch) -> None:
    shares: list[float] = []
    reserved: list[Any] = []

    def missing(*args: Any, **asked: Any) -> Any:
        certificate = certify(*args, **asked)
        if reserved:
            return certificate
        assert certificate.tool_box is not None
        shares.append(certificate.tool_box.share)
        beyond = Violation("path_deviation", 0.0, "the tool leaves its tolerance", {})
        return replace(certificate, verified=False, violation=beyond)

    def reserve(planners: Any) -> Any:
        reserved.append(with_reserve(planners))
        return reserved[-1]

    monkeypatch.setattr(pipeline, "certify", missing)
    monkeypatch.setattr(pipeline, "with_reserve", reserve)
    answer = followed(ask(on_cylinder(24, 0.6), ToolTolerance.of({"rz": (-0.2, 0.2)})))
    assert [planner.share for planner in reserved[0]] == [0.6]
    assert answer.certificate.tool_box is not None
    assert answer.certificate.tool_box.share < shares[0]


def test_deadlines_end_the_search() -> None:
    seam = SeamOptions(on_cylinder(200), SPIN, tool_speed=SPEED)
    goal = PoseGoal(seam.waypoints[-1].T_base_tip)
    problem = Problem(builtin("panda"), Scene(), HOME, (goal,))
    how = Options(planner="cartesian", cartesian=CartesianOptions(seam=seam), timeout=0.01)
    answer = planning_failure(problem, how)
    assert answer.code == "TIMED_OUT"


def on_wave(count: int = 40) -> tuple[SeamWaypoint, ...]:
    """Waypoints on a line that swings to either side, with the tool straight down."""
    R = np.diag([1.0, -1.0, -1.0])
    ys = np.linspace(-0.15, 0.15, count)
    return tuple(
        SeamWaypoint(transform(R, [0.48 + 0.03 * math.sin(12.0 * y), y, 0.35])) for y in ys
    )


@pytest.mark.parametrize("axes", [("x",), ("y",), ("x", "y"), ("x", "z")])
@pytest.mark.parametrize("is_arc", [False, True])
def test_ranges_of_position_are_proved_where_the_path_bends(
    axes: tuple[Axis, ...], is_arc: bool
) -> None:
    points = on_wave()
    if is_arc:
        first, middle, last = (points[k].T_base_tip for k in (4, 12, 20))
        points = (SeamWaypoint(first), SeamWaypoint(last, via=middle[:3, 3]))
    box = ToolTolerance.of(dict.fromkeys(axes, (-1e-3, 1e-3)), ("rz",), tilt=0.1)
    answer = followed(ask(points, box))
    worst = 0.0
    wide = box.widened(1e-4, 1e-3)
    for report in answer.tool_motions:
        if report.part != "seam":
            continue
        times = np.linspace(report.begins, min(report.ends, answer.trajectory.duration), 12)
        T = np.array([ORACLE.pose(q) for q in answer.trajectory.sample(times)])
        # The nearest of many places on the motion; between two of them it is off by little.
        places = report.motion.poses(np.linspace(0.0, 1.0, 2001 if is_arc else 201))
        away = np.linalg.norm(T[:, None, :3, 3] - places[None, :, :3, 3], axis=2)
        nominal = places[away.argmin(axis=1)]
        worst = max(worst, float(excess(wide, box_deviations(wide, nominal, T))[:, 0].max()))
    assert worst <= 5e-5


def test_a_range_along_a_bend_that_leaves_out_the_path_is_refused_with_advice() -> None:
    points = on_wave()
    first, middle, last = (points[k].T_base_tip for k in (4, 12, 20))
    arc = SeamWaypoint(first), SeamWaypoint(last, via=middle[:3, 3])
    answer = ask(arc, ToolTolerance.of({"x": (5e-4, 1e-3)}, ("rz",), tilt=0.1))
    assert isinstance(answer, Failure)
    assert (answer.code, answer.details["reason"]) == ("PLANNING_FAILED", "deviation")
    assert "leave out 0" in answer.hint


@pytest.mark.parametrize("seed", range(4))
def test_axes_that_are_asked_for_alone_are_kept_near_the_great_circle(seed: int) -> None:
    random = np.random.default_rng(seed)
    tilt, places, outs = 0.03, [], []
    for y in np.linspace(-0.15, 0.15, 4):
        places.append(np.array([0.5, y, 0.35]) + random.uniform(-0.04, 0.04, 3) * [1.0, 0.0, 1.0])
        out = UP + random.uniform(-0.35, 0.35, 3)
        outs.append(out / np.linalg.norm(out))
    waypoints = tuple(
        SeamWaypoint(transform(_frame(-out, place - places[0] + UP), place), axis_only=True)
        for place, out in zip(places, outs, strict=True)
    )
    answer = followed(ask(waypoints, ToolTolerance.of({}, ("rz",), tilt=tilt)))
    assert not answer.notes
    parts = [report for report in answer.tool_motions if report.part == "seam"]
    for part in parts:
        start, end = places[part.asked], places[part.asked + 1]
        way, turned = end - start, np.cross(-outs[part.asked], -outs[part.asked + 1])
        angle = math.asin(float(np.linalg.norm(turned)))
        for q in answer.trajectory.sample(np.linspace(part.begins, part.ends, 60)):
            T = ORACLE.pose(q)
            share = float(np.clip((T[:3, 3] - start) @ way / (way @ way), 0.0, 1.0))
            turn = Rotation.from_rotvec(share * angle * turned / np.linalg.norm(turned))
            axis = turn.apply(-outs[part.asked])
            assert math.acos(min(1.0, float(axis @ T[:3, 2]))) <= tilt + 1e-3 + 1e-6


def _frame(z: np.ndarray, along: np.ndarray) -> np.ndarray:
    """A frame whose axis z is given, with x near a direction."""
    x = along - (along @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])

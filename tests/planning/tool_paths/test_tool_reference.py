"""References of tool motions, paths that follow them and their speed, beside pinocchio."""

import itertools
import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import from_axis_angle, transform
from obstacles.scenes.scene import Scene
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.problem import PoseGoal, Problem
from planning.result import Plan
from planning.timing.options import TimingOptions
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_corner import ToolCurve, rounded_corner
from planning.tool_motions.tool_motion import ToolMotion, arc_via, line
from planning.tool_motions.tool_path import Tolerances, ToolRun
from planning.tool_paths.blending import runs
from planning.tool_paths.planner import INSTANTS, tool_reference
from planning.tool_paths.tool_deviation import pieces_within, places_at, run_errors
from planning.tool_paths.tool_following import follow
from planning.values.deadline import Deadline
from tests.planning.dense import worst_ratio
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin, planned_motion

#: What the motions may deviate by [m], [rad].
AWAY, TURNED = 1e-4, 1e-3


def mixed_motions(seed: int, blend: float) -> Plan:
    """A line, an arc and a line, each with a turn of the tool, with its corners rounded or not."""
    random = np.random.default_rng(seed)
    T, motions = forward(builtin("panda").chain, HOME), []
    for k, step in enumerate(([0.05, 0.08, 0.0], [0.0, 0.08, -0.08], [-0.05, 0.05, 0.0])):
        axis = random.normal(size=3)
        R = from_axis_angle(axis / np.linalg.norm(axis), random.uniform(0.05, 0.3))
        end = transform(R @ T[:3, :3], T[:3, 3] + np.array(step) + random.uniform(-0.01, 0.01, 3))
        via = None
        if k == 1:
            via = (0.5 * (T[:3, 3] + end[:3, 3]) + [0.02, 0.0, 0.0]).tolist()
        motions.append(ToolMotionOptions("lin" if k != 1 else "circ", end, via))
        T = end
    how = CartesianOptions(
        motions=tuple(motions), blend=blend, max_deviation=AWAY, max_orientation_deviation=TURNED
    )
    problem = Problem(builtin("panda"), Scene(), HOME, (PoseGoal(T),))
    return planned_motion(problem, Options(planner="cartesian", cartesian=how, timeout=30.0))


@pytest.mark.parametrize("blend", [0.0, 0.02])
@pytest.mark.parametrize("seed", range(3))
def test_the_tool_is_within_its_deviation_of_the_reference(seed: int, blend: float) -> None:
    answer = mixed_motions(seed, blend)
    found = tool_reference(builtin("panda").chain, answer.trajectory, answer.tool_motions, seed)
    assert len(found) == INSTANTS
    assert {one.motion for one in found} >= {0, len(answer.tool_motions) - 1}
    assert [one.time for one in found] == sorted(one.time for one in found)
    oracle = PinocchioArm()
    for one in found:
        report = answer.tool_motions[one.motion]
        assert report.begins <= one.time <= report.ends
        T = oracle.pose(answer.trajectory.sample([one.time])[0])
        assert np.linalg.norm(T[:3, 3] - one.T[:3, 3]) <= AWAY
        turn = Rotation.from_matrix(T[:3, :3] @ one.T[:3, :3].T)
        assert turn.magnitude() <= TURNED


def test_the_draw_goes_by_the_seed() -> None:
    answer, chain = mixed_motions(0, 0.02), builtin("panda").chain
    draws = [
        [one.time for one in tool_reference(chain, answer.trajectory, answer.tool_motions, seed)]
        for seed in (1, 1, 2)
    ]
    assert draws[0] == draws[1] != draws[2]
    assert tool_reference(chain, answer.trajectory, (), 1) == ()


@pytest.mark.parametrize("place", [0.0, 0.2, 0.9, 1.0])
def test_a_place_on_any_motion_is_found_again(place: float) -> None:
    answer = mixed_motions(1, 0.02)
    assert {report.kind for report in answer.tool_motions} == {"lin", "circ", "corner"}
    for report in answer.tool_motions:
        (found,) = places_at(report.motion, report.motion.pose(place)[None])
        assert found == pytest.approx(place, abs=1e-6)


def at(*place: float) -> np.ndarray:
    return transform(None, list(place))


def bend(angle: float) -> tuple[ToolMotion, ToolMotion]:
    """Two lines of one metre with a corner of this angle at (1, 0, 0)."""
    end = at(1.0 + math.cos(angle), math.sin(angle), 0.0)
    return line(at(0, 0, 0), at(1, 0, 0)), line(at(1, 0, 0), end)


def check_smooth(run: ToolRun) -> None:
    """Each motion begins where the one before ends, in its direction and orientation."""
    for one, other in zip(run.motions[:-1], run.motions[1:], strict=True):
        np.testing.assert_allclose(one.pose(1.0), other.pose(0.0), atol=1e-9)
        np.testing.assert_allclose(one.direction(1.0), other.direction(0.0), atol=1e-7)


@pytest.mark.parametrize("angle", [0.05, 0.7, math.pi / 2, 2.5])
def test_lines_are_joined_by_the_circle_that_touches_both(angle: float) -> None:
    (run,) = runs(bend(angle), [0.1, 0.0], arcs=True)
    check_smooth(run)
    first, *arcs, last = run.motions
    radius = 0.1 / math.tan(0.5 * angle)
    for arc in arcs:
        assert isinstance(arc, ToolMotion)
        assert arc.radius == pytest.approx(radius)
        np.testing.assert_allclose(arc.center, [0.9, radius, 0.0], atol=1e-9)
        assert arc.sweep == pytest.approx(0.5 * angle)
    assert (first.length, last.length) == pytest.approx((0.9, 0.9))
    assert (run.asked, run.blends) == ((0, 0, 0, 1), (False, True, True, False))
    assert run.length == pytest.approx(1.8 + radius * angle)


@pytest.mark.parametrize("arcs", [False, True])
def test_random_corners_of_lines_and_arcs_are_smooth(arcs: bool) -> None:
    random = np.random.default_rng(3)
    for _ in range(60):
        poses = [
            transform(from_axis_angle(axis / np.linalg.norm(axis), random.uniform(0.0, 1.5)), place)
            for axis, place in zip(
                random.normal(size=(5, 3)), random.normal(size=(5, 3)), strict=True
            )
        ]
        motions = [
            line(a, b) if random.random() < 0.5 else arc_via(a, b, random.normal(size=3))
            for a, b in itertools.pairwise(poses)
        ]
        blend = random.uniform(0.01, 0.5)
        found = runs(motions, [blend] * 4, arcs=arcs)
        for run in found:
            check_smooth(run)
            for part in run.parts:
                # No part of a blend is farther from its corner than its ends are along the way.
                corner = motions[part.asked].T_end[:3, 3]
                if part.blends:
                    away = [part.motion.pose(s)[:3, 3] - corner for s in np.linspace(0, 1, 9)]
                    assert np.linalg.norm(away, axis=1).max() <= blend * (1.0 + 1e-9)
        np.testing.assert_allclose(found[0].pose(0.0), poses[0], atol=1e-12)
        np.testing.assert_allclose(found[-1].pose(1.0), poses[-1], atol=1e-9)


def test_at_most_half_of_a_motion_is_cut() -> None:
    a, b = bend(1.0)
    third = line(b.T_end, transform(None, b.T_end[:3, 3] + [0.0, 0.0, 0.1]))
    (run,) = runs([a, b, third], [5.0, 5.0, 5.0])
    check_smooth(run)
    assert run.motions[-1].length == pytest.approx(0.05)
    assert run.motions[0].length == pytest.approx(0.5)


def test_the_tool_rests_at_reversals_turns_on_the_spot_and_where_no_blend_is_asked_for() -> None:
    a, b = bend(1.0)
    assert [run.motions for run in runs([a, b], [0.0, 0.1])] == [(a,), (b,)]
    back = line(a.T_end, a.T_start)
    assert [run.motions for run in runs([a, back], [0.1, 0.1])] == [(a,), (back,)]
    turned = transform(from_axis_angle([0, 0, 1], 1.0), a.T_end[:3, 3])
    spot, onward = line(a.T_end, turned), line(turned, at(1, 1, 0))
    assert len(runs([a, spot, onward], [0.1] * 3)) == 3
    straight = line(a.T_end, at(2, 0, 0))
    (run,) = runs([a, straight], [0.1, 0.1])
    assert run.motions == (a, straight)


def test_motions_that_go_on_in_each_other_are_blended_where_curvature_or_turning_jumps() -> None:
    a, _ = bend(1.0)
    straight = line(a.T_end, at(2, 0, 0))
    onward = arc_via(a.T_end, at(2, 1, 0), [1.0 + math.sin(0.5), 1.0 - math.cos(0.5), 0.0])
    turning = line(a.T_end, transform(from_axis_angle([0, 0, 1], 0.5), [2, 0, 0]))
    assert [len(runs([a, b], [0.1, 0.1])[0].motions) for b in (straight, onward, turning)] == [
        2, 3, 3,
    ]  # fmt: skip


ORACLE = PinocchioArm()
CHAIN = ORACLE.chain
T = forward(CHAIN, HOME)
TOLERANCES = Tolerances(1e-4, 1e-3)


def shifted(*shift: float) -> Array:
    return transform(T[:3, :3], T[:3, 3] + shift)


LINE = line(T, shifted(0.05, 0.2, -0.1))
TURNING = line(T, transform(Rotation.from_rotvec([0.1, 0.2, 0.4]).as_matrix() @ T[:3, :3],
                            T[:3, 3] + [0.0, 0.15, 0.05]))  # fmt: skip
ARC = arc_via(T, shifted(0.1, 0.1, 0.0), T[:3, 3] + [0.03, 0.07, 0.0])
#: Between lines, the tool turned on the second one; and from an arc to a line.
SHORT = line(T, shifted(0.02, 0.03, -0.02))
CORNER = rounded_corner(SHORT, line(SHORT.T_end, TURNING.T_end), SHORT.length)
BOW = arc_via(T, shifted(0.02, 0.04, 0.0), T[:3, 3] + [0.02, 0.02, 0.0])
BENT = rounded_corner(BOW, line(BOW.T_end, TURNING.T_end), BOW.length)


def led(motion: ToolCurve) -> JointPath:
    run = ToolRun((motion,), (0,), (False,))
    segment = follow(CHAIN, run, HOME, TOLERANCES, Deadline.after(60.0))
    assert segment.path is not None
    assert segment.stop is None
    return segment.path


def within(
    motion: ToolCurve, path: JointPath, tolerances: tuple[float, float]
) -> NDArray[np.bool_]:
    """Whether each piece of a path keeps to a motion."""
    run = ToolRun((motion,), (0,), (False,))
    places = path.breaks / path.length
    return pieces_within(CHAIN, run, places, path.breaks, path.coefficients, tolerances)


@pytest.mark.parametrize(
    "motion",
    [LINE, TURNING, ARC, CORNER, BENT],
    ids=["line", "turning", "arc", "corner", "bent"],
)
def test_a_path_that_follows_is_within_and_as_far_off_as_pinocchio_finds(
    motion: ToolCurve,
) -> None:
    path = led(motion)
    assert within(motion, path, TOLERANCES.pair).all()
    # Beside the motion by far more than the grid of places leaves open.
    aside = path.sample(np.linspace(0.0, path.length, 60)) + 2e-3
    nominal = motion.poses(np.linspace(0.0, 1.0, 4001))
    owners = np.zeros(len(aside), dtype=np.int64)
    found = run_errors(CHAIN, ToolRun.of(motion), owners, forward(CHAIN, aside), aside)
    for q, (position, orientation) in zip(aside, found, strict=True):
        pose = ORACLE.pose(q)
        gaps = np.linalg.norm(nominal[:, :3, 3] - pose[:3, 3], axis=1)
        nearest = nominal[int(np.argmin(gaps))]
        turn = Rotation.from_matrix(nearest[:3, :3].T @ pose[:3, :3])
        assert position == pytest.approx(float(gaps.min()), abs=2e-6)
        assert orientation == pytest.approx(turn.magnitude(), abs=4e-4 * motion.angle + 1e-9)


@pytest.mark.parametrize("aside", [5e-4, 1e-3, 0.01])
def test_a_path_that_strays_is_refused_where_it_does(aside: float) -> None:
    """Joint 1 swings aside in the middle of one piece and comes back."""
    path = led(LINE)
    piece = len(path.lengths) // 2
    size = path.coefficients.shape[2]
    c = np.zeros((len(path.lengths), 7, max(size, 5)))
    c[:, :, :size] = path.coefficients
    u = path.lengths[piece]
    # 16 w^2 (1 - w)^2 of the piece, in powers of its own parameter.
    c[piece, 0, 2:5] += 16.0 * aside * np.array([1.0, -2.0, 1.0]) / u ** np.arange(2, 5)
    keeps = within(LINE, JointPath(c, path.lengths), TOLERANCES.pair)
    assert keeps.tolist() == [k != piece for k in range(len(keeps))]


def test_a_turn_on_the_spot_is_measured_about_its_axis() -> None:
    axis = np.array([0.6, 0.0, 0.8])
    spot = line(T, transform(Rotation.from_rotvec(3.0 * axis).as_matrix() @ T[:3, :3], T[:3, 3]))
    poses = spot.poses(np.linspace(0.0, 1.0, 20))
    places = np.linspace(0.0, 1.0, 20)
    np.testing.assert_allclose(places_at(spot, poses), places, atol=1e-12)
    poses[:, :3, :3] = Rotation.from_rotvec([0.0, 2e-3, 0.0]).as_matrix() @ poses[:, :3, :3]
    poses[:, :3, 3] += [0.0, 0.0, 1e-3]
    # A turn across the axis and a shift leave the place on the turn as it is, to first order.
    np.testing.assert_allclose(places_at(spot, poses), places, atol=1e-5)


def test_the_parameter_may_be_time_or_any_other() -> None:
    path, run = led(ARC), ToolRun((ARC,), (0,), (False,))
    scaled = path.coefficients / 3.0 ** np.arange(path.coefficients.shape[2])
    for allowed in (TOLERANCES.pair, (1e-9, 1e-9)):
        three = pieces_within(CHAIN, run, path.breaks, 3.0 * path.breaks, scaled, allowed)
        np.testing.assert_array_equal(within(ARC, path, allowed), three)


NARROW = Tolerances(1e-5, 1e-4)


def test_the_path_is_smooth_without_jumps_and_within_the_tolerances() -> None:
    end = shifted(0.05, 0.3, -0.1)
    segment = follow(CHAIN, ToolRun.of(line(T, end)), HOME, NARROW, Deadline.after(30.0))
    path = segment.path
    assert path is not None
    assert (segment.stop, segment.reached) == (None, 1.0)
    np.testing.assert_array_equal(segment.start, HOME)
    way = end[:3, 3] - T[:3, 3]
    joints = path.sample(np.linspace(0.0, path.length, 300))
    for q in joints:
        M = ORACLE.pose(q)
        off = M[:3, 3] - T[:3, 3]
        off = off - way * (off @ way) / (way @ way)
        assert np.linalg.norm(off) <= 1e-5
        assert np.linalg.norm(pin.log3(T[:3, :3].T @ M[:3, :3])) <= 1e-4
    places = path.breaks[1:-1]
    for order in (0, 1, 2):
        before, after = path.sample(places - 1e-9, order), path.sample(places + 1e-9, order)
        np.testing.assert_allclose(before, after, atol=1e-4)
    assert np.abs(np.diff(joints, axis=0)).max() < 0.05


def test_time_is_a_reason_too() -> None:
    segment = follow(
        CHAIN, ToolRun.of(line(T, shifted(1.5, 0.0, 0.0))), HOME, NARROW, Deadline.after(0.0)
    )
    assert segment.stop is not None
    assert segment.stop.reason == "time"


STARTS = {
    "panda": HOME,
    "ur5e": np.array([0.3, -1.4, 1.8, -1.9, -1.5, 0.2]),
    "kr6_sixx": np.array([0.1, -1.2, 1.6, 0.2, 0.9, 0.0]),
    "iiwa14": np.array([0.2, 0.6, 0.1, -1.5, 0.1, 0.9, 0.0]),
}


def way(name: str, shifts: list[list[float]], turn: float = 0.0) -> tuple[ToolMotionOptions, ...]:
    """Lines through places relative to the start's, the tool turned a little more in each."""
    T = forward(builtin(name).chain, STARTS[name])
    return tuple(
        ToolMotionOptions(
            "lin",
            transform(from_axis_angle([0.6, 0.0, 0.8], k * turn) @ T[:3, :3], T[:3, 3] + shift),
        )
        for k, shift in enumerate(shifts, start=1)
    )


def tool_speed_limits_led(
    name: str,
    ways: tuple[ToolMotionOptions, ...],
    speed: float,
    blend: float,
    method: Any = "jerk_limited",
) -> Plan:
    asked = CartesianOptions(motions=ways, blend=blend)
    problem = Problem(builtin(name), Scene(), STARTS[name], (PoseGoal(ways[-1].T_base_tip),))
    timing = TimingOptions(method, tool_speed=speed)
    options = Options(planner="cartesian", cartesian=asked, timing=timing, timeout=60.0)
    answer = planned_motion(problem, options)
    assert answer.certificate.verified
    return answer


@pytest.mark.parametrize(
    ("name", "method"), [*((name, "jerk_limited") for name in STARTS), ("panda", "toppra")]
)
def test_the_tool_keeps_its_speed_through_sharp_flat_and_touching_corners(
    name: str, method: str
) -> None:
    # A right angle, a corner of 3 degrees, one of 135 degrees, and two blends that touch.
    shifts = [
        [0.0, 0.1, 0.0], [0.0, 0.1, -0.1], [0.0, 0.105, -0.2], [0.05, 0.105, -0.15],
        [0.05, 0.065, -0.15], [0.05, 0.065, -0.05],
    ]  # fmt: skip
    answer = tool_speed_limits_led(name, way(name, shifts, 0.05), 0.05, 0.03, method)
    motion, reports = answer.trajectory, answer.tool_motions
    assert [one.kind for one in reports].count("corner") == 5
    assert [one.speed_limit for one in reports] == [None] * len(reports)
    times = np.linspace(0.0, motion.duration, 3001)
    found = PinocchioArm(name).tip_speeds(motion, times) / 0.05
    assert found.max() <= 1.0 + 1e-9
    steady = np.flatnonzero(found >= 0.99)
    assert np.ptp(steady) == len(steady) - 1
    # What is left are the ramps from rest and to rest: a tenth of a second or two each.
    assert times[steady[0]] < 0.2
    assert motion.duration - times[steady[-1]] < 0.2


def test_the_joint_that_slows_the_tool_down_is_told() -> None:
    """The tool turns by much within a short line: some joint has to turn too fast for it."""
    ways = way("ur5e", [[0.0, 0.1, 0.0], [0.0, 0.1, -0.02], [0.0, 0.0, -0.02]])
    T = np.array(ways[1].T_base_tip)
    T[:3, :3] = from_axis_angle([0.0, 1.0, 0.0], 0.5) @ T[:3, :3]
    last = transform(T[:3, :3], np.array(ways[2].T_base_tip)[:3, 3])
    ways = (ways[0], ToolMotionOptions("lin", T), ToolMotionOptions("lin", last))
    answer = tool_speed_limits_led("ur5e", ways, 0.2, 0.03)
    slow = [one for one in answer.tool_motions if one.speed_limit is not None]
    assert slow
    chain, motion = builtin("ur5e").chain, answer.trajectory
    for one in slow:
        limit = one.speed_limit
        assert limit is not None
        assert limit.speed < 0.2
        assert limit.joint in chain.joint_names
        times = np.linspace(one.begins, one.ends, 201)
        found = PinocchioArm("ur5e").tip_speeds(motion, times)
        assert found.min() < 0.99 * 0.2
    slowest = min(slow, key=lambda one: one.speed_limit.speed if one.speed_limit else np.inf)
    assert slowest.speed_limit is not None
    # At half of the least speed that is told, nothing is in the way any more.
    easy = tool_speed_limits_led("ur5e", ways, 0.5 * slowest.speed_limit.speed, 0.03)
    assert all(one.speed_limit is None for one in easy.tool_motions)


SPLINE_STARTS = {"panda": HOME, "ur5e": np.array([0.0, -1.2, 1.4, -1.0, -1.5, 0.4])}


def stepped(
    name: str, step: list[float], timing: TimingOptions | None = None
) -> tuple[Plan, Array]:
    """A plan that leads the tool by a step, and its first and last place, shape (2, 3)."""
    robot, start = builtin(name), SPLINE_STARTS[name]
    T = forward(robot.chain, start).copy()
    ends = np.array([T[:3, 3], T[:3, 3] + step])
    T[:3, 3] = ends[1]
    problem = Problem(robot, Scene(()), start, (PoseGoal(T),))
    options = Options(
        planner="cartesian", timeout=60.0, timing=timing or TimingOptions(),
        cartesian=CartesianOptions(max_deviation=1e-4),
    )  # fmt: skip
    answer = planned_motion(problem, options)
    return answer, ends


@pytest.mark.parametrize("name", SPLINE_STARTS)
@pytest.mark.parametrize("step", [[0.0, 0.0, 0.05], [0.0, 0.2, 0.1], [0.1, -0.3, -0.2]])
def test_a_line_has_few_pieces_and_the_tool_keeps_to_it(name: str, step: list[float]) -> None:
    answer, (begin, end) = stepped(name, step)
    motion = answer.trajectory
    assert len(motion.coefficients) <= 20
    assert answer.certificate.verified
    assert worst_ratio(motion, builtin(name)) <= 1.0 + 1e-9
    oracle = PinocchioArm(name)
    along, worst = (end - begin) / np.linalg.norm(end - begin), 0.0
    for q in motion.sample(np.linspace(0.0, motion.duration, 1500)):
        away = oracle.pose(q)[:3, 3] - begin
        worst = max(worst, float(np.linalg.norm(away - (away @ along) * along)))
    assert worst <= 1e-4
    assert answer.certificate.path_deviation is not None
    assert worst <= answer.certificate.path_deviation.position + 1e-12
    np.testing.assert_allclose(
        motion.derivative(1).sample(np.array([0.0, motion.duration])), 0.0, atol=1e-9
    )
    slower = stepped(name, step, TimingOptions(method="jerk_limited", solver="interior_point"))[0]
    assert len(slower.trajectory.coefficients) > 60
    assert motion.duration <= 1.1 * slower.trajectory.duration

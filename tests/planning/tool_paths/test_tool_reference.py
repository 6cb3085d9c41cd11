"""References of tool motions and rounded corners, beside closed forms and pinocchio."""

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.forward import forward
from kinematics.pose import from_axis_angle, transform
from obstacles.scenes.scene import Scene
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.problem import PoseGoal, Problem
from planning.result import Plan
from planning.timing.options import TimingOptions
from planning.tool_motions.tool_corner import ToolCorner, ToolCurve
from planning.tool_motions.tool_motion import ToolMotion, arc_via, line
from planning.tool_motions.tool_path import ToolRun
from planning.tool_paths.blending import runs
from planning.tool_paths.motions import INSTANTS, tool_reference
from planning.tool_paths.tool_deviation import places_at
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


SPEED = 0.1


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


def distance(motion: ToolCurve, p: np.ndarray) -> float:
    """Distance of a point from the line, circle or corner of a motion [m]."""
    if isinstance(motion, ToolCorner):
        points = motion.poses(np.linspace(0.0, 1.0, 2001))[:, :3, 3]
        return float(np.linalg.norm(points - p, axis=1).min())
    if motion.kind == "lin":
        away = p - motion.T_start[:3, 3]
        return float(np.linalg.norm(np.cross(away, motion.direction(0.0))))
    spoke = p - motion.center
    height = float(spoke @ motion.normal)
    return math.hypot(np.linalg.norm(spoke - height * motion.normal) - motion.radius, height)


def test_motions_that_go_on_in_each_other_are_blended_where_curvature_or_turning_jumps() -> None:
    a, _ = bend(1.0)
    straight = line(a.T_end, at(2, 0, 0))
    onward = arc_via(a.T_end, at(2, 1, 0), [1.0 + math.sin(0.5), 1.0 - math.cos(0.5), 0.0])
    turning = line(a.T_end, transform(from_axis_angle([0, 0, 1], 0.5), [2, 0, 0]))
    assert [len(runs([a, b], [0.1, 0.1])[0].motions) for b in (straight, onward, turning)] == [
        2, 3, 3,
    ]  # fmt: skip


@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_the_tool_runs_through_rounded_corners_at_its_speed(method: str) -> None:
    robot, oracle = builtin("panda"), PinocchioArm()
    T = forward(robot.chain, HOME)
    places = [[0.0, 0.2, 0.0], [0.0, 0.2, -0.2], [0.0, 0.0, -0.2]]
    ways = tuple(ToolMotionOptions("lin", transform(T[:3, :3], T[:3, 3] + p)) for p in places)
    asked = CartesianOptions(motions=ways, blend=0.03)
    problem = Problem(robot, Scene(), HOME, (PoseGoal(ways[-1].T_base_tip),))
    timing = TimingOptions(method, tool_speed=SPEED)  # type: ignore[arg-type]
    answer = planned_motion(
        problem, Options(planner="cartesian", cartesian=asked, timing=timing, timeout=30)
    )
    assert answer.certificate.verified
    motion, reports = answer.trajectory, answer.tool_motions
    assert [report.blends for report in reports].count(True) == 2
    assert all(report.speed_limit is None for report in reports)
    assert reports[-1].ends == pytest.approx(motion.duration)
    assert answer.fraction == 1.0
    h = 1e-5
    for report in reports:
        for time in np.linspace(report.begins + 0.01, report.ends - 0.01, 25):
            p, later = (oracle.pose(motion.sample([t])[0])[:3, 3] for t in (time, time + h))
            assert distance(report.motion, p) <= asked.max_deviation
            if report.blends:
                assert 0.99 * SPEED <= np.linalg.norm(later - p) / h <= SPEED * (1.0 + 1e-6)

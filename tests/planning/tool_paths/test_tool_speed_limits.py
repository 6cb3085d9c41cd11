"""Speed of the tool through rounded corners, and splines of few pieces near its motions."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import from_axis_angle, transform
from obstacles.scenes.scene import Scene
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.problem import PoseGoal, Problem
from planning.result import Plan
from planning.timing.options import TimingOptions
from tests.planning.dense import worst_ratio
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin, planned_motion

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


def led(name: str, ways: tuple[ToolMotionOptions, ...], speed: float, blend: float) -> Plan:
    asked = CartesianOptions(motions=ways, blend=blend)
    problem = Problem(builtin(name), Scene(), STARTS[name], (PoseGoal(ways[-1].T_base_tip),))
    timing = TimingOptions("jerk_limited", tool_speed=speed)
    options = Options(planner="cartesian", cartesian=asked, timing=timing, timeout=60.0)
    answer = planned_motion(problem, options)
    assert answer.certificate.verified
    return answer


@pytest.mark.parametrize("name", list(STARTS))
def test_the_tool_keeps_its_speed_through_sharp_flat_and_touching_corners(name: str) -> None:
    # A right angle, a corner of 3 degrees, one of 135 degrees, and two blends that touch.
    shifts = [
        [0.0, 0.1, 0.0], [0.0, 0.1, -0.1], [0.0, 0.105, -0.2], [0.05, 0.105, -0.15],
        [0.05, 0.065, -0.15], [0.05, 0.065, -0.05],
    ]  # fmt: skip
    answer = led(name, way(name, shifts, 0.05), 0.05, 0.03)
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
    answer = led("ur5e", ways, 0.2, 0.03)
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
    easy = led("ur5e", ways, 0.5 * slowest.speed_limit.speed, 0.03)
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

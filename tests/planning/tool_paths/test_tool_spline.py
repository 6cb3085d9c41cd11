"""Splines of few pieces near motions of the tool: exact limits, and the tool within tolerances."""

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.robots import builtin_urdf
from obstacles.scenes.scene import Scene
from planning.options import CartesianOptions, Options
from planning.pipeline.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.result import Plan
from planning.timing.options import TimingOptions
from tests.planning.dense import worst_ratio
from tests.planning.scenes import HOME, builtin

STARTS = {"panda": HOME, "ur5e": np.array([0.0, -1.2, 1.4, -1.0, -1.5, 0.4])}


def led(name: str, step: list[float], timing: TimingOptions | None = None) -> tuple[Plan, Array]:
    """A plan that leads the tool by a step, and its first and last place, shape (2, 3)."""
    robot, start = builtin(name), STARTS[name]
    T = forward(robot.chain, start).copy()
    ends = np.array([T[:3, 3], T[:3, 3] + step])
    T[:3, 3] = ends[1]
    problem = Problem(robot, Scene(()), start, (PoseGoal(T),))
    options = Options(
        planner="cartesian", timeout=60.0, timing=timing or TimingOptions(),
        cartesian=CartesianOptions(max_deviation=1e-4),
    )  # fmt: skip
    answer = plan(problem, options)
    assert isinstance(answer, Plan), answer
    return answer, ends


@pytest.mark.parametrize("name", STARTS)
@pytest.mark.parametrize("step", [[0.0, 0.0, 0.05], [0.0, 0.2, 0.1], [0.1, -0.3, -0.2]])
def test_a_line_has_few_pieces_and_the_tool_keeps_to_it(name: str, step: list[float]) -> None:
    answer, (begin, end) = led(name, step)
    motion = answer.trajectory
    assert len(motion.coefficients) <= 20
    assert answer.certificate.verified
    assert worst_ratio(motion, builtin(name)) <= 1.0 + 1e-9
    model = pin.buildModelFromXML(builtin_urdf(name))
    data, frame = model.createData(), model.getFrameId(builtin(name).chain.tip_link)
    along, worst = (end - begin) / np.linalg.norm(end - begin), 0.0
    for q in motion.sample(np.linspace(0.0, motion.duration, 1500)):
        pin.framesForwardKinematics(model, data, np.concatenate([q, np.zeros(model.nq - len(q))]))
        away = data.oMf[frame].translation - begin
        worst = max(worst, float(np.linalg.norm(away - (away @ along) * along)))
    assert worst <= 1e-4
    assert answer.certificate.path_deviation is not None
    assert worst <= answer.certificate.path_deviation.position + 1e-12
    np.testing.assert_allclose(
        motion.derivative(1).sample(np.array([0.0, motion.duration])), 0.0, atol=1e-9
    )
    slower = led(name, step, TimingOptions(method="jerk_limited", solver="interior_point"))[0]
    assert len(slower.trajectory.coefficients) > 60
    assert motion.duration <= 1.1 * slower.trajectory.duration

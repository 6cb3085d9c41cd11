"""Reference of tool motions: pinocchio's kinematics of the trajectory is near it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.forward import forward
from kinematics.pose import from_axis_angle, transform
from obstacles.scenes.scene import Scene
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.pipeline.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.result import Plan
from planning.tool_paths.motions import INSTANTS, place_at, tool_reference
from tests.planning.pinocchio_panda import PinocchioPanda
from tests.planning.scenes import HOME, builtin

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
    answer = plan(problem, Options(planner="cartesian", cartesian=how, timeout=30.0))
    assert isinstance(answer, Plan), answer
    return answer


@pytest.mark.parametrize("blend", [0.0, 0.02])
@pytest.mark.parametrize("seed", range(3))
def test_the_tool_is_within_its_deviation_of_the_reference(seed: int, blend: float) -> None:
    answer = mixed_motions(seed, blend)
    found = tool_reference(builtin("panda").chain, answer.trajectory, answer.tool_motions, seed)
    assert len(found) == INSTANTS
    assert {one.motion for one in found} >= {0, len(answer.tool_motions) - 1}
    assert [one.time for one in found] == sorted(one.time for one in found)
    oracle = PinocchioPanda()
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
        assert place_at(report.motion, report.motion.pose(place)) == pytest.approx(place, abs=1e-6)

"""Inverse kinematics of many poses beside that of each pose alone."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption, InvalidPose, InvalidRobotState
from kinematics.forward import forward
from kinematics.ik.inverse import IkOptions, inverse_kinematics, inverse_kinematics_batch
from kinematics.pose import transform
from kinematics.robots import builtin_chain
from tests.kinematics.ik.arms import random_joints


@pytest.mark.parametrize("robot", ["ur5e", "kr6_sixx", "panda", "iiwa14"])
@pytest.mark.parametrize(
    "options",
    [IkOptions(), IkOptions(ranking="limits"), IkOptions(method="analytic")],
    ids=["auto", "limits", "analytic"],
)
def test_closed_forms_answer_as_for_one_pose(robot: str, options: IkOptions) -> None:
    chain = builtin_chain(robot)
    # More poses than are tabulated at once.
    targets = forward(chain, random_joints(chain, 150, 1))
    near = random_joints(chain, 1, 2)[0]
    solutions = inverse_kinematics_batch(chain, targets, options, seed_joints=near)
    for T, solution in zip(targets, solutions, strict=True):
        assert solution is not None
        alone = inverse_kinematics(chain, T, options, seed_joints=near).solutions[0]
        assert np.array_equal(solution.joints, alone.joints)
        assert solution.branch == alone.branch
        assert np.abs(forward(chain, solution.joints) - T).max() < 1e-8


def test_the_search_answers_what_the_closed_form_does_not() -> None:
    chain = builtin_chain("scara")
    lower, upper = chain.limits.lower, chain.limits.upper
    targets = forward(chain, random_joints(chain, 20, 3))
    targets[7] = transform(None, [9.0, 0.0, 0.0])
    options = IkOptions(axes=("x", "y", "z", "rz"))
    solutions = inverse_kinematics_batch(chain, targets, options)
    assert solutions[7] is None
    for k, solution in enumerate(solutions):
        if k != 7:
            assert solution is not None
            assert ((solution.joints >= lower) & (solution.joints <= upper)).all()
            assert np.abs(forward(chain, solution.joints) - targets[k]).max() < 3e-6


def test_a_closed_form_alone_leaves_what_it_cannot_reach() -> None:
    chain = builtin_chain("ur5e")
    targets = np.array([forward(chain, np.full(6, 0.7)), transform(None, [9.0, 0.0, 0.0])])
    solutions = inverse_kinematics_batch(chain, targets, IkOptions(method="analytic"))
    assert solutions[0] is not None
    assert solutions[1] is None


@pytest.mark.parametrize(
    "options", [IkOptions(most=2), IkOptions(all_turns=True), IkOptions(outside_limits=True)]
)
def test_more_than_one_solution_a_pose_is_refused(options: IkOptions) -> None:
    with pytest.raises(InvalidOption, match="one solution inside the limits"):
        inverse_kinematics_batch(builtin_chain("ur5e"), np.eye(4)[None], options)


def test_poses_and_seeds_are_checked() -> None:
    chain = builtin_chain("ur5e")
    with pytest.raises(InvalidPose):
        inverse_kinematics_batch(chain, np.full((2, 4, 4), np.nan))
    with pytest.raises(InvalidRobotState):
        inverse_kinematics_batch(chain, np.eye(4)[None], seed_joints=[0.0])
    assert inverse_kinematics_batch(chain, np.empty((0, 4, 4))) == []

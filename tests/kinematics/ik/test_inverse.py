"""Choosing a method and the best solution: options, ranking and order."""

from typing import Any

import numpy as np
import pytest

from kinematics.errors import InvalidOption, InvalidPose, InvalidRobotState
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import parameter
from kinematics.ik.inverse import METHODS, IkOptions, inverse_kinematics
from kinematics.ik.ranking import RANKINGS
from kinematics.pose import transform
from kinematics.robots import builtin_chain
from tests.kinematics.ik.arms import general_arm, random_joints

FAR = transform(None, [9.0, 0.0, 0.0])


# ------------------------------------------------------------------------------------- options


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"method": "newton"}, "no method 'newton'"),
        ({"method": "Analytic"}, "no method"),
        ({"ranking": "best"}, "best"),
        ({"most": 0}, "most must be 1"),
        ({"most": -3}, "most must be 1"),
        ({"method": "analytic", "axes": ("x", "y")}, "needs all axes"),
    ],
)
def test_wrong_options_are_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidOption, match=words):
        IkOptions(**values)


def test_right_options_are_taken() -> None:
    for method in METHODS:
        for ranking in RANKINGS:
            assert IkOptions(method=method, ranking=ranking).all_axes
    assert IkOptions(axes=["rz", "ry", "rx", "z", "y", "x"]).all_axes
    assert not IkOptions(axes=["x"]).all_axes


# ------------------------------------------------------------------------------------- methods


@pytest.mark.parametrize("name", ["ur5e", "panda", "iiwa14", "scara"])
def test_the_nearest_solution_to_the_configuration_itself_is_itself(name: str) -> None:
    chain = builtin_chain(name)
    for q in random_joints(chain, 10, 0):
        T = forward(chain, q)
        result = inverse_kinematics(chain, T, seed_joints=q)
        assert result.solutions
        assert np.abs(result.solutions[0].joints - q).max() < 1e-5
        assert result.nearest == result.solutions[0]


@pytest.mark.parametrize("name", ["ur5e", "panda", "kr6_sixx"])
@pytest.mark.parametrize("method", METHODS)
def test_every_method_reaches_the_pose_inside_the_limits(name: str, method: Any) -> None:
    chain = builtin_chain(name)
    for q in random_joints(chain, 5, 1):
        T = forward(chain, q)
        best = inverse_kinematics(chain, T, IkOptions(method=method)).solutions[0]
        assert np.abs(forward(chain, best.joints) - T).max() < 3e-6
        assert ((best.joints >= chain.limits.lower) & (best.joints <= chain.limits.upper)).all()
        assert (best.branch is None) == (method == "numeric")
        assert best.within_limits


def test_axes_that_do_not_count_are_left_to_the_search() -> None:
    chain = builtin_chain("ur5e")
    T = forward(chain, random_joints(chain, 1, 3)[0])
    best = inverse_kinematics(chain, T, IkOptions(axes=("x", "y", "z"))).solutions[0]
    assert best.branch is None
    assert np.abs(forward(chain, best.joints)[:3, 3] - T[:3, 3]).max() < 3e-6


@pytest.mark.parametrize("method", METHODS)
def test_out_of_reach_has_no_solution_but_a_nearest_attempt(method: Any) -> None:
    result = inverse_kinematics(builtin_chain("ur5e"), FAR, IkOptions(method=method))
    assert result.solutions == ()
    assert result.nearest.position_error > 7.0
    assert "beyond" in result.advice
    assert ("out of reach by 8.086 m" in result.advice) == (method != "numeric")


# ------------------------------------------------------------------------- several solutions


@pytest.mark.parametrize("most", [1, 2, 5, 100])
def test_as_many_solutions_as_wanted_the_best_first(most: int) -> None:
    chain = general_arm(np.random.default_rng(5), "spherical, axes 2 and 3 parallel")
    q = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
    T, seed = forward(chain, q), q + 0.2
    solutions = inverse_kinematics(chain, T, IkOptions(most=most), seed_joints=seed).solutions
    everything = inverse_kinematics(chain, T, IkOptions(most=100), seed_joints=seed).solutions
    assert len(solutions) == min(most, len(everything))
    away = [float(np.linalg.norm(s.joints - seed)) for s in solutions]
    assert away == sorted(away)
    for one, other in zip(solutions, everything, strict=False):
        np.testing.assert_array_equal(one.joints, other.joints)


def test_a_given_parameter_is_the_solutions_own() -> None:
    chain = builtin_chain("panda")
    q = random_joints(chain, 1, 7)[0]
    T = forward(chain, q)
    found = inverse_kinematics(chain, T, IkOptions(parameters=[q[6]], most=8)).solutions
    assert found
    assert all(parameter(chain, s.joints) == q[6] for s in found if s.branch is not None)


def test_bad_targets_and_seeds_are_refused_for_every_method() -> None:
    chain = builtin_chain("ur5e")
    for method in METHODS:
        options = IkOptions(method=method)
        for T in (np.eye(3), np.full((4, 4), np.nan)):
            with pytest.raises(InvalidPose):
                inverse_kinematics(chain, T, options)
        for seed in ([0.0], [np.nan] * 6):
            with pytest.raises(InvalidRobotState):
                inverse_kinematics(chain, np.eye(4), options, seed_joints=seed)

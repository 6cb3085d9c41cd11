"""Trajectories from the wire and back, against scipy's splines and polynomials by hand."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from armwright_wire.motions.trajectory import TrajectoryBody
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.robots import builtin_chain
from service.translate.trajectories import named_trajectory, trajectory, trajectory_answer

CHAIN = builtin_chain("planar_rr")
NAMES = list(CHAIN.joint_names)


def body(**fields: Any) -> TrajectoryBody:
    return TrajectoryBody.model_validate(fields)


def segment(t0: float, t1: float, *rows: list[float]) -> dict[str, Any]:
    return {"t0": t0, "t1": t1, "coefficients": list(rows)}


def test_segments_begin_when_they_say_and_joints_follow_the_robot() -> None:
    two = [segment(3.0, 4.0, [1.0, 2.0], [5.0]), segment(4.0, 6.0, [3.0, 0.0, 1.0], [5.0, -1.0])]
    motion, begins = trajectory(body(joint_names=NAMES[::-1], segments=two), CHAIN)
    assert begins == 3.0
    assert motion.duration == 3.0
    assert motion.joint_names == CHAIN.joint_names
    # The first row of the request is the robot's second joint.
    np.testing.assert_allclose(motion.sample(np.array([0.5])), [[5.0, 2.0]])
    np.testing.assert_allclose(motion.sample(np.array([2.0])), [[4.0, 4.0]])
    np.testing.assert_allclose(motion.sample(np.array([2.0]), 1), [[-1.0, 2.0]])


def test_samples_become_the_spline_that_is_named() -> None:
    times, rows = [0.0, 1.0, 3.0, 4.0], [[0.0, 1.0], [1.0, 0.5], [-1.0, 0.0], [0.5, 2.0]]
    samples = {"time": times, "position": rows}
    motion, _ = trajectory(body(samples=samples, interpolation="natural_spline"), CHAIN)
    expected = CubicSpline(times, rows, bc_type="natural")
    at = np.linspace(0.0, 4.0, 33)
    np.testing.assert_allclose(motion.sample(at), expected(at), atol=1e-12)
    named = body(samples=samples, interpolation="natural_spline", joint_names=NAMES)
    np.testing.assert_array_equal(named_trajectory(named).coefficients, motion.coefficients)


def test_names_of_a_motion_without_a_robot_are_different() -> None:
    with pytest.raises(InvalidTrajectory, match="named twice"):
        named_trajectory(body(joint_names=["a", "a"], segments=[segment(0, 1, [0.0], [0.0])]))


def test_an_answer_can_be_sent_again_and_is_sampled_as_asked() -> None:
    first, _ = trajectory(body(segments=[segment(0.0, 2.0, [0.0, 1.0], [1.0, 0.0, -0.5])]), CHAIN)
    answer = trajectory_answer(first, 0.5)
    again, _ = trajectory(TrajectoryBody.model_validate(answer | {"samples": None}), CHAIN)
    np.testing.assert_array_equal(again.breaks, first.breaks)
    np.testing.assert_array_equal(again.coefficients, first.coefficients)
    samples = answer["samples"]
    np.testing.assert_allclose(samples["time"], [0.0, 0.5, 1.0, 1.5, 2.0])
    np.testing.assert_allclose(samples["position"], first.sample(np.array(samples["time"])))
    np.testing.assert_allclose(samples["acceleration"], [[0.0, -1.0]] * 5)
    assert trajectory_answer(first, None)["samples"] is None
    with pytest.raises(InvalidOption, match="more than 100000 samples"):
        trajectory_answer(first, 1e-6)

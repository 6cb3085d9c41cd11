"""References of requests, by name and as trajectories."""

from typing import Any

import numpy as np
import pytest

from armwright_wire.motions.simulation import SimulateRequest
from kinematics.errors import InvalidRobotState
from kinematics.robots import builtin_chain
from service.endpoints.simulate.task import RequestReference, reference

CHAIN = builtin_chain("planar_rr")


def request(**fields: Any) -> SimulateRequest:
    body = {"robot": "r", "controller": {"type": "computed_torque", "natural_frequency": 1.0}}
    return SimulateRequest.model_validate(body | fields)


def named(**fields: Any) -> RequestReference:
    return reference(request(reference=fields), CHAIN)


def test_a_trajectory_begins_at_its_own_time() -> None:
    segments = [{"t0": 5.0, "t1": 6.0, "coefficients": [[0.1, 1.0], [0.2]]}]
    motion, begins, rest = reference(request(trajectory={"segments": segments}), CHAIN)
    assert (begins, rest) == (5.0, None)
    np.testing.assert_allclose(motion.end, [1.1, 0.2])


def test_a_step_rests_where_it_comes_from() -> None:
    found = named(type="step", **{"from": [0.1, 0.2], "to": [0.3, 0.4]}, at=0.5, duration=1.0)
    assert found.rest is not None
    np.testing.assert_array_equal(found.rest, [0.1, 0.2])
    np.testing.assert_array_equal(found.motion.end, [0.3, 0.4])


def test_other_references_begin_where_they_are() -> None:
    wave = named(type="sine", center=[0.1, 0.2], amplitude=0.5, frequency=1.0, duration=1.0)
    assert (wave.begins, wave.rest) == (0.0, None)
    np.testing.assert_allclose(wave.motion.sample([0.25]), [[0.6, 0.7]])
    still = named(type="hold", joints=[0.1, 0.2], duration=2.0)
    assert still.motion.duration == 2.0
    curve = named(type="spline", points=[[0.0, 0.0], [1.0, 2.0]], times=[0.0, 2.0],
                  interpolation="natural_spline")  # fmt: skip
    np.testing.assert_allclose(curve.motion.sample([1.0]), [[0.5, 1.0]])
    # Clamped where nothing is said: at rest at both ends.
    clamped = named(type="spline", points=[[0.0, 0.0], [1.0, 2.0]], times=[0.0, 2.0])
    np.testing.assert_allclose(clamped.motion.sample([0.0, 2.0], 1), np.zeros((2, 2)), atol=1e-12)


def test_a_vector_of_another_robot_is_refused() -> None:
    with pytest.raises(InvalidRobotState, match=r"reference\.from"):
        named(type="step", **{"from": [0.1], "to": [0.3, 0.4]}, duration=1.0)

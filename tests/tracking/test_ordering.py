"""With a model whose masses are wrong, the order among the controllers that theory predicts."""

from collections.abc import Mapping

import numpy as np
import pytest

from dynamics.model.body import scale_masses
from dynamics.terms import gravity_vector
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from tests.tracking.controllers.test_computed_torque import wave
from tests.tracking.samples import constant, smooth
from tracking.controllers.controller import Controller
from tracking.controllers.model_based import (
    Adaptive,
    ComputedTorque,
    IndependentJoint,
    Passivity,
    PdGravity,
    effective_inertia,
)
from tracking.simulation.result import SimulationResult
from tracking.simulation.simulation import SimulationOptions, simulate

FREE = SimulationOptions(saturate=False)
PANDA = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])


def five(model: Chain, q: Array, w: float) -> Mapping[str, Controller]:
    """All controllers of one bandwidth."""
    felt = effective_inertia(model, q)
    return {
        "independent_joint": IndependentJoint.by_pole_placement(model, w, 1.0, felt),
        "computed_torque": ComputedTorque.by_pole_placement(model, w),
        "pd_gravity": PdGravity(model, felt * w**2, 2.0 * felt * w),
        "passivity": Passivity(model, np.array(w), felt * w),
        "adaptive": Adaptive(model, np.array(w), felt * w, np.array(1.0)),
    }


def errors(model: Chain, robot: Chain, trajectory: Trajectory, w: float) -> dict[str, float]:
    """Root mean square of the tracking error over the second half of a motion."""

    def rms(result: SimulationResult) -> float:
        late = result.tracking_error[len(result.times) // 2 :]
        return float(np.sqrt((late**2).mean()))

    return {
        name: rms(simulate(controller, trajectory, FREE, robot=robot))
        for name, controller in five(model, trajectory.start, w).items()
    }


@pytest.mark.parametrize("scale", [0.7, 1.3])
def test_ordering_under_thirty_percent_of_mass_error(scale: float) -> None:
    chain = builtin_chain("panda")
    frequencies = np.array([[0.2, 0.3, 0.25, 0.35, 0.4, 0.45, 0.5]])
    motion = wave(chain, frequencies, 12.0)
    path = Trajectory(
        motion.joint_names,
        motion.breaks,
        motion.coefficients + PANDA[:, None] * (np.arange(motion.degree + 1) == 0.0),
    )
    found = errors(scale_masses(chain, scale), chain, path, 20.0)
    # Learning the masses beats trusting them; with the weight known, even wrongly, the model-based
    # ones beat the one that takes it for a disturbance.
    assert found["adaptive"] < 0.3 * found["passivity"]
    assert found["adaptive"] < 0.3 * found["computed_torque"]
    assert found["computed_torque"] < 0.8 * found["independent_joint"]
    assert found["passivity"] < 0.8 * found["independent_joint"]
    assert found["pd_gravity"] < found["independent_joint"]


def test_ordering_with_the_exact_model() -> None:
    chain = builtin_chain("panda")
    path = smooth(chain, PANDA, PANDA + 0.5, 1.0)
    found = errors(chain, chain, path, 20.0)
    exact = max(found["computed_torque"], found["passivity"], found["adaptive"])
    assert exact < 1e-6
    # A set-point law on a moving reference lags, one without the weight is worse.
    assert 1e-4 < found["pd_gravity"] < found["independent_joint"]


def test_set_point_under_wrong_weight_ends_beside_it() -> None:
    chain = builtin_chain("planar_rr")
    wrong = scale_masses(chain, 1.3)
    goal = np.array([0.4, 0.3])
    controller = PdGravity(wrong, np.array(200.0), np.array(40.0))
    options = SimulationOptions(saturate=False, duration=15.0, sample_period=0.5)
    result = simulate(controller, constant(chain, goal), options, robot=chain)
    # K_p q_tilde = G - G_wrong at rest.
    q = result.position[-1]
    expected = (gravity_vector(chain, q) - gravity_vector(wrong, q)) / 200.0
    np.testing.assert_allclose(result.tracking_error[-1], expected, rtol=1e-5)

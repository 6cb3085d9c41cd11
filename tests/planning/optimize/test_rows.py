"""Linear rows, responses and objectives of the optimisation, by differences and pinocchio."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics.model.payload import with_payload
from kinematics.trajectory.trajectory import Trajectory
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import JointConstraint
from planning.optimize import objective
from planning.optimize.iterate import Iterate
from planning.optimize.linearization import local_matrix, tool_speed, torques
from planning.values.optimize_options import Objective
from tests.planning.optimize.motions import PANDA, SPACE, iterate, packed, task, unpacked
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME

U = np.linspace(0.03, 0.97, 9)


@pytest.mark.parametrize("response", [torques, tool_speed])
def test_responses_change_as_their_derivatives_say(response: object) -> None:
    assert callable(response)
    at = iterate(1)
    found = response(PANDA, at, U)
    m = found.values.shape[1]
    rows = [g.reshape(-1, 7) for g in found.gradients]
    A = local_matrix(at, np.repeat(U, m), rows, found.in_time.ravel()).toarray()
    direction = np.append(np.random.default_rng(2).normal(size=A.shape[1] - 1), 0.0)
    step, z = 1e-6, packed(at)
    ahead = response(PANDA, unpacked(z + step * direction), U).values.ravel()
    behind = response(PANDA, unpacked(z - step * direction), U).values.ravel()
    slope = (ahead - behind) / (2.0 * step)
    np.testing.assert_allclose(A @ direction, slope, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("name", ["time", "jerk", "energy"])
def test_models_have_the_gradient_of_the_objective(name: Objective) -> None:
    at, weights = iterate(3), {name: 1.0}
    model = objective.model(task(), weights, at)
    z, rng = packed(at), np.random.default_rng(4)
    gradient = model.H @ z + model.g
    for _ in range(5):
        direction = np.append(rng.normal(size=len(z) - 1), 0.0)
        step = 1e-6
        values = [
            objective.value(
                unpacked(z + sign * step * direction).trajectory(PANDA.joint_names), weights, PANDA
            )
            for sign in (1.0, -1.0)
        ]
        slope = (values[0] - values[1]) / (2.0 * step)
        # The smoothing of the time objective is part of its model.
        assert gradient @ direction == pytest.approx(slope, rel=1e-4, abs=0.1)
    assert (np.linalg.eigvalsh(model.H.toarray()) > -1e-6 * abs(model.H).max()).all()


PINOCCHIO = PinocchioArm()
PLACES = np.linspace(0.0, 1.0, 7)


@pytest.mark.parametrize("duration", [0.4, 1.3, 6.0])
def test_values_are_pinocchios_in_time(duration: float) -> None:
    at = Iterate(SPACE, iterate(2).points, duration)
    tau, speed = torques(PANDA, at, PLACES), tool_speed(PANDA, at, PLACES)
    assert tau.values.shape == (len(PLACES), 7)
    assert speed.values.shape == (len(PLACES), 1)
    for k, u in enumerate(PLACES):
        q, qd, qdd = (at.sample(np.array([u]), r)[0] / duration**r for r in range(3))
        wanted = PINOCCHIO.torque(q, qd, qdd) + PANDA.viscous_friction * qd
        np.testing.assert_allclose(tau.values[k], wanted, atol=1e-9 * np.abs(wanted).max())
        fastest = float(np.linalg.norm(PINOCCHIO.tip_velocity(q, qd)))
        assert speed.values[k, 0] == pytest.approx(fastest, abs=1e-4)


NAMES = PANDA.joint_names
WAY = np.array([0.3, -0.2, 0.1, 0.4, 0.0, -0.5, 0.2])


def test_jerk_without_bound_is_infinite() -> None:
    halves = np.zeros((2, 7, 3))
    halves[0, :, 2], halves[1, :, 0] = WAY, WAY
    halves[1, :, 1], halves[1, :, 2] = 2.0 * WAY, -WAY
    bang_bang = Trajectory(NAMES, np.array([0.0, 1.0, 2.0]), halves)
    assert bang_bang.continuity().velocity < 1e-12
    assert objective.value(bang_bang, {"jerk": 1.0}, PANDA) == np.inf
    assert np.isfinite(objective.value(bang_bang, {"time": 1.0, "energy": 1.0}, PANDA))


def test_energy_is_the_integral_of_pinocchios_squared_torques() -> None:
    motion, oracle = iterate(1).trajectory(NAMES), PinocchioArm()
    times = np.linspace(0.0, motion.duration, 2001)
    states = zip(*(motion.sample(times, order) for order in range(3)), strict=True)
    tau = np.array([oracle.torque(*s) + PANDA.viscous_friction * s[1] for s in states])
    wanted = np.trapezoid(np.square(tau).sum(axis=1), times)
    assert objective.value(motion, {"energy": 1.0}, PANDA) == pytest.approx(wanted, rel=1e-4)


def test_wishes_cost_half_the_weighed_square_of_what_they_are_violated_by() -> None:
    """A joint that is to stay at most 0.1 above HOME, on a line that leads 0.3 past it."""
    line = np.zeros((1, 7, 2))
    line[0, :, 0], line[0, 0, 1] = HOME, 0.4
    motion = Trajectory(NAMES, np.array([0.0, 1.0]), line)
    wish = JointConstraint(NAMES[0], float(HOME[0]), 0.1, 0.5, weight=6.0)
    held = JointConstraint(NAMES[1], float(HOME[1]), 0.1, 0.1, weight=6.0)
    fine = np.linspace(0.0, 1.0, 100_001)
    wanted = 3.0 * np.trapezoid(np.maximum(0.4 * fine - 0.1, 0.0) ** 2, fine)
    paid = objective.value(motion, {}, PANDA, ConstraintSet(PANDA, (wish,)))
    # A sum over four nodes, of a function with a corner.
    assert paid == pytest.approx(wanted, rel=0.02)
    assert objective.value(motion, {}, PANDA, ConstraintSet(PANDA, (held,))) == 0.0
    both = ConstraintSet(PANDA, (wish, held))
    plain = objective.value(motion, {"time": 1.0}, PANDA)
    assert objective.value(motion, {"time": 1.0}, PANDA, both) == pytest.approx(plain + paid)


def test_the_model_of_the_length_touches_it_and_is_nowhere_below_it() -> None:
    """|x| <= (|x|^2 / |x'| + |x'|) / 2: a step down the model is a step down the length."""
    at, rng = iterate(4), np.random.default_rng(4)
    model = objective.model(task(), {"path_length": 1.0}, at)

    def length(z: np.ndarray) -> float:
        motion = unpacked(z).trajectory(NAMES)
        return objective.value(motion, {"path_length": 1.0}, PANDA)

    z = packed(at)
    offset = length(z) - 0.5 * z @ (model.H @ z) - model.g @ z
    for size in (1e-3, 0.1, 1.0):
        for _ in range(10):
            step = np.append(size * rng.normal(size=len(z) - 2), [0.0, 0.0])
            other = z + step
            promised = 0.5 * other @ (model.H @ other) + model.g @ other + offset
            # The length by eight nodes a piece, its model by four.
            assert length(other) <= promised * (1.0 + 2e-3)


def test_the_carrier_decides_the_energy_of_the_model() -> None:
    """Value and model are those of the robot with what it carries."""
    at, heavy = iterate(7), with_payload(PANDA, 10.0)
    motion = at.trajectory(NAMES)
    values = [objective.value(motion, {"energy": 1.0}, chain) for chain in (PANDA, heavy)]
    assert values[1] > 1.5 * values[0]
    for chain, value in zip((PANDA, heavy), values, strict=True):
        model = objective.model(replace(task(), loaded_chain=chain), {"energy": 1.0}, at)
        slope = (model.H @ packed(at) + model.g)[-2]
        ahead, behind = (
            objective.value(
                replace(at, duration=at.duration + step).trajectory(NAMES), {"energy": 1.0}, chain
            )
            for step in (1e-5, -1e-5)
        )
        assert slope == pytest.approx((ahead - behind) / 2e-5, abs=1e-4 * value)

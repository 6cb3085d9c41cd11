"""Values of objectives by closed forms and dense sums, and what their models promise."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics.model.payload import with_payload
from kinematics.trajectory.trajectory import Trajectory
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.joint import JointConstraint
from planning.optimize import objective
from tests.planning.optimize.motions import PANDA, iterate, packed, task, unpacked
from tests.planning.pinocchio_panda import PinocchioPanda
from tests.planning.scenes import HOME

NAMES = PANDA.joint_names
WAY = np.array([0.3, -0.2, 0.1, 0.4, 0.0, -0.5, 0.2])


def quintic(duration: float) -> Trajectory:
    """From HOME to HOME + WAY with the least integral of squared jerks, at rest at its ends."""
    powers = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / duration ** np.arange(6)
    coefficients = WAY[:, None] * powers
    coefficients[:, 0] = HOME
    return Trajectory(NAMES, np.array([0.0, duration]), coefficients[None])


@pytest.mark.parametrize("duration", [0.5, 2.0])
def test_the_jerk_of_a_quintic_has_a_closed_form(duration: float) -> None:
    wanted = 720.0 * (WAY @ WAY) / duration**5
    assert objective.value(quintic(duration), {"jerk": 1.0}, PANDA) == pytest.approx(wanted)


def test_jerk_without_bound_is_infinite() -> None:
    halves = np.zeros((2, 7, 3))
    halves[0, :, 2], halves[1, :, 0] = WAY, WAY
    halves[1, :, 1], halves[1, :, 2] = 2.0 * WAY, -WAY
    bang_bang = Trajectory(NAMES, np.array([0.0, 1.0, 2.0]), halves)
    assert bang_bang.continuity().velocity < 1e-12
    assert objective.value(bang_bang, {"jerk": 1.0}, PANDA) == np.inf
    assert np.isfinite(objective.value(bang_bang, {"time": 1.0, "energy": 1.0}, PANDA))


def test_energy_is_the_integral_of_pinocchios_squared_torques() -> None:
    motion, oracle = iterate(1).trajectory(NAMES), PinocchioPanda()
    times = np.linspace(0.0, motion.duration, 2001)
    states = zip(*(motion.sample(times, order) for order in range(3)), strict=True)
    tau = np.array([oracle.torque(*s) + PANDA.viscous_friction * s[1] for s in states])
    wanted = np.trapezoid(np.square(tau).sum(axis=1), times)
    assert objective.value(motion, {"energy": 1.0}, PANDA) == pytest.approx(wanted, rel=1e-4)


def test_the_length_of_a_path_does_not_depend_on_its_timing() -> None:
    motion = iterate(2).trajectory(NAMES)
    points = motion.sample(np.linspace(0.0, motion.duration, 20_001))
    wanted = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    assert objective.value(motion, {"path_length": 1.0}, PANDA) == pytest.approx(wanted, rel=1e-4)
    slow = motion.dilate(3.0)
    assert objective.value(slow, {"path_length": 1.0}, PANDA) == pytest.approx(wanted, rel=1e-4)
    straight = objective.value(quintic(2.0), {"path_length": 1.0}, PANDA)
    assert straight == pytest.approx(float(np.linalg.norm(WAY)), rel=1e-9)


def test_objectives_are_summed_with_their_weights() -> None:
    motion = iterate(3).trajectory(NAMES)
    time, length = (objective.value(motion, {name: 1.0}, PANDA) for name in ("time", "path_length"))
    assert time == motion.duration
    both = objective.value(motion, {"time": 2.0, "path_length": 0.5}, PANDA)
    assert both == pytest.approx(2.0 * time + 0.5 * length)


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


@pytest.mark.parametrize("name", objective._MODELS)
def test_models_are_convex_and_weighed_and_never_pay_for_slack(name: str) -> None:
    at = iterate(5)
    weights = {name: 1.0}
    one = objective.model(task(), weights, at)  # type: ignore[arg-type]
    three = objective.model(task(), {name: 3.0}, at)  # type: ignore[dict-item]
    near = objective.model(task(), {}, at)
    np.testing.assert_allclose(three.g - near.g, 3.0 * (one.g - near.g), atol=1e-9)
    difference = (three.H - near.H) - 3.0 * (one.H - near.H)
    assert abs(difference).max() <= 1e-9 * max(abs(three.H).max(), 1.0)
    H = one.H.toarray()
    np.testing.assert_allclose(H, H.T, atol=1e-9 * np.abs(H).max())
    assert np.linalg.eigvalsh(H).min() > -1e-6 * np.abs(H).max()
    assert one.g[-1] == 0.0
    assert np.abs(one.H.toarray()[-1, :-1]).max() == 0.0


def test_only_haste_is_smoothed() -> None:
    """Of many fastest motions the one of small accelerations, by their shares of the limits."""
    at = iterate(6)
    hasty = objective.model(task(), {"time": 1.0}, at).H
    calm = objective.model(task(), {}, at).H
    smoothing = (hasty - calm).toarray()[:-2, :-2]
    fine = np.linspace(0.0, 1.0, 4001)
    shares = at.sample(fine, 2) / at.duration**2 / PANDA.limits.acceleration
    integral = np.trapezoid(np.square(shares).sum(axis=1), fine) * at.duration
    flat = at.points.ravel()
    assert 0.5 * flat @ smoothing @ flat == pytest.approx(3e-4 * integral, rel=1e-4)


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

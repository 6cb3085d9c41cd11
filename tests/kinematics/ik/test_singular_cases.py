"""The table of singular and limit cases in docs/singular_cases.md, row by row."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches, parameter
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.ik.numeric.numeric import solve
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from tests.kinematics.ik.arms import apart


def reached(chain: Chain, joints: Array, T: Array) -> bool:
    return bool(np.abs(forward(chain, joints) - T).max() < 2e-9)


@pytest.mark.parametrize("name", ["kr6_sixx", "elbow_wrist", "puma560"])
def test_straight_wrist(name: str) -> None:
    chain = builtin_chain(name)
    lower, upper = chain.sampling_bounds()
    q = 0.3 * lower + 0.7 * upper
    q[4] = 0.0
    seed = q.copy()
    seed[3] += 0.2
    T = forward(chain, q)
    found = branches(chain, T, seed_joints=seed)
    straight = np.abs(found.joints[:, 4]) < 1e-9
    mine = straight & (apart(found.joints[:, :3], q[:3]) < 1e-6)
    # The seed's q4, and q6 such that what is determined stays.
    assert found.joints[mine][0, 3] == pytest.approx(seed[3])
    assert reached(chain, found.joints, T)


def test_target_on_axis_1() -> None:
    chain = builtin_chain("elbow_wrist")
    # Upper arm and forearm upright: the wrist is on axis 1.
    q = np.array([0.4, np.pi / 2, np.pi / 2, 0.2, 0.7, -0.5])
    seed = q.copy()
    seed[0] = -0.9
    T = forward(chain, q)
    found = branches(chain, T, seed_joints=seed)
    assert np.abs(found.joints[:, 0] + 0.9).min() < 1e-9
    assert reached(chain, found.joints, T)


@pytest.mark.parametrize("along_axis_1", [False, True])
def test_arm_angle_where_it_is_hard_to_tell(along_axis_1: bool) -> None:
    chain = builtin_chain("iiwa14")
    q = np.array([0.5, 0.0 if along_axis_1 else 0.4, 0.3, 0.0, -0.6, 0.7, 0.1])
    T = forward(chain, q)
    value = parameter(chain, q)
    found = branches(chain, T, parameters=[value])
    assert np.isfinite(value)
    assert len(found.table)
    assert reached(chain, found.joints, T)


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_a_joint_missed_by_rounding_is_put_onto_its_limit(side: str) -> None:
    # At a fold rounding of 1e-16 is 1e-8 of the elbow, to either side of the limit.
    nominal = builtin_chain("ur5e")
    bound = getattr(nominal.limits, side).copy()
    bound[2] = 0.0
    chain = replace(nominal, limits=replace(nominal.limits, **{side: bound}))
    rng = np.random.default_rng(3)
    for _ in range(20):
        q = rng.uniform(-2.0, 2.0, 6)
        q[2] = 0.0
        T = forward(chain, q)
        found = branches(chain, T, seed_joints=q)
        mine = found.within_limits & (apart(found.joints, q) < 1e-5)
        assert mine.any()
        assert (found.joints[mine] >= chain.limits.lower).all()
        assert (found.joints[mine] <= chain.limits.upper).all()
        assert reached(chain, found.joints[mine], T)


def test_continuous_joints_turn_nearest_to_the_seed() -> None:
    nominal = builtin_chain("ur5e")
    free = np.full(6, np.inf)
    chain = replace(
        nominal,
        limits=replace(nominal.limits, lower=-free, upper=free),
        continuous=np.ones(6, dtype=np.bool_),
    )
    q = np.array([0.3, -1.0, 1.4, -0.7, -1.3, 0.2])
    T = forward(chain, q)
    seed = q + 4.0 * np.pi
    best = inverse_kinematics(chain, T, seed_joints=seed).solutions[0]
    np.testing.assert_allclose(best.joints, seed, atol=1e-6)
    turned = inverse_kinematics(
        chain, T, IkOptions(most=1000, all_turns=True), seed_joints=q
    ).solutions
    own = [s.joints for s in turned if apart(s.joints, q) < 1e-6]
    assert {float(round((j[0] - q[0]) / (2.0 * np.pi))) for j in own} == {-1.0, 0.0, 1.0}


def test_singular_start_of_the_numeric_method() -> None:
    chain = builtin_chain("kr6_sixx")
    T = forward(chain, np.clip([0.3, -1.2, 1.1, 0.4, 0.8, 0.2], *chain.sampling_bounds()))
    found = solve(chain, T, seed_joints=np.clip(np.zeros(6), *chain.sampling_bounds()))
    assert np.abs(forward(chain, found.solutions[0].joints) - T).max() < 3e-6

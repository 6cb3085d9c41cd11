"""Velocity kinematics against pinocchio, scipy's pseudo-inverse and differences."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotState
from kinematics.forward import forward
from kinematics.jacobian import geometric, geometric_rate, pose_and_jacobian
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain, builtin_names
from kinematics.velocity import DAMPED_BELOW, joint_velocities, link_twist, singular_directions
from tests.kinematics.samples import configurations, random_chain
from tests.planning.pinocchio_arm import PinocchioArm

STEP = 1e-5


@pytest.mark.parametrize("name", [name for name in builtin_names() if name != "cart_pendulum"])
def test_twist_and_jacobian_rate_are_pinocchios(name: str) -> None:
    arm, rng = PinocchioArm(name), np.random.default_rng(0)
    for q in configurations(arm.chain, 5):
        rates = rng.normal(size=arm.chain.n)
        twist, rate = arm.twist(q, rates), arm.jacobian_rate(q, rates)
        np.testing.assert_allclose(link_twist(arm.chain, q, rates), twist, atol=1e-12)
        np.testing.assert_allclose(geometric_rate(arm.chain, q, rates), rate, atol=1e-11)


def test_jacobian_rate_equals_differences_at_any_point_of_any_link() -> None:
    rng = np.random.default_rng(2)
    for _ in range(60):
        chain = random_chain(rng)
        q, rates = rng.uniform(-3, 3, chain.n), rng.uniform(-1, 1, chain.n)
        link = chain.links[int(rng.integers(len(chain.links)))].name
        point = rng.uniform(-0.5, 0.5, 3)
        ahead = geometric(chain, q + STEP * rates, link, point)
        behind = geometric(chain, q - STEP * rates, link, point)
        expected = (ahead - behind) / (2 * STEP)
        np.testing.assert_allclose(
            geometric_rate(chain, q, rates, link, point), expected, atol=1e-7
        )


@pytest.mark.parametrize("n", [1, 3, 5, 6, 7, 9])
def test_undamped_is_the_pseudo_inverse(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        chain = random_chain(rng, n)
        q, xi, b = rng.uniform(-3, 3, n), rng.normal(size=6), rng.normal(size=n)
        J = geometric(chain, q)
        inverse = np.linalg.pinv(J, rcond=1e-12)
        if np.linalg.norm(inverse) > 1e6:
            continue
        solution = joint_velocities(chain, q, xi, nullspace=b, damped_below=0.0)
        expected = inverse @ xi + (np.eye(n) - inverse @ J) @ b
        scale = max(1.0, float(np.linalg.norm(inverse)))
        np.testing.assert_allclose(solution.joint_velocities, expected, atol=1e-10 * scale**2)
        np.testing.assert_allclose(solution.residual, xi - J @ expected, atol=1e-10 * scale**2)
        assert (solution.gains == 1.0).all()


def test_six_regular_joints_give_the_twist_itself() -> None:
    chain = builtin_chain("ur5e")
    q, xi = np.array([0.3, -1.0, 1.4, -0.7, -1.3, 0.2]), np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6])
    solution = joint_velocities(chain, q, xi)
    assert np.abs(solution.residual).max() < 1e-14
    np.testing.assert_allclose(link_twist(chain, q, solution.joint_velocities), xi, atol=1e-13)


def test_nullspace_moves_the_arm_and_not_the_tip() -> None:
    chain = builtin_chain("panda")
    q = np.array([0.3, -0.5, 0.2, -2.0, 0.3, 1.7, 0.4])
    xi = np.zeros(6)
    solution = joint_velocities(chain, q, xi, nullspace=np.ones(7))
    assert np.linalg.norm(solution.joint_velocities) > 0.1
    assert np.abs(solution.residual).max() < 1e-14
    ahead, behind = (forward(chain, q + h * solution.joint_velocities) for h in (STEP, -STEP))
    assert np.abs(ahead - behind).max() < 1e-9


def wrist_singular(chain: Chain, bend: float) -> Array:
    q = np.array([0.3, -0.6, 1.1, 0.4, bend, -0.2])
    return np.array(np.clip(q, chain.limits.lower, chain.limits.upper))


@pytest.mark.parametrize("bend", [0.0, 1e-12, 1e-6, 1e-3])
def test_near_a_singularity_joints_stay_slow_and_what_is_lost_is_told(bend: float) -> None:
    chain = builtin_chain("kr6_sixx")
    q = wrist_singular(chain, bend)
    rng = np.random.default_rng(3)
    for _ in range(10):
        xi = rng.normal(size=6)
        solution = joint_velocities(chain, q, xi)
        found = solution.directions
        damped = solution.gains < 1.0
        assert damped.sum() == 1
        assert damped[-1]
        assert np.linalg.norm(solution.joint_velocities) <= np.linalg.norm(xi) / (
            0.5 * DAMPED_BELOW
        )
        # All that is missing of the twist lies along the direction told.
        lost = found.twists[:, -1]
        np.testing.assert_allclose(
            solution.residual, (1.0 - solution.gains[-1]) * lost * (lost @ xi), atol=1e-9
        )


def test_damping_sets_in_without_a_jump() -> None:
    chain = builtin_chain("kr6_sixx")
    xi = np.array([0.2, 0.1, -0.3, 0.5, -0.4, 0.3])
    bends = np.linspace(-0.1, 0.1, 4001)
    batch = np.array([wrist_singular(chain, bend) for bend in bends])
    solution = joint_velocities(chain, batch, xi)
    assert (solution.gains < 1.0).any()
    assert (solution.gains[0] == 1.0).all()
    jumps = np.abs(np.diff(solution.joint_velocities, axis=0)).max()
    assert jumps < 0.02 * np.abs(solution.joint_velocities).max()


def test_rank_and_singular_directions() -> None:
    chain = builtin_chain("kr6_sixx")
    J = geometric(chain, wrist_singular(chain, 0.0))
    found = singular_directions(J)
    assert found.rank == 5
    assert np.abs(found.twists[:, -1] @ J).max() < 1e-12
    still = found.motions[-1]
    assert np.abs(J @ still).max() < 1e-12
    # Axes 4 and 6 turn against each other.
    assert abs(still[3]) == pytest.approx(np.sqrt(0.5), abs=1e-9)
    assert abs(still[5]) == pytest.approx(np.sqrt(0.5), abs=1e-9)
    assert singular_directions(geometric(builtin_chain("scara"), np.zeros(4))).rank <= 4


def test_pose_and_jacobian_are_those_of_the_single_calls() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        chain = random_chain(rng)
        q = rng.uniform(-3, 3, chain.n)
        for link in (None, *chain.index):
            T, J = pose_and_jacobian(chain, q.tolist(), link)
            np.testing.assert_allclose(T, forward(chain, q, link), atol=1e-15)
            np.testing.assert_allclose(J, geometric(chain, q, link, [0, 0, 0]), atol=1e-14)


def test_bad_input_is_named() -> None:
    chain = builtin_chain("panda")
    q = np.zeros(7)
    with pytest.raises(InvalidOption, match="twist"):
        joint_velocities(chain, q, [0.0] * 5)
    with pytest.raises(InvalidOption, match="twist"):
        joint_velocities(chain, q, [np.nan] * 6)
    with pytest.raises(InvalidOption, match="damped_below"):
        joint_velocities(chain, q, [0.0] * 6, damped_below=-1.0)
    with pytest.raises(InvalidRobotState, match="nullspace"):
        joint_velocities(chain, q, [0.0] * 6, nullspace=[0.0])
    with pytest.raises(InvalidRobotState, match="joint_velocities"):
        link_twist(chain, q, [0.0])
    with pytest.raises(InvalidRobotState):
        pose_and_jacobian(chain, np.zeros((2, 7)))


def test_batches_go_with_one_configuration_or_as_many() -> None:
    chain = builtin_chain("panda")
    rng = np.random.default_rng(8)
    q, rates, twist = rng.uniform(-1, 1, (4, 7)), rng.normal(size=(4, 7)), rng.normal(size=(4, 6))
    moved = link_twist(chain, q[0], rates)
    solved = joint_velocities(chain, q[0], twist, nullspace=rates).joint_velocities
    for k in range(4):
        np.testing.assert_allclose(moved[k], link_twist(chain, q[0], rates[k]), atol=1e-13)
        alone = joint_velocities(chain, q[0], twist[k], nullspace=rates[k]).joint_velocities
        np.testing.assert_allclose(solved[k], alone, atol=1e-12)


def test_batches_that_do_not_fit_are_named_with_their_shapes() -> None:
    chain = builtin_chain("panda")
    q, rates, twist = np.zeros((4, 7)), np.zeros((3, 7)), np.zeros((3, 6))
    with pytest.raises(InvalidOption, match=r"joints \(4,\), joint_velocities \(3,\)"):
        link_twist(chain, q, rates)
    with pytest.raises(InvalidOption, match=r"joints \(4,\), twist \(3,\)"):
        joint_velocities(chain, q, twist)
    with pytest.raises(InvalidOption, match=r"joints \(4,\), nullspace \(3,\)"):
        joint_velocities(chain, q, np.zeros(6), nullspace=rates)

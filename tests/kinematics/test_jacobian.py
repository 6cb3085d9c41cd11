"""Jacobians, velocities and forces beside pinocchio, differences, virtual work and CasADi."""

import casadi
import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidLinkName, InvalidOption, InvalidRobotState
from kinematics.forward import forward, joint_frames
from kinematics.jacobian import (
    analytic_zyz,
    geometric,
    geometric_rate,
    manipulability,
    pose_and_jacobian,
)
from kinematics.model.chain import Chain
from kinematics.pose import from_zyz, rotation_error, to_zyz
from kinematics.robots import builtin_chain, builtin_names, builtin_urdf
from kinematics.symbolic import (
    symbolic_frames,
    symbolic_jacobian,
)
from kinematics.velocity import (
    DAMPED_BELOW,
    holding_torques,
    joint_velocities,
    link_twist,
    singular_directions,
)
from tests.dynamics.samples import random_chain as symbolic_random_chain
from tests.dynamics.samples import random_state
from tests.kinematics.samples import Sample, configurations, random_chain, reference, samples
from tests.planning.pinocchio_arm import PinocchioArm

#: Central differences are off by step^2 (6e-10) and by rounding / step (1e-11).
STEP = 1e-5
DIFFERENCE_TOLERANCE = 1e-8


@pytest.mark.parametrize("sample", samples(), ids=lambda sample: sample.name)
def test_equals_pinocchios(sample: Sample) -> None:
    arm = reference(sample)
    chain = arm.chain
    for q in configurations(chain, 3):
        for link in chain.links:
            J = geometric(chain, q, link.name)
            np.testing.assert_allclose(J, arm.jacobian(q, link.name), atol=1e-12, rtol=0)


def differences(chain: Chain, q: Array, link: str, point: Array) -> Array:
    J = np.zeros((6, chain.n))
    for j in range(chain.n):
        step = np.zeros(chain.n)
        step[j] = STEP
        ahead, behind = forward(chain, q + step, link), forward(chain, q - step, link)
        J[:3, j] = (ahead - behind)[:3, :3] @ point + (ahead - behind)[:3, 3]
        J[3:, j] = rotation_error(behind[:3, :3], ahead[:3, :3])
    return J / (2.0 * STEP)


def test_equals_differences_at_any_point_of_any_link() -> None:
    rng = np.random.default_rng(11)
    for _ in range(40):
        chain = random_chain(rng)
        q, point = rng.uniform(-3, 3, chain.n), rng.uniform(-0.5, 0.5, 3)
        link = chain.links[int(rng.integers(len(chain.links)))].name
        J = geometric(chain, q, link, point)
        expected = differences(chain, q, link, point)
        np.testing.assert_allclose(J, expected, atol=DIFFERENCE_TOLERANCE)
        wrench = rng.normal(size=6)
        torques = holding_torques(chain, q, wrench, link, point)
        np.testing.assert_allclose(torques, J.T @ wrench, atol=1e-12)


@pytest.mark.parametrize("point", [[0, 0], [0, 0, np.nan], [[0, 0, 0]], 1.0])
def test_points_refused(point: object) -> None:
    chain = random_chain(np.random.default_rng(14), 2)
    with pytest.raises(InvalidOption, match="point"):
        geometric(chain, [0, 0], point=point)  # type: ignore[arg-type]


def test_analytic_gives_the_zyz_rates() -> None:
    rng = np.random.default_rng(15)
    for _ in range(40):
        chain = random_chain(rng)
        q, rate = rng.uniform(-3, 3, (2, chain.n))
        T = forward(chain, q)
        if np.hypot(T[0, 2], T[1, 2]) < 1e-2:
            continue
        J = analytic_zyz(geometric(chain, q), T[:3, :3])
        ahead, behind = forward(chain, q + STEP * rate), forward(chain, q - STEP * rate)
        turned = to_zyz(ahead[:3, :3]) - to_zyz(behind[:3, :3])
        turned = (turned + np.pi) % (2 * np.pi) - np.pi
        # The rates grow with 1 / sin(theta), their differences' error with its cube.
        assert (J @ rate)[3:] == pytest.approx(turned / (2 * STEP), rel=1e-4, abs=1e-6)
        np.testing.assert_array_equal(J[:3], geometric(chain, q)[:3])


@pytest.mark.parametrize("theta", [0.0, 1e-9, np.pi, np.pi - 1e-9])
def test_analytic_is_refused_where_zyz_is_singular(theta: float) -> None:
    with pytest.raises(InvalidOption, match="theta"):
        analytic_zyz(np.zeros((6, 3)), from_zyz([0.3, theta, 0.5]))


def test_manipulability() -> None:
    rng = np.random.default_rng(16)
    for _ in range(20):
        J = rng.normal(size=(6, int(rng.integers(6, 9))))
        singular = np.array(np.linalg.svd(J, compute_uv=False), dtype=np.float64)
        assert manipulability(singular) == pytest.approx(np.sqrt(np.linalg.det(J @ J.T)))


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


def test_batches_that_do_not_fit_are_named_with_their_shapes() -> None:
    chain = builtin_chain("panda")
    q, rates, twist = np.zeros((4, 7)), np.zeros((3, 7)), np.zeros((3, 6))
    with pytest.raises(InvalidOption, match=r"joints \(4,\), joint_velocities \(3,\)"):
        link_twist(chain, q, rates)
    with pytest.raises(InvalidOption, match=r"joints \(4,\), twist \(3,\)"):
        joint_velocities(chain, q, twist)
    with pytest.raises(InvalidOption, match=r"joints \(4,\), nullspace \(3,\)"):
        joint_velocities(chain, q, np.zeros(6), nullspace=rates)


@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford", "scara"])
def test_a_load_at_any_link_is_what_pinocchio_adds_for_it(name: str) -> None:
    chain = builtin_chain(name)
    model = pin.buildModelFromXML(builtin_urdf(name))
    data = model.createData()
    rng = np.random.default_rng(0)
    still = np.zeros(chain.n)
    for q in configurations(chain, 3):
        for link in chain.links:
            wrench = rng.normal(size=6)
            pin.framesForwardKinematics(model, data, q)
            frame = model.getFrameId(link.name)
            joint = model.frames[frame].parentJoint
            # The wrench at the link's origin in base axes, moved into the joint's frame.
            at_origin = pin.SE3(np.eye(3), data.oMf[frame].translation)
            local = data.oMi[joint].actInv(at_origin.act(pin.Force(wrench)))
            external = pin.StdVec_Force()
            for _ in range(model.njoints):
                external.append(pin.Force.Zero())
            external[joint] = local
            alone = pin.rnea(model, data, q, still, still).copy()
            expected = alone - pin.rnea(model, data, q, still, still, external)
            np.testing.assert_allclose(
                holding_torques(chain, q, wrench, link.name), expected, atol=1e-10
            )


def test_bad_wrenches() -> None:
    chain, q = builtin_chain("panda"), np.zeros(7)
    for bad in ([0.0] * 5, [np.inf] * 6, "wrench", 1.0):
        with pytest.raises(InvalidOption, match="wrench"):
            holding_torques(chain, q, bad)


def test_a_batch_of_wrenches_that_does_not_fit_is_named() -> None:
    chain = builtin_chain("panda")
    q, F = np.zeros((4, 7)), np.zeros((3, 6))
    with pytest.raises(InvalidOption, match=r"wrenches \(3, 6\) does not fit joints \(4, 7\)"):
        holding_torques(chain, q, F)


CHAINS = [
    *(symbolic_random_chain(seed, 1 + seed) for seed in range(8)),
    *(builtin_chain(name) for name in builtin_names()),
]


def ids(chain: object) -> str:
    return getattr(chain, "name", "")


@pytest.mark.parametrize("chain", CHAINS, ids=ids)
def test_equals_the_kernels_for_every_link(chain: Chain) -> None:
    symbols, point = casadi.SX.sym("q", chain.n), np.array([0.1, -0.2, 0.3])
    for link in chain.index:
        jacobian = casadi.Function("J", [symbols], [symbolic_jacobian(chain, symbols, link, point)])
        for q in random_state(chain, 1, 10)[0]:
            J = np.array(jacobian(q))
            np.testing.assert_allclose(J, geometric(chain, q, link, point), atol=1e-12, rtol=0)


@pytest.mark.parametrize("chain", CHAINS, ids=ids)
def test_frames_are_those_of_the_joints(chain: Chain) -> None:
    q = casadi.SX.sym("q", chain.n)
    frames = casadi.Function("frames", [q], symbolic_frames(chain, q))
    for value in random_state(chain, 2, 5)[0]:
        got = frames(value) if chain.n > 1 else [frames(value)]
        np.testing.assert_allclose(
            np.array([np.array(T) for T in got]), joint_frames(chain, value), atol=1e-12, rtol=0
        )


def test_faults_are_named() -> None:
    chain = symbolic_random_chain(0, 3)
    with pytest.raises(InvalidRobotState, match="3 joints"):
        symbolic_frames(chain, casadi.SX.sym("q", 2))
    with pytest.raises(InvalidLinkName, match="no link 'nowhere'"):
        symbolic_jacobian(chain, casadi.SX.sym("q", 3), "nowhere")
    with pytest.raises(InvalidOption, match="point"):
        symbolic_jacobian(chain, casadi.SX.sym("q", 3), point=[0.0, np.nan, 0.0])

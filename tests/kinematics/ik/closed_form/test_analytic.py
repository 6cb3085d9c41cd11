"""Closed forms, exact and calibrated: by pinocchio, dense search, symmetries and folds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidPose, InvalidRobotState, NotAvailable
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches, closed_form, parameter
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.inverse import inverse_kinematics
from kinematics.ik.numeric.numeric import SearchOptions, solve, solve_many
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.pose import (
    from_axis_angle,
    rotation_error,
    rotation_x,
    rotation_z,
    transform,
)
from kinematics.robots import builtin_chain
from tests.kinematics.ik.arms import (
    GENERAL,
    apart,
    arm_of,
    calibrated,
    edge_configuration,
    general_arm,
    reversed_arm,
    searched,
)
from tests.kinematics.ik.symmetries import distance, regular, regular_cases, wrapped
from tests.planning.pinocchio_arm import PinocchioArm

ARMS = ("ur5e", "kr6_sixx", "puma560", "elbow_wrist", "panda", "iiwa14")


FORMS = {
    "ur5e": ("three_parallel", False, None),
    "kr6_sixx": ("spherical", False, None),
    "puma560": ("spherical", False, None),
    "elbow_wrist": ("spherical", False, None),
    "panda": ("spherical", True, 6),
    "iiwa14": ("redundant", False, None),
}


def parameters(chain: Chain, q: Array) -> list[float] | None:
    form = structure(chain)
    return [parameter(chain, q)] if form is not None and form.redundant else None


@pytest.mark.parametrize("name", ARMS)
def test_forms_of_the_built_in_arms(name: str) -> None:
    form = closed_form(builtin_chain(name))
    assert (form.kind, form.reverse, form.locked) == FORMS[name]
    assert form.miss < 1e-12


@pytest.mark.parametrize("name", ARMS)
def test_every_pose_has_its_own_branch_and_all_are_right(name: str) -> None:
    chain = builtin_chain(name)
    arm = PinocchioArm(name)
    rng = np.random.default_rng(1)
    lower, upper = chain.sampling_bounds()
    for _ in range(150):
        q = rng.uniform(lower, upper)
        T = forward(chain, q)
        found = branches(chain, T, parameters=parameters(chain, q))
        assert apart(found.joints, q).min() < 1e-6
        assert found.within_limits[apart(found.joints, q).argmin()]
        labels = [found.label(i) for i in range(len(found.table))]
        assert len(set(labels)) == len(labels)
        for solution in found.joints:
            reached = arm.pose(solution)
            assert np.linalg.norm(reached[:3, 3] - T[:3, 3]) < 1e-9
            assert np.linalg.norm(rotation_error(reached[:3, :3], T[:3, :3])) < 1e-9


@pytest.mark.parametrize("name", ARMS)
def test_edge_poses_are_answered_inside_the_limits(name: str) -> None:
    chain = builtin_chain(name)
    rng = np.random.default_rng(2)
    for k in range(400):
        q = edge_configuration(chain, rng, k)
        T = forward(chain, q)
        found = branches(chain, T, parameters=parameters(chain, q))
        assert found.within_limits.any(), (name, q)
        inside = found.joints[found.within_limits]
        assert (inside >= chain.limits.lower).all()
        assert (inside <= chain.limits.upper).all()
        assert np.abs(forward(chain, found.joints) - T).max() < 2e-9
        # Where the arm is regular for its parameter, its own configuration is among them.
        J = geometric(chain, q)
        if chain.n == 6 and np.linalg.svd(J, compute_uv=False)[-1] > 1e-3:
            assert apart(found.joints, q).min() < 1e-6


@pytest.mark.parametrize("kind", [*GENERAL, "reversed spherical", "reversed three parallel"])
def test_general_arms_lose_nothing_that_search_finds(kind: str) -> None:
    rng = np.random.default_rng(3)
    compared = 0
    for _ in range(4):
        chain = general_arm(rng, kind.removeprefix("reversed "))
        if kind.startswith("reversed"):
            chain = reversed_arm(chain)
        form = structure(chain)
        assert form is not None
        assert form.reverse == kind.startswith("reversed")
        for k in range(3):
            q = rng.uniform(-np.pi, np.pi, 6)
            T = forward(chain, q)
            found = branches(chain, T)
            assert apart(found.joints, q).min() < 1e-6
            assert found.within_limits.all()
            compared += searched(chain, T, found.joints, k)
    assert compared > 20


def right_angles(rng: np.random.Generator, kind: int) -> Array:
    """Multiples of 45 degrees, zeros, or some multiples of 90 degrees."""
    q = rng.uniform(-np.pi, np.pi, 6)
    match kind % 3:
        case 0:
            return np.array(np.round(q / (np.pi / 4)) * np.pi / 4)
        case 1:
            return np.array(np.where(rng.random(6) < 0.6, 0.0, q))
        case _:
            return np.array(np.where(rng.random(6) < 0.5, rng.integers(-2, 3, 6) * np.pi / 2, q))


def lost(chain: Chain, q: Array) -> bool:
    """Whether the configuration's own branch is missing, or any that is answered is wrong."""
    T = forward(chain, q)
    found = branches(chain, T)
    if not len(found.table) or np.abs(forward(chain, found.joints) - T).max() > 3e-9:
        return True
    regular = np.linalg.svd(geometric(chain, q), compute_uv=False)[-1] > 1e-4
    return bool(regular and apart(found.joints, q).min() > 1e-6)


@pytest.mark.parametrize("kind", [*GENERAL, "reversed spherical", "reversed three parallel"])
def test_general_arms_at_right_angles(kind: str) -> None:
    rng = np.random.default_rng(6)
    for _ in range(20):
        chain = general_arm(rng, kind.removeprefix("reversed "))
        chain = reversed_arm(chain) if kind.startswith("reversed") else chain
        assert not [k for k in range(30) if lost(chain, right_angles(rng, k))]


@pytest.mark.parametrize("exponent", range(3, 13))
@pytest.mark.parametrize("kind", GENERAL[1:5])
def test_arms_that_are_nearly_special(kind: str, exponent: int) -> None:
    rng = np.random.default_rng(exponent)
    for _ in range(6):
        chain = general_arm(rng, kind)
        offsets = list(chain.offsets)
        for i in (1, 2):
            size = 10.0**-exponent
            turn = from_axis_angle(rng.normal(size=3), size * rng.uniform())
            offsets[i] = offsets[i] @ transform(turn, size * rng.normal(size=3))
        chain = arm_of(offsets, chain.tip.T_joint_link)
        assert not [k for k in range(30) if lost(chain, right_angles(rng, k))]


def test_families_of_one_name_are_all_answered() -> None:
    # Two arms reach the wrist point with the same signs; both leave the straight wrist free.
    def offset(alpha: float, a: float, d: float, theta: float) -> Array:
        return transform(rotation_x(alpha), [a, 0.0, 0.0]) @ transform(rotation_z(theta), [0, 0, d])

    right = np.pi / 2
    chain = arm_of(
        [
            offset(0.0, 0.0, 0.45, right), offset(0.0, 0.1, 0.45, 0.0), offset(right, 0.3, -0.2, 0),
            offset(right, 0.0, 0.45, right), offset(right, 0.0, 0.0, right),
            offset(right, 0.0, 0.0, 0.0),
        ],
        np.eye(4),
    )  # fmt: skip
    both = np.array([[0.0, 2.9376, -np.pi, 0.0, right, 0.2], [0.6, 0.5, 0.4, 0.0, right, 0.2]])
    for q in both:
        T = forward(chain, q)
        found = branches(chain, T, seed_joints=q)
        for other in solve(chain, T, SearchOptions(starts=60), solutions=12).solutions:
            assert apart(found.joints[:, :3], other.joints[:3]).min() < 0.02


def test_a_plane_arm_of_four_joints_answers_both_of_its_loops() -> None:
    # Axis 6 is parallel to axes 2 to 4: links of 0.3, 0.1 and 0.15 m close a loop over 0.3 m.
    up = rotation_x(np.pi / 2)
    links = [transform(None, [x, 0.0, 0.0]) for x in (0.3, 0.1)]
    links += [transform(up, [0.15, 0.0, 0.0]), transform(up)]
    chain = arm_of([np.eye(4), transform(up, [0.1, 0.0, 0.2]), *links], np.eye(4))
    rng, tried = np.random.default_rng(7), 0
    while tried < 20:
        q = np.array([*rng.uniform(-np.pi, np.pi, 4), 0.0, rng.uniform(-np.pi, np.pi)])
        span = 0.3 + 0.1 * np.exp(1j * q[2]) + 0.15 * np.exp(1j * (q[2] + q[3]))
        if not 0.26 < abs(span) < 0.34:
            continue
        tried += 1
        T = forward(chain, q)
        found = branches(chain, T).joints
        # The last link stands on either side of the line that the loop spans.
        line = np.exp(1j * q[1]) * span
        sides = np.imag(np.exp(1j * found[:, 1:4].sum(axis=1)) / line)
        near = np.isclose(np.cos(found[:, 0] - q[0]), 1.0)
        assert (sides[near] > 0.0).any()
        assert (sides[near] < 0.0).any()


def test_the_stretched_arm_and_the_target_on_axis_1() -> None:
    chain = builtin_chain("elbow_wrist")
    straight = np.array([0.4, 0.3, 0.0, 0.2, 0.0, -0.5])
    for q in (straight, np.array([0.4, np.pi / 2, 0.0, 0.2, 0.7, -0.5]), np.zeros(6)):
        T = forward(chain, q)
        # Seeds decide what a pose leaves open: the same angle of a free joint comes back.
        found = branches(chain, T, seed_joints=q)
        assert apart(found.joints, q).min() < 1e-6
        assert np.abs(forward(chain, found.joints) - T).max() < 1e-9


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_parameters_of_redundant_arms(name: str) -> None:
    chain = builtin_chain(name)
    rng = np.random.default_rng(5)
    lower, upper = chain.sampling_bounds()
    for _ in range(20):
        q = rng.uniform(lower, upper)
        T = forward(chain, q)
        wanted = [parameter(chain, q), 0.3, -1.1]
        found = branches(chain, T, parameters=wanted)
        for solution, value in zip(found.joints, found.parameter, strict=True):
            assert parameter(chain, solution) == pytest.approx(value, abs=1e-7)
        # A parameter that is named again, next to itself or not, has no branches more.
        again = branches(chain, T, parameters=[wanted[0], *wanted, *wanted[::-1]])
        np.testing.assert_array_equal(again.table, found.table)
        # The seed's own parameter is the one that is taken by itself.
        own = branches(chain, T, seed_joints=q)
        assert apart(own.joints, q).min() < 1e-6
        np.testing.assert_allclose(own.parameter, wanted[0], atol=1e-12)


@pytest.mark.parametrize("slides", [False, True])
def test_a_first_joint_that_is_held_stays_at_the_parameter(slides: bool) -> None:
    six = general_arm(np.random.default_rng(3), "spherical")
    mount = transform(from_axis_angle([1.0, 2.0, 3.0], 0.7), [0.2, -0.3, 0.4])
    chain = replace(
        six,
        joint_names=("rail", *six.joint_names),
        joint_types=np.array([int(slides), *six.joint_types]),
        offsets=np.concatenate([mount[None], six.offsets]),
        links=tuple(replace(k, joint=k.joint + 1 if k.joint >= 0 else -1) for k in six.links),
        limits=type(six.limits).unlimited(7),
        continuous=np.ones(7, dtype=np.bool_),
    )
    value = 0.45
    assert closed_form(chain).locked == 0
    q = np.array([value, 0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
    T = forward(chain, q)
    table = branches(chain, T, parameters=[value], seed_joints=q)
    assert np.abs(table.joints - q).max(axis=1).min() < 1e-8
    assert (table.joints[:, 0] == value).all()


@pytest.mark.parametrize("name", ["ur5e", "kr6_sixx"])
def test_joints_are_the_whole_turns_inside_the_limits_nearest_the_seed(name: str) -> None:
    rng = np.random.default_rng(8)
    for _ in range(40):
        bounds = np.sort(rng.uniform(-7.0, 7.0, (2, 6)), axis=0)
        chain = builtin_chain(name)
        chain = replace(chain, limits=replace(chain.limits, lower=bounds[0], upper=bounds[1]))
        q = rng.uniform(bounds[0], bounds[1])
        # Limits that cut a configuration off by rounding take it in.
        seed, q[rng.integers(6)] = rng.uniform(*bounds), bounds[rng.integers(2), 0]
        found = branches(chain, forward(chain, q), seed_joints=seed)
        for row, inside in zip(found.joints, found.within_limits, strict=True):
            turns = row + 2.0 * np.pi * np.arange(-4, 5)[:, None]
            fits = (turns >= bounds[0] - 1e-6) & (turns <= bounds[1] + 1e-6)
            assert inside == fits.any(axis=0).all()
            away = np.where(fits | ~fits.any(axis=0), np.abs(turns - seed), np.inf).min(axis=0)
            np.testing.assert_allclose(np.abs(row - seed), away, atol=1e-5)


@pytest.mark.parametrize("name", ["ur5e", "kr6_sixx", "puma560"])
def test_limits_a_hair_from_a_branch_lose_none(name: str) -> None:
    chain, rng = builtin_chain(name), np.random.default_rng(12)
    whole = np.full(6, 2.0 * np.pi)
    free = replace(chain, limits=replace(chain.limits, lower=-whole, upper=whole))
    for _ in range(60):
        T = forward(chain, rng.uniform(-3.0, 3.0, 6))
        every = branches(free, T).joints
        row, j = every[rng.integers(len(every))], rng.integers(6)
        hair = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-10.0, -5.0)
        upper = whole.copy()
        upper[j] = row[j] + hair
        found = branches(replace(free, limits=replace(free.limits, upper=upper)), T)
        turns = np.round((every[:, None] - found.joints) / (2.0 * np.pi))
        away = np.abs(every[:, None] - found.joints - 2.0 * np.pi * turns).max(axis=2)
        assert away.min(axis=1).max() < 1e-6
        fits = found.joints <= upper + 1e-9
        assert fits[found.within_limits].all()


def test_bad_input_is_named() -> None:
    chain = builtin_chain("ur5e")
    with pytest.raises(InvalidPose):
        branches(chain, np.full((4, 4), np.nan))
    with pytest.raises(InvalidPose):
        branches(chain, np.eye(3))
    with pytest.raises(InvalidRobotState, match="6 joints"):
        branches(chain, np.eye(4), seed_joints=[0.0])
    with pytest.raises(InvalidRobotState, match="finite"):
        branches(chain, np.eye(4), seed_joints=[np.nan] * 6)
    with pytest.raises(InvalidOption, match="parameters"):
        branches(chain, np.eye(4), parameters=[np.inf])
    with pytest.raises(NotAvailable, match="closed form"):
        branches(builtin_chain("scara"), np.eye(4))


NAMES = ("ur5e", "kr6_sixx")


def free_arm(name: str, size: float, seed: int = 0) -> Chain:
    """A robot whose axes miss its form by up to ``size`` [m], [rad], without limits."""
    chain = calibrated(builtin_chain(name), size, np.random.default_rng(seed))
    return arm_of(list(chain.offsets), chain.tip.T_joint_link)


@pytest.mark.parametrize("name", NAMES)
def test_the_branches_approach_those_of_the_exact_arm_as_the_miss_does(name: str) -> None:
    exact = builtin_chain(name)
    exact = arm_of(list(exact.offsets), exact.tip.T_joint_link)
    for q, _, _ in regular_cases(exact, 3, 3):
        T = forward(exact, q)
        expected = branches(exact, T).joints
        away = [distance(branches(free_arm(name, s), T).joints, expected) for s in (1e-4, 1e-6)]
        # The least singular value of a regular case is 1e-2: an error becomes a hundred times it.
        assert away[0] < 100 * 6e-4
        assert away[1] < 100 * 6e-6


def singular_configuration(chain: Chain, q: Array, joint: int) -> Array | None:
    """The configuration nearest to q along a joint at which the determinant vanishes."""

    def determinant(angle: float) -> float:
        moved = q.copy()
        moved[joint] = angle
        return float(np.linalg.det(geometric(chain, moved)))

    grid = q[joint] + np.linspace(-np.pi, np.pi, 73)
    values = [determinant(angle) for angle in grid]
    for i in np.argsort(np.abs(grid[:-1] - q[joint])):
        if values[i] * values[i + 1] < 0.0:
            moved = q.copy()
            moved[joint] = brentq(determinant, grid[i], grid[i + 1], xtol=1e-15)
            return moved
    return None


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("joint", [2, 4])
def test_a_configuration_at_a_fold_is_among_the_branches_of_its_pose(name: str, joint: int) -> None:
    chain, rng = free_arm(name, 1e-4), np.random.default_rng(4)
    tried = 0
    for _ in range(4):
        q = singular_configuration(chain, rng.uniform(-2.0, 2.0, 6), joint)
        if q is None:
            continue
        tried += 1
        assert np.linalg.svd(geometric(chain, q), compute_uv=False)[-1] < 1e-7
        T = forward(chain, q)
        table = branches(chain, T, seed_joints=q)
        assert np.abs(forward(chain, table.joints) - T).max() < 1e-8
        # Two branches meet there: rounding of the pose moves them by the root of it.
        assert np.abs(wrapped(table.joints - q)).max(axis=1).min() < 1e-3
    assert tried >= 2


@pytest.mark.parametrize("name", NAMES)
def test_the_same_question_has_the_same_answer(name: str) -> None:
    chain = free_arm(name, 1e-3)
    rng = np.random.default_rng(5)
    targets = forward(chain, rng.uniform(-2.0, 2.0, (6, 6)))
    batch = branches(chain, targets, threads=2)
    assert batch.counts is not None
    for k, T in enumerate(targets):
        once, twice = branches(chain, T), branches(chain, T)
        np.testing.assert_array_equal(once.table, twice.table)
        np.testing.assert_array_equal(batch.table[k, : batch.counts[k]], once.table)


@pytest.mark.parametrize("name", NAMES)
def test_no_branch_is_answered_twice(name: str) -> None:
    chain, rng = free_arm(name, 1e-3), np.random.default_rng(6)
    for _ in range(6):
        q = rng.uniform(-2.0, 2.0, 6)
        q[4] *= 0.01  # near the straight wrist
        joints = branches(chain, forward(chain, q)).joints
        for i, row in enumerate(joints):
            others = np.delete(joints, i, axis=0)
            if regular(chain, row, 1e-4) and len(others):
                assert np.abs(wrapped(others - row)).max(axis=1).min() > 1e-6


@pytest.mark.parametrize("size", [1e-12, 1e-7, 1e-4, 3e-3])
@pytest.mark.parametrize("name", ["ur5e", "kr6_sixx"])
def test_calibrated_arms_keep_their_branches(name: str, size: float) -> None:
    rng = np.random.default_rng(4)
    nominal = builtin_chain(name)
    compared = 0
    for _ in range(3):
        chain = calibrated(nominal, size, rng)
        form = closed_form(chain)
        assert form.kind == closed_form(nominal).kind
        for k in range(12):
            q = rng.uniform(-np.pi, np.pi, 6)
            T = forward(chain, q)
            found = branches(chain, T)
            assert found.position_error.max() < 1e-9
            assert found.orientation_error.max() < 1e-9
            assert apart(found.joints, q).min() < 1e-6
            if k > 1:
                continue
            compared += searched(chain, T, found.joints, k)
    assert compared > 20


@pytest.mark.parametrize("size", [1e-7, 1e-5, 1e-3])
@pytest.mark.parametrize("name", ["ur5e", "elbow_wrist"])
def test_calibrated_arms_keep_both_sides_of_a_fold(name: str, size: float) -> None:
    rng = np.random.default_rng(8)
    whole = np.full(6, np.pi)
    twins = 0
    for _ in range(4):
        chain = calibrated(builtin_chain(name), size, rng)
        chain = replace(chain, limits=replace(chain.limits, lower=-whole, upper=whole))
        for _ in range(4):
            q = rng.uniform(-np.pi, np.pi, 6)
            # Hardly bent: where the form has one branch, the true arm may have two.
            q[2] = (0.0 if name == "ur5e" else 0.5 * np.pi) + 10.0 ** rng.uniform(-4.0, -1.0)
            T = forward(chain, q)
            found = branches(chain, T).joints
            seeds = np.clip(q + rng.normal(size=(60, 6)) * 0.3, -np.pi, np.pi)
            search = solve_many(
                chain, np.tile(T, (60, 1, 1)), SearchOptions(0, 1, 1e-10, 1e-10),
                seed_joints=seeds, threads=1,
            )  # fmt: skip
            for other in search.joints[search.solved]:
                if np.linalg.svd(geometric(chain, other), compute_uv=False)[-1] > 1e-5:
                    assert apart(found, other).min() < 1e-4
                    twins += bool(1e-4 < apart(other[None], q)[0] < 0.3)
    assert twins > 20


@pytest.mark.parametrize("size", [1e-9, 1e-5, 1e-3])
@pytest.mark.parametrize("name", ["ur5e", "kr6_sixx", "iiwa14"])
def test_calibrated_arms_answer_edge_poses(name: str, size: float) -> None:
    rng = np.random.default_rng(12)
    for _ in range(3):
        chain = calibrated(builtin_chain(name), size, rng)
        for k in range(40):
            q = edge_configuration(chain, rng, k)
            T = forward(chain, q)
            found = inverse_kinematics(chain, T, seed_joints=q)
            assert found.solutions, q
            assert np.abs(forward(chain, found.solutions[0].joints) - T).max() < 3e-6


def twice_singular(rng: np.random.Generator) -> Array:
    """Three joints within 1e-9 to 0.1 rad of a right angle: wrist, shoulder, elbow at once."""
    q = rng.uniform(-np.pi, np.pi, 6)
    near = np.round(q / (np.pi / 2)) * np.pi / 2
    near += rng.choice([-1.0, 1.0], 6) * 10.0 ** rng.uniform(-9.0, -1.0, 6)
    which = rng.permutation(6)[:3]
    q[which] = near[which]
    return np.array(q)


@pytest.mark.parametrize("size", [1e-7, 1e-5, 1e-4, 1e-3, 3e-3])
@pytest.mark.parametrize("name", ["ur5e", "puma560", "elbow_wrist"])
def test_calibrated_arms_keep_their_branches_where_several_things_are_singular(
    name: str, size: float
) -> None:
    rng = np.random.default_rng(11)
    compared = 0
    for _ in range(5):
        chain = calibrated(builtin_chain(name), size, rng)
        for _ in range(6):
            q = twice_singular(rng)
            T = forward(chain, q)
            found = branches(chain, T).joints
            assert len(found), q
            assert np.abs(forward(chain, found) - T).max() < 3e-9
            J = geometric(chain, np.vstack([q, found]))
            least = np.linalg.svd(J, compute_uv=False)[:, -1]
            away = apart(found, q).min()
            # Nearer than its singular value can tell, two branches are one within 1e-9.
            if least[0] > 3e-7 and not (away < 0.02 and 0.25 * away * least[0] < 1.5e-9):
                assert away < 3e-5, q
            # Branches come and go in pairs whose determinants have opposite signs; two that are one
            # within 1e-9 have singular values below 1e-4.
            if least.min() > 1e-4:
                compared += 1
                assert np.sign(np.linalg.det(J[1:])).sum() == 0.0, q
    assert compared > 4

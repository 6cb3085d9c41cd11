"""From candidates to solutions: polish, poses before held joints, and the table of branches."""

from dataclasses import replace

import numpy as np
import pytest

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.frame import Frame
from kinematics.ik.closed_form.analytic import branches, closed_form, parameter
from kinematics.ik.closed_form.refine import (
    CODE,
    GROUP,
    INSIDE,
    MORE,
    VALUE,
    enter_kernel,
    fold_kernel,
    product_kernel,
    refine_kernel,
    size_kernel,
    tip_kernel,
)
from kinematics.ik.numeric.dls_step import frame_kernel
from kinematics.model.chain import Chain
from kinematics.pose import from_axis_angle, inverse, rotation_error, rotation_z, transform
from kinematics.robots import builtin_chain
from tests.kinematics.ik.arms import general_arm, reversed_arm
from tests.kinematics.samples import random_chain

Known = tuple[float, float, float, float, float, float]


@kernel
def entered_kernel(about: Known, q: Array, out: Array, count: int) -> int:
    """The new count of a table of branches."""
    return enter_kernel(about, q, out, count)


def frame(T: Array) -> Frame:
    """A transform as the kernels have it."""
    return tuple(float(x) for x in T[:3].flat)  # type: ignore[return-value]


def matrix(B: Frame) -> Array:
    """The transform of a frame."""
    return np.vstack([np.reshape(B, (3, 4)), [0.0, 0.0, 0.0, 1.0]])


def errors(chain: Chain, q: Array, T: Array) -> tuple[float, float]:
    """Distance and angle of the tip from a pose, by other means than the kernels'."""
    reached = forward(chain, q)
    away = np.linalg.norm(reached[:3, 3] - T[:3, 3])
    return float(away), float(np.linalg.norm(rotation_error(reached[:3, :3], T[:3, :3])))


# -------------------------------------------------------------------------------------- frames


def test_the_frame_of_a_link_is_that_of_forward_kinematics() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        chain = random_chain(rng, 5)
        q = rng.uniform(-3.0, 3.0, 5)
        for name, number in chain.index.items():
            found = matrix(tip_kernel(chain.model, q, number))
            np.testing.assert_allclose(found, forward(chain, q, name), atol=1e-14)


def test_products_of_frames_are_those_of_matrices() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        A, B = (
            transform(from_axis_angle(rng.normal(size=3), 2.0), rng.normal(size=3)) for _ in "ab"
        )
        np.testing.assert_allclose(matrix(product_kernel(frame(A), frame(B))), A @ B, atol=1e-14)
        np.testing.assert_array_equal(matrix(frame_kernel(A)), A)


def test_the_size_of_an_error_is_of_its_halves() -> None:
    assert size_kernel((3.0, 0.0, 4.0, 0.0, -5.0, 12.0)) == (5.0, 13.0)


def test_a_form_without_locked_joint_sees_the_pose_itself_or_its_inverse() -> None:
    chain = general_arm(np.random.default_rng(2), "spherical")
    q = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
    for arm in (chain, reversed_arm(chain)):
        form, T = closed_form(arm), forward(arm, q)
        expected = inverse(T) if form.reverse else T
        np.testing.assert_allclose(
            matrix(fold_kernel(form.plan, frame(T), 0.9)), expected, atol=1e-14
        )


@pytest.mark.parametrize("slides", [False, True])
def test_a_first_joint_that_is_held_is_taken_off_the_pose(slides: bool) -> None:
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
    form, value = closed_form(chain), 0.45
    assert form.locked == 0
    q = np.array([value, 0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
    T = forward(chain, q)
    motion = transform(None, [0, 0, value]) if slides else transform(rotation_z(value))
    expected = inverse(mount @ motion) @ T
    expected = inverse(expected) if form.reverse else expected
    np.testing.assert_allclose(
        matrix(fold_kernel(form.plan, frame(T), value)), expected, atol=1e-13
    )
    table = branches(chain, T, parameters=[value], seed_joints=q)
    assert np.abs(table.joints - q).max(axis=1).min() < 1e-8
    assert (table.joints[:, 0] == value).all()


def test_a_last_joint_that_is_held_is_taken_off_the_pose() -> None:
    chain = builtin_chain("panda")
    form = closed_form(chain)
    assert form.locked == 6
    rng = np.random.default_rng(4)
    lower, upper = chain.sampling_bounds()
    for q in rng.uniform(lower, upper, (10, 7)):
        T = forward(chain, q)
        motion = transform(rotation_z(q[6]))
        before = T @ inverse(chain.offsets[6] @ motion @ chain.tip.T_joint_link)
        expected = inverse(before) if form.reverse else before
        found = matrix(fold_kernel(form.plan, frame(T), float(q[6])))
        np.testing.assert_allclose(found, expected, atol=1e-13)
        assert parameter(chain, q) == q[6]


# -------------------------------------------------------------------------------------- polish


def polished(
    chain: Chain, T: Array, q: Array, held: int = -1, room: float = np.inf
) -> tuple[Array, tuple[float, float]]:
    """A configuration after damped steps within ``room`` of where it began, and its errors."""
    moved = q.copy()
    error = refine_kernel(
        chain.model, chain.index[chain.tip_link], frame(T), q - room, q + room, held, moved
    )
    return moved, error


@pytest.mark.parametrize("size", [1e-8, 1e-5, 1e-3, 1e-2])
@pytest.mark.parametrize("name", ["ur5e", "panda", "kr6_sixx"])
def test_polish_takes_a_near_configuration_onto_its_pose(name: str, size: float) -> None:
    chain, rng = builtin_chain(name), np.random.default_rng(5)
    lower, upper = chain.sampling_bounds()
    for goal in rng.uniform(0.6 * lower, 0.6 * upper, (8, chain.n)):
        T = forward(chain, goal)
        q, error = polished(chain, T, goal + size * rng.uniform(-1.0, 1.0, chain.n))
        assert max(error) < 1e-11
        assert errors(chain, q, T) == pytest.approx(error, abs=1e-12)


def test_polish_never_makes_an_error_larger_even_out_of_reach() -> None:
    chain, rng = builtin_chain("ur5e"), np.random.default_rng(6)
    for _ in range(10):
        q = rng.uniform(-2.0, 2.0, 6)
        T = forward(chain, q)
        T[:3, 3] *= 3.0
        moved, error = polished(chain, T, q)
        before, after = errors(chain, q, T), errors(chain, moved, T)
        assert np.hypot(*after) <= np.hypot(*before) + 1e-12
        assert after == pytest.approx(error, abs=1e-9)


def test_a_joint_that_is_held_stays_and_the_others_do_its_work() -> None:
    chain, rng = builtin_chain("panda"), np.random.default_rng(7)
    goal = np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.7, 0.4])
    T = forward(chain, goal)
    for held in range(7):
        start = goal + 1e-3 * rng.uniform(-1.0, 1.0, 7)
        q, error = polished(chain, T, start, held)
        assert q[held] == start[held]
        assert max(error) < 1e-10


def test_polish_stays_inside_its_bounds() -> None:
    chain = builtin_chain("ur5e")
    goal = np.array([0.3, -1.2, 1.4, -0.8, -1.1, 0.4])
    start = goal + 0.02
    q, error = polished(chain, forward(chain, goal), start, room=0.005)
    assert (np.abs(q - start) <= 0.005 + 1e-15).all()
    assert max(error) > 1e-4
    # The bound is used: without it, the joints end up at the goal.
    assert np.abs(polished(chain, forward(chain, goal), start)[0] - goal).max() < 1e-9


# ------------------------------------------------------------------------------------- the table


def known(inside: bool = True, code: int = 0, family: int = 0, value: float = 0.0) -> Known:
    """What is known of a branch."""
    return 0.0, 0.0, float(inside), float(code), float(family), value


def table_of(*rows: tuple[Known, float], size: int = 4) -> Array:
    """The table after entering configurations (x, x, x), cut to the rows that are filled."""
    out, count = np.zeros((size, 3 + MORE)), 0
    for about, x in rows:
        count = entered_kernel(about, np.full(3, x), out, count)
    return out[:count]


def test_a_configuration_is_entered_once() -> None:
    table = table_of((known(), 0.5), (known(), 0.5 + 9e-7), (known(code=3), 0.5), (known(), 0.51))
    assert table[:, 0].tolist() == [0.5, 0.51]


def test_a_millionth_of_a_radian_tells_configurations_apart() -> None:
    assert len(table_of((known(), 0.5), (known(), 0.5 + 1.1e-6))) == 2


def test_the_same_configuration_counts_anew_for_another_parameter() -> None:
    table = table_of((known(value=0.1), 0.5), (known(value=0.2), 0.5))
    assert table[:, 3 + VALUE].tolist() == [0.1, 0.2]


def test_of_a_family_the_first_member_inside_the_limits_stands_for_all() -> None:
    outside = known(inside=False, family=7)
    inside = known(inside=True, family=7)
    assert table_of((outside, 0.1), (outside, 0.2))[:, 0].tolist() == [0.1]
    assert table_of((outside, 0.1), (inside, 0.2), (inside, 0.3))[:, 0].tolist() == [0.2]
    assert table_of((inside, 0.1), (outside, 0.2))[:, 0].tolist() == [0.1]


def test_families_and_branches_of_other_numbers_are_apart() -> None:
    rows = [
        (known(family=f, code=c), 0.1 * (1 + i))
        for i, (f, c) in enumerate([(7, 0), (8, 0), (7, 1)])
    ]
    table = table_of(*rows)
    assert table[:, 3 + GROUP].tolist() == [7.0, 8.0, 7.0]
    assert table[:, 3 + CODE].tolist() == [0.0, 0.0, 1.0]


def test_a_full_table_takes_no_more_but_still_replaces() -> None:
    outside = known(inside=False, family=7)
    table = table_of((outside, 0.1), (known(), 0.2), (known(), 0.3), (known(family=7), 0.4), size=2)
    assert table[:, 0].tolist() == [0.4, 0.2]
    assert table[:, 3 + INSIDE].tolist() == [1.0, 1.0]

"""Methods, ranking, batches and singular cases of inverse kinematics."""

import itertools
import threading
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidPose, InvalidRobotState, NotAvailable
from kinematics.forward import forward
from kinematics.ik import batch
from kinematics.ik.batch import processors, shared
from kinematics.ik.closed_form.analytic import branches, parameter
from kinematics.ik.inverse import METHODS, IkOptions, inverse_kinematics, inverse_kinematics_batch
from kinematics.ik.ranking import margin, order, outside, whole_turns
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain, Limits
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.pose import transform
from kinematics.robots import builtin_chain
from tests.kinematics.ik.arms import apart, general_arm, random_joints
from tests.kinematics.ik.symmetries import wrapped

FAR = transform(None, [9.0, 0.0, 0.0])


# ------------------------------------------------------------------------------------- options


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"method": "newton"}, "no method 'newton'"),
        ({"method": "Analytic"}, "no method"),
        ({"ranking": "best"}, "best"),
        ({"most": 0}, "most must be 1"),
        ({"most": -3}, "most must be 1"),
        ({"method": "analytic", "axes": ("x", "y")}, "needs all axes"),
    ],
)
def test_wrong_options_are_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidOption, match=words):
        IkOptions(**values)


# ------------------------------------------------------------------------------------- methods


@pytest.mark.parametrize("name", ["ur5e", "panda", "iiwa14", "scara"])
def test_the_nearest_solution_to_the_configuration_itself_is_itself(name: str) -> None:
    chain = builtin_chain(name)
    for q in random_joints(chain, 10, 0):
        T = forward(chain, q)
        result = inverse_kinematics(chain, T, seed_joints=q)
        assert result.solutions
        assert np.abs(result.solutions[0].joints - q).max() < 1e-5
        assert result.nearest == result.solutions[0]


@pytest.mark.parametrize("name", ["ur5e", "panda", "kr6_sixx"])
@pytest.mark.parametrize("method", METHODS)
def test_every_method_reaches_the_pose_inside_the_limits(name: str, method: Any) -> None:
    chain = builtin_chain(name)
    for q in random_joints(chain, 5, 1):
        T = forward(chain, q)
        best = inverse_kinematics(chain, T, IkOptions(method=method)).solutions[0]
        assert np.abs(forward(chain, best.joints) - T).max() < 3e-6
        assert ((best.joints >= chain.limits.lower) & (best.joints <= chain.limits.upper)).all()
        assert (best.branch is None) == (method == "numeric")
        assert best.within_limits


def test_axes_that_do_not_count_are_left_to_the_search() -> None:
    chain = builtin_chain("ur5e")
    T = forward(chain, random_joints(chain, 1, 3)[0])
    best = inverse_kinematics(chain, T, IkOptions(axes=("x", "y", "z"))).solutions[0]
    assert best.branch is None
    assert np.abs(forward(chain, best.joints)[:3, 3] - T[:3, 3]).max() < 3e-6


@pytest.mark.parametrize("method", METHODS)
def test_out_of_reach_has_no_solution_but_a_nearest_attempt(method: Any) -> None:
    result = inverse_kinematics(builtin_chain("ur5e"), FAR, IkOptions(method=method))
    assert result.solutions == ()
    assert result.nearest.position_error > 7.0
    assert "beyond" in result.advice
    assert ("out of reach by 8.086 m" in result.advice) == (method != "numeric")


# ------------------------------------------------------------------------- several solutions


@pytest.mark.parametrize("most", [1, 2, 5, 100])
def test_as_many_solutions_as_wanted_the_best_first(most: int) -> None:
    chain = general_arm(np.random.default_rng(5), "spherical, axes 2 and 3 parallel")
    q = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
    T, seed = forward(chain, q), q + 0.2
    solutions = inverse_kinematics(chain, T, IkOptions(most=most), seed_joints=seed).solutions
    everything = inverse_kinematics(chain, T, IkOptions(most=100), seed_joints=seed).solutions
    assert len(solutions) == min(most, len(everything))
    away = [float(np.linalg.norm(s.joints - seed)) for s in solutions]
    assert away == sorted(away)
    for one, other in zip(solutions, everything, strict=False):
        np.testing.assert_array_equal(one.joints, other.joints)


def test_a_given_parameter_is_the_solutions_own() -> None:
    chain = builtin_chain("panda")
    q = random_joints(chain, 1, 7)[0]
    T = forward(chain, q)
    found = inverse_kinematics(chain, T, IkOptions(parameters=[q[6]], most=8)).solutions
    assert found
    assert all(parameter(chain, s.joints) == q[6] for s in found if s.branch is not None)


def test_bad_targets_and_seeds_are_refused_for_every_method() -> None:
    chain = builtin_chain("ur5e")
    for method in METHODS:
        options = IkOptions(method=method)
        for T in (np.eye(3), np.full((4, 4), np.nan)):
            with pytest.raises(InvalidPose):
                inverse_kinematics(chain, T, options)
        for seed in ([0.0], [np.nan] * 6):
            with pytest.raises(InvalidRobotState):
                inverse_kinematics(chain, np.eye(4), options, seed_joints=seed)


@pytest.mark.parametrize("robot", ["ur5e", "kr6_sixx", "panda", "iiwa14"])
@pytest.mark.parametrize(
    "options",
    [IkOptions(), IkOptions(ranking="limits"), IkOptions(method="analytic")],
    ids=["auto", "limits", "analytic"],
)
def test_closed_forms_answer_as_for_one_pose(robot: str, options: IkOptions) -> None:
    chain = builtin_chain(robot)
    # More poses than are tabulated at once.
    targets = forward(chain, random_joints(chain, 150, 1))
    near = random_joints(chain, 1, 2)[0]
    solutions = inverse_kinematics_batch(chain, targets, options, seed_joints=near)
    for T, solution in zip(targets, solutions, strict=True):
        assert solution is not None
        alone = inverse_kinematics(chain, T, options, seed_joints=near).solutions[0]
        assert np.array_equal(solution.joints, alone.joints)
        assert solution.branch == alone.branch
        assert np.abs(forward(chain, solution.joints) - T).max() < 1e-8


def test_the_search_answers_what_the_closed_form_does_not() -> None:
    chain = builtin_chain("scara")
    lower, upper = chain.limits.lower, chain.limits.upper
    targets = forward(chain, random_joints(chain, 20, 3))
    targets[7] = transform(None, [9.0, 0.0, 0.0])
    options = IkOptions(axes=("x", "y", "z", "rz"))
    solutions = inverse_kinematics_batch(chain, targets, options)
    assert solutions[7] is None
    for k, solution in enumerate(solutions):
        if k != 7:
            assert solution is not None
            assert ((solution.joints >= lower) & (solution.joints <= upper)).all()
            assert np.abs(forward(chain, solution.joints) - targets[k]).max() < 3e-6


def test_a_closed_form_alone_leaves_what_it_cannot_reach() -> None:
    chain = builtin_chain("ur5e")
    targets = np.array([forward(chain, np.full(6, 0.7)), transform(None, [9.0, 0.0, 0.0])])
    solutions = inverse_kinematics_batch(chain, targets, IkOptions(method="analytic"))
    assert solutions[0] is not None
    assert solutions[1] is None


@pytest.mark.parametrize(
    "options", [IkOptions(most=2), IkOptions(all_turns=True), IkOptions(outside_limits=True)]
)
def test_more_than_one_solution_a_pose_is_refused(options: IkOptions) -> None:
    with pytest.raises(InvalidOption, match="one solution inside the limits"):
        inverse_kinematics_batch(builtin_chain("ur5e"), np.eye(4)[None], options)


def test_poses_and_seeds_are_checked() -> None:
    chain = builtin_chain("ur5e")
    with pytest.raises(InvalidPose):
        inverse_kinematics_batch(chain, np.full((2, 4, 4), np.nan))
    with pytest.raises(InvalidRobotState):
        inverse_kinematics_batch(chain, np.eye(4)[None], seed_joints=[0.0])
    assert inverse_kinematics_batch(chain, np.empty((0, 4, 4))) == []


def slices(count: int, threads: int | None) -> list[tuple[int, int]]:
    """Begin and end of the parts in order."""
    parts: list[tuple[int, int]] = []
    shared(lambda part: parts.append((part.start, part.stop)), count, threads)
    return sorted(parts)


@given(st.integers(0, 3000), st.integers(1, 6))
def test_the_parts_are_the_whole_range_once(count: int, threads: int) -> None:
    parts = slices(count, threads)
    assert parts[0][0] == 0
    assert parts[-1][1] == count
    assert all(one[1] == other[0] for one, other in pairwise(parts))
    sizes = [end - begin for begin, end in parts]
    assert max(sizes) - min(sizes) <= 1
    assert len(parts) <= threads


def test_the_threads_are_those_of_the_processors_where_none_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(batch, "processors", lambda: 3)
    assert len(slices(10_000, None)) == 3
    assert len(slices(10_000, 0)) == 3


def test_the_parts_run_side_by_side_and_one_in_the_callers_thread() -> None:
    barrier, names = threading.Barrier(3, timeout=10.0), set()

    def part(_: slice) -> None:
        barrier.wait()  # nobody passes before all three are here
        names.add(threading.get_ident())

    shared(part, 300, 3)
    assert len(names) == 3
    assert threading.get_ident() in names


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_an_error_of_any_part_reaches_the_caller(failing: int) -> None:
    def part(some: slice) -> None:
        if some.start == failing * 100:
            raise ValueError(f"part {failing}")

    with pytest.raises(ValueError, match=f"part {failing}"):
        shared(part, 300, 3)


def test_processors_are_those_that_this_process_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    assert processors() >= 1
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {4, 7}, raising=False)
    assert processors() == 2
    monkeypatch.delattr("os.sched_getaffinity")
    monkeypatch.setattr("os.cpu_count", lambda: 5)
    assert processors() == 5
    monkeypatch.setattr("os.cpu_count", lambda: None)
    assert processors() == 1


def reached(chain: Chain, joints: Array, T: Array) -> bool:
    return bool(np.abs(forward(chain, joints) - T).max() < 2e-9)


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


def test_whole_turns_are_all_there_are() -> None:
    rng = np.random.default_rng(0)
    for name in ("ur5e", "kr6_sixx", "puma560", "scara", "stanford"):
        chain = builtin_chain(name)
        lower, upper = chain.limits.lower, chain.limits.upper
        for _ in range(20):
            q = rng.uniform(lower, upper)
            turning = chain.joint_types == 0
            turns = np.array(list(itertools.product((-2, -1, 0, 1, 2), repeat=chain.n)))
            copies = q + 2 * np.pi * turns * turning
            inside = ((copies >= lower) & (copies <= upper)).all(axis=1)
            expected = {tuple(row) for row in np.round(copies[inside], 9)}
            found = whole_turns(chain, q, 10_000)
            assert {tuple(np.round(row, 9)) for row in found} == expected
            assert len(found) == len(expected)
            distances = np.linalg.norm(found - q, axis=1)
            assert (np.diff(distances) >= -1e-12).all()
            np.testing.assert_array_equal(found[0], q)
            few = whole_turns(chain, q, 3)
            np.testing.assert_allclose(
                np.linalg.norm(few - q, axis=1), distances[: len(few)], atol=1e-12
            )


def test_whole_turns_outside_and_without_limits() -> None:
    chain = builtin_chain("planar_rr")
    assert len(whole_turns(chain, np.array([0.0, 3.0]), 10)) == 0
    pendulum = builtin_chain("cart_pendulum")
    assert len(whole_turns(pendulum, np.array([0.0, 1.0]), 10)) == 3
    assert len(whole_turns(pendulum, np.array([2.0, 1.0]), 10)) == 0


def test_orders_by_their_definitions() -> None:
    chain = builtin_chain("ur5e")
    seed = np.array([0.3, -1.0, 1.4, -0.7, -1.3, 0.2])
    joints = branches(chain, forward(chain, seed)).joints
    ranked = joints[order(chain, joints, "nearest", seed)]
    assert (np.diff(np.linalg.norm(ranked - seed, axis=1)) >= -1e-9).all()
    ranked = joints[order(chain, joints, "limits", seed)]
    assert (np.diff(margin(chain, ranked)) >= -1e-9).all()
    ranked = joints[order(chain, joints, "manipulability", seed)]
    volumes = np.sqrt([np.linalg.det(J @ J.T) for J in geometric(chain, ranked)])
    assert (np.diff(volumes) <= 1e-9).all()
    with pytest.raises(InvalidOption, match="best"):
        order(chain, joints, "best", seed)  # type: ignore[arg-type]
    assert "elbow" in str(outside(chain, np.array([0.0, 0.0, 4.0, 0.0, 0.0, 0.0])))
    assert outside(chain, np.zeros(6)) is None
    assert margin(builtin_chain("cart_pendulum"), np.array([[1.5, 9.0]])) == pytest.approx(1.0)


def test_all_solutions_with_whole_turns() -> None:
    chain = builtin_chain("ur5e")
    q = np.array([0.3, -1.0, 1.4, -0.7, -1.3, 0.2])
    T = forward(chain, q)
    eight = inverse_kinematics(chain, T, IkOptions(most=100)).solutions
    assert len(eight) == 8
    many = inverse_kinematics(
        chain, T, IkOptions(most=1000, all_turns=True), seed_joints=q
    ).solutions
    # Two whole turns of each joint but the elbow, which turns once.
    assert len(many) == 8 * 2**5
    assert len({tuple(np.round(s.joints, 6)) for s in many}) == len(many)
    assert np.abs(forward(chain, np.array([s.joints for s in many])) - T).max() < 1e-9
    distances = [np.linalg.norm(s.joints - q) for s in many]
    # Turns that are as far either way are equal but for rounding.
    assert np.diff(distances).min() >= -1e-12
    np.testing.assert_allclose(many[0].joints, q, atol=1e-9)


def test_solutions_outside_limits_come_last_and_say_so() -> None:
    chain = builtin_chain("puma560")
    q = np.array([2.7, -3.8, 3.8, 2.9, 1.7, -4.6])
    T = forward(chain, q)
    inside = inverse_kinematics(chain, T, IkOptions(most=100)).solutions
    every = inverse_kinematics(chain, T, IkOptions(most=100, outside_limits=True)).solutions
    assert len(every) == 8
    flags = [s.within_limits for s in every]
    assert flags == sorted(flags, reverse=True)
    assert sum(flags) == len(inside) < 8
    assert all(outside(chain, s.joints) is not None for s in every if not s.within_limits)
    assert len({s.branch for s in every}) == 8


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_redundant_arms_by_parameter_by_seed_and_all_around(name: str) -> None:
    chain = builtin_chain(name)
    rng = np.random.default_rng(2)
    lower, upper = chain.sampling_bounds()
    for _ in range(30):
        q = rng.uniform(lower, upper)
        T = forward(chain, q)
        near = inverse_kinematics(chain, T, seed_joints=q).solutions[0]
        np.testing.assert_allclose(near.joints, q, atol=1e-6)
        assert near.branch is not None
        analytic = inverse_kinematics(chain, T, IkOptions(method="analytic")).solutions
        assert analytic
        assert analytic[0].within_limits
        assert np.abs(forward(chain, analytic[0].joints) - T).max() < 2e-9
    many = inverse_kinematics(chain, T, IkOptions(most=500)).solutions
    assert len(many) > 8
    assert len({s.branch for s in many}) == len(many)
    for solution in many:
        assert apart(forward(chain, solution.joints).ravel(), T.ravel()) < 2e-9


def test_arms_without_a_closed_form_are_refused_by_its_method() -> None:
    with pytest.raises(NotAvailable):
        inverse_kinematics(builtin_chain("cart_pendulum"), np.eye(4), IkOptions(method="analytic"))


def test_a_joint_that_cannot_move_is_as_far_from_its_limits_as_it_will_be() -> None:
    chain = builtin_chain("ur5e")
    lower, upper = chain.limits.lower.copy(), chain.limits.upper.copy()
    lower[1] = upper[1] = 0.3
    lower[4], upper[4] = -np.inf, np.inf
    fixed = replace(chain, limits=replace(chain.limits, lower=lower, upper=upper))
    joints = np.tile(0.5 * (chain.limits.lower + chain.limits.upper), (3, 1))
    joints[:, 1] = 0.3
    joints[1, 4] = 100.0
    joints[2, 0] = chain.limits.upper[0]
    np.testing.assert_allclose(margin(fixed, joints), [0.0, 0.0, 1.0], atol=1e-12)
    unlimited = replace(chain, limits=Limits.unlimited(6))
    assert margin(unlimited, joints).tolist() == [0.0, 0.0, 0.0]


def test_costs_that_differ_by_rounding_keep_their_order() -> None:
    chain = builtin_chain("ur5e")
    seed = np.zeros(6)
    joints = np.array([np.full(6, 1.0 + 1e-15), np.full(6, 1.0), np.full(6, 0.5)])
    assert order(chain, joints, "nearest", seed).tolist() == [2, 0, 1]


def test_what_is_outside_a_limit_is_named_with_the_limit() -> None:
    chain = builtin_chain("ur5e")
    lower, upper = chain.limits.lower, chain.limits.upper
    assert outside(chain, lower) is None
    assert outside(chain, upper) is None
    for values, side in ((lower, -1.0), (upper, 1.0)):
        for j in range(6):
            q = 0.5 * (lower + upper)
            q[j] = values[j] + side * 1e-3
            said = outside(chain, q)
            assert said is not None
            assert repr(chain.joint_names[j]) in said


def test_a_slide_has_no_whole_turns() -> None:
    chain = builtin_chain("scara")
    slide = int(np.flatnonzero(chain.joint_types == 1)[0])
    q = 0.5 * (chain.limits.lower + chain.limits.upper)
    copies = whole_turns(chain, q, 100)
    assert len(copies) >= 1
    assert (copies[:, slide] == q[slide]).all()
    q[slide] = chain.limits.upper[slide] + 1e-3
    assert len(whole_turns(chain, q, 100)) == 0


def test_a_wrist_that_nearly_meets_axis_1_behind_small_offsets_is_reached() -> None:
    lengths, a1 = 0.6, 1e-3
    shapes = [(a1, 0.5, 0.3), (lengths, 0.0, 1e-4), (0.0, 0.5, 0.0), (0.0, -0.5, lengths),
              (0.0, 0.5, 0.0), (0.0, 0.0, 0.1)]  # fmt: skip
    rows = [DhRow("revolute", a=a, alpha=alpha * np.pi, d=d, lower=-np.pi, upper=np.pi)
            for a, alpha, d in shapes]  # fmt: skip
    chain = chain_from_dh("offsets", DhTable("standard", tuple(rows)))
    rng = np.random.default_rng(4)
    without = 0
    for _ in range(150):
        q = rng.uniform(-3.0, 3.0, 6)
        # The wrist is a1 + |w| cos(q2 + arg w) from axis 1 in the plane of the links.
        w = lengths * (1.0 + np.exp(1j * (q[2] - 0.5 * np.pi)))
        q[1] = rng.choice([-1, 1]) * np.arccos(np.clip(-a1 / abs(w), -1.0, 1.0)) - np.angle(w)
        q[1] = wrapped(q[1] + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-7.0, -4.0))
        T = forward(chain, q)
        without += len(branches(chain, T).joints) == 0
        solutions = inverse_kinematics(chain, T).solutions
        assert solutions
        found = forward(chain, solutions[0].joints)
        assert np.linalg.norm(found[:3, 3] - T[:3, 3]) < 1.1e-6
        assert np.abs(found[:3, :3] - T[:3, :3]).max() < 2e-6
    assert without > 10

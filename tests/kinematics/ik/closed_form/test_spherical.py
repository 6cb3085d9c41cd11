"""Spherical wrists and three parallel axes: names of branches, singular poses, arm angles."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward, joint_frames
from kinematics.ik.closed_form.analytic import branches, closed_form, parameter
from kinematics.ik.closed_form.structure import classify_wrist, structure
from kinematics.ik.closed_form.subproblem import circle_roots_kernel
from kinematics.model.chain import Chain
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.pose import inverse, rotation_x, transform
from kinematics.robots import builtin_chain, builtin_names
from tests.kinematics.ik import symmetries
from tests.kinematics.ik.arms import GENERAL, arm_of, general_arm, random_joints, reversed_arm
from tests.kinematics.ik.symmetries import distance, labels, regular_cases, wrapped

KINDS = [kind for kind in GENERAL if kind.startswith("spherical")]
ALL = [*GENERAL, "ur5e"]


def arm(kind: str, seed: int) -> Chain:
    """A random arm of a kind, or a built-in one."""
    if kind in GENERAL:
        return general_arm(np.random.default_rng(seed), kind)
    return builtin_chain(kind)


@pytest.mark.parametrize("kind", [kind for kind in ALL if kind != "three parallel"])
def test_the_names_signs_multiply_to_that_of_the_determinant(kind: str) -> None:
    chain = arm(kind, 2)
    ratios = set()
    for _, _, table in regular_cases(chain, 2, 8):
        signs = np.sign(symmetries.determinants(chain, table.joints))
        ratios |= {
            int(sign) * symmetries.product_of_signs(name)
            for sign, name in zip(signs, labels(table), strict=True)
        }
    assert len(ratios) == 1


@pytest.mark.parametrize("kind", [kind for kind in KINDS if "1 and 2 parallel" not in kind])
def test_the_sign_of_the_shoulder_is_the_side_of_the_wrist_that_joint_1_turned_to(
    kind: str,
) -> None:
    chain = general_arm(np.random.default_rng(2), kind)
    for _, _, table in regular_cases(chain, 2, 6):
        assert len(set(labels(table))) == len(table.table)
        for name, row in zip(labels(table), table.joints, strict=True):
            lever = symmetries.first_lever(chain, row, 4)
            assert ("shoulder+" in name) == (lever < 0.0)


@pytest.mark.parametrize("kind", ALL)
def test_the_arm_from_tip_to_base_has_the_same_branches_backwards(kind: str) -> None:
    chain = arm(kind, 14)
    back = reversed_arm(chain)
    assert closed_form(back).reverse
    for _, T, table in regular_cases(chain, 4, 4):
        other = branches(back, inverse(T))
        assert distance(other.joints, -table.joints[:, ::-1]) < 1e-8
        assert sorted(map(symmetries.product_of_signs, labels(other))) == sorted(
            map(symmetries.product_of_signs, labels(table))
        )


@pytest.mark.parametrize("kind", KINDS)
def test_a_straight_wrist_is_answered_at_the_seed_with_its_own_joints(kind: str) -> None:
    chain = general_arm(np.random.default_rng(8), kind)
    # Where axes 4 and 6 are one, which skew axes of a general wrist never are.
    offsets = chain.offsets.copy()
    offsets[5, :3, :3] = offsets[4, :3, :3].T
    chain = replace(chain, offsets=offsets)
    rng = np.random.default_rng(9)
    for _ in range(6):
        q = rng.uniform(-np.pi, np.pi, 6)
        q[4] = 0.0
        T = forward(chain, q)
        table = branches(chain, T, seed_joints=q)
        assert np.abs(forward(chain, table.joints) - T).max() < 1e-8
        assert np.abs(table.joints - q).max(axis=1).min() < 1e-6
        # Another seed has the same sum of angles, near its own.
        seed = q.copy()
        seed[3] += 0.7
        near = branches(chain, T, seed_joints=seed)
        row = near.joints[np.abs(near.joints[:, :3] - q[:3]).max(axis=1).argmin()]
        assert row[3] == pytest.approx(seed[3], abs=1e-6)
        assert row[3] + row[5] == pytest.approx(q[3] + q[5], abs=1e-6)


# ------------------------------------------------------------------------------------ pieces


def arm_angle(chain: Chain, q: Array) -> float:
    """The angle of the elbow's normal about the line from shoulder to wrist.

    It is counted from the horizontal across that line; the normal is axis 4, turned round on one
    side of the elbow.
    """
    F = joint_frames(chain, q)
    shoulder, wrist = F[1, :3, 3], F[5, :3, 3]
    s = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    r = np.cross([0.0, 0.0, 1.0], s)
    r = r / np.linalg.norm(r) if np.linalg.norm(r) > 1e-8 else np.array([0.0, 1.0, 0.0])
    z = np.sign(np.sin(q[3])) * F[3, :3, 2]
    return float(np.arctan2(z @ np.cross(s, r), z @ r))


def test_the_parameter_is_the_arm_angle() -> None:
    chain = builtin_chain("iiwa14")
    for q in random_joints(chain, 200, 0):
        assert wrapped(parameter(chain, q) - arm_angle(chain, q)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("bend", [None, 1e-2, 1e-4])
def test_branches_have_the_arm_angle_asked_for_and_reach_the_pose(bend: float | None) -> None:
    chain = builtin_chain("iiwa14")
    rng = np.random.default_rng(1)
    for q in random_joints(chain, 40, 2):
        if bend is not None:
            q[3], q[5] = bend, -bend  # near the stretched arm and the straight wrist
        T, psi = forward(chain, q), rng.uniform(-np.pi, np.pi)
        table = branches(chain, T, parameters=[psi], seed_joints=q)
        assert len(table.joints) == 8
        for row in table.joints:
            assert np.abs(forward(chain, row) - T).max() < 1e-9
            # Where the arm is stretched the elbow's plane is known as well as its bend.
            error = wrapped(arm_angle(chain, row) - psi)
            assert abs(error) < 1e-9 / (1.0 if bend is None else bend)


PARALLEL_KINDS = [kind for kind in GENERAL if kind.startswith("three parallel")]


def arms(seed: int) -> list[Chain]:
    """The UR5e and general arms with three parallel axes."""
    rng = np.random.default_rng(seed)
    return [builtin_chain("ur5e"), *(general_arm(rng, kind) for kind in PARALLEL_KINDS)]


@pytest.mark.parametrize("which", range(3))
def test_the_sign_of_the_shoulder_is_the_side_that_joint_1_turned_to(which: int) -> None:
    chain = arms(2)[which]
    for _, _, table in regular_cases(chain, 2, 6):
        for name, row in zip(labels(table), table.joints, strict=True):
            # Where axes 5 and 6 miss each other the sign is counted the other way.
            behind = symmetries.first_lever(chain, row, 5) < 0.0
            assert ("shoulder+" in name) == (behind if which < 2 else not behind)


def without_limits(chain: Chain) -> Chain:
    """The arm with two turns of every joint."""
    far = np.full(chain.n, 2.0 * np.pi)
    return replace(chain, limits=replace(chain.limits, lower=-far, upper=far))


@pytest.mark.parametrize("fifth", [0.0, np.pi])
def test_where_axis_6_is_parallel_too_the_seeds_own_member_is_answered(fifth: float) -> None:
    chain = without_limits(builtin_chain("ur5e"))
    rng = np.random.default_rng(7)
    for _ in range(20):
        q = rng.uniform(-np.pi, np.pi, 6)
        q[4] = fifth
        T = forward(chain, q)
        table = branches(chain, T, seed_joints=q)
        assert np.abs(forward(chain, table.joints) - T).max() < 1e-8
        assert np.abs(table.joints - q).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("fifth", [0.0, np.pi])
def test_a_family_has_a_member_inside_narrow_limits(fifth: float) -> None:
    # The seed's own member is outside; the member that is inside differs from it in many joints.
    chain = without_limits(builtin_chain("ur5e"))
    rng = np.random.default_rng(8)
    for _ in range(15):
        q = rng.uniform(-2.5, 2.5, 6)
        q[4] = fifth
        lower, upper = chain.limits.lower.copy(), chain.limits.upper.copy()
        lower[5], upper[5] = q[5] - 0.1, q[5] + 0.1
        narrow = replace(chain, limits=replace(chain.limits, lower=lower, upper=upper))
        seed = q.copy()
        seed[5] = np.clip(q[5] + 2.0, lower[5], upper[5])
        T = forward(narrow, q)
        table = branches(narrow, T, seed_joints=seed)
        assert table.within_limits.any()
        inside = table.joints[table.within_limits]
        assert (np.abs(inside[:, 5] - q[5]) <= 0.1 + 1e-9).all()


def table(rows: list[tuple[float, float, float]], kinds: str) -> Chain:
    types = {"R": "revolute", "P": "prismatic"}
    return chain_from_dh(
        "made",
        DhTable(
            "standard",
            tuple(
                DhRow(types[kind], a=a, alpha=alpha, d=d, lower=-2.0, upper=2.0)  # type: ignore[arg-type]
                for kind, (a, alpha, d) in zip(kinds, rows, strict=True)
            ),
        ),
    )


def meet(lines: list[tuple[Array, Array]]) -> bool:
    """Least squares: the point nearest to all lines lies on each."""
    projectors = [np.eye(3) - np.outer(z, z) for _, z in lines]
    total = np.sum(projectors, axis=0)
    if np.linalg.cond(total) > 1e10:
        return False
    right = np.sum([P @ o for P, (o, _) in zip(projectors, lines, strict=True)], axis=0)
    point = np.linalg.solve(total, right)
    away = [P @ (point - o) for P, (o, _) in zip(projectors, lines, strict=True)]
    return float(np.linalg.norm(away)) < 1e-5


@pytest.mark.parametrize("name", builtin_names())
def test_agrees_with_the_axes_at_random_configurations(name: str) -> None:
    chain = builtin_chain(name)
    random = np.random.default_rng(5)
    lower, upper = chain.sampling_bounds()
    spherical, parallel = chain.n >= 3, chain.n >= 3
    for frames in joint_frames(chain, random.uniform(lower, upper, (20, chain.n))):
        lines = [(frame[:3, 3], frame[:3, 2]) for frame in frames]
        revolute = chain.joint_types == 0
        spherical = spherical and bool(revolute[-3:].all()) and meet(lines[-3:])
        parallel = parallel and any(
            bool(revolute[i : i + 3].all())
            and all(
                np.linalg.norm(np.cross(lines[i][1], lines[k][1])) < 2e-6 for k in (i + 1, i + 2)
            )
            for i in range(chain.n - 2)
        )
    expected = "spherical" if spherical else "three_parallel" if parallel else "none"
    assert classify_wrist(chain) == expected


QUARTER = np.pi / 2
COILED = [(0.0, QUARTER, 0.0), (0.0, -QUARTER, 0.0), (0.0, 0.0, 0.0)]
TURNED_OVER = [(0.4, np.pi, 0.1), (0.3, 0.0, 0.0), (0.2, 0.0, 0.1)]


@pytest.mark.parametrize(("rows", "kinds", "wrist"), [
    ([(0, QUARTER, 0.3), (0, -QUARTER, 0.1), (0, 0, 0.2)], "RRR", "none"),  # two points of meeting
    (COILED, "RRR", "spherical"), (COILED, "RRP", "none"),
    (TURNED_OVER, "RRR", "three_parallel"), (TURNED_OVER, "RPR", "none"),
    ([(0.0, 0.0, 0.1)] * 3, "RRR", "three_parallel"),  # axes that coincide
    ([(0.4, 0.0, 0.0)], "R", "none"),
])  # fmt: skip
def test_wrists_of_tables(rows: list[tuple[float, float, float]], kinds: str, wrist: str) -> None:
    assert classify_wrist(table(rows, kinds)) == wrist


def leaning_wrist(tilt: float) -> Chain:
    """An arm whose axes 4, 5 and 6 meet, 4 and 5 at an angle."""
    chain = general_arm(np.random.default_rng(1), "spherical")
    offsets = chain.offsets.copy()
    offsets[4] = transform(rotation_x(tilt))
    return arm_of(list(offsets), chain.tip.T_joint_link)


@pytest.mark.parametrize(("tilt", "solvable"), [(0.04, False), (0.06, True), (np.pi - 0.04, False)])
def test_axes_that_are_nearly_one_make_no_wrist(tilt: float, solvable: bool) -> None:
    assert (structure(leaning_wrist(tilt)) is not None) == solvable


@pytest.mark.parametrize(("size", "solvable"), [(0.0, True), (4e-3, True), (2e-2, False)])
def test_axes_may_miss_their_meeting_point_by_millimetres(size: float, solvable: bool) -> None:
    chain = general_arm(np.random.default_rng(2), "spherical")
    offsets = chain.offsets.copy()
    offsets[5, :3, 3] = [size, 0.0, 0.0]
    form = structure(arm_of(list(offsets), chain.tip.T_joint_link))
    assert (form is not None) == solvable
    if form is not None:
        assert form.miss <= size + 1e-12
        assert (form.miss > 1e-4) == (size > 0.0)
        assert not form.redundant


def test_only_six_or_seven_joints_have_a_form() -> None:
    chain = general_arm(np.random.default_rng(3), "spherical")
    assert structure(arm_of(list(chain.offsets[:5]), np.eye(4))) is None
    assert structure(replace(chain, joint_types=np.array([0, 0, 1, 0, 0, 0]))) is None  # a slide
    eight = [*chain.offsets, transform(), transform()]
    assert structure(arm_of(eight, np.eye(4))) is None


@pytest.mark.parametrize("odd", [0.0, 1e-17, 1e-15, 1e-13, 1e-9, 1e-3, 1.0])
def test_zeros_on_the_circle_are_those_of_the_polynomial_in_exp_ix(odd: float) -> None:
    rng = np.random.default_rng(8)
    whole = np.array([0.0, 1.0, -1.0, 0.5])
    for k in range(400):
        phase, (one, two) = rng.uniform(-np.pi, np.pi), rng.uniform(-1.5, 1.5, 2)
        if k % 2:
            one = rng.choice(whole) + rng.choice([-1, 0, 1]) * 10.0 ** rng.uniform(-17, -1)
        # (y - one) (y - two) + odd sin(x - phase), with y = cos(x - phase); or y - one alone.
        c, s = np.cos(phase), np.sin(phase)
        square, line, rest = (0.0, 1.0, -one) if k % 5 == 0 else (1.0, -one - two, one * two)
        E = np.array([
            rest, line * c - odd * s, line * s + odd * c,
            square * c * c, 2.0 * square * c * s, square * s * s,
        ])  # fmt: skip
        roots = np.empty((8, 2))
        count = circle_roots_kernel(E, 1e-14, 0.0, np.empty((8, 6)), roots)
        c, s = roots[:count].T
        assert (
            np.abs(E @ [c**0, c, s, c * c, c * s, s * s]).max(initial=0.0) < 2e-12 * np.abs(E).max()
        )
        e, p, q, a, b, d = E
        w = np.roots([
            (a - d) / 4 - 0.25j * b, 0.5 * (p - 1j * q), e + (a + d) / 2, 0.5 * (p + 1j * q),
            (a - d) / 4 + 0.25j * b,
        ])  # fmt: skip
        angle = np.angle(w[np.abs(np.abs(w) - 1.0) < 1e-7])
        missed = [x for x in angle if np.hypot(c - np.cos(x), s - np.sin(x)).min(initial=9) > 1e-5]
        assert not missed

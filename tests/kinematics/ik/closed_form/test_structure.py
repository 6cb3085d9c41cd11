"""The wrist's class against its definition, checked on the axes at random configurations."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.ik.closed_form.structure import classify_wrist, structure
from kinematics.model.chain import Chain
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.pose import rotation_x, transform
from kinematics.robots import builtin_chain, builtin_names
from tests.kinematics.ik.arms import arm_of, general_arm

KNOWN = {
    "panda": "none",
    "ur5e": "three_parallel",
    "iiwa14": "spherical",
    "kr6_sixx": "spherical",
    "puma560": "spherical",
    "scara": "none",
    "stanford": "spherical",
    "planar_rr": "none",
    "cart_pendulum": "none",
    "elbow_wrist": "spherical",
}


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
def test_built_in_robots(name: str) -> None:
    assert classify_wrist(builtin_chain(name)) == KNOWN[name]


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


def test_three_axes_that_meet_in_two_points_are_no_wrist() -> None:
    right = np.pi / 2
    assert classify_wrist(table([(0, right, 0.3), (0, -right, 0.1), (0, 0, 0.2)], "RRR")) == "none"


def test_a_slide_in_the_wrist_is_none() -> None:
    right = np.pi / 2
    rows = [(0.0, right, 0.0), (0.0, -right, 0.0), (0.0, 0.0, 0.0)]
    assert classify_wrist(table(rows, "RRR")) == "spherical"
    assert classify_wrist(table(rows, "RRP")) == "none"


def test_antiparallel_axes_are_parallel() -> None:
    rows = [(0.4, np.pi, 0.1), (0.3, 0.0, 0.0), (0.2, 0.0, 0.1)]
    assert classify_wrist(table(rows, "RRR")) == "three_parallel"
    assert classify_wrist(table(rows, "RPR")) == "none"


def test_parallel_axes_that_coincide_are_no_spherical_wrist() -> None:
    rows = [(0.0, 0.0, 0.1), (0.0, 0.0, 0.1), (0.0, 0.0, 0.1)]
    assert classify_wrist(table(rows, "RRR")) == "three_parallel"


def test_short_chains_have_none() -> None:
    assert classify_wrist(table([(0.4, 0.0, 0.0)], "R")) == "none"


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
    eight = [*chain.offsets, transform(), transform()]
    assert structure(arm_of(eight, np.eye(4))) is None


def test_a_slide_among_the_six_has_no_form() -> None:
    chain = general_arm(np.random.default_rng(4), "spherical")
    types = np.zeros(6, dtype=np.int64)
    types[2] = 1
    assert structure(replace(chain, joint_types=types)) is None

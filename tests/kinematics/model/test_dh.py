"""Denavit-Hartenberg tables: which can be built; their definition, sympy and chains."""

import math
from collections.abc import Callable
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotDescription
from kinematics.forward import forward, joint_frames, link_poses
from kinematics.model.chain import MAX_JOINTS, Chain
from kinematics.model.dh import (
    PARALLEL_ANGLE,
    Convention,
    DhRow,
    DhTable,
    chain_from_dh,
    check_table,
    dh_from_chain,
    frame_origins,
)
from kinematics.pose import from_axis_angle, from_rpy, rotation_x, rotation_z, transform
from kinematics.rounding import TENSOR_TOLERANCE
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from tests.kinematics.ik.arms import arm_of
from tests.kinematics.samples import (
    Sample,
    configurations,
    random_chain,
    random_offset,
    random_rotation,
    samples,
)
from tests.planning.scenes import builtin

CONVENTIONS: tuple[Convention, ...] = ("standard", "modified")
#: A table holds d to half a unit in its 53rd binary digit, and a chain adds a few of them up.
ROUNDING_OF_D = 1e-15


def random_row(rng: np.random.Generator, **given: Any) -> DhRow:
    a, d = rng.uniform(-0.5, 0.5, 2)
    alpha, theta = rng.uniform(-3, 3, 2)
    kind: Any = rng.choice(["revolute", "prismatic"])
    values: dict[str, Any] = {"a": a, "alpha": alpha, "d": d, "theta": theta}
    return DhRow(kind, **(values | {"lower": -1.0, "upper": 1.0} | given))


def random_table(rng: np.random.Generator, convention: Convention) -> DhTable:
    rows = tuple(random_row(rng) for _ in range(rng.integers(1, 8)))
    ends = [transform(random_rotation(rng), rng.uniform(-1, 1, 3)) for _ in range(2)]
    return DhTable(convention, rows, *ends)


def stage(row: DhRow, q: float, convention: Convention) -> Array:
    """One H_i, multiplied out from its four motions."""
    theta = row.theta + (q if row.type == "revolute" else 0.0)
    d = row.d + (q if row.type == "prismatic" else 0.0)
    z = transform(rotation_z(theta)) @ transform(position=[0, 0, d])
    x = transform(position=[row.a, 0, 0]) @ transform(rotation_x(row.alpha))
    return z @ x if convention == "standard" else x @ z


def product(table: DhTable, q: Array) -> list[Array]:
    """Frames 0 to n and the tool, in the base frame."""
    frames = [table.base]
    for row, value in zip(table.rows, q, strict=True):
        frames.append(frames[-1] @ stage(row, float(value), table.convention))
    return [*frames, frames[-1] @ table.tool]


# ----------------------------------------------------------------------------- table to chain


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_frames_are_the_products(convention: Convention) -> None:
    rng = np.random.default_rng(30)
    for _ in range(60):
        table = random_table(rng, convention)
        chain = chain_from_dh("random", table)
        q = rng.uniform(-3, 3, chain.n)
        frames = product(table, q)
        for i in range(1, chain.n + 1):
            np.testing.assert_allclose(forward(chain, q, f"link_{i}"), frames[i], atol=1e-13)
        np.testing.assert_allclose(forward(chain, q), frames[-1], atol=1e-13)


def test_names_types_and_limits() -> None:
    rows = (
        DhRow("revolute", lower=-math.inf, upper=math.inf, velocity=2.0, effort=5.0),
        DhRow("prismatic", lower=0.0, upper=1.0, acceleration=3.0, jerk=4.0, motor_inertia=0.1),
        DhRow("revolute", lower=-1.0, upper=2.0, viscous_friction=0.2),
    )
    chain = chain_from_dh("three", DhTable("standard", rows, gravity=np.array([0, -9.8, 0])))
    assert chain.joint_names == ("joint_1", "joint_2", "joint_3")
    assert list(chain.index) == ["base", "link_1", "link_2", "link_3", "tool"]
    assert (chain.base_link, chain.tip_link) == ("base", "tool")
    assert list(chain.joint_types) == [0, 1, 0]
    assert list(chain.continuous) == [True, False, False]
    np.testing.assert_array_equal(chain.limits.upper, [math.inf, 1, 2])
    np.testing.assert_array_equal(chain.limits.velocity, [2, math.nan, math.nan])
    np.testing.assert_array_equal(chain.limits.jerk, [math.nan, 4, math.nan])
    np.testing.assert_array_equal(chain.motor_inertia, [0, 0.1, 0])
    np.testing.assert_array_equal(chain.viscous_friction, [0, 0, 0.2])
    np.testing.assert_array_equal(chain.gravity, [0, -9.8, 0])


def test_masses_are_in_the_frames_of_the_table() -> None:
    inertia = np.diag([0.1, 0.2, 0.25])
    row = DhRow(
        "revolute", 0.5, 0.3, lower=-1, upper=1, mass=2.0, center_of_mass=[-0.25, 0, 0],
        inertia=inertia,
    )  # fmt: skip
    chain = chain_from_dh("one", DhTable("standard", (row, DhRow("revolute", lower=0, upper=1))))
    link = chain.link("link_1")
    assert link.inertia is not None
    np.testing.assert_array_equal(link.inertia.tensor, inertia)
    T = link_poses(chain, [0.0, 0.0], ["link_1"])[0]
    center = T[:3, :3] @ link.inertia.center_of_mass + T[:3, 3]
    np.testing.assert_allclose(center, [0.25, 0, 0], atol=1e-15)
    assert chain.link("link_2").inertia is None
    point = chain_from_dh(
        "point", DhTable("modified", (DhRow("revolute", lower=0, upper=1, mass=1.0),))
    ).link("link_1")
    assert point.inertia is not None
    assert not point.inertia.tensor.any()


# ----------------------------------------------------------------------------- chain to table


def worst_error(chain: Chain, table: DhTable, q: Array) -> float:
    """Largest difference of the tip's pose, over what rounding of the table's d allows."""
    back = chain_from_dh("back", table)
    far = max(abs(row.d) for row in table.rows)
    error = np.abs(forward(chain, q) - forward(back, q)).max()
    return float(error / max(1e-12, ROUNDING_OF_D * far))


@pytest.mark.parametrize("sample", samples(), ids=lambda sample: sample.name)
@pytest.mark.parametrize("convention", CONVENTIONS)
def test_robots_keep_their_tip(sample: Sample, convention: Convention) -> None:
    chain = sample.chain()
    table = dh_from_chain(chain, convention)
    back = chain_from_dh("back", table)
    q = np.array(configurations(chain, 20))
    np.testing.assert_allclose(forward(back, q), forward(chain, q), atol=1e-12, rtol=0)
    np.testing.assert_array_equal(back.joint_types, chain.joint_types)
    np.testing.assert_array_equal(back.continuous, chain.continuous)
    for quantity in ("lower", "upper", "velocity", "acceleration", "jerk", "effort"):
        theirs = getattr(chain.limits, quantity)
        np.testing.assert_array_equal(getattr(back.limits, quantity), theirs)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_random_chains_keep_their_tip(convention: Convention) -> None:
    rng = np.random.default_rng(31)
    for _ in range(400):
        chain = random_chain(rng)
        q = rng.uniform(-2, 2, (3, chain.n))
        assert worst_error(chain, dh_from_chain(chain, convention), q) < 1.0


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("exponent", range(-17, 0))
def test_nearly_parallel_axes(convention: Convention, exponent: int) -> None:
    rng = np.random.default_rng(32)
    for flip in (np.eye(3), rotation_x(math.pi)):
        tilt = from_axis_angle(rng.normal(size=3), 10.0**exponent) @ flip
        offsets = [random_offset(rng), transform(tilt, [0.3, -0.2, 0.1]), random_offset(rng)]
        chain = arm_of(offsets, random_offset(rng))
        q = rng.uniform(-3, 3, (5, 3))
        table = dh_from_chain(chain, convention)
        assert worst_error(chain, table, q) < 1.0
        if exponent < -8 or exponent > -3:
            back = chain_from_dh("back", table)
            np.testing.assert_allclose(forward(back, q), forward(chain, q), atol=1e-12, rtol=0)
        # Whoever reads the four classical numbers only is off by no more than the tilt.
        poses = np.array([product(table, row)[-1] for row in q])
        np.testing.assert_allclose(poses, forward(chain, q), atol=2 * PARALLEL_ANGLE)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_classical_numbers_suffice_but_for_near_parallels(convention: Convention) -> None:
    rng = np.random.default_rng(33)
    for _ in range(100):
        offsets = [transform(random_rotation(rng), rng.uniform(-1, 1, 3)) for _ in range(5)]
        kinds, none = rng.integers(0, 2, 5), np.zeros(5, dtype=np.bool_)
        chain = replace(arm_of(offsets, offsets[0]), joint_types=kinds, continuous=none)
        q = rng.uniform(-3, 3, 5)
        table = dh_from_chain(chain, convention)
        assert all(row.beta == 0.0 and row.a >= 0.0 for row in table.rows)
        np.testing.assert_allclose(product(table, q)[-1], forward(chain, q), atol=1e-11)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_textbook_table_comes_back(convention: Convention) -> None:
    """An elbow arm with a spherical wrist: every case of the notes but the skew one."""
    half = math.pi / 2
    rows = tuple(
        DhRow("revolute", a, alpha, d, lower=-3, upper=3)
        for a, alpha, d in [
            (0.0, half, 0.4), (0.5, 0.0, 0.0), (0.0, half, 0.0),
            (0.0, -half, 0.35), (0.0, half, 0.0), (0.0, 0.0, 0.1),
        ]
    )  # fmt: skip
    table = DhTable("standard", rows)
    derived = dh_from_chain(chain_from_dh("elbow", table), convention)
    if convention == "modified":
        # The same arm has a and alpha one row later, and the last ones in the tool.
        expected = [(0.0, 0.0), *[(row.a, row.alpha) for row in rows[:-1]]]
        found = np.array([(row.a, row.alpha) for row in derived.rows])
        np.testing.assert_allclose(found, expected, atol=1e-12)
        return
    for before, after in zip(table.rows, derived.rows, strict=True):
        numbers = (after.a, after.alpha, after.d, after.theta, after.beta)
        wanted = (before.a, before.alpha, before.d, before.theta, 0.0)
        assert numbers == pytest.approx(wanted, abs=1e-12)
    np.testing.assert_allclose(derived.base, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(derived.tool, np.eye(4), atol=1e-12)


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("sample", samples()[:8], ids=lambda sample: sample.name)
def test_masses_move_alike(sample: Sample, convention: Convention) -> None:
    """Mass, centre and inertia about the base's origin of all that moves, in any configuration."""
    chain = sample.chain()
    back = chain_from_dh("back", dh_from_chain(chain, convention))
    for q in configurations(chain, 3):
        np.testing.assert_allclose(_spatial(chain, q), _spatial(back, q), atol=1e-10)


def _spatial(chain: Chain, q: Array) -> Array:
    """Mass, moment (3,) and inertia (3, 3) one after the other, shape (13,)."""
    mass, moment, tensor = 0.0, np.zeros(3), np.zeros((3, 3))
    for link, T in zip(chain.links, link_poses(chain, q), strict=True):
        if link.joint < 0 or link.inertia is None:
            continue
        m, R = link.inertia.mass, T[:3, :3]
        c = R @ link.inertia.center_of_mass + T[:3, 3]
        mass += m
        moment = moment + m * c
        tensor = tensor + R @ link.inertia.tensor @ R.T + m * (c @ c * np.eye(3) - np.outer(c, c))
    return np.concatenate([[mass], moment, tensor.ravel()])


def test_far_common_normals_keep_the_chain_small() -> None:
    """The table's frames may lie 100 km away, the frames of its joints may not."""
    tilt = transform(from_axis_angle([1, 0.3, 0], 1e-6), [0.3, 0.2, 0.1])
    chain = arm_of([np.eye(4), tilt], np.eye(4))
    for convention in CONVENTIONS:
        table = dh_from_chain(chain, convention)
        assert max(abs(row.d) for row in table.rows) > 1e5
        back = chain_from_dh("back", table)
        assert np.abs(back.offsets[:, :3, 3]).max() < 1.0


def test_tip_must_move_with_the_last_joint() -> None:
    chain = random_chain(np.random.default_rng(35), 3)
    with pytest.raises(InvalidRobotDescription, match="'link_1'"):
        dh_from_chain(replace(chain, tip_link="link_1"))


def row(a: float, d: float, alpha: float = 0.0, kind: str = "revolute") -> DhRow:
    return DhRow(kind, a=a, alpha=alpha, d=d, lower=-3.0, upper=3.0)  # type: ignore[arg-type]


def origins(chain: Chain, q: Array) -> Array:
    """O_i in the base frame, shape (n, 3)."""
    frames = joint_frames(chain, q)
    local = np.column_stack([frame_origins(chain), np.ones(chain.n)])
    return np.array([T @ place for T, place in zip(frames, local, strict=True)])[:, :3]


@pytest.mark.parametrize(
    ("name", "i", "distance"),
    [("puma560", 1, 0.2435), ("puma560", 3, 0.4331), ("stanford", 1, 0.154),
     ("elbow_wrist", 3, 0.4)],
)  # fmt: skip
def test_an_origin_is_on_the_common_normal_and_not_at_the_next_joint(
    name: str, i: int, distance: float
) -> None:
    chain = builtin(name).chain
    next_joint = joint_frames(chain, np.zeros(chain.n))[i, :3, 3]
    gap = np.linalg.norm(origins(chain, np.zeros(chain.n))[i - 1] - next_joint)
    assert gap == pytest.approx(distance, abs=5e-5)


@pytest.mark.parametrize("seed", range(20))
def test_a_table_has_the_origins_of_its_frames_as_forward_kinematics_has(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = tuple(
        row(
            rng.uniform(-0.5, 0.5),
            rng.uniform(-0.5, 0.5),
            float(rng.choice([0.0, math.pi / 2, -0.7, 1e-9])),
            kind,
        )
        for kind in rng.choice(["revolute", "prismatic"], rng.integers(1, 7))
    )
    chain = chain_from_dh("arm", DhTable("standard", rows, tool=transform(position=[0.1, 0, 0.2])))
    q = rng.uniform(-1.0, 1.0, chain.n)
    names = [f"link_{i + 1}" for i in range(chain.n - 1)]
    expected = [*link_poses(chain, q, names)[:, :3, 3], forward(chain, q)[:3, 3]]
    np.testing.assert_allclose(origins(chain, q), expected, atol=1e-14)


def test_of_a_modified_table_it_is_the_frame_on_the_next_axis() -> None:
    rows = (row(0.0, 0.4), row(0.3, 0.1, -0.5), row(0.2, 0.3, 0.8))
    chain = chain_from_dh("arm", DhTable("modified", rows, tool=transform(position=[0.1, 0, 0])))
    q = np.array([0.3, -0.4, 0.5])
    expected = [*link_poses(chain, q, ["link_2", "link_3", "tool"])[:, :3, 3]]
    np.testing.assert_allclose(origins(chain, q), expected, atol=1e-14)


def test_between_nearly_parallel_axes_the_next_joint_stands_for_an_origin_far_away() -> None:
    joint = (
        '<joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{0}"/>'
        '<origin xyz="0.4 0 0" rpy="1e-3 0 0"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint><link name="l{0}"/>'
    )
    joints = "".join(joint.format(i, i - 1) for i in (1, 2))
    # Axes 1 and 2 are 1e-3 rad from parallel and meet the plane across them 0.4 m apart in x and
    # 0.3 m apart in y: their common normal is 300 m away.
    urdf = f'<robot name="off"><link name="l0"/>{joints}</robot>'.replace("0.4 0 0", "0.4 0.3 0")
    chain = serial_chain(parse_urdf(urdf))
    assert abs(dh_from_chain(chain).rows[1].d) > 100.0
    np.testing.assert_allclose(frame_origins(chain)[0], chain.offsets[1][:3, 3], atol=1e-15)


def test_the_convention_is_part_of_the_content() -> None:
    """The frames of two tables of one row are told apart although the arms are the same."""
    rows = (row(0.0, 0.0),)
    standard, modified = (chain_from_dh("arm", DhTable(k, rows)) for k in ("standard", "modified"))
    assert standard.dh_convention == "standard"
    assert builtin("panda").chain.dh_convention is None
    assert standard.content_hash != modified.content_hash


ROW = DhRow("revolute", a=0.3, alpha=0.5, d=0.1, theta=-0.2, lower=-1.0, upper=2.0)


def table(*rows: DhRow, **changes: Any) -> DhTable:
    """A table of rows, or of the one above."""
    return DhTable("standard", rows or (ROW,), **changes)


def changes(name: str, value: float) -> Any:
    """One field of a row."""
    return {name: value}


def with_inertia(tensor: Any) -> DhTable:
    """A table whose row has a tensor."""
    return table(replace(ROW, mass=1.0, inertia=tensor))


def refused(wrong: DhTable, words: str) -> None:
    """See that no chain is made of a table, which is told with certain words."""
    with pytest.raises(InvalidRobotDescription, match=words):
        chain_from_dh("wrong", wrong)


FITTING: dict[str, Callable[[], DhTable]] = {
    "plain": table,
    "modified": lambda: DhTable("modified", (ROW,)),
    "prismatic": lambda: table(replace(ROW, type="prismatic")),
    "longest": lambda: table(*[ROW] * MAX_JOINTS),
    "unlimited": lambda: table(replace(ROW, lower=-math.inf, upper=math.inf)),
    "half open": lambda: table(replace(ROW, lower=0.0, upper=math.inf)),
    "a joint that stands still": lambda: table(replace(ROW, lower=0.5, upper=0.5)),
    "no speed limit": lambda: table(replace(ROW, velocity=math.inf)),
    "slow": lambda: table(replace(ROW, velocity=1e-12)),
    "massless": lambda: table(replace(ROW, mass=0.0)),
    "no friction": lambda: table(replace(ROW, viscous_friction=0.0, motor_inertia=0.0)),
    "point mass": lambda: table(replace(ROW, mass=1.0, center_of_mass=(0, 0, 1))),
    "turned base": lambda: table(base=transform(from_rpy([0.1, 0.2, 0.3]), [1.0, 2.0, 3.0])),
    "weightless": lambda: table(gravity=np.zeros(3)),
    "flat body": lambda: with_inertia(np.diag([1.0, 1.0, 0.0])),
    "no inertia": lambda: with_inertia(np.zeros((3, 3))),
}


@pytest.mark.parametrize("name", FITTING)
def test_tables_that_can_be_built_are_taken(name: str) -> None:
    check_table(FITTING[name]())


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_symmetry_and_sign_of_a_tensor_may_miss_by_the_tolerance(share: float) -> None:
    skew, negative = np.diag([2.0, 2.0, 2.0]), np.diag([2.0000001, 2.0, 0.0])
    skew[0, 1] = share * TENSOR_TOLERANCE * 2.0
    negative[2, 2] = -share * TENSOR_TOLERANCE * 2.0
    if share < 1.0:
        check_table(with_inertia(skew))
        check_table(with_inertia(negative))
    else:
        refused(with_inertia(skew), "not symmetric")
        refused(with_inertia(negative), "not positive semi-definite")


def test_a_tensor_that_is_negative_in_turned_axes_is_refused() -> None:
    R = from_rpy([0.4, -0.7, 1.1])
    refused(with_inertia(R @ np.diag([1.0, 1.0, -0.5]) @ R.T), "row 1 .*semi-definite")


@pytest.mark.parametrize("name", ["a", "alpha", "d", "theta", "beta"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_every_number_of_the_geometry_must_be_finite(name: str, value: float) -> None:
    refused(table(ROW, replace(ROW, **changes(name, value))), f"^{name} in row 2")


@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk", "effort"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_every_limit_must_be_positive(name: str, value: float) -> None:
    refused(table(ROW, ROW, replace(ROW, **changes(name, value))), f"^{name} in row 3 .*positive")


@pytest.mark.parametrize("name", ["mass", "motor_inertia", "viscous_friction"])
@pytest.mark.parametrize("value", [-1e-12, math.nan, math.inf])
def test_masses_and_motors_must_not_be_negative(name: str, value: float) -> None:
    refused(table(replace(ROW, **changes(name, value))), f"^{name} in row 1")


@pytest.mark.parametrize(
    ("lower", "upper"),
    [(1.0, 0.999), (math.inf, math.inf), (-math.inf, -math.inf), (math.nan, 1.0), (0.0, math.nan)],
)
def test_a_range_without_positions_is_refused(lower: float | None, upper: float | None) -> None:
    refused(table(replace(ROW, lower=lower, upper=upper)), "row 1 .*lower .*upper")


@pytest.mark.parametrize(
    "values",
    [
        {"center_of_mass": "abc"},
        {"center_of_mass": [0.0, 0.0]},
        {"center_of_mass": [[0.0], [0.0], [0.0]]},
        {"center_of_mass": [0.0, 0.0, math.inf]},
        {"center_of_mass": [None, 0.0, 0.0]},
        {"inertia": "diagonal"},
        {"inertia": [1.0, 1.0, 1.0]},
        {"inertia": np.eye(4)},
        {"inertia": [[1, 0, 0], [0, 1, 0], [0, 0]]},
        {"inertia": np.full((3, 3), math.nan)},
    ],
)
def test_hostile_mass_properties_are_refused_by_name(values: dict[str, Any]) -> None:
    refused(table(replace(ROW, mass=1.0, **values)), f"^{next(iter(values))} in row 1")


def test_mass_properties_without_a_mass_are_refused() -> None:
    refused(table(replace(ROW, inertia=np.eye(3))), "has inertia but no mass")
    refused(table(replace(ROW, center_of_mass=[0, 0, 0])), "has center_of_mass but no mass")


@pytest.mark.parametrize("name", ["base", "tool"])
@pytest.mark.parametrize(
    "T",
    [
        np.eye(3),
        np.full((4, 4), math.nan),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.diag([1.0, 1.0, 1.001, 1.0]),
        np.diag([1.0, 1.0, 1.0, 2.0]),
        np.eye(4) + np.eye(4, k=-3),
        transform(None, [0.0, 0.0, math.inf]),
    ],
)
def test_a_base_or_tool_that_is_no_rigid_motion_is_refused(name: str, T: Any) -> None:
    refused(table(**{name: T}), f"^{name} of the DH table")


def test_unknown_conventions_and_types_are_refused_with_those_there_are() -> None:
    for wrong, words in (
        (DhTable("usual", (ROW,)), "'usual'"),  # type: ignore[arg-type]
        (table(ROW, replace(ROW, type="helical")), "row 2 .*'helical'"),  # type: ignore[arg-type]
    ):
        with pytest.raises(InvalidRobotDescription, match=words) as error:
            chain_from_dh("wrong", wrong)
        assert "One of" in str(error.value.hint)


@pytest.mark.parametrize("count", [0, MAX_JOINTS + 1])
def test_the_number_of_rows_is_bounded(count: int) -> None:
    refused(DhTable("standard", (ROW,) * count), f"this one has {count}")


@pytest.mark.parametrize("gravity", [[0.0, 9.81], [0.0, 0.0, math.nan], [[0.0, 0.0, 9.81]]])
def test_gravity_is_three_finite_numbers(gravity: Any) -> None:
    refused(table(gravity=np.array(gravity)), "gravity")


def test_a_table_keeps_its_own_copies_and_cannot_be_changed() -> None:
    base, rows = np.eye(4), [ROW, ROW]
    made = DhTable("standard", rows, base=base)  # type: ignore[arg-type]
    base[0, 3] = 1.0
    rows.clear()
    assert len(made.rows) == 2
    assert made.base[0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        made.tool[0, 3] = 1.0
    with pytest.raises(FrozenInstanceError):
        made.convention = "modified"  # type: ignore[misc]

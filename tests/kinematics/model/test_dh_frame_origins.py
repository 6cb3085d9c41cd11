"""Origins O_i of Denavit-Hartenberg frames against tables multiplied out row by row."""

import math

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward, joint_frames, link_poses
from kinematics.model.chain import Chain
from kinematics.model.dh import DhRow, DhTable, chain_from_dh, dh_from_chain, frame_origins
from kinematics.pose import rotation_x, rotation_y, rotation_z, transform
from kinematics.robots import builtin_names
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from tests.planning.scenes import builtin


def row(a: float, d: float, alpha: float = 0.0, kind: str = "revolute") -> DhRow:
    return DhRow(kind, a=a, alpha=alpha, d=d, lower=-3.0, upper=3.0)  # type: ignore[arg-type]


def origins(chain: Chain, q: Array) -> Array:
    """O_i in the base frame, shape (n, 3)."""
    frames = joint_frames(chain, q)
    local = np.column_stack([frame_origins(chain), np.ones(chain.n)])
    return np.array([T @ place for T, place in zip(frames, local, strict=True)])[:, :3]


def multiplied_out(table: DhTable, q: Array) -> Array:
    """Origins of the frames of a standard table, the tool's instead of the last, shape (n, 3)."""
    T, places = table.base, []
    for r, value in zip(table.rows, q, strict=True):
        theta, d = (r.theta + value, r.d) if r.type == "revolute" else (r.theta, r.d + value)
        x_part = transform(rotation_x(r.alpha) @ rotation_y(r.beta), [r.a, 0.0, 0.0])
        T = T @ transform(rotation_z(theta), [0.0, 0.0, d]) @ x_part
        places.append(T[:3, 3])
    return np.array([*places[:-1], (T @ table.tool)[:3, 3]])


def test_two_parallel_axes_have_their_origins_at_the_height_of_the_table() -> None:
    chain = chain_from_dh("rr", DhTable("standard", (row(0.3, 0.4), row(0.2, 0.1))))
    np.testing.assert_allclose(
        origins(chain, np.zeros(2)), [[0.3, 0.0, 0.4], [0.5, 0.0, 0.5]], atol=1e-15
    )


@pytest.mark.parametrize("name", builtin_names())
def test_built_in_robots_have_the_origins_of_their_own_table(name: str) -> None:
    chain = builtin(name).chain
    table = dh_from_chain(chain)
    for q in np.random.default_rng(1).uniform(*chain.sampling_bounds(), size=(5, chain.n)):
        np.testing.assert_allclose(origins(chain, q), multiplied_out(table, q), atol=1e-12)


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

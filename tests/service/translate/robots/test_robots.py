"""Robots from the wire and back: tables, descriptions, limits, solids, and what is odd."""

import base64
from typing import Any

import numpy as np
import pytest

from armwright_wire.robots.robot import RobotBody
from kinematics.errors import ArmwrightError, InvalidRobotDescription
from kinematics.forward import forward
from service.translate.robots.robots import built_in, dh_table, robot, robot_answer
from tests.service.robots import ACCELERATIONS, bench, urdf

ROW: dict[str, Any] = {
    "type": "revolute", "a": 0.5, "alpha": 0.3, "d": 0.1, "theta": 0.2, "lower": -2.0,
    "upper": 3.0, "velocity": 1.0, "acceleration": 2.0,
}  # fmt: skip
SLIDE = ROW | {"type": "prismatic", "d": 0.4, "velocity": 0.5}


def table(*rows: dict[str, Any], **fields: Any) -> RobotBody:
    """A robot from a table; fields of the table have the prefix `dh_`."""
    dh = {"convention": "standard", "rows": list(rows)}
    dh |= {name.removeprefix("dh_"): fields.pop(name) for name in [*fields] if name[:3] == "dh_"}
    return RobotBody.model_validate({"name": "arm", "dh": dh} | fields)


def standard(a: float, alpha: float, d: float, theta: float) -> Any:
    """Rot_z(theta) Trans_z(d) Trans_x(a) Rot_x(alpha)."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    )


def modified(a: float, alpha: float, d: float, theta: float) -> Any:
    """Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d)."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [[c, -s, 0, a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca], [0, 0, 0, 1]]
    )


@pytest.mark.parametrize(("convention", "link"), [("standard", standard), ("modified", modified)])
def test_a_table_is_the_product_of_its_rows(convention: str, link: Any) -> None:
    geometry, _ = robot(table(ROW, SLIDE, dh_convention=convention))
    q = np.array([0.7, 0.25])
    first = link(ROW["a"], ROW["alpha"], ROW["d"], ROW["theta"] + q[0])
    second = link(SLIDE["a"], SLIDE["alpha"], SLIDE["d"] + q[1], SLIDE["theta"])
    np.testing.assert_allclose(forward(geometry.chain, q), first @ second, atol=1e-12)


def test_base_and_tool_stand_before_and_behind_the_rows() -> None:
    base, tool = {"position": [1.0, 2.0, 3.0]}, {"position": [0.0, 0.0, 0.2], "rpy": [0.1, 0, 0]}
    plain, _ = robot(table(ROW))
    framed, _ = robot(table(ROW, dh_base=base, dh_tool=tool))
    q = np.array([0.4])
    T_base, T_tool = np.eye(4), np.eye(4)
    T_base[:3, 3], T_tool[:3, 3] = base["position"], tool["position"]
    c, s = np.cos(0.1), np.sin(0.1)
    T_tool[1:3, 1:3] = [[c, -s], [s, c]]
    expected = T_base @ forward(plain.chain, q) @ T_tool
    np.testing.assert_allclose(forward(framed.chain, q), expected, atol=1e-12)


def test_gravity_is_that_of_the_request_or_of_the_earth() -> None:
    np.testing.assert_allclose(robot(table(ROW))[0].chain.gravity, [0.0, 0.0, -9.81], atol=0.01)
    moon = robot(table(ROW, dh_gravity=[0.0, 1.62, 0.0]))[0]
    np.testing.assert_array_equal(moon.chain.gravity, [0.0, 1.62, 0.0])


def test_limits_of_joints_replace_those_of_the_rows() -> None:
    limits = {"joint_2": {"velocity": 9.0, "jerk": 7.0}}
    chain = robot(table(ROW, SLIDE, joint_limits=limits))[0].chain
    np.testing.assert_array_equal(chain.limits.velocity, [1.0, 9.0])
    np.testing.assert_array_equal(chain.limits.acceleration, [2.0, 2.0])
    assert np.isnan(chain.limits.jerk[0]) or np.isinf(chain.limits.jerk[0])
    assert chain.limits.jerk[1] == 7.0
    np.testing.assert_array_equal(chain.limits.lower, [-2.0, -2.0])
    with pytest.raises(InvalidRobotDescription, match="'elbow', which the table") as refused:
        dh_table(table(ROW, SLIDE, joint_limits={"elbow": {"velocity": 1.0}}))
    assert refused.value.hint == "Its joints are: joint_1, joint_2."


def test_only_a_table_is_a_table() -> None:
    assert dh_table(RobotBody.model_validate(bench("b"))) is None
    made = dh_table(table(ROW))
    assert made is not None
    assert len(made.rows) == 1


def test_a_limit_that_plans_need_is_missed_in_words() -> None:
    unknown = {key: value for key, value in ROW.items() if key != "acceleration"}
    _, lint = robot(table(ROW, unknown))
    assert any("no acceleration limit is known for joint_2:" in line for line in lint)
    assert not any("velocity limit" in line for line in lint)
    assert robot(table(ROW))[1] == [] or not any(
        "limit is known" in s for s in robot(table(ROW))[1]
    )


def test_links_of_a_table_have_their_own_names() -> None:
    with pytest.raises(InvalidRobotDescription, match="the base of a DH table is"):
        robot(table(ROW, base_link="floor"))
    chain = robot(table(ROW, SLIDE))[0].chain
    assert robot(table(ROW, base_link=chain.base_link))[0].chain.base_link == chain.base_link
    first = next(link.name for link in chain.links if link.joint == 0)
    assert robot(table(ROW, SLIDE, tip_link=first))[0].chain.tip_link == first
    with pytest.raises(ArmwrightError, match="nowhere"):
        robot(table(ROW, tip_link="nowhere"))


def test_solids_of_rows_and_capsules_of_all_links() -> None:
    ball = {"shape": {"type": "sphere", "radius": 0.1}, "pose": {"position": [0.0, 0.0, 0.05]}}
    assert robot(table(ROW))[0].pieces == ()
    with_ball = robot(table(ROW | {"geometry": [ball]}))[0]
    (piece,) = with_ball.pieces
    assert piece.bounding_sphere()[1] == pytest.approx(0.1)
    capsules = robot(table(ROW, SLIDE, dh_geometry={"capsules": 0.05}))[0]
    assert len(capsules.pieces) >= 2
    empty = {"type": "mesh", "stl_base64": base64.b64encode(b"solid nothing").decode()}
    wrong = ROW | {"geometry": [ball, {"shape": empty}]}
    with pytest.raises(InvalidRobotDescription, match=r"dh\.rows\[1\]\.geometry\[1\]"):
        robot(table(ROW, wrong))


# ------------------------------------------------------------------------------ descriptions


def test_a_description_has_its_meshes_and_limits() -> None:
    geometry, lint = robot(RobotBody.model_validate(bench("bench")))
    chain = geometry.chain
    assert chain.name == "bench"
    assert chain.joint_names == ("shoulder", "elbow")
    np.testing.assert_array_equal(chain.limits.acceleration, [5.0, 5.0])
    assert set(geometry.links) == {"lower", "upper"}
    assert not any("acceleration" in line for line in lint)
    _, bare = robot(RobotBody.model_validate(bench("bench", joint_limits=None)))
    assert any("no acceleration limit is known for shoulder, elbow" in line for line in bare)


def test_a_mesh_that_is_not_there_is_named() -> None:
    body = RobotBody.model_validate(bench("bench", urdf=urdf("package://meshes/other.obj")))
    with pytest.raises(InvalidRobotDescription, match=r"other\.obj"):
        robot(body)


def test_a_limit_of_an_unknown_joint_is_refused() -> None:
    limits = ACCELERATIONS | {"wrist": {"velocity": 1.0}}
    with pytest.raises(InvalidRobotDescription, match="wrist"):
        robot(RobotBody.model_validate(bench("bench", joint_limits=limits)))


# ------------------------------------------------------------------------------------ back


def test_an_answer_gives_the_table_as_it_was_given() -> None:
    ball = {"shape": {"type": "sphere", "radius": 0.1}}
    body = table(ROW | {"geometry": [ball]}, SLIDE, dh_geometry={"capsules": 0.05})
    geometry, lint = robot(body)
    answer = robot_answer(geometry, lint, "arm", is_built_in=False, body=body)
    assert answer.dh is not None
    assert answer.dh.convention == "standard"
    for row, given in zip(answer.dh.rows, (ROW, SLIDE), strict=True):
        assert {name: getattr(row, name) for name in ("type", "a", "alpha", "d", "theta")} == {
            name: given[name] for name in ("type", "a", "alpha", "d", "theta")
        }
    assert answer.dh.rows[0].geometry is not None
    assert answer.dh.rows[1].geometry is None
    assert answer.dh.geometry is not None
    assert answer.joint_types == ["revolute", "prismatic"]
    assert answer.limits.lower == [-2.0, -2.0]
    assert answer.limits.jerk == [None, None]
    assert answer.hash == geometry.content_hash
    assert (answer.name, answer.built_in) == ("arm", False)


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara", "planar_rr"])
def test_a_table_derived_from_a_description_is_the_same_arm(name: str) -> None:
    geometry, lint = built_in(name)
    answer = robot_answer(geometry, lint, name, is_built_in=True)
    assert answer.built_in
    assert answer.dh is not None
    again = {
        "convention": answer.dh.convention,
        "rows": [
            row.model_dump(exclude={"geometry"}) | {"lower": -3.0, "upper": 3.0}
            for row in answer.dh.rows
        ],
        "base": answer.dh.base.model_dump(),
        "tool": answer.dh.tool.model_dump(),
    }
    twin, _ = robot(RobotBody.model_validate({"name": "twin", "dh": again}))
    rng = np.random.default_rng(4)
    for q in rng.uniform(-1.0, 1.0, (5, geometry.chain.n)):
        np.testing.assert_allclose(forward(twin.chain, q), forward(geometry.chain, q), atol=1e-9)


def test_pairs_that_may_touch_come_with_their_reasons() -> None:
    geometry, lint = built_in("panda")
    answer = robot_answer(geometry, lint, "panda", is_built_in=True)
    assert len(answer.allowed_collisions) == len(answer.allowed_collision_reasons)
    pairs = [tuple(pair) for pair in answer.allowed_collisions]
    reasons = answer.allowed_collision_reasons
    assert dict(zip(pairs, reasons, strict=True)) == dict(geometry.allowed)
    with pytest.raises(ArmwrightError, match="nobody"):
        built_in("nobody")


def test_massless_links_are_told_where_a_later_one_has_mass() -> None:
    heavy = ROW | {"mass": 1.0}
    _, lint = robot(table(ROW, heavy))
    assert "the links of joint_1 have no inertia: they are massless in the dynamics" in lint
    for rows in ((heavy, heavy), (ROW, ROW)):
        _, lint = robot(table(*rows))
        assert not any("massless" in line for line in lint)


def test_joints_that_carry_no_inertia_are_told() -> None:
    heavy = ROW | {"mass": 1.0}
    _, lint = robot(table(heavy, ROW))
    assert any(line.startswith("nothing at or beyond joint_2 has an inertia") for line in lint)
    _, lint = robot(table(heavy, ROW | {"motor_inertia": 0.1}))
    assert not any("nothing at or beyond" in line for line in lint)

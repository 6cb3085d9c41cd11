"""Robots from the wire and back: tables, descriptions, limits, solids, and what is odd."""

from typing import Any

import numpy as np
import pytest

from armwright_wire.robots.robot import RobotBody
from kinematics.errors import ArmwrightError, InvalidRobotDescription
from service.translate.robots.robots import dh_table, robot

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


def test_links_of_a_table_have_their_own_names() -> None:
    with pytest.raises(InvalidRobotDescription, match="the base of a DH table is"):
        robot(table(ROW, base_link="floor"))
    chain = robot(table(ROW, SLIDE))[0].chain
    assert robot(table(ROW, base_link=chain.base_link))[0].chain.base_link == chain.base_link
    first = next(link.name for link in chain.links if link.joint == 0)
    assert robot(table(ROW, SLIDE, tip_link=first))[0].chain.tip_link == first
    with pytest.raises(ArmwrightError, match="nowhere"):
        robot(table(ROW, tip_link="nowhere"))


# ------------------------------------------------------------------------------ descriptions


# ------------------------------------------------------------------------------------ back


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

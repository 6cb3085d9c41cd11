"""Constraints from the wire: every form by its residuals, and faults by their number."""

import math
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from armwright_wire.goals.constraint import Constraints, ConstraintUse
from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidLinkName
from kinematics.forward import forward
from kinematics.pose import from_axis_angle, to_quaternion
from kinematics.robots import builtin_chain
from planning.constraints.kinds.constraint import JointConstraint
from service.translate.constraints import constraint_set, uses

CHAIN = builtin_chain("panda")
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
TIP = forward(CHAIN, HOME)
P, R = TIP[:3, 3], TIP[:3, :3]
BODIES: TypeAdapter[Any] = TypeAdapter(Constraints)


def residuals(*bodies: dict[str, Any]) -> Any:
    made = constraint_set(BODIES.validate_python(list(bodies)), CHAIN)
    assert made is not None
    return made.residuals(HOME)


def at(point: Any) -> list[float]:
    return [float(x) for x in point]


def test_without_constraints_there_is_no_set() -> None:
    assert constraint_set(None, CHAIN) is None
    assert constraint_set([], CHAIN) is None


def test_constraints_of_the_service_stand_behind_those_of_the_request() -> None:
    extra = JointConstraint("panda_joint1", 0.5, 0.1, 0.1)
    alone = constraint_set(None, CHAIN, extra)
    assert alone is not None
    assert alone.constraints == (extra,)
    clearance = BODIES.validate_python([{"type": "clearance", "margin": 0.02}])
    both = constraint_set(clearance, CHAIN, extra)
    assert both is not None
    assert both.constraints[1] is extra
    assert both.margin == 0.02


def beside(x: float, y: float, z: float) -> list[float]:
    """A point so far from the tip [m]."""
    return at(P + np.array([x, y, z]))


#: A frame turned by half a radian, whose origin is beside the tip.
Z = from_axis_angle([0.0, 0.0, 1.0], 0.5)
BOX = {
    "type": "box", "size": [0.2, 0.4, 0.0],
    "pose": {"position": at(P - Z @ [0.3, 0.1, 0.0]), "rpy": [0.0, 0.0, 0.5]},
}  # fmt: skip
LINE: dict[str, Any] = {
    "type": "line", "point": beside(2.0, 0.04, 0.0), "direction": [3.0, 0.0, 0.0],
    "tolerance": 0.01,
}  # fmt: skip
LINK = CHAIN.links[3].name
T_LINK = forward(CHAIN, HOME, LINK)
TURNED = at(to_quaternion(R @ from_axis_angle([0.0, 0.0, 1.0], -0.3)))


def tilted(angle: float) -> Array:
    """A direction at an angle to the tool's axis [rad]."""
    return np.asarray(R @ np.array([math.sin(angle), 0.0, math.cos(angle)]))


def joint(above: float, below: float) -> dict[str, Any]:
    return {"type": "joint", "joint": "panda_joint2", "position": HOME[1] - 0.1,
            "tolerance_above": above, "tolerance_below": below}  # fmt: skip


def inside(region: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"type": "position", "region": region} | more


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (joint(0.2, 0.1), [-0.1]),
        (joint(0.05, 0.5), [0.05]),
        (joint(0.1, 0.1), [0.0]),
        (inside({"type": "sphere", "center": beside(0.0, 0.3, 0.0), "radius": 0.1}), [0.2]),
        (inside({"type": "sphere", "radius": 0.25, "center": at(T_LINK[:3] @ [0.1, 0.2, 0.3, 1])},
                link=LINK, point=[0.1, 0.2, 0.3]), [-0.25]),
        (inside({"type": "plane", "point": beside(5.0, 7.0, 0.03), "normal": [0.0, 0.0, 2.0],
                 "tolerance": 0.01}), [0.02]),
        (inside(LINE), [0.03]),
        (inside(LINE | {"length": 1.0}), [0.03, 1.5]),
        (inside(BOX), [-0.1, 0.0, 0.2]),
        ({"type": "orientation", "axis": [0, 0, 1], "direction": at(tilted(0.3)),
          "cone_angle": 0.1}, [0.2]),
        ({"type": "orientation", "quaternion_xyzw": TURNED, "axis_tolerances": [0.1, 0.2, 0.05]},
         [-0.2, -0.1, 0.25]),
        ({"type": "look_at", "axis": [0, 0, 1], "target": at(P + tilted(0.4)), "angle": 0.1},
         [0.3]),
    ],
)  # fmt: skip
def test_a_form_measures_what_it_names(body: dict[str, Any], expected: list[float]) -> None:
    np.testing.assert_allclose(np.sort(residuals(body)), expected, atol=1e-7)


def test_a_relative_pose_measures_position_and_turn() -> None:
    pose = {"position": beside(0.02, 0.0, 0.0), "rotation_matrix": R.tolist()}
    body = {"type": "relative_pose", "pose": pose, "position_tolerance": 0.01,
            "orientation_tolerance": 0.1}  # fmt: skip
    off = np.abs(R.T @ [0.02, 0.0, 0.0]).max()
    np.testing.assert_allclose(np.max(residuals(body)), off - 0.01, atol=1e-7)


def test_an_orientation_that_is_none_is_refused() -> None:
    body = {"type": "orientation", "quaternion_xyzw": [0.0, 0.0, 0.0, 0.0], "axis_tolerances": 0.1}
    with pytest.raises(InvalidGoal, match=r"constraints\[0\] \(orientation\)"):
        residuals(body)


def test_limits_of_motions_have_no_rows() -> None:
    bodies = [{"type": "clearance", "margin": 0.02}, {"type": "tool_speed", "limit": 0.25},
              {"type": "torque", "limits": [10.0] * 7}]  # fmt: skip
    made = constraint_set(BODIES.validate_python(bodies), CHAIN)
    assert made is not None
    assert len(made.rows) == 0
    assert (made.margin, made.tool_speed) == (0.02, 0.25)
    assert made.torque is not None
    assert made.torque.limits == (10.0,) * 7
    own = constraint_set(BODIES.validate_python([{"type": "torque"}]), CHAIN)
    assert own is not None
    assert own.torque is not None
    assert own.torque.limits is None


@pytest.mark.parametrize(
    ("body", "error", "words"),
    [
        ({"type": "joint", "joint": "elbow", "position": 0.0}, InvalidGoal, "elbow"),
        ({"type": "torque", "limits": [1.0]}, InvalidGoal, "torque"),
        ({"type": "look_at", "axis": [0, 0, 0], "target": [0, 0, 0], "angle": 0.1}, InvalidGoal,
         "axis"),
        ({"type": "position", "region": {"type": "plane", "point": [0, 0, 0], "tolerance": 0.0,
                                         "normal": [0, 0, 0]}}, InvalidGoal, "normal"),
        ({"type": "position", "link": "nobody",
          "region": {"type": "sphere", "center": [0, 0, 0], "radius": 1.0}}, InvalidLinkName,
         "nobody"),
    ],
)  # fmt: skip
def test_a_constraint_at_fault_is_told_by_its_number(
    body: dict[str, Any], error: type[Exception], words: str
) -> None:
    bodies = BODIES.validate_python([{"type": "clearance", "margin": 0.0}, body])
    with pytest.raises(error, match=words) as caught:
        constraint_set(bodies, CHAIN)
    if error is InvalidGoal:
        assert f"constraints[1] ({body['type']}): " in str(caught.value)
        assert caught.value.details["constraint"] == 1  # type: ignore[attr-defined]


def test_each_constraint_tells_its_worst_row() -> None:
    box = {"type": "box", "pose": {"position": [0.0, 0.0, 0.0]}, "size": [1.0, 1.0, 1.0]}
    bodies = [
        {"type": "clearance", "margin": 0.01},
        {"type": "position", "region": box, "weight": 2.0},
        {"type": "joint", "joint": "panda_joint1", "position": 0.0},
    ]
    made = constraint_set(BODIES.validate_python(bodies), CHAIN)
    assert made is not None
    given = uses(made, np.array([-0.3, 0.2, -0.1, 0.4]))
    # Clearances have no residual at a configuration.
    assert [item["constraint"] for item in given] == [1, 2]
    assert [item["residual"] for item in given] == [0.2, 0.4]
    assert [item["unit"] for item in given] == ["m", "rad"]
    assert [item["hard"] for item in given] == [False, True]
    for item in given:
        ConstraintUse.model_validate(item)

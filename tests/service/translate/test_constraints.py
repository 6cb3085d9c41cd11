"""Constraints from the wire: every form by its residuals, and faults by their number."""

import math
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from armwright_wire.goals.constraint import Constraints, ConstraintUse
from kinematics.errors import InvalidGoal, InvalidLinkName
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from planning.constraints.kinds.joint import JointConstraint
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


@pytest.mark.parametrize(
    ("above", "below", "expected"), [(0.2, 0.1, 0.1 - 0.2), (0.05, 0.5, 0.05), (0.1, 0.1, 0.0)]
)
def test_a_joint_has_its_own_tolerance_above_and_below(
    above: float, below: float, expected: float
) -> None:
    body = {"type": "joint", "joint": "panda_joint2", "position": HOME[1] - 0.1,
            "tolerance_above": above, "tolerance_below": below}  # fmt: skip
    np.testing.assert_allclose(residuals(body), max(expected, -0.1 - below), atol=1e-12)


def test_a_sphere_measures_the_distance_from_its_center() -> None:
    region = {"type": "sphere", "center": beside(0.0, 0.3, 0.0), "radius": 0.1}
    np.testing.assert_allclose(residuals({"type": "position", "region": region}), 0.2, atol=1e-9)


def test_a_plane_measures_the_distance_along_its_normal() -> None:
    region = {"type": "plane", "point": beside(5.0, 7.0, 0.03), "normal": [0.0, 0.0, 2.0],
              "tolerance": 0.01}  # fmt: skip
    np.testing.assert_allclose(residuals({"type": "position", "region": region}), 0.02, atol=1e-9)


def test_a_line_measures_the_distance_from_it_and_from_its_ends() -> None:
    line = {"type": "line", "point": beside(2.0, 0.04, 0.0), "direction": [3.0, 0.0, 0.0],
            "tolerance": 0.01}  # fmt: skip
    np.testing.assert_allclose(residuals({"type": "position", "region": line}), 0.03, atol=1e-9)
    short = line | {"length": 1.0}
    rows = residuals({"type": "position", "region": short})
    np.testing.assert_allclose(sorted(rows), [0.03, 1.5], atol=1e-9)


def test_a_box_measures_along_the_axes_of_its_pose() -> None:
    c, s = math.cos(0.5), math.sin(0.5)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    off = np.array([0.3, 0.1, 0.0])
    pose = {"position": at(P - turned @ off), "rpy": [0.0, 0.0, 0.5]}
    region = {"type": "box", "pose": pose, "size": [0.2, 0.4, 0.0]}
    rows = residuals({"type": "position", "region": region})
    np.testing.assert_allclose(rows, [0.2, -0.1, 0.0], atol=1e-9)


def test_a_point_of_a_link_is_held_in_place_of_the_tip() -> None:
    link = CHAIN.links[3].name
    T = forward(CHAIN, HOME, link)
    point = np.array([0.1, 0.2, 0.3])
    region = {"type": "sphere", "center": at(T[:3, :3] @ point + T[:3, 3]), "radius": 0.25}
    body = {"type": "position", "region": region, "link": link, "point": at(point)}
    np.testing.assert_allclose(residuals(body), -0.25, atol=1e-9)


def test_a_cone_measures_the_angle_of_an_axis() -> None:
    axis = np.array([0.0, 0.0, 1.0])
    tilted = R @ np.array([math.sin(0.3), 0.0, math.cos(0.3)])
    body = {"type": "orientation", "axis": at(axis), "direction": at(tilted), "cone_angle": 0.1}
    np.testing.assert_allclose(residuals(body), 0.2, atol=1e-7)


def test_an_orientation_measures_the_turn_about_each_axis() -> None:
    from kinematics.pose import from_axis_angle, to_quaternion

    turned = R @ from_axis_angle([0.0, 0.0, 1.0], -0.3)
    body = {"type": "orientation", "quaternion_xyzw": at(to_quaternion(turned)),
            "axis_tolerances": [0.1, 0.2, 0.05]}  # fmt: skip
    np.testing.assert_allclose(residuals(body), [-0.1, -0.2, 0.25], atol=1e-7)
    with pytest.raises(InvalidGoal, match=r"constraints\[0\] \(orientation\)"):
        residuals(body | {"quaternion_xyzw": [0.0, 0.0, 0.0, 0.0]})


def test_looking_at_a_target_measures_the_angle_towards_it() -> None:
    target = P + R @ np.array([math.sin(0.4), 0.0, math.cos(0.4)])
    body = {"type": "look_at", "axis": [0.0, 0.0, 1.0], "target": at(target), "angle": 0.1}
    np.testing.assert_allclose(residuals(body), 0.3, atol=1e-7)


def test_a_relative_pose_measures_position_and_turn() -> None:
    pose = {"position": beside(0.02, 0.0, 0.0), "rotation_matrix": R.tolist()}
    body = {"type": "relative_pose", "pose": pose, "position_tolerance": 0.01,
            "orientation_tolerance": 0.1}  # fmt: skip
    worst = residuals(body)
    np.testing.assert_allclose(
        np.max(worst), np.abs(R.T @ [0.02, 0.0, 0.0]).max() - 0.01, atol=1e-7
    )


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

"""Constraints and timings from the wire, and certificates as answers."""

import json
import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter
from pydantic_core import to_json

from armwright_wire.goals.goal import Constraints, ConstraintUse
from armwright_wire.motions.retime import RetimeTiming
from armwright_wire.motions.timing import Timing
from armwright_wire.motions.trajectory import LimitsBody
from armwright_wire.plans.plan import ValidateRequest
from armwright_wire.scenes.scene import Scene
from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidLinkName, InvalidOption, MissingLimit
from kinematics.forward import forward
from kinematics.pose import from_axis_angle, to_quaternion
from kinematics.robots import builtin_chain
from planning.constraints.kinds.constraint import JointConstraint
from planning.proof.certificate import Certificate, Proved
from planning.proof.constraints.constraints import ConstraintReport
from planning.proof.limits.limit_uses import Violation
from planning.proof.limits.limits import LimitReport
from planning.proof.premises import Premises
from planning.proof.tool.tool_deviation import PathDeviation
from planning.timing.options import TimingOptions
from service.translate.certificates import certificate_answer
from service.translate.constraints import constraint_set, uses
from service.translate.timings import (
    effort_loads,
    limits,
    timing_options,
)

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


VALID = Certificate(
    verified=True,
    min_clearance=0.1,
    clearance_pair=("hand", "table"),
    min_obstacle_clearance=0.1,
    min_self_clearance=0.2,
    method="by hand",
    limits={"velocity": LimitReport(0.5, "elbow", 1.5)},
    continuity={"position": 1e-12, "velocity": 0.0},
    cells=17,
    proved=Proved(True, True),
    premises=Premises("arm", "0a" * 32, None, "1b" * 32, 2, ("cup",), "flange", 0.01),
)
REPORTS = (
    ConstraintReport(0, "upright", -0.1, "rad", 0.5, hard=True),
    ConstraintReport(1, "near", 0.3, "m", 0.25, hard=False),
)


def answer(begins: float = 0.0, **changes: Any) -> dict[str, Any]:
    return certificate_answer(replace(VALID, **changes), begins)


def written(**changes: Any) -> Any:
    """The answer as JSON has it, infinities as tasks write them."""
    return json.loads(to_json(answer(**changes), inf_nan_mode="null"))


def test_a_valid_motion_is_answered_with_all_that_was_proved() -> None:
    proved = {name: value for name, value in asdict(VALID).items() if value is not None}
    never = {"violation": None, "path_constraint_residual": None}
    assert written() == json.loads(to_json(proved)) | never


def test_the_name_of_a_stored_scene_is_told_and_no_scene_inside_of_a_request() -> None:
    assert certificate_answer(VALID, scene="table")["premises"]["scene"] == "table"
    inline = Scene.model_validate({"obstacles": []})
    assert certificate_answer(VALID, scene=inline)["premises"]["scene"] is None


@pytest.mark.parametrize("name", ["min_clearance", "min_obstacle_clearance", "min_self_clearance"])
def test_an_infinite_clearance_is_null(name: str) -> None:
    assert written(**{name: math.inf})[name] is None
    assert written(**{name: -0.01})[name] == -0.01


def test_a_ratio_to_a_limit_of_nothing_is_null() -> None:
    beyond = {"velocity": LimitReport(math.inf, "elbow", 0.0)}
    assert written(limits=beyond)["limits"]["velocity"]["worst_ratio"] is None


def test_constraints_are_answered_in_order_and_only_hard_ones_count() -> None:
    given = answer(path_constraints=REPORTS)
    assert [item["name"] for item in given["path_constraints"]] == ["upright", "near"]
    assert given["path_constraints"][1] == {
        "constraint": 1, "name": "near", "residual": 0.3, "unit": "m", "hard": False, "time": 0.25,
    }  # fmt: skip
    assert given["path_constraint_residual"] == 0.0
    broken = (replace(REPORTS[0], residual=0.02), REPORTS[1])
    assert answer(path_constraints=broken)["path_constraint_residual"] == 0.02
    assert answer(path_constraints=REPORTS[1:])["path_constraint_residual"] is None


def test_every_time_is_told_in_the_clock_of_the_request() -> None:
    violation = Violation("collision", 0.75, "hand penetrates table", {"pair": ["hand", "table"]})
    deviation = PathDeviation(1e-5, None, True, 0.5, 1e-4, None)
    changes: dict[str, Any] = {
        "violation": violation, "path_deviation": deviation, "path_constraints": REPORTS,
    }  # fmt: skip
    early, late = answer(**changes), answer(begins=100.0, **changes)

    def times(given: dict[str, Any]) -> list[float]:
        return [
            given["limits"]["velocity"]["time"],
            given["path_deviation"]["time"],
            given["violation"]["time"],
            *(item["time"] for item in given["path_constraints"]),
        ]

    assert times(early) == [1.5, 0.5, 0.75, 0.5, 0.25]
    assert times(late) == [101.5, 100.5, 100.75, 100.5, 100.25]


def test_a_violation_carries_plain_values() -> None:
    details = {"pair": ["hand", "table"], "depth": np.float64(0.012), "cell": np.int64(3)}
    violation = Violation("collision", 0.75, "hand penetrates table", details)
    given = answer(verified=False, violation=violation)["violation"]
    assert given == {
        "kind": "collision", "time": 0.75, "message": "hand penetrates table",
        "pair": ["hand", "table"], "depth": 0.012, "cell": 3,
    }  # fmt: skip
    assert (type(given["depth"]), type(given["cell"])) == (float, int)


TIMINGS_CHAIN = builtin_chain("planar_rr")
SEGMENT = {"t0": 0.0, "t1": 1.0, "coefficients": [[0.0], [0.0]]}


def validate(**fields: Any) -> ValidateRequest:
    least = {"robot": "r", "trajectory": {"segments": [SEGMENT]}}
    return ValidateRequest.model_validate(least | fields)


def body(**fields: Any) -> LimitsBody:
    return LimitsBody.model_validate(fields)


# ---------------------------------------------------------------------------------- options


def test_what_is_left_out_is_as_planning_has_it() -> None:
    left_out = timing_options(Timing())
    plain = TimingOptions()
    for name in TimingOptions.__slots__:
        assert getattr(left_out, name) == getattr(plain, name), name


def test_what_is_given_reaches_planning() -> None:
    load = {"mass": 2.0, "center_of_mass": [0.0, 0.0, 0.1], "link": "tip",
            "inertia": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}  # fmt: skip
    fields = {
        "method": "spline", "velocity_scaling": 0.5, "acceleration_scaling": 0.25,
        "jerk_scaling": 0.125, "times": [0.0, 1.0], "scale_times": True,
        "interpolation": "clamped_spline", "blend_tolerance": 0.01, "torque_limits": True,
        "tool_speed": 0.4, "start_velocity": [0.1, 0.2], "end_velocity": [0.3, 0.4],
    }  # fmt: skip
    made = timing_options(RetimeTiming.model_validate(fields | {"payload": load}))
    assert {name: getattr(made, name) for name in fields} == fields
    assert made.payload is not None
    given = {name: getattr(made.payload, name) for name in load}
    assert given == load


# ----------------------------------------------------------------------------------- limits


def test_a_motion_is_held_to_the_request_first_and_then_to_the_robot() -> None:
    bounds = limits(None, TIMINGS_CHAIN)
    assert set(bounds) == {"velocity", "acceleration"}
    np.testing.assert_array_equal(bounds["velocity"], TIMINGS_CHAIN.limits.velocity)
    bounds = limits(
        body(acceleration=[1.0, 2.0], jerk=[3.0, 4.0], effort=[5.0, 6.0]), TIMINGS_CHAIN
    )
    assert set(bounds) == {"velocity", "acceleration", "jerk"}
    np.testing.assert_array_equal(bounds["acceleration"], [1.0, 2.0])
    np.testing.assert_array_equal(bounds["jerk"], [3.0, 4.0])


# ------------------------------------------------------------------------------------ loads


def test_torques_are_held_to_the_request_or_to_the_robot() -> None:
    chain = replace(
        TIMINGS_CHAIN, limits=replace(TIMINGS_CHAIN.limits, effort=np.array([8.0, 9.0]))
    )
    own = effort_loads(validate(torque_limits=True), chain)
    assert own is not None
    np.testing.assert_array_equal(own.effort, [8.0, 9.0])
    given = effort_loads(validate(torque_limits=True, limits={"effort": [1.0, 2.0]}), chain)
    assert given is not None
    np.testing.assert_array_equal(given.effort, [1.0, 2.0])
    alone = effort_loads(validate(limits={"effort": [1.0, 2.0]}), chain)
    assert alone is not None
    np.testing.assert_array_equal(alone.effort, [1.0, 2.0])
    with pytest.raises(InvalidOption, match=r"limits\.effort"):
        effort_loads(validate(limits={"effort": [1.0]}), chain)
    nobody = replace(chain, limits=replace(chain.limits, effort=np.array([8.0, np.nan])))
    with pytest.raises(MissingLimit):
        effort_loads(validate(torque_limits=True), nobody)

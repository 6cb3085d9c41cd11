"""The ROS 2 bridge: MoveIt's requests as ours, refusals by name, motions as its messages."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armwright_wire.plans.plan import PlanRequest
from integrations.ros2.armwright_bridge.translate import (
    ERROR_CODES,
    Refused,
    plan_request,
)

JOINTS = [f"panda_joint{i}" for i in range(1, 8)]
HOME = dict(zip(JOINTS, [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], strict=True))
TIP = "panda_hand_tcp"


def ns(**fields: Any) -> SimpleNamespace:
    return SimpleNamespace(**fields)


def constraints(**kinds: Any) -> SimpleNamespace:
    names = ("joint", "position", "orientation", "visibility")
    return ns(**{f"{name}_constraints": kinds.get(name, []) for name in names})


def at_joints(positions: dict[str, float]) -> SimpleNamespace:
    rows = [ns(joint_name=name, position=value, tolerance_above=0.01, tolerance_below=0.01)
            for name, value in positions.items()]  # fmt: skip
    return constraints(joint=rows)


def xyz(*values: float) -> SimpleNamespace:
    return ns(**dict(zip("xyzw", values, strict=False)))


def oriented(quaternion: Any, tolerances: Any, kind: int = 0, link: str = TIP) -> SimpleNamespace:
    named = {
        f"absolute_{axis}_axis_tolerance": t for axis, t in zip("xyz", tolerances, strict=True)
    }
    return ns(header=ns(frame_id=""), orientation=xyz(*quaternion), link_name=link,
              parameterization=kind, **named)  # fmt: skip


def placed(position: Any, dimensions: Any, offset: Any = (0, 0, 0), link: str = TIP) -> Any:
    solid = ns(type={0: 3, 1: 2, 3: 1}[len(dimensions)], dimensions=list(dimensions))
    place = ns(position=xyz(*position), orientation=xyz(0, 0, 0, 1))
    region = ns(primitives=[solid], meshes=[], primitive_poses=[place])
    return ns(header=ns(frame_id=""), link_name=link, target_point_offset=xyz(*offset),
              constraint_region=region)  # fmt: skip


def asked(*goals: Any, **changed: Any) -> SimpleNamespace:
    state = ns(joint_state=ns(name=[], position=[]), attached_collision_objects=[])
    fields = {
        "goal_constraints": list(goals),
        "path_constraints": constraints(),
        "trajectory_constraints": ns(constraints=[]),
        "reference_trajectories": [],
        "start_state": state,
        "planner_id": "",
        "group_name": "arm",
        "allowed_planning_time": 0.0,
        "max_velocity_scaling_factor": 0.0,
        "max_acceleration_scaling_factor": 0.0,
        "cartesian_speed_limited_link": "",
        "max_cartesian_speed": 0.0,
    }
    return ns(**fields | changed)


def translated(request: Any) -> dict[str, Any]:
    """The body for the service, which has to be of its form."""
    body = plan_request(request, "panda", JOINTS, TIP, HOME, "arm")
    PlanRequest.model_validate(body)
    return body


GOAL = dict(zip(JOINTS, [1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785], strict=True))
DOWN = (1.0, 0.0, 0.0, 0.0)


def test_a_pose_is_of_the_point_that_the_region_holds() -> None:
    """A point 0.1 m before the tip is in the region: the tip, turned down, is 0.1 m above it."""
    goal = constraints(
        position=[placed((0.4, 0.1, 0.3), [0.01], (0, 0, 0.1))],
        orientation=[oriented(DOWN, (0.02, 0.03, 0.04))],
    )
    answer = translated(asked(goal, at_joints(GOAL)))["goal"]["any_of"][0]
    turned = Rotation.from_quat(DOWN).apply([0, 0, 0.1])
    assert np.allclose(answer["pose"]["position"], np.array([0.4, 0.1, 0.3]) - turned)
    assert (answer["position_tolerance"], answer["orientation_tolerance"]) == (0.01, 0.02)


@pytest.mark.parametrize("tolerances", [(0.3, 0.2, 0.4), (0.3, 0.25, 3.2), (0.6, 0.6, 7.0)])
def test_what_is_held_holds_euler_angles_as_moveit_reads_them(tolerances: Any) -> None:
    """kinematic_constraints of MoveIt: angles X, Y, Z of target^T actual within tolerances."""
    random = np.random.default_rng(3)
    target = Rotation.random(random_state=4)
    path = constraints(orientation=[oriented(target.as_quat(), tolerances)])
    (row,) = translated(asked(at_joints(GOAL), path_constraints=path))["constraints"]
    held = 0
    for _ in range(4000):
        turn = Rotation.from_rotvec(random.normal(0.0, 0.25, 3) * [1, 1, random.choice([0.5, 9.0])])
        actual = target * turn
        if "cone_angle" in row:
            tilt = np.arccos(np.clip(actual.apply(row["axis"]) @ row["direction"], -1.0, 1.0))
            kept = tilt <= row["cone_angle"]
        else:
            vector = (target.inv() * actual).as_rotvec()
            kept = bool((np.abs(vector) <= row["axis_tolerances"]).all())
        held += kept
        angles = np.abs((target.inv() * actual).as_euler("XYZ"))
        assert not kept or (angles <= np.array(tolerances) + 1e-9).all()
    assert held > 100


def test_a_path_may_hold_joints_points_and_rotation_vectors() -> None:
    path = constraints(
        joint=at_joints({JOINTS[0]: 0.2}).joint_constraints,
        orientation=[oriented((0, 0, 0, 2), (0.1, 3.2, 0.3), kind=1)],
        position=[placed((0.4, 0, 0.4), [0.2, 0.4, 0.6], (0, 0, 0.1)), placed((0, 0, 1), [0.3])],
    )
    rows = translated(asked(at_joints(GOAL), path_constraints=path))["constraints"]
    assert [row["type"] for row in rows] == ["joint", "orientation", "position", "position"]
    assert rows[1]["axis_tolerances"] == [0.1, 3.2, 0.3]
    assert rows[1]["quaternion_xyzw"] == [0, 0, 0, 1]
    assert rows[2]["region"]["size"] == [0.2, 0.4, 0.6]
    assert rows[3]["region"] == {"type": "sphere", "center": [0, 0, 1], "radius": 0.3}


_POSE = constraints(
    position=[placed((0.4, 0, 0.3), [0.01])], orientation=[oriented(DOWN, [0.1] * 3)]
)


_POINT, _TURN = _POSE.position_constraints, _POSE.orientation_constraints
_ELBOW = [placed((0, 0, 1), [0.1], link="elbow")]
_HELD = at_joints(GOAL)
_LOADED = ns(joint_state=ns(name=[], position=[]), attached_collision_objects=[1])
_ROWS: list[tuple[Any, str, str]] = [
    (asked(), "INVALID_GOAL_CONSTRAINTS", "no goal_constraints"),
    (asked(at_joints({JOINTS[0]: 0.1})), "INVALID_GOAL_CONSTRAINTS", "panda_joint2"),
    (asked(_HELD, group_name="leg"), "INVALID_GROUP_NAME", "leg"),
    (asked(constraints(position=_POINT)), "UNRECOGNIZED_GOAL_TYPE", "one position and one"),
    (asked(constraints(visibility=[1])), "UNRECOGNIZED_GOAL_TYPE", "visibility"),
    (asked(constraints(position=_ELBOW, orientation=_TURN)), "INVALID_LINK_NAME", "elbow"),
    (asked(constraints(position=[placed((0, 0, 1), [])], orientation=_TURN)),
     "INVALID_GOAL_CONSTRAINTS", "box or sphere"),
    (asked(_HELD, reference_trajectories=[1]), "INVALID_MOTION_PLAN", "reference"),
    (asked(_HELD, trajectory_constraints=ns(constraints=[1])), "INVALID_MOTION_PLAN", "trajectory"),
    (asked(_HELD, path_constraints=constraints(visibility=[1])),
     "INVALID_MOTION_PLAN", "visibility"),
    (asked(_HELD, path_constraints=constraints(orientation=[oriented(DOWN, (7.0, 0.1, 0.1))])),
     "INVALID_MOTION_PLAN", "ROTATION_VECTOR"),
    (asked(_HELD, max_cartesian_speed=0.2, cartesian_speed_limited_link="elbow"),
     "INVALID_LINK_NAME", "elbow"),
    (asked(_HELD, start_state=_LOADED), "INVALID_ROBOT_STATE", "attached"),
]  # fmt: skip


@pytest.mark.parametrize(("request_", "code", "says"), _ROWS)
def test_what_can_not_be_honoured_is_refused_by_name(request_: Any, code: str, says: str) -> None:
    with pytest.raises(Refused, match=says) as refused:
        translated(request_)
    assert refused.value.code == code
    assert code in ERROR_CODES


def test_a_joint_that_nobody_measured_is_named() -> None:
    with pytest.raises(Refused, match="panda_joint7"):
        plan_request(asked(at_joints(GOAL)), "panda", JOINTS, TIP, dict(list(HOME.items())[:6]))

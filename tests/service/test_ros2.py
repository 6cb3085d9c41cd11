"""The ROS 2 bridge before a service: a request of MoveIt, a certified motion as its message."""

import httpx
import numpy as np
import pytest

from armwright_client import Client, Goal, Scene
from integrations.ros2.armwright_bridge.translate import fill_trajectory
from tests.integrations.test_ros2 import GOAL, HOME, JOINTS, TIP, asked, at_joints, ns, translated

#: As rosidl_runtime_py writes a planning scene.
SCENE = """
world:
  collision_objects:
  - id: post
    header: {frame_id: panda_link0}
    primitives: [{type: 1, dimensions: [0.1, 0.1, 1.2]}]
    primitive_poses: [{position: {x: 0.42, y: 0.28, z: 0.6}, orientation: {w: 1.0}}]
"""


def test_a_request_is_planned_and_its_motion_written(client: httpx.Client) -> None:
    request = asked(
        at_joints(GOAL),
        max_velocity_scaling_factor=0.5,
        allowed_planning_time=20.0,
        max_cartesian_speed=0.6,
    )
    body = translated(request)
    start, robot = body.pop("start"), body.pop("robot")
    goal = Goal.model_validate(body.pop("goal"))
    with Client(str(client.base_url)) as service:
        model = service.robots.get(robot)
        assert (model.joint_names, model.tip_link) == (JOINTS, TIP)
        plan = service.plan(robot, start["joints"], goal, scene=Scene(moveit=SCENE), **body)
    assert plan.certificate.verified
    message = ns(header=ns(frame_id=""), joint_names=[], points=[])
    rows = plan.trajectory.joint_trajectory(0.01, model.frame)
    fill_trajectory(message, rows, ns, ns)
    assert message.joint_names == JOINTS
    assert np.allclose(message.points[0].positions, list(HOME.values()))
    assert np.allclose(message.points[-1].positions, list(GOAL.values()))
    last = message.points[-1].time_from_start
    assert last.sec + 1e-9 * last.nanosec == pytest.approx(plan.trajectory.duration, abs=1e-9)

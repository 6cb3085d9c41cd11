"""Node that answers MoveIt's planning requests with certified motions of an Armwright service.

It serves ``plan_kinematic_path`` (moveit_msgs/srv/GetMotionPlan) and the action ``move_action``
(moveit_msgs/action/MoveGroup, planning only), listens to ``joint_states`` and to whole planning
scenes on ``monitored_planning_scene``, and publishes what each motion was proved for on
``~/certificate`` (std_msgs/String, JSON). It sends no motion to a controller.
"""

from typing import Any

import rclpy
from builtin_interfaces.msg import Duration
from moveit_msgs.action import MoveGroup
from moveit_msgs.msg import MotionPlanResponse, PlanningScene
from moveit_msgs.srv import GetMotionPlan
from rclpy.action import ActionServer
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rosidl_runtime_py import message_to_yaml
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectoryPoint

from armwright_bridge.translate import ERROR_CODES, Refused, fill_trajectory, plan_request
from armwright_client import ApiError, Client, Goal, Scene, TransportError


class Bridge(Node):
    """The node; its parameters are ``url``, ``token``, ``robot``, ``group`` and ``period``."""

    def __init__(self) -> None:
        super().__init__("armwright")
        text = {"url": "http://127.0.0.1:8000", "token": "", "robot": "", "group": ""}
        given = {
            name: self.declare_parameter(name, default).value for name, default in text.items()
        }
        self._period = float(self.declare_parameter("period", 0.01).value)
        self._robot, self._group = given["robot"], given["group"]
        self._client = Client(given["url"], token=given["token"] or None)
        model = self._client.robots.get(self._robot)
        self._joints, self._tip = list(model.joint_names), model.tip_link
        self._root = model.frame
        self._measured: dict[str, float] = {}
        self._scene: str | None = None
        self._certificates = self.create_publisher(String, "~/certificate", 10)
        self.create_subscription(JointState, "joint_states", self._keep_state, 10)
        self.create_subscription(PlanningScene, "monitored_planning_scene", self._keep_scene, 10)
        several = ReentrantCallbackGroup()
        self.create_service(
            GetMotionPlan, "plan_kinematic_path", self._answer, callback_group=several
        )
        self._action = ActionServer(
            self, MoveGroup, "move_action", self._execute, callback_group=several
        )

    def _keep_state(self, message: JointState) -> None:
        self._measured.update(zip(message.name, message.position, strict=False))

    def _keep_scene(self, message: PlanningScene) -> None:
        if message.is_diff:
            self.get_logger().warning(
                "a difference of planning scenes is not read: publish whole scenes", once=True
            )
            return
        self._scene = message_to_yaml(message)

    def _answer(
        self, request: GetMotionPlan.Request, response: GetMotionPlan.Response
    ) -> GetMotionPlan.Response:
        response.motion_plan_response = self._plan(request.motion_plan_request)
        return response

    def _execute(self, goal: Any) -> MoveGroup.Result:
        result = MoveGroup.Result()
        if not goal.request.planning_options.plan_only:
            self.get_logger().warning("planned only: send the trajectory to your controller")
        found = self._plan(goal.request.request)
        result.error_code, result.planning_time = found.error_code, found.planning_time
        result.planned_trajectory = found.trajectory
        result.trajectory_start = found.trajectory_start
        if found.error_code.val == ERROR_CODES["SUCCESS"]:
            goal.succeed()
        else:
            goal.abort()
        return result

    def _plan(self, request: Any) -> MotionPlanResponse:
        """The response to a request: the motion, or the error code with its reason in the log."""
        response = MotionPlanResponse()
        response.group_name = request.group_name
        began = self.get_clock().now()
        try:
            body = plan_request(
                request, self._robot, self._joints, self._tip, self._measured, self._group
            )
            if self._scene is not None:
                body["scene"] = Scene(moveit=self._scene)
            start, robot = body.pop("start"), body.pop("robot")
            goal = Goal.model_validate(body.pop("goal"))
            plan = self._client.plan(robot, start["joints"], goal, **body)
        except Refused as error:
            return self._failed(response, error.code, str(error))
        except ApiError as error:
            return self._failed(response, error.code, str(error))
        except TransportError as error:
            return self._failed(response, "FAILURE", str(error))
        response.planning_time = (self.get_clock().now() - began).nanoseconds * 1e-9
        response.error_code.val = ERROR_CODES["SUCCESS"]
        response.trajectory_start.joint_state.name = self._joints
        response.trajectory_start.joint_state.position = plan.trajectory.sample([0.0])[0]
        fill_trajectory(
            response.trajectory.joint_trajectory,
            plan.trajectory.joint_trajectory(self._period, self._root),
            JointTrajectoryPoint,
            Duration,
        )
        self._certificates.publish(String(data=plan.certificate.model_dump_json()))
        return response

    def _failed(self, response: MotionPlanResponse, code: str, reason: str) -> MotionPlanResponse:
        self.get_logger().error(f"{code}: {reason}")
        response.error_code.val = ERROR_CODES.get(code, ERROR_CODES["FAILURE"])
        return response


def main() -> None:
    """Spin the node until it is interrupted."""
    rclpy.init()
    node = Bridge()
    executor = MultiThreadedExecutor()
    executor.add_node(node)
    try:
        executor.spin()
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()

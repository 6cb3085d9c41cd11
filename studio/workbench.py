"""Commands of the studio: each changes the state or asks the service, and knows no browser."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from pydantic import ValidationError

from armwright_client import (
    ApiError,
    ArmwrightError,
    Client,
    DefaultLimits,
    Export,
    NoIkSolution,
    Obstacle,
    Plan,
    Pose,
    Robot,
    RobotArchive,
    RobotUpload,
    Scene,
)
from armwright_client.call import Call
from armwright_client.export import ExportFormat
from armwright_client.geometry import GeometryAnswer
from studio.branch import Branch, Verdict, branches
from studio.code import curl, ik_python, plan_python
from studio.requests import ik_request, plan_request
from studio.result import Failure, Outcome, Planned, failure
from studio.settings_form import FormField, form_fields
from studio.shapes import ShapeKind, new_obstacle
from studio.state import History, StudioState

#: Where new obstacles appear [m]: before most arms, within their reach.
_NEW_PLACE = (0.4, 0.3, 0.3)
#: URDF knows no accelerations: without a rule no uploaded robot could be planned for.
_RULES = DefaultLimits(acceleration="10 x velocity")
#: Joints without limits are drawn between these positions [rad or m].
_FREE_RANGE = 3.141592653589793


class Workbench:
    """The studio without its page: state, history, and the service's answers.

    Args:
        client: Connected to the service.
        url: Its address, for the code that is shown.
        robot: Name of the first robot.

    Raises:
        ArmwrightError: The service does not answer, or has no such robot.
    """

    def __init__(self, client: Client, url: str, robot: str) -> None:
        self.client = client
        self.url = url
        self.fields: tuple[FormField, ...] = form_fields(self._openapi())
        self.outcome: Outcome | None = None
        self.pinned: Planned | None = None
        self.branches: tuple[Branch, ...] = ()
        self.model: Robot
        self.history: History
        self.choose_robot(robot)

    @property
    def state(self) -> StudioState:
        """The present state."""
        return self.history.present

    # ------------------------------------------------------------------------------- robots

    def robot_names(self) -> list[str]:
        """Names of all robots, built-in and stored."""
        return [robot.name for robot in self.client.robots.iterate()]

    def choose_robot(self, name: str) -> None:
        """Begin with another robot; the scene stays, and nothing is held.

        Args:
            name: Of a built-in or stored robot.
        """
        self.model = self.client.robots.get(name)
        joints = home(self.model)
        obstacles = self.history.present.obstacles if hasattr(self, "history") else ()
        self.history = History(StudioState(name, joints, joints, obstacles=obstacles))
        self.outcome, self.pinned, self.branches = None, None, ()

    def upload_robot(self, file_name: str, content: bytes) -> None:
        """Store a robot of a URDF or a .zip, and begin with it; its lint is in `model.lint`.

        Args:
            file_name: Its stem becomes the robot's name.
            content: Of the file.

        Raises:
            ApiError: The description is refused.
            ValueError: The file is neither a URDF nor a .zip.
        """
        stem, _, suffix = file_name.rpartition(".")
        if suffix.lower() == "zip":
            robot: RobotUpload | RobotArchive = RobotArchive(
                stem, content, {"default_limits": _RULES}
            )
        elif suffix.lower() in ("urdf", "xml"):
            robot = RobotUpload(name=stem, urdf=content.decode("utf-8"), default_limits=_RULES)
        else:
            raise ValueError(f"{file_name}: give a .urdf, or a .zip with the URDF and its meshes")
        self.choose_robot(self.client.robots.create(robot).name)

    def geometry(self) -> GeometryAnswer:
        """The robot's collision geometry."""
        return self.client.robots.geometry(self.state.robot)

    def link_poses(self, joints: Sequence[float]) -> dict[str, Pose]:
        """Poses of all links at a configuration, in the root frame.

        Args:
            joints: Shape (n,) [rad or m].
        """
        return self.client.robots.fk(self.state.robot, joints).links

    def link_poses_of(self, rows: Sequence[Sequence[float]]) -> dict[str, list[Pose]]:
        """Poses of all links at many configurations, in the root frame.

        Args:
            rows: Shape (m, n) [rad or m].
        """
        return self.client.robots.fk_batch(self.state.robot, rows).links

    def joint_ranges(self) -> list[tuple[float, float]]:
        """Range of each joint's slider [rad or m]."""
        return _ranges(self.model)

    # --------------------------------------------------------------------------- start, goal

    def set_start(self, joints: Sequence[float], key: str | None = None) -> None:
        """Change the start configuration [rad or m]."""
        self._change(replace(self.state, start=tuple(joints)), key)

    def set_goal_joints(self, joints: Sequence[float], key: str | None = None) -> None:
        """Make a configuration the goal [rad or m]."""
        self._change(replace(self.state, goal_joints=tuple(joints), goal_pose=None), key)

    def goal_tip(self) -> Pose:
        """The pose of the tip at the goal, in the root frame."""
        if self.state.goal_pose is not None:
            return self.state.goal_pose
        return self.client.robots.fk(self.state.robot, self.state.goal_joints).pose

    def move_goal(self, pose: Pose, key: str | None = None) -> tuple[Branch, ...]:
        """Make a pose of the tip the goal, and answer all configurations that reach it.

        Args:
            pose: In the root frame.
            key: See `History.change`.
        """
        self.branches = self._solve(pose)
        state = replace(self.state, goal_pose=pose)
        valid = [branch for branch in self.branches if branch.verdict is Verdict.VALID]
        if valid:
            state = replace(state, goal_joints=valid[0].joints)
        self._change(state, key)
        return self.branches

    def solve_goal(self) -> tuple[Branch, ...]:
        """All configurations that reach the goal's pose in the present scene."""
        self.branches = self._solve(self.goal_tip())
        return self.branches

    def choose_branch(self, number: int) -> None:
        """Make one of the configurations that reach the goal's pose the goal.

        Args:
            number: Of the branch, counted from 1.
        """
        self.set_goal_joints(self.branches[number - 1].joints)

    def _solve(self, pose: Pose) -> tuple[Branch, ...]:
        request = ik_request(self.state, pose)
        options = _fields(request, without=("pose",))
        try:
            answer = self.client.robots.ik(self.state.robot, pose, **options)
        except NoIkSolution as error:
            return branches(error.problem.details.get("rejected") or [])
        return branches([solution.model_dump(mode="json") for solution in answer.solutions])

    # -------------------------------------------------------------------------------- scene

    def add_obstacle(self, kind: ShapeKind) -> Obstacle:
        """Add an obstacle of the usual size before the robot.

        Args:
            kind: Of its shape.
        """
        obstacle = new_obstacle(kind, self.state.free_id(kind), _NEW_PLACE)
        self._change(self.state.with_obstacle(obstacle))
        return obstacle

    def change_obstacle(self, obstacle: Obstacle, key: str | None = None) -> None:
        """Put an obstacle in place of the one of its id."""
        self._change(self.state.with_obstacle(obstacle), key)

    def remove_obstacle(self, obstacle_id: str) -> None:
        """Take an obstacle out of the scene."""
        self._change(self.state.without_obstacle(obstacle_id))

    def attach(self, obstacle_id: str, link: str | None) -> None:
        """Let a link carry an obstacle from the start on, or nothing carry it.

        Args:
            obstacle_id: Of the obstacle.
            link: Of the robot; None to put the obstacle back into the scene.
        """
        self._change(self.state.with_attached(obstacle_id, link))

    def import_scene(self, content: bytes) -> None:
        """Take the obstacles of a scene in JSON, as the API has it.

        Args:
            content: Of the file.

        Raises:
            pydantic.ValidationError: The JSON is no scene.
            ValueError: The scene names no obstacles.
        """
        self._take_scene(Scene.model_validate_json(content))

    def load_scene(self, name: str) -> None:
        """Take the obstacles of a stored scene.

        Args:
            name: Of the scene.
        """
        self._take_scene(self.client.scenes.get(name))

    def save_scene(self, name: str) -> None:
        """Store the scene under a name, whether there is one or not.

        Args:
            name: Of the scene.
        """
        self.client.scenes.replace(name, Scene(obstacles=list(self.state.obstacles)))

    # --------------------------------------------------------------------- settings, history

    def set_setting(self, path: str, value: Any) -> None:
        """Change a setting; None leaves the field to the service.

        Args:
            path: Of the setting, "timing.method".
            value: Its value.
        """
        self._change(self.state.with_setting(path, value), f"setting {path}")

    def undo(self) -> None:
        """Take the latest change back."""
        self.history = self.history.undo()

    def redo(self) -> None:
        """Make the change again that was taken back last."""
        self.history = self.history.redo()

    def end_drag(self) -> None:
        """Let the next change stand alone: a drag or a move of a slider is over."""
        self.history = self.history.close_change()

    # --------------------------------------------------------------------------------- plans

    def plan(self) -> Outcome:
        """Plan from start to goal; a motion with its certificate, or a failure explained."""
        self.outcome = self._attempt(self._plan)
        return self.outcome

    def pin(self) -> None:
        """Keep the present plan, to compare the next one with it."""
        if isinstance(self.outcome, Planned):
            self.pinned = self.outcome

    def export(self, file_format: ExportFormat) -> Export:
        """The present motion as a file for a controller.

        Args:
            file_format: Of the file.

        Raises:
            ApiError: The service refuses it.
            ValueError: There is no motion.
        """
        if not isinstance(self.outcome, Planned):
            raise ValueError("there is no motion yet: plan one first")
        request = plan_request(self.outcome.state)
        options = {
            name: value
            for name, value in _fields(request).items()
            if name in ("scene", "attached", "margin")
        }
        return self.client.export(
            self.state.robot, self.outcome.plan.trajectory, file_format, **options
        )

    def plan_code(self) -> tuple[str, str]:
        """The present plan request as Python and as curl."""
        request = plan_request(self.state, keep=False)
        return plan_python(self.url, request), curl(self.url, "/v1/plan", request)

    def ik_code(self, tip: Pose) -> str:
        """The inverse kinematics of the goal as Python.

        Args:
            tip: Pose of the tip at the goal, in the root frame.
        """
        return ik_python(self.url, self.state.robot, ik_request(self.state, tip))

    def view_url(self) -> str | None:
        """Address of the page of the latest plan, or of its failure, if the service kept it."""
        plan_id = None if self.outcome is None else self.outcome.plan_id
        return None if plan_id is None else f"{self.url.rstrip('/')}/v1/plans/{plan_id}/view"

    def _plan(self) -> Planned:
        request = plan_request(self.state)
        options = _fields(request, without=("robot", "start", "goal"))
        plan: Plan = self.client.plan(request.robot, request.start, request.goal, **options)
        return Planned(self.state, plan)

    def _attempt(self, action: Callable[[], Planned]) -> Outcome:
        try:
            return action()
        except ApiError as error:
            return failure(self.state, error.problem)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(step) for step in first["loc"])
            return Failure(self.state, "A setting is out of its range", f"{where}: {first['msg']}")
        except ArmwrightError as error:
            return Failure(self.state, "The service did not answer", str(error))

    def _take_scene(self, scene: Scene) -> None:
        if scene.obstacles is None:
            raise ValueError("this scene is MoveIt's text, which the studio does not draw")
        state = replace(self.state, obstacles=tuple(scene.obstacles), attached=MappingProxyType({}))
        self._change(state)

    def _change(self, state: StudioState, key: str | None = None) -> None:
        self.history = self.history.change(state, key)

    def _openapi(self) -> Mapping[str, Any]:
        document: Mapping[str, Any] = self.client._sender.send(
            Call("GET", "/openapi.json", json.loads)
        )
        return document


def home(model: Robot) -> tuple[float, ...]:
    """The first named state of a robot, or the configuration in the middle of its limits.

    Args:
        model: Of the robot.
    """
    if model.states:
        return tuple(next(iter(model.states.values())))
    return tuple(0.5 * (low + high) for low, high in _ranges(model))


def _ranges(model: Robot) -> list[tuple[float, float]]:
    limits = zip(model.limits.lower, model.limits.upper, strict=True)
    return [
        (-_FREE_RANGE if low is None else low, _FREE_RANGE if high is None else high)
        for low, high in limits
    ]


def _fields(request: Any, without: Sequence[str] = ()) -> dict[str, Any]:
    """Fields of a request that are set, as the client's methods take them."""
    return {
        name: getattr(request, name)
        for name in type(request).model_fields
        if name in request.model_fields_set
        and name not in without
        and getattr(request, name) is not None
    }

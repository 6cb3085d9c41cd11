"""Commands of the studio: each changes the state or asks the service, and knows no browser."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Literal

from armwright_client import (
    CheckAnswer,
    Client,
    FramedPose,
    NoIkSolution,
    Obstacle,
    Pose,
    Robot,
    Scene,
)
from armwright_client.call import Call
from armwright_wire.motions.export import Format as ExportFormat
from armwright_wire.robots.robot import GeometryAnswer
from studio.export import ExportFile, export_file
from studio.pose import stays_in
from studio.requests import (
    MOVEIT,
    NEW_SIZE,
    ShapeKind,
    attempt,
    ik_request,
    listed,
    new_obstacle,
    plan,
    plan_request,
    read_obstacles,
    robot_upload,
    set_fields,
)
from studio.settings_form import (
    EntryForms,
    FormField,
    entry_forms,
    form_fields,
    goal_form,
    path_fields,
    tour_fields,
    waypoint_form,
)
from studio.stages import pick_stages, place_stages
from studio.state import (
    Branch,
    Entries,
    Failure,
    History,
    Outcome,
    Planned,
    StudioState,
    TaskPlanned,
    TourPlanned,
    Verdict,
    branches,
    with_option,
)

#: Where new obstacles appear [m]: before most arms, within their reach.
_NEW_PLACE = (0.4, 0.3, 0.3)
#: Part of the jaws' opening that a new obstacle takes.
_HELD = 0.8
#: Joints without limits are drawn between these positions [rad or m].
_FREE_RANGE = 3.141592653589793
#: What is planned.
Kind = Literal["motion", "task", "tour", "tool path"]


class Workbench:
    """The studio without its page: state, history, and the service's answers.

    Args:
        client: Connected to the service.
        url: Address of the service, for the code that is shown.
        robot: Name of the first robot.

    Raises:
        ArmwrightError: The service does not answer, or has no such robot.
    """

    def __init__(self, client: Client, url: str, robot: str) -> None:
        self.client = client
        self.url = url
        document = self._openapi()
        self.fields: tuple[FormField, ...] = form_fields(document)
        self.constraint_forms: EntryForms = entry_forms(document, "PlanRequest", "constraints")
        self.stage_forms: EntryForms = entry_forms(document, "TaskRequest", "stages")
        self.goal_forms: EntryForms = goal_form(document)
        self.waypoint_forms: EntryForms = waypoint_form(document)
        self.tour_fields = tour_fields(document)
        self.path_fields = path_fields(document)
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

    @property
    def is_outdated(self) -> bool:
        """Whether the latest outcome is that of another state than the present one."""
        return self.outcome is not None and self.outcome.state != self.state

    # ------------------------------------------------------------------------------- robots

    def robot_names(self) -> list[str]:
        """Names of all robots, built-in and stored."""
        return [robot.name for robot in self.client.robots.iterate()]

    def choose_robot(self, name: str) -> None:
        """Begin with another robot; the scene stays, and nothing is held.

        Args:
            name: Name of a built-in or stored robot.
        """
        self.model = self.client.robots.get(name)
        joints = home(self.model)
        obstacles = self.history.present.obstacles if hasattr(self, "history") else ()
        self.history = History(StudioState(name, joints, joints, obstacles=obstacles))
        self.outcome, self.pinned, self.branches = None, None, ()

    def restore(self, state: StudioState) -> None:
        """Begin with the state of an earlier session, as far as the service still has its robot.

        Args:
            state: State of that session.
        """
        if state.robot not in self.robot_names():
            return
        self.choose_robot(state.robot)
        if len(state.start) == len(self.model.joint_names):
            tool = state.tool if state.tool in self.tool_names() else None
            self.history = History(replace(state, tool=tool))

    def upload_robot(self, file_name: str, content: bytes, tip_link: str | None = None) -> None:
        """Store a robot of a URDF or a .zip, and begin with it; its lint is in `model.lint`.

        Args:
            file_name: Name whose stem becomes the robot's name.
            content: Content of the file.
            tip_link: Link that the chain ends at, for a tree with several arms: a refusal names
                them.

        Raises:
            ApiError: The description is refused.
            ValueError: The file is neither a URDF nor a .zip.
        """
        upload = robot_upload(file_name, content, tip_link)
        self.choose_robot(self.client.robots.create(upload).name)

    def tool_names(self) -> list[str]:
        """Names of all stored tools."""
        return [tool.name for tool in self.client.tools.iterate()]

    def mount(self, tool: str | None) -> None:
        """Mount a stored tool, or none; goal poses mean its tip from now on.

        Args:
            tool: Name of the tool.
        """
        self._change(replace(self.state, tool=tool, goal_pose=None))

    def geometry(self, kind: Literal["collision", "visual"] = "collision") -> GeometryAnswer:
        """The collision geometry of robot and tool, or what they look like.

        Args:
            kind: Kind of geometry.
        """
        return self.client.robots.geometry(self.state.robot, kind, tool=self.state.tool)

    def link_poses(self, joints: Sequence[float]) -> dict[str, Pose]:
        """Poses of all links at a configuration, in the root frame; fingers as at the start.

        Args:
            joints: Shape (n,) [rad or m].
        """
        fingers = dict(self.state.fingers) or None
        state = self.state
        return self.client.robots.fk(state.robot, joints, fingers=fingers, tool=state.tool).links

    def link_poses_of(
        self,
        rows: Sequence[Sequence[float]],
        fingers: Mapping[str, float | Sequence[float]] | None = None,
    ) -> dict[str, list[Pose]]:
        """Poses of all links at many configurations, in the root frame.

        Args:
            rows: Shape (m, n) [rad or m].
            fingers: Positions of joints of the gripper, as they are at the start if None: one, or
                one with each configuration [rad or m].
        """
        at = dict(self.state.fingers if fingers is None else fingers) or None
        state = self.state
        return self.client.robots.fk_batch(state.robot, rows, fingers=at, tool=state.tool).links

    def joint_ranges(self) -> list[tuple[float, float]]:
        """Range of each joint's slider [rad or m]."""
        return joint_ranges(self.model)

    # --------------------------------------------------------------------------- start, goal

    def set_start(self, joints: Sequence[float], key: str | None = None) -> None:
        """Change the start configuration [rad or m]."""
        self._change(replace(self.state, start=tuple(joints)), key)

    def set_goal_joints(self, joints: Sequence[float], key: str | None = None) -> None:
        """Make a configuration the goal [rad or m]."""
        self._change(replace(self.state, goal_joints=tuple(joints), goal_pose=None), key)

    def set_finger(self, joint: str, position: float) -> None:
        """Change where a joint of the gripper stands at the start, and during a plan.

        Args:
            joint: Joint of the gripper.
            position: [rad or m].
        """
        fingers = with_option(self.state.fingers, joint, position)
        self._change(replace(self.state, fingers=fingers), f"finger {joint}")

    def goal_tip(self) -> Pose:
        """The pose of the tip at the goal, in the root frame."""
        if self.state.goal_pose is not None:
            return self.state.goal_pose
        state = self.state
        return self.client.robots.fk(state.robot, state.goal_joints, tool=state.tool).pose

    def move_goal(self, pose: Pose, key: str | None = None) -> tuple[Branch, ...]:
        """Make a pose of the tip the goal, and answer all configurations that reach it.

        Args:
            pose: Pose in the root frame.
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
            number: Number of the branch, counted from 0.
        """
        self.set_goal_joints(self.branches[number].joints)

    def _solve(self, pose: Pose) -> tuple[Branch, ...]:
        request = ik_request(self.state, pose)
        options = set_fields(request, without=("pose",))
        try:
            answer = self.client.robots.ik(self.state.robot, pose, **options)
        except NoIkSolution as error:
            return branches(error.problem.details.get("rejected") or [])
        return branches([solution.model_dump(mode="json") for solution in answer.solutions])

    # -------------------------------------------------------------------------------- scene

    def add_obstacle(self, kind: ShapeKind) -> Obstacle:
        """Add an obstacle before the robot, of a size that the jaws of a mounted tool can hold.

        Args:
            kind: Kind of the shape.
        """
        obstacle = new_obstacle(kind, self.state.free_id(kind), _NEW_PLACE, self._new_size())
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
            obstacle_id: Id of the obstacle.
            link: Link of the robot; None to put the obstacle back into the scene.
        """
        self._change(self.state.with_attached(obstacle_id, link))

    def import_file(self, file_name: str, content: bytes) -> None:
        """Take the obstacles of a scene (JSON, MoveIt's YAML) in place of all, or add a mesh.

        Args:
            file_name: Name with its ending.
            content: Content of the file.

        Raises:
            ValueError: It is none of these, or can't be read.
        """
        obstacles = read_obstacles(file_name, content, self._frame_pose)
        if file_name.lower().endswith(("json", *MOVEIT)):
            self._take_obstacles(obstacles)
            return
        (mesh,) = obstacles
        taken = {item.id for item in self.state.obstacles}
        name = self.state.free_id(mesh.id) if mesh.id in taken else mesh.id
        placed = mesh.model_copy(update={"id": name, "pose": FramedPose.at(*_NEW_PLACE)})
        self._change(self.state.with_obstacle(placed))

    def load_scene(self, name: str) -> None:
        """Take the obstacles of a stored scene.

        Args:
            name: Name of the scene.
        """
        self._take_obstacles(listed(self.client.scenes.get(name), self._frame_pose))

    def save_scene(self, name: str) -> None:
        """Store the scene under a name, whether there is one or not.

        Args:
            name: Name of the scene.
        """
        self.client.scenes.replace(name, Scene(obstacles=list(self.state.obstacles)))

    # --------------------------------------------------------------------- settings, history

    def set_setting(self, path: str, value: Any) -> None:
        """Change a setting; None leaves the field to the service.

        Args:
            path: Path of the setting, "timing.method".
            value: New value.
        """
        self._change(self.state.with_setting(path, value), f"setting {path}")

    def set_entries(self, name: str, entries: Entries, key: str | None = None) -> None:
        """Change a list of the state.

        Args:
            name: "constraints" of the plan, "stages" of the task, "goals" of the tour, or
                "waypoints" of the tool path.
            entries: Entries in order.
            key: See `History.change`.
        """
        changes: dict[str, Any] = {name: entries}
        self._change(replace(self.state, **changes), key)

    def set_option(self, which: str, name: str, value: Any) -> None:
        """Change an option of the "tour" or of the tool "path"; None leaves it to the service."""
        options = with_option(getattr(self.state, f"{which}_options"), name, value)
        changes: dict[str, Any] = {f"{which}_options": options}
        self._change(replace(self.state, **changes), f"{which} {name}")

    def add_pick_and_place(
        self, obstacle: Obstacle, *, pick: bool = True, place: bool = True
    ) -> None:
        """Add the stages that pick an object, and those that place it at the goal.

        Args:
            obstacle: The object.
            pick: Whether to add those of the pick.
            place: Whether to add those of the place.
        """
        stages = self.state.stages
        if pick:
            stages += pick_stages(obstacle, self.gripper_links(), self.tool_grasps())
        if place:
            stages += place_stages(obstacle, self.goal_tip())
        self.set_entries("stages", stages)

    def _new_size(self) -> float:
        """Size of a new obstacle [m]: at most a part of the opening of a mounted tool's jaws."""
        if self.state.tool is None:
            return NEW_SIZE
        tool = self.client.tools.get(self.state.tool)
        opening = tool.opening[1] if tool.opening else getattr(tool.form, "opening", 2.0 * NEW_SIZE)
        return min(NEW_SIZE, _HELD * opening)

    def tool_grasps(self) -> str | None:
        """Kind of grasps that the mounted tool has of an object's shape; None without a tool."""
        if self.state.tool is None:
            return None
        tool = self.client.tools.get(self.state.tool)
        sucks = tool.grip == "suction" or (tool.form and tool.form.type == "suction_cup")
        return "suction" if sucks else "top"

    def gripper_links(self) -> list[str]:
        """Links that may touch a load: the mounted tool, or those that do not move in the tip."""
        if self.state.tool is not None:
            return [self.state.tool]
        poses = self._poses_twice()
        tips = poses[self.model.tip_link]
        bodies = self.geometry().bodies
        return sorted({body.link for body in bodies if stays_in(poses[body.frame], tips)})

    def still_links(self) -> list[str]:
        """Links that no joint of the robot moves."""
        origin = [Pose.at(0.0, 0.0, 0.0)] * 2
        return [name for name, rows in self._poses_twice().items() if stays_in(rows, origin)]

    def _poses_twice(self) -> dict[str, list[Pose]]:
        """Poses of all links at the start and with all joints elsewhere."""
        return self.link_poses_of([self.state.start, [q + 0.1 for q in self.state.start]])

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

    def plan(self, kind: Kind = "motion") -> Outcome:
        """Plan from the start on; motions with their certificates, or a failure explained.

        Args:
            kind: "motion" to the goal, the stages of the "task" as one, the goals of the "tour" in
                the best order, or the "tool path" along the waypoints.
        """
        self.outcome = attempt(self.state, lambda: plan(self.client, self.state, kind))
        return self.outcome

    def pin(self) -> None:
        """Keep the present plan, to compare the next one with it."""
        if isinstance(self.outcome, Planned):
            self.pinned = self.outcome

    def export(self, file_format: ExportFormat) -> ExportFile:
        """The present motion, or those of the task, as a file for a controller.

        Args:
            file_format: Format of the file.

        Raises:
            ApiError: The service refuses it.
            ValueError: There is no motion.
        """
        if not isinstance(self.outcome, Planned | TaskPlanned | TourPlanned):
            raise ValueError("there is no motion yet: plan one first")
        return export_file(self.client, self.outcome, file_format)

    def view_url(self) -> str | None:
        """Address of the page of the latest plan, or of its failure, if the service kept it."""
        plan_id = None if self.outcome is None else self.outcome.plan_id
        return None if plan_id is None else f"{self.url.rstrip('/')}/v1/plans/{plan_id}/view"

    def _take_obstacles(self, obstacles: Sequence[Obstacle]) -> None:
        nothing: Mapping[str, str] = MappingProxyType({})
        self._change(replace(self.state, obstacles=tuple(obstacles), attached=nothing))

    def _frame_pose(self, frame: str) -> Pose:
        """The pose of a link that stands still, in the root frame.

        Raises:
            ValueError: The robot has no such link, or it moves.
        """
        if frame in (self.model.frame, "world"):
            return Pose.at(0.0, 0.0, 0.0)
        if frame not in self.still_links():
            raise ValueError(f"frame {frame!r} is no link that stands still")
        return self.link_poses(self.state.start)[frame]

    def _change(self, state: StudioState, key: str | None = None) -> None:
        self.history = self.history.change(state, key)

    def _openapi(self) -> Mapping[str, Any]:
        document: Mapping[str, Any] = self.client._sender.send(
            Call("GET", "/openapi.json", json.loads)
        )
        return document


def colliding_pairs(workbench: Workbench, failed: Failure) -> list[tuple[str, str]]:
    """The pairs that collide or are nearer than the margin, the deepest first.

    Args:
        workbench: Workbench that asks.
        failed: Failure with the configuration that it is about.
    """
    pairs = [] if failed.pair is None else [failed.pair]
    if failed.shown is None:
        return pairs
    answer = check(workbench, failed)
    hits = sorted(answer.collisions, key=lambda hit: -(hit.depth or 0.0))
    pairs += [hit.pair for hit in hits]
    if not hits and answer.clearance_pair is not None and not answer.valid:
        pairs.append(answer.clearance_pair)
    return [pair for i, pair in enumerate(pairs) if {*pair} not in [{*p} for p in pairs[:i]]]


def check(workbench: Workbench, failed: Failure) -> CheckAnswer:
    """The verdict on the configuration that a failure is about.

    Args:
        workbench: Workbench that asks.
        failed: Failure with the configuration that it is about.
    """
    fields = set_fields(plan_request(failed.state, keep=False))
    names = ("scene", "attached", "margin", "fingers")
    options = {name: fields[name] for name in names if name in fields}
    answer = workbench.client.check(failed.state.robot, list(failed.shown or ()), **options)
    if not isinstance(answer, CheckAnswer):
        raise TypeError("one configuration was asked about, and many verdicts were answered")
    return answer


def joint_ranges(model: Robot) -> list[tuple[float, float]]:
    """Range of each joint's slider [rad or m].

    Args:
        model: Model of the robot.
    """
    limits = zip(model.limits.lower, model.limits.upper, strict=True)
    return [
        (-_FREE_RANGE if low is None else low, _FREE_RANGE if high is None else high)
        for low, high in limits
    ]


def home(model: Robot) -> tuple[float, ...]:
    """The first named state of a robot, or the configuration in the middle of its limits.

    Args:
        model: Model of the robot.
    """
    if model.states:
        return tuple(next(iter(model.states.values())))
    return tuple(0.5 * (low + high) for low, high in joint_ranges(model))

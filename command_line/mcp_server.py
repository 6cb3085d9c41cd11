"""The tools that a language model calls, over a service: small answers, links to kept plans."""

from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from functools import wraps
from typing import Annotated, Any, ParamSpec, TypeVar

from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ResourceNotFoundError, ToolError
from mcp.types import ResourceLink, ToolAnnotations
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from armwright_client import (
    ApiError,
    ArmwrightError,
    AsyncClient,
    Goal,
    Start,
    TransportError,
)
from armwright_wire.motions.trajectory import TrajectoryBody
from armwright_wire.plans.kept_plan import KeptPlan
from armwright_wire.plans.stages import StageUnion
from armwright_wire.scenes.scene import Obstacle, SceneReference
from service.version import VERSION
from service.viewer.words import certificate_sentences, problem_sentences

P = ParamSpec("P")
A = TypeVar("A")

#: Items of a list that an answer names; it says how many more there are.
_SHOWN = 30
_INSTRUCTIONS = """\
Motions of robot arms, planned and proved by an Armwright service. Lengths are in metres, angles in
radians, quaternions in the order x, y, z, w; poses are in the robot's root frame. Begin with
list_robots. plan and task keep what they answer: explain and view take its plan_id, and the motion
itself is the resource armwright://plans/{plan_id}. `proved` true means that limits and collisions
are proved for every instant; never call a motion safe for which it is false."""
_START_HINT = "Start one with `armwright serve`, or give its address: `armwright mcp --url`."
#: Fields of a request that say what a motion is proved against.
_PREMISES = (
    *("scene", "frame", "attached", "allowed_collisions", "margin", "collisions"),
    *("fingers", "limits", "constraints"),
)
_READS = ToolAnnotations(read_only_hint=True, open_world_hint=False)
_KEEPS = ToolAnnotations(read_only_hint=False, destructive_hint=False, open_world_hint=False)

Robot = Annotated[str, Field(description="name of a robot, see list_robots")]
Configuration = Annotated[
    list[float] | str,
    Field(description="joint positions in the robot's order [rad or m], or the name of a state"),
]
Target = Annotated[
    list[float] | str | dict[str, Any],
    Field(
        description="joint positions, the name of a state, a pose of the tip {position: [x, y, z], "
        "rpy: [..] or quaternion_xyzw: [..]}, or any goal of POST /v1/plan"
    ),
]
SceneOf = Annotated[
    str | dict[str, Any] | None,
    Field(
        description="name of a stored scene, or {obstacles: [{id, shape: {type: box, size: [..]}, "
        "pose: {position: [..]}}]}; no obstacles if left out"
    ),
]
Margin = Annotated[float, Field(ge=0.0, description="distance to be kept from obstacles [m]")]
PlanId = Annotated[str, Field(description="`plan_id` of an answer")]
Options = Annotated[
    dict[str, Any] | None,
    Field(description="further fields of the request, as the service's /docs has them"),
]


class Robots(BaseModel):
    """Robots of the service, and the model of one of them."""

    robots: list[str]
    joint_names: list[str] | None = None
    lower: list[float | None] | None = None
    upper: list[float | None] | None = None
    states: dict[str, list[float]] | None = None
    frame: str | None = None
    tip_link: str | None = None
    notes: list[str] | None = None


class Described(BaseModel):
    """Stored scenes, or the obstacles of one."""

    scenes: list[str] | None = None
    obstacles: list[str] | None = None


class Checked(BaseModel):
    """Verdict about a configuration."""

    valid: bool
    clearance: float | None = Field(description="[m]; negative in collision")
    says: list[str]


class Kept(BaseModel):
    """A kept plan in short."""

    plan_id: str
    proved: bool = Field(description="all that was asked is proved, for every instant")
    duration: float = Field(description="[s]")
    end: list[float] = Field(description="joint positions at the end")
    says: list[str]
    data: str = Field(description="resource that holds the whole answer")
    page: str = Field(description="address of a page for people")


class Proof(BaseModel):
    """Verdict about a motion."""

    proved: bool
    plan_id: str | None
    says: list[str]


class Explained(BaseModel):
    """A kept plan or failure in words."""

    operation: str
    status: str
    robot: str | None
    scene: str | None
    says: list[str]


def told(tool: Callable[P, Awaitable[A]]) -> Callable[P, Awaitable[A]]:
    """The tool whose problems the model reads as short sentences."""

    @wraps(tool)
    async def run(*args: P.args, **kwargs: P.kwargs) -> A:
        try:
            return await tool(*args, **kwargs)
        except ApiError as error:
            problem = error.problem.model_dump(mode="json")
            kept = error.details.get("plan_id")
            lines = [f"Kept as plan_id {kept}."] if kept else []
            raise ToolError("\n".join(some([*lines, *problem_sentences(problem)]))) from None
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(map(str, first["loc"]))
            raise ToolError(f"{where}: {first['msg']}") from None
        except TransportError as error:
            raise ToolError(f"The service does not answer: {error}. {_START_HINT}") from None
        except ArmwrightError as error:
            raise ToolError(str(error)) from None

    return run


class Tools:
    """Tools over a service.

    Args:
        client: Connected to the service.
        url: Address of the service, for links.
    """

    def __init__(self, client: AsyncClient, url: str) -> None:
        self._client = client
        self._url = url.rstrip("/")

    @told
    async def list_robots(self, robot: Robot | None = None) -> Robots:
        """Names of all robots; of a robot that is named also joints, limits, states and frames."""
        names = [item.name async for item in self._client.robots.iterate()]
        if robot is None:
            return Robots(robots=names)
        model = await self._client.robots.get(robot)
        return Robots(
            robots=names,
            joint_names=model.joint_names,
            lower=model.limits.lower,
            upper=model.limits.upper,
            states=model.states,
            frame=model.frame,
            tip_link=model.tip_link,
            notes=some(model.lint),
        )

    @told
    async def describe_scene(self, scene: str | None = None) -> Described:
        """The obstacles of a stored scene in words; names of the stored scenes if left out."""
        if scene is None:
            names = [item.name async for item in self._client.scenes.iterate()]
            return Described(scenes=some(names))
        stored = await self._client.scenes.get(scene)
        if stored.moveit is not None:
            return Described(obstacles=["A planning scene of MoveIt, kept as its own text."])
        return Described(obstacles=some(map(obstacle_words, stored.obstacles or ())))

    @told
    async def check(
        self, robot: Robot, joints: Configuration, scene: SceneOf = None, margin: Margin = 0.0
    ) -> Checked:
        """Whether a configuration is inside its limits and free of collision."""
        at = await self._joints(robot, joints)
        answer = await self._client.check(robot, at, scene=scene_of(scene), margin=margin)
        says = [
            f"{' and '.join(item.pair)} collide{depth(item.depth)}." for item in answer.collisions
        ]
        says += [
            f"{item.joint} is at {item.value:.4g}, its limit is {item.limit:.4g}."
            for item in answer.limit_violations
        ]
        if answer.clearance is not None and answer.clearance_pair is not None:
            says.append(f"Nearest: {' and '.join(answer.clearance_pair)}.")
        return Checked(valid=answer.valid, clearance=answer.clearance, says=some(says))

    @told
    async def plan(
        self,
        robot: Robot,
        start: Configuration,
        goal: Target,
        scene: SceneOf = None,
        margin: Margin = 0.0,
        options: Options = None,
    ) -> Kept:
        """Plan a motion from a configuration to a goal, and prove it; the plan is kept."""
        answer = await self._client.plan(
            robot,
            start_of(start),
            goal_of(goal),
            **{"scene": scene_of(scene), "margin": margin, **further(options), "keep": True},
        )
        end = answer.path.joints[-1]
        says = certificate_sentences(answer.certificate.model_dump(mode="json", exclude_unset=True))
        proved = answer.certificate.verified
        return self._kept(answer.plan_id, proved, answer.trajectory.duration, end, says)

    @told
    async def task(
        self,
        robot: Robot,
        start: Configuration,
        stages: Annotated[
            list[dict[str, Any]],
            Field(
                description="in order, each {kind, ...}: move {goal}, approach, retreat and lift "
                "{distance: [least, most]}, grasp {object, region or grasps, touch_links}, place "
                "{poses or region}, attach {object}, detach, open, close, wait {duration}"
            ),
        ],
        scene: SceneOf = None,
        margin: Margin = 0.0,
        options: Options = None,
    ) -> Kept:
        """Plan grasps, places and motions of several stages as one, each proved; it is kept."""
        answer = await self._client.plan_task(
            robot,
            start_of(start),
            TypeAdapter(list[StageUnion]).validate_python(stages),
            **{"scene": scene_of(scene), "margin": margin, **further(options), "keep": True},
        )
        fields = answer.model_dump(mode="json", exclude_unset=True)
        proved = all(stage.certificate.verified for stage in answer.stages)
        end = answer.stages[-1].trajectory.sample([answer.stages[-1].trajectory.duration])[0]
        says = [*stage_sentences(fields["stages"])]
        if answer.status == "partial":
            says.append(f"Not all stages could be done: {answer.failure}.")
        return self._kept(answer.plan_id, proved, answer.duration, end, says)

    @told
    async def validate(
        self,
        motion: Annotated[
            str | dict[str, Any],
            Field(description="plan_id of a plan, or a trajectory as POST /v1/validate has it"),
        ],
        robot: Annotated[str | None, Field(description="needed with a trajectory")] = None,
        scene: SceneOf = None,
        margin: Annotated[float | None, Field(ge=0.0, description="in place of 0 [m]")] = None,
        options: Options = None,
    ) -> Proof:
        """Prove a motion, or tell its first violation; of a kept plan with what it was made for.

        A scene or margin that is given stands in place of the plan's.
        """
        fields: dict[str, Any] = {}
        if isinstance(motion, str):
            kept = await self._client.plans.get(motion)
            if not kept.operation.endswith("/plan") or kept.answer is None:
                raise ToolError(
                    "Only the motion of a plan is proved again: stages of tasks and legs of tours "
                    "carry their own proof (explain)."
                )
            fields = {name: kept.request[name] for name in _PREMISES if name in kept.request}
            robot = robot or kept.request["robot"]
            motion = {"segments": kept.answer["trajectory"]["segments"]}
        if robot is None:
            raise ToolError("robot: name the robot that the trajectory is for.")
        given = {"scene": scene_of(scene), "margin": margin, **further(options)}
        fields |= {name: value for name, value in given.items() if value is not None}
        trajectory = TrajectoryBody.model_validate(motion)
        answer = await self._client.validate(robot, trajectory, **{**fields, "keep": True})
        says = certificate_sentences(answer.model_dump(mode="json", exclude_unset=True))
        return Proof(proved=answer.verified, plan_id=answer.plan_id, says=some(says))

    @told
    async def explain(self, plan_id: PlanId) -> Explained:
        """A kept plan in words: its proof, or why there is none and what to change."""
        kept = await self._client.plans.get(plan_id)
        return Explained(
            operation=kept.operation,
            status=kept.status,
            robot=None if kept.robot is None else kept.robot.name,
            scene=None if kept.scene is None else kept.scene.name,
            says=some(kept_sentences(kept)),
        )

    @told
    async def view(self, plan_id: PlanId) -> list[ResourceLink | str]:
        """A page of a kept plan for people: motion, curves and proof, or why there is none."""
        await self._client.plans.get(plan_id)
        link = ResourceLink(
            type="resource_link",
            uri=f"{resource(plan_id)}/page",
            name=f"plan {plan_id}",
            mime_type="text/html",
        )
        return [f"Open {self._page(plan_id)} in a browser.", link]

    async def document(self, plan_id: str) -> str:
        """A kept plan with its request and its answer or problem, as JSON."""
        try:
            kept = await self._client.plans.get(plan_id)
        except ArmwrightError as error:
            raise ResourceNotFoundError(str(error)) from None
        return kept.model_dump_json(exclude_none=True)

    async def page(self, plan_id: str) -> str:
        """The page of a kept plan."""
        try:
            return (await self._client.plans.view(plan_id)).decode()
        except ArmwrightError as error:
            raise ResourceNotFoundError(str(error)) from None

    async def _joints(self, robot: str, joints: list[float] | str) -> list[float]:
        if not isinstance(joints, str):
            return joints
        states = (await self._client.robots.get(robot)).states
        if joints not in states:
            known = ", ".join(sorted(states)) or "none"
            raise ToolError(f"{robot} has no state {joints!r}; it has: {known}.")
        return states[joints]

    def _page(self, plan_id: str) -> str:
        return f"{self._url}/v1/plans/{plan_id}/view"

    def _kept(
        self,
        plan_id: str | None,
        proved: bool,
        duration: float,
        end: Sequence[float],
        says: list[str],
    ) -> Kept:
        assert plan_id is not None
        return Kept(
            plan_id=plan_id,
            proved=proved,
            duration=round(duration, 4),
            end=[round(q, 6) for q in end],
            says=some(says),
            data=resource(plan_id),
            page=self._page(plan_id),
        )


def mcp_server(client: AsyncClient, url: str) -> MCPServer[Any]:
    """The server of the tools, and of kept plans as resources.

    Args:
        client: Connected to the service.
        url: Address of the service, for links.
    """
    tools = Tools(client, url)
    server: MCPServer[Any] = MCPServer(
        "armwright", instructions=_INSTRUCTIONS, version=VERSION, log_level="WARNING"
    )
    for read in (tools.list_robots, tools.describe_scene, tools.check, tools.explain, tools.view):
        server.add_tool(read, annotations=_READS)
    for write in (tools.plan, tools.task, tools.validate):
        server.add_tool(write, annotations=_KEEPS)
    place = resource("{plan_id}")
    server.resource(place, name="plan", mime_type="application/json")(tools.document)
    server.resource(f"{place}/page", name="page", mime_type="text/html")(tools.page)
    return server


def resource(plan_id: str) -> str:
    """The address of a kept plan as a resource."""
    return f"armwright://plans/{plan_id}"


def some(items: Iterable[str]) -> list[str]:
    """The first items, and how many more there are."""
    every = list(items)
    more = len(every) - _SHOWN
    return every if more <= 0 else [*every[:_SHOWN], f"… and {more} more"]


def start_of(start: list[float] | str) -> Start:
    """The start that is meant by joints or by the name of a state."""
    return Start(state=start) if isinstance(start, str) else Start.of(joints=start)


def goal_of(goal: list[float] | str | Mapping[str, Any]) -> Goal:
    """The goal that is meant by joints, the name of a state, a pose, or a goal's own fields."""
    if isinstance(goal, str):
        return Goal(state=goal)
    if isinstance(goal, Mapping):
        is_goal = any(name in goal for name in Goal.one_of)
        return Goal.model_validate(goal if is_goal else {"pose": goal})
    return Goal.at_joints(goal)


def scene_of(scene: str | dict[str, Any] | None) -> Any:
    """A scene as requests take it."""
    return scene if scene is None else TypeAdapter(SceneReference).validate_python(scene)


def further(options: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Further fields of a request, those of the tool's own arguments refused."""
    doubled = {"robot", "start", "goal", "stages", "scene", "margin", "keep"} & set(options or ())
    if doubled:
        raise ToolError(f"options: {', '.join(sorted(doubled))} have no place there.")
    return options or {}


def depth(value: float | None) -> str:
    """How deep a pair overlaps, in words."""
    return "" if value is None else f", {1000.0 * value:.1f} mm deep"


def obstacle_words(obstacle: Obstacle) -> str:
    """An obstacle in a line: name, shape, sizes and position."""
    fields = obstacle.shape.model_dump(mode="json", exclude_none=True)
    kind = fields.pop("type")
    # Vertices, points and files are too long for a line.
    sizes = [f"{name} {value}" for name, value in fields.items()
             if not (isinstance(value, str | list) and len(value) > 8)]  # fmt: skip
    place = obstacle.pose.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    where = ", ".join(f"{name} {value}" for name, value in place.items())
    margin = f", margin {obstacle.margin} m" if obstacle.margin else ""
    return f"{obstacle.id}: {', '.join([kind, *sizes])}; {where}{margin}"


def stage_sentences(stages: Iterable[Mapping[str, Any]]) -> Iterable[str]:
    """Sentences of stages of a task or of legs of a tour."""
    for number, stage in enumerate(stages):
        certificate, kind = stage["certificate"], stage.get("kind", "leg")
        verdict = "proved" if certificate["verified"] else "NOT proved"
        clearance = certificate.get("min_clearance")
        near = "" if clearance is None else f", clearance at least {1000.0 * clearance:.1f} mm"
        yield f"{number} {kind}: {stage['trajectory']['duration']:.3f} s, {verdict}{near}."


def kept_sentences(kept: KeptPlan) -> list[str]:
    """Sentences of a kept request's answer or problem."""
    if kept.problem is not None:
        return problem_sentences(kept.problem.model_dump(mode="json", exclude_unset=True))
    answer = kept.answer
    if "certificate" in answer:
        stages = [f"{item['name']}: {item['outcome']}" for item in answer["stages"]]
        return [*certificate_sentences(answer["certificate"]), f"Stages: {'; '.join(stages)}."]
    if "verified" in answer:
        return certificate_sentences(answer)
    parts = answer.get("stages") or answer.get("legs")
    if parts is not None:
        duration = answer["time"] if "legs" in answer else answer["duration"]
        left = [
            f"Goal {one['id']} is left out: {one['message']}" for one in answer.get("unvisited", ())
        ]
        return [f"{duration:.3f} s in all.", *stage_sentences(parts), *left]
    if "solutions" in answer:
        return [f"{len(answer['solutions'])} configurations reach the pose."]
    return [f"valid: {answer['valid']}, clearance: {answer['clearance']}."]

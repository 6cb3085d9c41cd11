"""Tasks of several stages from wire to domain."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from armwright_wire.goals.goal import SingleGoal
from armwright_wire.goals.tool_motion import CartesianOptions as CartesianBody
from armwright_wire.goals.tool_motion import cartesian_options
from armwright_wire.plans import stages as schema
from armwright_wire.plans.task import TaskRequest
from armwright_wire.robots.reach import ReachTolerance
from armwright_wire.scenes.check import Attached
from armwright_wire.scenes.tool import HeldTip
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, located
from kinematics.pose import transform
from kinematics.tree.srdf import state
from obstacles.robots.grasps import (
    GraspKind,
    GraspSearch,
    find_grasps,
    jaw_span,
    object_down,
    surface_of,
)
from obstacles.robots.resting import resting_places
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.options import CartesianOptions, Options
from planning.problem import Goal, JointGoal, PoseGoal
from planning.reach.evaluation import Axis, Tolerance
from planning.sequence.stage import (
    Attach,
    Detach,
    DirectionFrame,
    Follow,
    Grasp,
    Gripper,
    Into,
    Load,
    Move,
    ObjectTip,
    Place,
    Signal,
    Stage,
    StageSettings,
    Straight,
)
from planning.sequence.stage import Wait as WaitStage
from planning.sequence.target import grasp_region, place_region
from service.translate import poses, timings
from service.translate.constraints import constraint
from service.translate.contacts import contacts, touch_depth
from service.translate.frames import (
    Frames,
    cartesian_in_root_frame,
    constraints_in_root_frame,
)
from service.translate.problems import cartesian, planner_name
from service.translate.robots.tools import tip_in_object

#: Frame and direction of straight motions that name none.
_DIRECTIONS: Mapping[str, tuple[DirectionFrame, tuple[float, float, float]]] = {
    "approach": ("tool", (0.0, 0.0, 1.0)),
    "insert": ("tool", (0.0, 0.0, 1.0)),
    "retreat": ("tool", (0.0, 0.0, -1.0)),
    "lift": ("root", (0.0, 0.0, 1.0)),
}


def stages(
    body: TaskRequest,
    flat: Sequence[schema.SingleStage],
    robots: Sequence[tuple[RobotGeometry, HeldTip | None]],
    scene: Scene,
    start: Array,
    timeout: float,
) -> tuple[Stage, ...]:
    """The stages of a request, all poses in the root frame.

    Args:
        body: The request.
        flat: Its stages, those of blocks put in.
        robots: The robot alone, with the tool that it has in each stage.
        scene: The objects that are not held at the start.
        start: Configuration of the robot at the start, shape (n,) [rad or m].
        timeout: Timeout for all stages together [s].

    Raises:
        ArmwrightError: A stage is malformed; the message and the details say which.
    """
    names = {stage.name: k for k, stage in enumerate(flat) if stage.name is not None}
    made: list[Stage] = []
    for k, (stage, (robot, held)) in enumerate(zip(flat, robots, strict=True)):
        frames = Frames(robot.chain, start, body.frame)
        tip = None if held is None else ObjectTip(held.object, tip_in_object(held))
        made.append(_Translator(body, names, robot, tip, scene, frames, timeout).stage(k, stage))
    return tuple(made)


class _Translator:
    """Translates the stages of one request."""

    def __init__(
        self, body: TaskRequest, names: Mapping[str, int], robot: RobotGeometry,
        tip: ObjectTip | None, scene: Scene, frames: Frames, timeout: float,
    ) -> None:  # fmt: skip
        self._tip = tip
        self._body, self._robot, self._scene, self._frames = body, robot, scene, frames
        self._timeout, self._names = timeout, names

    def stage(self, k: int, body: schema.SingleStage) -> Stage:
        """Stage ``k``, its faults told with its number."""
        details = {"index": k, "kind": body.kind, "name": body.name}
        with located(f"stages[{k}] ({body.kind})", details=details):
            return self._stage(k, body)

    def _stage(self, k: int, body: schema.SingleStage) -> Stage:
        settings = self._settings(body)
        match body:
            case schema.MoveStage():
                return self._move(body, settings)
            case schema.StraightStage():
                return _straight(body, settings)
            case schema.LineStage() | schema.ArcStage() | schema.SeamStage():
                return Follow(body.kind, settings)
            case schema.GraspStage():
                grips = self._grasps(body)
                return Grasp(
                    body.object, grips, tuple(body.touch_links), supports(body.support), settings,
                    touch_depth(body.touch_depth),
                )  # fmt: skip
            case schema.PlaceStage():
                return Place(
                    body.object, self._places(body, k), body.relative_to, supports(body.support),
                    settings, touch_depth(body.touch_depth),
                )  # fmt: skip
            case schema.OpenStage() | schema.CloseStage():
                until = body.until if isinstance(body, schema.CloseStage) else None
                return Gripper(body.kind, self._fingers(body), body.duration, settings, until)
            case _:
                return _still(body, settings)

    def _settings(self, body: schema.SingleStage) -> StageSettings:
        task = self._body
        timing = body.timing or task.timing
        if isinstance(body, schema.FollowStage) and body.tool_speed is not None:
            timing = timing.model_copy(update={"tool_speed": body.tool_speed})
        chain = self._robot.chain
        wanted = constraints_in_root_frame(body.constraints, self._frames)
        pairs = [*(task.allowed_collisions or ()), *(body.allowed_collisions or ())]
        planner = planner_name(body.planner) if isinstance(body, schema.MoveStage) else "auto"
        deviations = self._cartesian(body)
        if isinstance(body, schema.StraightStage):
            deviations = CartesianOptions(
                max_deviation=body.max_deviation,
                max_orientation_deviation=body.max_orientation_deviation,
            )
        return StageSettings(
            name=body.name or "",
            margin=task.margin if body.margin is None else body.margin,
            allowed=contacts(pairs, "request"),
            constraints=tuple(constraint(item) for item in wanted or ()),
            options=Options(
                planner=planner,
                timing=timings.timing_options(timing, several=True),
                limits=timings.given_limits(body.limits or task.limits, chain.joint_names),
                cartesian=deviations,
                timeout=self._timeout,
                seed=task.seed,
                stops=task.stops,
            ),
            robot=self._robot,
            tip=self._tip,
        )

    def _cartesian(self, body: schema.StageBody) -> CartesianOptions:
        """Lines, arcs or the seam of a stage; none of others."""
        given: dict[str, Any] = body.model_dump(mode="json", exclude_unset=True)
        names = {"max_deviation", "max_orientation_deviation", "blend"}
        motions: list[dict[str, Any]] | None = None
        match body:
            case schema.LineStage():
                poses = given.get("poses") or [given["pose"]]
                motions = [{"type": "lin", "pose": pose} for pose in poses]
            case schema.ArcStage():
                frame = given["pose"].pop("frame", None)
                names_of = {"pose", "via", "center", "normal"} & given.keys()
                arc: dict[str, Any] = {name: given[name] for name in names_of}
                motions = [{"type": "circ", "frame": frame, **arc}]
            case schema.SeamStage():
                names = {*CartesianBody.model_fields}
            case _:
                return CartesianOptions()
        options = {name: given[name] for name in names if name in given}
        options |= {} if motions is None else {"motions": motions}
        rooted = cartesian_in_root_frame(options, self._frames)
        return cartesian(cartesian_options(rooted), self._robot.chain)

    def _move(self, body: schema.MoveStage, settings: StageSettings) -> Move:
        if body.end_of is not None:
            if body.end_of not in self._names:
                raise InvalidOption(
                    f"end_of names {body.end_of!r}, and no stage has that name",
                    hint=f"Names are: {', '.join(self._names) or 'none'}.",
                )
            return Move((), self._names[body.end_of], settings, body.blend)
        if body.goal is None:
            return Move(settings=settings)
        items: Sequence[SingleGoal] = body.goal.any_of or [body.goal]
        goals = [self._goal(item, i) for i, item in enumerate(items)]
        if body.tolerance is not None:
            goals = [near for goal in goals for near in _around(goal, body.tolerance)]
        if len(goals) > schema.MAX_TARGETS:
            raise InvalidOption(
                f"goal and tolerance make {len(goals)} poses, at most {schema.MAX_TARGETS}",
                hint="Take fewer samples.",
            )
        return Move(tuple(goals), None, settings, body.blend)

    def _goal(self, item: SingleGoal, i: int) -> Goal:
        chain = self._robot.chain
        if item.velocities is not None or item.accelerations is not None:
            raise InvalidOption("stages end at rest: a goal has no velocities or accelerations")
        if item.position_tolerance is not None or item.orientation_tolerance is not None:
            raise InvalidOption(
                "a goal of a stage has no position_tolerance or orientation_tolerance",
                hint="Give the stage a tolerance: ranges and free axes about its poses.",
            )
        if item.state is not None:
            return JointGoal(state(self._robot.states, item.state, f"goal.any_of[{i}].state"))
        if item.joints is not None:
            return JointGoal(chain.configuration(item.joints, f"goal.any_of[{i}].joints"))
        assert item.pose is not None
        pose = self._frames.pose(item.pose, item.frame, f"goal.any_of[{i}]")
        return PoseGoal(poses.transform(pose))

    def _grasps(self, body: schema.GraspStage) -> Array:
        found = body.grasps
        if not isinstance(found, schema.FoundGrasps):
            return _grasps(body)
        kind = next(name for name in found.one_of if getattr(found, name) is not None)
        asked: schema.GraspSearch = getattr(found, kind)
        stands = self._scene.obstacle(body.object)
        down = object_down(stands.T_world_obstacle)
        span = None if kind == "suction" else jaw_span(self._robot)
        search = GraspSearch(cast(GraspKind, kind), **vars(asked))
        grasps = find_grasps(stands.shape, down, search, span)
        if not len(grasps):
            size = np.ptp(surface_of(stands.shape).vertices, axis=0).round(4).tolist()
            widest = "" if span is None else f" and the fingers open {span.widest:.4g} m"
            raise InvalidOption(
                f"grasps: no {kind} grasp of {body.object!r} was found: it measures {size} m"
                f"{widest}",
                hint="Ask for another kind, more of them, or a wider tool; or give poses.",
            )
        return grasps

    def _fingers(self, body: schema.OpenStage | schema.CloseStage) -> Mapping[str, float] | None:
        states = self._robot.fingers.states
        if body.state is None:
            return body.joints
        if body.state not in states:
            raise InvalidOption(
                f"the gripper has no state {body.state!r}",
                hint=f"Its states are: {', '.join(states) or 'none; give joints'}.",
            )
        return states[body.state]

    def _places(self, body: schema.PlaceStage, k: int) -> Array:
        where = f"stages[{k}]"
        region, grid = body.region, body.grid or body.stack
        if body.resting is not None:
            return self._resting(body, body.resting)
        given = body.poses if region is None else [region.pose]
        given = [grid.pose] if grid is not None else given
        assert given is not None
        named = [frame for pose in given if (frame := poses.frame_of(pose)) is not None]
        if body.relative_to is not None:
            if named:
                raise InvalidOption(
                    f"poses are relative to {body.relative_to!r} and name the frame {named[0]!r}",
                    hint="Give relative_to or frame, not both.",
                )
            matrices = [poses.transform(pose) for pose in given]
        else:
            rooted = [self._frames.pose(pose, None, where) for pose in given]
            matrices = [poses.transform(pose) for pose in rooted]
        if grid is not None:
            return _on_grid(matrices[0], grid)
        if region is None:
            return np.array(matrices)
        return place_region(
            matrices[0],
            (region.size[0], region.size[1]),
            (region.angles[0], region.angles[1]),
            (region.samples[0], region.samples[1], region.angle_samples),
        )

    def _resting(self, body: schema.PlaceStage, how: schema.RestingPlaces) -> Array:
        shape = self._scene.obstacle(str(body.object)).shape
        under = [self._scene.obstacle(name) for name in supports(body.support)]
        found = resting_places(shape, under, (how.samples[0], how.samples[1]), how.angle_samples)
        if not len(found):
            raise InvalidOption(
                f"resting: {body.object!r} stands firmly nowhere on {supports(body.support)}",
                hint="Name a larger support, or give poses.",
            )
        return found[: schema.MAX_TARGETS]


def _still(
    body: schema.AttachStage
    | schema.DetachStage
    | schema.WaitStage
    | schema.SignalStage
    | schema.SetStage
    | schema.WaitForStage,
    settings: StageSettings,
) -> Stage:
    """A stage in which the arm stands still and no finger moves."""
    match body:
        case schema.AttachStage():
            touching = tuple(body.touch_links), load(body), settings
            return Attach(body.object, body.link, *touching, touch_depth(body.touch_depth))
        case schema.DetachStage():
            depth = touch_depth(body.touch_depth)
            return Detach(body.object, tuple(body.touch_links), settings, depth)
        case schema.WaitStage():
            return WaitStage(body.duration, settings)
        case schema.SignalStage():
            return Signal(body.kind, body.output, float(body.value), body.duration, settings)
        case schema.SetStage():
            return Signal(body.kind, body.output, body.value, 0.0, settings)
        case schema.WaitForStage():
            return Signal(body.kind, body.input, float(body.value), 0.0, settings)


def supports(given: str | list[str] | None) -> tuple[str, ...]:
    """Names of the supports that an object stands on."""
    return (given,) if isinstance(given, str) else tuple(given or ())


def _on_grid(T: Array, grid: schema.PlaceGrid) -> Array:
    """Free places of a grid or stack: along x first, then along y, then along z."""
    across, along, up = grid.count
    numbers = range(grid.first, across * along * up)
    if not numbers:
        raise InvalidOption(
            f"all {across * along * up} places of the grid are taken",
            hint="Give a larger count, or fewer objects.",
        )
    if grid.fill == "next":
        numbers = numbers[:1]
    if len(numbers) > schema.MAX_TARGETS:
        raise InvalidOption(f"there are {len(numbers)} places, at most {schema.MAX_TARGETS}")
    cells = np.array([[k % across, k // across % along, k // (across * along)] for k in numbers])
    steps = np.array([transform(None, cell * np.array(grid.step)) for cell in cells])
    return np.asarray(T @ steps)


def _straight(body: schema.StraightStage, settings: StageSettings) -> Straight:
    assert isinstance(
        body,
        schema.ApproachStage | schema.RetreatStage | schema.LiftStage | schema.InsertStage,
    )
    frame, direction = _DIRECTIONS[body.kind]
    if body.direction == "normal":
        inward = body.kind in ("approach", "insert")
        frame, direction = "normal", (0.0, 0.0, -1.0 if inward else 1.0)
    along = direction if not isinstance(body.direction, list) else body.direction
    if isinstance(body, schema.InsertStage):
        ends = body.distance, body.distance
        into = Into(supports(body.into), touch_depth(body.touch_depth))
        return Straight(
            body.kind, along, body.frame or frame, *ends, settings, body.relative_to, into
        )
    ends = body.distance[0], body.distance[1]
    return Straight(body.kind, along, body.frame or frame, *ends, settings, body.relative_to)


def _grasps(body: schema.GraspStage) -> Array:
    region = body.region
    if region is None:
        given = body.grasps
        assert isinstance(given, list)
        return np.array([poses.transform(pose) for pose in given])
    return grasp_region(
        poses.transform(region.pose),
        region.axis,
        (region.angles[0], region.angles[1]),
        (region.offsets[0], region.offsets[1]),
        (region.angle_samples, region.offset_samples),
    )


def load(body: Attached | schema.AttachStage) -> Load | None:
    """Load of an object that is held; None without a mass."""
    if body.mass is None:
        return None
    x, y, z = body.center_of_mass or (0.0, 0.0, 0.0)
    tensor = None if body.inertia is None else np.array(body.inertia)
    return Load(body.mass, (x, y, z), tensor)


def reach_tolerance(given: ReachTolerance | None) -> Tolerance:
    """A region about poses; none at all where it is left out."""
    if given is None:
        return Tolerance()
    ranges: dict[Axis, tuple[float, float]] = dict.fromkeys(given.free, (-np.pi, np.pi))
    axes: tuple[Axis, ...] = ("x", "y", "z", "rx", "ry", "rz")
    for axis in axes:
        limits = getattr(given, axis)
        if limits is not None:
            ranges[axis] = (limits[0], limits[1])
    return Tolerance(ranges, given.samples)


def _around(goal: Goal, tolerance: ReachTolerance) -> list[Goal]:
    if isinstance(goal, JointGoal):
        return [goal]
    deviations = reach_tolerance(tolerance).deviations()
    return [replace(goal, T_base_tip=goal.T_base_tip @ T) for T in deviations]

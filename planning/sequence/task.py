"""Tasks: a robot, a scene, a start and the stages in order, checked for contradictions."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.errors import (
    ArmwrightError,
    InvalidLinkName,
    InvalidObjectName,
    InvalidOption,
)
from kinematics.readers.lint import meant
from kinematics.tree.fingers import Fingers, Positions
from obstacles.robots.attachment import stands_for
from obstacles.robots.finger_geometry import moved_links, with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.robots.tool import PART
from obstacles.scenes.scene import Scene
from planning.sequence.stage import (
    GRIPPER_DURATION,
    Attach,
    Detach,
    Grasp,
    Gripper,
    Into,
    Move,
    Place,
    Stage,
    Straight,
    Wait,
    describe_stage,
    is_target,
    passing_distance,
    stage_kind,
)
from planning.sequence.world import World
from planning.timing.method import timing_method
from planning.values.finger_motion import FingerMotion, least_duration

#: Names of the states that a stage means which names none, by its kind.
_STATES = {"open": ("open", "opened"), "close": ("close", "closed")}


class Segment(NamedTuple):
    """Stages from one target to the next.

    Args:
        first: Number of the first stage.
        target: Number of the stage that ends it with a choice; of its last where ``trails``.
        approach: Number of the straight motion that ends at the target; None where there is none.
        free: Number of the stage whose motion is free; that after its last where ``trails``.
        trails: Whether it is what comes after the last target, without a choice.
    """

    first: int
    target: int
    approach: int | None
    free: int
    trails: bool = False

    @property
    def forward(self) -> range:
        """Numbers of the stages before the free motion: what they do follows from where it is."""
        return range(self.first, self.free)


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A sequence of stages to be planned.

    Args:
        world: The robot and the scene at the start, with what the robot holds by then.
        start: Configuration of the arm, shape (n,) [rad or m].
        stages: Stages in order; names of objects that were left out are put in.
        seed: Seed of everything random.
        segments: The stages from target to target.

    Raises:
        InvalidOption: The stages contradict each other; the message says which, and what to do.
        InvalidObjectName: A stage names an object that there is not.
        InvalidLinkName: A stage names a link that the robot does not have.
        InvalidRobotState: The start has the wrong length or is not finite.
    """

    world: World
    start: Array
    stages: tuple[Stage, ...]
    seed: int = 0
    segments: tuple[Segment, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        chain = self.world.robot.chain
        start = chain.state(self.start, "start.joints")
        object.__setattr__(self, "start", frozen(start))
        object.__setattr__(self, "stages", _check_objects(self.world, self.stages))
        _check_names(self.world, self.stages)
        object.__setattr__(self, "stages", _with_tips(self.world, self.stages))
        _check_tools(self.world, self.stages)
        holders = [item.attachment.link for item in self.world.held]
        stages = with_finger_motions(self.world.robot, self.stages, holders)
        object.__setattr__(self, "stages", stages)
        object.__setattr__(self, "segments", segments(self.stages))


def segments(stages: Sequence[Stage]) -> tuple[Segment, ...]:
    """The stages from target to target.

    Raises:
        InvalidOption: An approach leads to no target, or nothing leads to an approach.
    """
    parts: list[Segment] = []
    first = 0
    for k, stage in enumerate(stages):
        if isinstance(stage, Straight) and stage.kind == "approach":
            _check_approach(stages, k)
        if isinstance(stage, Move) and stage.connects:
            _check_connection(stages, k)
        if passing_distance(stage) is not None:
            _check_passing(stages, k)
        if not is_target(stage):
            continue
        before = stages[k - 1] if k else None
        approached = isinstance(before, Straight) and before.kind == "approach"
        approach = k - 1 if approached else None
        parts.append(Segment(first, k, approach, k - 2 if approached else k))
        first = k + 1
    if first < len(stages):
        parts.append(Segment(first, len(stages) - 1, None, len(stages), trails=True))
    return tuple(parts)


def _check_approach(stages: Sequence[Stage], k: int) -> None:
    if k + 1 == len(stages) or not is_target(stages[k + 1]):
        raise _fault(
            stages, k, "leads to nothing",
            "Put a stage grasp, place or move with a goal right after it.",
        )  # fmt: skip
    before = stages[k - 1] if k else None
    if not (isinstance(before, Move) and before.connects):
        raise _fault(
            stages, k, "begins away from where the stage before it ends",
            'Put {"kind": "move"} without a goal right before it: it goes there.',
        )  # fmt: skip


def _check_connection(stages: Sequence[Stage], k: int) -> None:
    after = stages[k + 1] if k + 1 < len(stages) else None
    if not (isinstance(after, Straight) and after.kind == "approach"):
        raise _fault(
            stages, k, "has no goal and no approach follows it",
            "Give it a goal, or put an approach right after it.",
        )  # fmt: skip


def _check_passing(stages: Sequence[Stage], k: int) -> None:
    """Check that a stage can pass its end: the next one is a free motion of the same kind."""
    after = stages[k + 1] if k + 1 < len(stages) else None
    here, there = stages[k], after
    if isinstance(here, Move) and here.connects:
        raise _fault(stages, k, "has a blend and ends where an approach begins, at rest",
                     "Leave blend out, or give the stage a goal of its own.")  # fmt: skip
    if there is None or not (isinstance(there, Move) or is_target(there)):
        raise _fault(stages, k, "has a blend, and no free motion follows it",
                     "Leave blend out, or put a stage move right after it.")  # fmt: skip
    blend = passing_distance(here)
    if blend is None or not (np.isfinite(blend) and blend > 0.0):
        raise _fault(stages, k, f"has a blend of {blend}", "Give a positive distance.")
    one, other = here.settings.options, there.settings.options
    for options in (one, other):
        method = timing_method(options.timing.method, options.timing.solver)
        if options.refine is not None or options.planner == "optimize" or not method.follows_path:
            raise _fault(stages, k, "has a blend, and a motion that does not follow its path",
                         "Leave blend out, or take another planner and timing.method."
                         )  # fmt: skip
    same = repr(one.timing) == repr(other.timing) and one.limits.keys() == other.limits.keys()
    if not (same and all(np.array_equal(one.limits[x], other.limits[x]) for x in one.limits)):
        raise _fault(stages, k, "has a blend, and the stage after it other timing or limits",
                     "Give both the same timing and limits, or leave blend out.")  # fmt: skip


def _check_objects(world: World, stages: Sequence[Stage]) -> tuple[Stage, ...]:
    """The stages with the objects that they left out, checked for what is held when."""
    held = [item.name for item in world.held]
    named: dict[str, int] = {}
    checked: list[Stage] = []
    if not stages:
        raise InvalidOption("there are no stages", hint="Give one at least.")
    for k, stage in enumerate(stages):
        if stage.settings.name:
            if stage.settings.name in named:
                raise _fault(stages, k, f"has the name of stage {named[stage.settings.name]}",
                             "Give each stage a name of its own.")  # fmt: skip
            named[stage.settings.name] = k
        new = _with_reference(stages, k, _with_object(stages, k, held), held)
        if isinstance(new, Attach):
            held.append(new.object)
        elif isinstance(new, Detach):
            held.remove(str(new.object))
        if isinstance(new, Move) and new.to_end_of is not None and not 0 <= new.to_end_of < k:
            raise _fault(stages, k, f"refers to stage {new.to_end_of}", "Name an earlier stage.")
        checked.append(new)
    return tuple(checked)


def _with_object(stages: Sequence[Stage], k: int, held: list[str]) -> Stage:
    """The stage with the object it is about, checked for whether that is held."""
    stage = stages[k]
    if isinstance(stage, Grasp | Attach):
        if stage.object in held:
            raise _fault(
                stages, k, f"takes {stage.object!r}, which is held by then",
                "Put a stage detach before it.",
            )  # fmt: skip
    elif isinstance(stage, Place | Detach):
        name = stage.object
        if name is None:
            if len(held) != 1:
                what = "nothing is" if not held else f"{', '.join(map(repr, held))} are"
                raise _fault(
                    stages, k, f"names no object, and {what} held by then",
                    "Put grasp and attach before it." if not held else "Name the object.",
                )  # fmt: skip
            return replace(stage, object=held[0])
        if name not in held:
            raise _fault(
                stages, k, f"needs {name!r} to be held, and it is not by then",
                "Put grasp and attach of it before this stage.",
            )  # fmt: skip
    return stage


def _with_reference(stages: Sequence[Stage], k: int, stage: Stage, held: Sequence[str]) -> Stage:
    """The stage with the object whose frame or surface its direction is in."""
    if not isinstance(stage, Straight):
        return stage
    if stage.into.names and not held:
        raise _fault(stages, k, "pushes what is held into something, and nothing is held by then",
                     "Put grasp and attach before it.")  # fmt: skip
    if stage.of is not None or stage.frame in ("tool", "root"):
        return stage
    near = (*stage.into.names, *held) if stage.frame == "object" else stage.into.names
    others = stages[k + 1 : k + 2] if stage.kind == "approach" else stages[k - 1 :: -1] if k else ()
    target = next((one for one in others if isinstance(one, Grasp | Place)), None)
    if not near and target is not None:
        own = (target.object or (held[0] if held else None),)
        at_grasp = isinstance(target, Grasp) and not held
        on_object = stage.frame == "object" or (stage.frame == "normal" and at_grasp)
        near = tuple(x for x in (own if on_object else target.supports or own) if x)
    if not near:
        raise _fault(stages, k, f"has a direction in the frame {stage.frame!r}, of nothing",
                     "Name the object in of.")  # fmt: skip
    return replace(stage, of=near[0])


def _with_tips(world: World, stages: Sequence[Stage]) -> tuple[Stage, ...]:
    """The stages with the point of a held object that leads in each."""
    if all(stage.settings.tip is None for stage in stages):
        return tuple(stages)
    held, done = {item.name for item in world.held}, list[Stage]()
    robot, tip = world.robot, None
    for k, stage in enumerate(stages):
        own = stage.settings
        if own.robot is not None or own.tip is not None:
            robot, tip = own.robot or robot, own.tip
        if isinstance(stage, Detach):
            tip = None if tip is not None and tip.object == stage.object else tip
            held.discard(str(stage.object))
        if tip is not None and tip.object not in held:
            raise _fault(stages, k, f"leads a point of {tip.object!r}, which is not held by then",
                         "Put grasp and attach of it before this stage.")  # fmt: skip
        if isinstance(stage, Attach):
            held.add(stage.object)
            if tip is not None and stage.link is None:
                raise _fault(stages, k, f"attaches to the tip of {tip.object!r}, which is held",
                             "Name the link that holds the object.")  # fmt: skip
        done.append(replace(stage, settings=replace(own, robot=robot, tip=tip)))
    return tuple(done)


def _check_tools(world: World, stages: Sequence[Stage]) -> None:
    """No tool changes between a motion and the target it leads to, or while something is held."""
    held, tip = len(world.held), world.robot.chain.tip_link
    for k, stage in enumerate(stages):
        new = stage.settings.robot.chain.tip_link if stage.settings.robot else tip
        before = stages[k - 1] if k else None
        if stage.settings.tip is not None:
            new = f"{new.partition(PART)[0]}{PART}{stage.settings.tip}"
        if new != tip and isinstance(before, Straight) and before.kind == "approach":
            raise _fault(stages, k, "changes the tool between an approach and its end",
                         "Name the tool in the stage move before the approach.")  # fmt: skip
        if new != tip and isinstance(stage, Straight) and stage.kind == "approach":
            raise _fault(stages, k, "changes the tool between a motion and its approach",
                         "Name the tool in the stage move before it.")  # fmt: skip
        if held and new.partition(PART)[0] != tip.partition(PART)[0]:
            raise _fault(stages, k, f"changes the tool to {new!r} while something is held",
                         "Put a stage detach before it.")  # fmt: skip
        held += isinstance(stage, Attach) - isinstance(stage, Detach)
        tip = new


def _robots(world: World, stages: Sequence[Stage]) -> list[RobotGeometry]:
    """The robot with the tool that it has in each stage."""
    robots, robot = [], world.robot
    for stage in stages:
        robot = stage.settings.robot or robot
        robots.append(robot)
    return robots


def _check_names(world: World, stages: Sequence[Stage]) -> None:
    objects = {*world.scene.ids, *(item.name for item in world.held)}
    for k, (stage, robot) in enumerate(zip(stages, _robots(world, stages), strict=True)):
        chain = robot.chain
        bodies = objects | {*chain.index, *robot.names}
        known = bodies | robot.groups.keys()
        tip = chain.link(chain.tip_link)
        for where, name in _object_names(stage):
            if name not in objects:
                raise _unknown(InvalidObjectName, stages, k, (where, name), objects)
        for where, name in _link_names(stage):
            if name not in chain.index and name not in robot.names:
                raise _unknown(InvalidLinkName, stages, k, (where, name), set(chain.index))
        pairs = [name for pair in stage.settings.allowed for name in pair]
        named = [name for name in pairs if not stands_for(name, robot, bodies)]
        named += stage.touches if isinstance(stage, Attach) else ()
        for name in named:
            if name not in known:
                raise _unknown(InvalidObjectName, stages, k, ("allowed_collisions", name), known)
        if isinstance(stage, Attach) and stage.link is not None:
            holder = chain.link(stage.link)
            if holder.joint != tip.joint:
                raise _fault(
                    stages, k, f"attaches to {stage.link!r}, which does not move with the tip",
                    f"Take the tip {chain.tip_link!r} or a link that is fixed to it.",
                )  # fmt: skip
        if isinstance(stage, Place) and stage.object in (stage.reference, *stage.supports):
            raise _fault(stages, k, f"places {stage.object!r} on itself", "Name another object.")


def _object_names(stage: Stage) -> list[tuple[str, str]]:
    """Names of objects in a stage, each with its field."""
    pairs = [(name, getattr(stage, name, None)) for name in ("object", "reference")]
    pairs += [("support", name) for name in getattr(stage, "supports", ())]
    pairs += [("into", name) for name in getattr(stage, "into", Into()).names]
    pairs += [("of", getattr(stage, "of", None))]
    return [(name, str(value)) for name, value in pairs if value is not None]


def _link_names(stage: Stage) -> list[tuple[str, str]]:
    """Names of links in a stage, each with its field."""
    names = []
    if isinstance(stage, Grasp | Detach):
        names += [("touch_links", name) for name in stage.touches]
    if isinstance(stage, Attach) and stage.link is not None:
        names.append(("link", stage.link))
    return names


def _unknown(
    error: type[ArmwrightError],
    stages: Sequence[Stage],
    k: int,
    entry: tuple[str, str],
    known: set[str],
) -> ArmwrightError:
    where, name = entry
    some = sorted(known)
    # Names that an error tells.
    max_names = 60
    listed = ", ".join(some[:max_names]) + (", …" if len(some) > max_names else "")
    return error(
        f"{describe_stage(stages, k)}: {where} names {name!r}, which there is not"
        f"{meant(name, some)}",
        hint=f"There are: {listed or 'none'}.",
        index=k,
        kind=stage_kind(stages[k]),
        name=name,
    )


def _fault(stages: Sequence[Stage], k: int, message: str, hint: str) -> InvalidOption:
    return InvalidOption(
        f"{describe_stage(stages, k)} {message}",
        hint=hint,
        index=k,
        kind=stage_kind(stages[k]),
        name=stages[k].settings.name or None,
    )


def with_finger_motions(
    robot: RobotGeometry, stages: Sequence[Stage], holders: Sequence[str] = ()
) -> tuple[Stage, ...]:
    """The stages, those of the gripper with where its fingers go.

    Args:
        robot: The robot with its fingers where they are at first.
        stages: Stages in order.
        holders: Links that hold something at the start.

    Raises:
        InvalidOption: A joint or a position is none of the gripper, there is too little time, or a
            link of a finger that moves holds something; the message names the stage.
    """
    done: list[Stage] = []
    world = World(robot, Scene())
    for k, stage in enumerate(stages):
        world = world.entered(stage.settings)
        robot = world.robot
        if isinstance(stage, Gripper):
            try:
                if stage.until is not None:
                    _check_contact(stages, k)
                new = with_motion(robot, stage)
            except InvalidOption as error:
                where = {"index": k, "kind": stage.kind, "name": stage.settings.name or None}
                message = f"{describe_stage(stages, k)}: {error.message}"
                raise InvalidOption(message, hint=error.hint, **error.details, **where) from None
            world = world.with_robot(new.robot or robot)
            done.append(new)
        else:
            done.append(stage)
    _check_holders(done, holders)
    return tuple(done)


def _check_contact(stages: Sequence[Stage], k: int) -> None:
    """A grasp stands before fingers that close until they touch its object.

    Raises:
        InvalidOption: None does.
    """
    before = next((s for s in reversed(stages[:k]) if not isinstance(s, Wait | Gripper)), None)
    if not isinstance(before, Grasp):
        raise InvalidOption(
            "it closes until contact, and no grasp says with what",
            hint="Put it right after a grasp, or give joints or state alone.",
        )


def with_motion(robot: RobotGeometry, stage: Gripper) -> Gripper:
    """A stage of the gripper with where its fingers go.

    Args:
        robot: The robot with its fingers where they are before.
        stage: The stage.

    Raises:
        InvalidOption: A joint or a position is none of the gripper, or there is too little time.
    """
    asked = _wanted_positions(robot.fingers, stage)
    first, last = robot.fingers.positions, robot.fingers.with_positions(asked)
    least = least_duration(robot.fingers, first, last)
    duration = stage.duration
    if duration is None:
        duration = max(GRIPPER_DURATION, least)
    elif duration < least:
        raise InvalidOption(
            f"the fingers can't get there in {duration:g} s",
            hint=f"Give {least:.4g} s or more, or leave duration out.",
        )
    if first == last:
        return replace(stage, duration=duration)
    motion = FingerMotion(robot.fingers, first, last, duration)
    return replace(stage, duration=duration, motion=motion, robot=with_fingers(robot, last))


def _wanted_positions(fingers: Fingers, stage: Gripper) -> Positions:
    """Positions that a stage asks for; none where the model knows nothing of its gripper."""
    if stage.fingers is not None:
        return stage.fingers
    for name in _STATES[stage.kind]:
        for known, values in fingers.states.items():
            if name in (known, known.rpartition("/")[2]):
                return values
    return {}


def _check_holders(stages: Sequence[Stage], holders: Sequence[str]) -> None:
    """No link of a finger that moves may hold anything: what it holds would move with it."""
    grips = [stage for stage in stages if isinstance(stage, Gripper)]
    moved = frozenset[str]().union(
        *(moved_links(one.robot, one.motion.leaders) for one in grips if one.motion and one.robot)
    )
    for k, stage in enumerate(stages):
        if isinstance(stage, Attach) and stage.link in moved:
            raise InvalidOption(
                f"{describe_stage(stages, k)}: {stage.link!r} is a finger that moves",
                hint="Attach to the link that carries the fingers, or leave link out.",
                index=k,
                kind="attach",
                name=stage.settings.name or None,
            )
    for link in holders:
        if link in moved:
            raise InvalidOption(
                f"attached: {link!r} is a finger that moves, and holds something",
                hint="Attach to the link that carries the fingers.",
            )

"""Stages of a task: the motions, choices and changes of what the robot holds, as values."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dynamics.model.payload import with_payload
from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.model.chain import Chain
from kinematics.tree.fingers import Positions
from obstacles.robots.allowed_pairs import TOUCH_DEPTH
from obstacles.robots.robot_geometry import RobotGeometry
from planning.constraints.kinds.constraint import Constraint
from planning.options import Options
from planning.problem import Goal
from planning.values.finger_motion import FingerMotion

Pair = tuple[str, str]
#: Frames of a straight motion's direction: the tool's where the stage begins or ends, the root's,
#: those of the object or of its support as they then stand; and along the outward normal of a
#: surface, whose third coordinate alone counts.
DirectionFrame = Literal["tool", "root", "object", "support", "normal"]
StraightKind = Literal["approach", "retreat", "lift", "insert"]

#: Duration of a stage in which the gripper opens or closes, unless told otherwise [s].
GRIPPER_DURATION = 0.5


class ObjectTip(NamedTuple):
    """A point of a held object that leads.

    Args:
        object: Name of the object.
        T_object_tip: Frame of the point in the object's, shape (4, 4).
    """

    object: str
    T_object_tip: Array


@dataclass(frozen=True, slots=True, eq=False)
class StageSettings:
    """StageSettings that every stage has.

    Args:
        name: Name by which later stages refer to it; empty for none.
        margin: Distance to keep from obstacles beyond their own margins [m].
        allowed: Pairs of names that may touch during this stage, perhaps with their contacts.
        constraints: Constraints to be held during this stage.
        options: Planner, timing and limits of its motion; its timeout is the longest one plan of
            this stage may take.
        robot: The robot with the tool that it has from this stage on, its fingers anywhere; None
            for that of the stage before.
        tip: Point of a held object that leads from this stage on, until another robot is named or
            the object is detached; None for that of the stage before, or of ``robot``.
    """

    name: str = ""
    margin: float = 0.0
    allowed: Iterable[Pair] = ()
    constraints: tuple[Constraint, ...] = ()
    options: Options = field(default_factory=Options)
    robot: RobotGeometry | None = None
    tip: ObjectTip | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """A free motion.

    Args:
        goals: Any one of these is to be reached; none for the place where the next stage begins.
        to_end_of: Number of an earlier stage, in place of goals: its last configuration.
        settings: StageSettings of the stage.
        blend: How far from its goal the arm may pass it without resting, Euclidean in joint space
            [rad or m]; None to rest there. The next stage is a free motion then.
    """

    goals: tuple[Goal, ...] = ()
    to_end_of: int | None = None
    settings: StageSettings = field(default_factory=StageSettings)
    blend: float | None = None

    @property
    def connects(self) -> bool:
        """Whether the motion goes to where the next stage begins."""
        return not self.goals and self.to_end_of is None


class Into(NamedTuple):
    """What something is pushed into.

    Args:
        names: Names of the objects.
        touch_depth: How deep it may overlap these [m]; infinite for any depth.
    """

    names: tuple[str, ...] = ()
    touch_depth: float = TOUCH_DEPTH


@dataclass(frozen=True, slots=True, eq=False)
class Straight:
    """A straight motion of the tool.

    Args:
        kind: "approach" ends at the target of the next stage; "retreat", "lift" and "insert" begin
            where the tool is.
        direction: Direction of the motion, shape (3,); its length does not count.
        frame: Frame of the direction: "tool" where the tool is at the target, or another.
        least: Shortest way [m].
        most: Longest way, which is tried first [m].
        settings: StageSettings of the stage.
        of: Object or support whose frame or surface is meant; a task puts it in where it is None.
        into: Objects that what is held may touch from this stage to the next free motion.

    Raises:
        InvalidOption: The direction is zero, or the distances are not 0 < least <= most.
    """

    kind: StraightKind
    direction: ArrayLike
    frame: DirectionFrame
    least: float
    most: float
    settings: StageSettings = field(default_factory=StageSettings)
    of: str | None = None
    into: Into = field(default_factory=Into)

    def __post_init__(self) -> None:
        direction = np.asarray(self.direction, dtype=np.float64).reshape(3)
        length = float(np.linalg.norm(direction))
        if not (np.isfinite(length) and length > 0.0):
            raise InvalidOption("direction has no length", hint="Give a vector such as [0, 0, 1].")
        object.__setattr__(self, "direction", frozen(direction / length))
        if not 0.0 < self.least <= self.most:
            raise InvalidOption(
                f"distance is from {self.least:g} to {self.most:g} m",
                hint="Give the shortest and the longest way, both positive, in this order.",
            )


@dataclass(frozen=True, slots=True, eq=False)
class Follow:
    """Lines, arcs or a seam from where the tool is, as ``settings.options.cartesian`` has them.

    Args:
        kind: "line", "arc" or "seam"; the arm goes to the beginning of a seam by a free motion.
        settings: StageSettings of the stage.
    """

    kind: Literal["line", "arc", "seam"]
    settings: StageSettings = field(default_factory=StageSettings)


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """A word with the machines around while the arm stands still: it stands in the program.

    Args:
        kind: "signal" switches a digital output, "set" gives an analog output a number, and
            "wait_for" waits for a digital input.
        port: Number or name of the output or input.
        value: On or off, or the number.
        duration: How long the arm stands at least [s].
        settings: StageSettings of the stage.
    """

    kind: Literal["signal", "set", "wait_for"]
    port: int | str
    value: float = 1.0
    duration: float = 0.0
    settings: StageSettings = field(default_factory=StageSettings)


@dataclass(frozen=True, slots=True, eq=False)
class Grasp:
    """A choice among grasps of an object: the tool goes to one of them.

    Args:
        object: Name of the obstacle.
        frames: T_object_tool of each grasp, shape (k, 4, 4).
        touches: Links that may touch the object from here on until it is attached, and while it is
            held.
        support: Obstacles that the object stands on, which it may touch from the attachment to the
            end of the next straight motion; the name alone where it is one.
        settings: StageSettings of the stage.
        touch_depth: How deep it may overlap all of these [m]; infinite for any depth.
    """

    object: str
    frames: Array
    touches: tuple[str, ...] = ()
    support: tuple[str, ...] | str | None = ()
    settings: StageSettings = field(default_factory=StageSettings)
    touch_depth: float = TOUCH_DEPTH

    @property
    def supports(self) -> tuple[str, ...]:
        """Obstacles that the object stands on."""
        return _names(self.support)

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames", _poses(self.frames, "grasps"))


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A choice among poses of a held object: the tool brings it to one of them.

    Args:
        object: Name of the held object; None where only one thing is held.
        poses: T_reference_object of each place, shape (k, 4, 4).
        reference: Obstacle in whose frame, as it then stands, the poses are; None for the root.
        support: Obstacles that it may touch from the approach to the detachment; the name alone
            where it is one.
        settings: StageSettings of the stage.
        touch_depth: How deep it may overlap these [m]; infinite for any depth.
    """

    object: str | None
    poses: Array
    reference: str | None = None
    support: tuple[str, ...] | str | None = ()
    settings: StageSettings = field(default_factory=StageSettings)
    touch_depth: float = TOUCH_DEPTH

    @property
    def supports(self) -> tuple[str, ...]:
        """Obstacles that it may touch."""
        return _names(self.support)

    def __post_init__(self) -> None:
        object.__setattr__(self, "poses", _poses(self.poses, "places"))


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """Mass of an object.

    Args:
        mass: [kg].
        center_of_mass: Position in the object's frame, shape (3,) [m].
        tensor: Inertia about it, in the object's axes, shape (3, 3) [kg m^2]; None for a point.
    """

    mass: float
    center_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tensor: Array | None = None

    def added_to(self, chain: Chain, link: str, T_link_object: Array) -> Chain:
        """The chain with this load at a link.

        Args:
            chain: The robot.
            link: The link that holds the object.
            T_link_object: Pose of the object in the link's frame, shape (4, 4).
        """
        R, p = T_link_object[:3, :3], T_link_object[:3, 3]
        center = R @ np.array(self.center_of_mass) + p
        tensor = None if self.tensor is None else R @ self.tensor @ R.T
        return with_payload(chain, self.mass, center, tensor, link=link)


@dataclass(frozen=True, slots=True, eq=False)
class Attach:
    """The object becomes a part of the robot, where it stands.

    Args:
        object: Name of the obstacle.
        link: The link that holds it; None for the tip.
        touches: Links, obstacles and held objects that it may touch from now on.
        load: Mass and inertia; None where it weighs nothing.
        settings: StageSettings of the stage.
        touch_depth: How deep it may overlap what is in ``touches`` [m]; infinite for any depth.
    """

    object: str
    link: str | None = None
    touches: tuple[str, ...] = ()
    load: Load | None = None
    settings: StageSettings = field(default_factory=StageSettings)
    touch_depth: float = TOUCH_DEPTH


@dataclass(frozen=True, slots=True, eq=False)
class Detach:
    """The object becomes an obstacle, where it is held.

    Args:
        object: Name of the held object; None where only one thing is held.
        touches: Links that may touch it until the next free motion, beside those of its grasp.
        settings: StageSettings of the stage.
        touch_depth: How deep these may overlap it [m]; infinite for any depth.
    """

    object: str | None = None
    touches: tuple[str, ...] = ()
    settings: StageSettings = field(default_factory=StageSettings)
    touch_depth: float = TOUCH_DEPTH


@dataclass(frozen=True, slots=True, eq=False)
class Wait:
    """The arm stands still.

    Args:
        duration: [s].
        settings: StageSettings of the stage.
    """

    duration: float
    settings: StageSettings = field(default_factory=StageSettings)


@dataclass(frozen=True, slots=True, eq=False)
class Gripper:
    """The gripper opens or closes while the arm stands still.

    Args:
        kind: "open" or "close".
        fingers: Positions of joints of the gripper [rad or m]; None for the robot's state of the
            name "open" or "close", where it has one. The others stay.
        duration: [s]; None for half a second, or longer where the fingers' speeds need it.
        settings: StageSettings of the stage.
        until: "contact" for fingers that stop where they touch the object of the grasp before;
            None for fingers that go all the way.
        motion: Motion of the fingers; a task puts it in, None where none moves.
        robot: The robot with its fingers there; a task puts it in, None where none moves.
    """

    kind: Literal["open", "close"]
    fingers: Positions | None = None
    duration: float | None = None
    settings: StageSettings = field(default_factory=StageSettings)
    until: Literal["contact"] | None = None
    motion: FingerMotion | None = None
    robot: RobotGeometry | None = None


Stage = Move | Straight | Follow | Grasp | Place | Attach | Detach | Wait | Gripper | Signal


def stage_kind(stage: Stage) -> str:
    """Name of the stage's kind on the wire."""
    if isinstance(stage, Straight | Gripper | Follow | Signal):
        return stage.kind
    return type(stage).__name__.lower()


def is_target(stage: Stage) -> bool:
    """Whether the stage says where the tool has to be: a choice that the search makes."""
    return isinstance(stage, Grasp | Place) or (isinstance(stage, Move) and not stage.connects)


def passing_distance(stage: Stage) -> float | None:
    """Distance within which a stage passes its end [rad or m]; None where the arm rests there."""
    return stage.blend if isinstance(stage, Move) else None


def describe_stage(stages: Sequence[Stage], k: int) -> str:
    """Name of a stage in messages.

    Args:
        stages: All stages.
        k: Number of the stage.
    """
    name = stages[k].settings.name
    return f"stage {k} ({stage_kind(stages[k])}{f' {name!r}' if name else ''})"


def _names(named: tuple[str, ...] | str | None) -> tuple[str, ...]:
    return (named,) if isinstance(named, str) else named or ()


def _poses(poses: ArrayLike, what: str) -> Array:
    T = np.asarray(poses, dtype=np.float64)
    if T.ndim != 3 or T.shape[1:] != (4, 4) or not np.isfinite(T).all():
        raise InvalidPose(f"{what} must be finite 4x4 transforms, shape (k, 4, 4)")
    # Most candidates of one stage.
    max_targets = 10_000
    if not 0 < len(T) <= max_targets:
        raise InvalidOption(
            f"there are {len(T)} {what}",
            hint=f"Give 1 to {max_targets}.",
        )
    return frozen(T)

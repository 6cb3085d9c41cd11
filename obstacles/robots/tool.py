"""Tools: what is mounted on a link of an arm and brings a tip, solids, a mass and jaws of its own.

A mounted tool is a part of the robot: its name is a link's, where its solids and its mass are, and
each of its tips is the link ``<tool>/<tip>``, one of them the tip of the chain. Jaws are fingers
that one joint ``<tool>/opening`` moves, the distance between them; the link of that name is the
joint's own and carries nothing.

Built-in tools: a parallel jaw, three jaws, a suction cup, a torch and a spindle, by their sizes.

Each stands on its flange with z away from the arm. They are plain solids that hold the real thing
where their sizes are chosen so; the maker's own solids are nearer.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, Remade, numbers, typed
from kinematics.errors import InvalidLinkName, InvalidOption, InvalidPose
from kinematics.model.chain import Chain, Inertia, Link, with_frames
from kinematics.pose import from_matrix, rotation_y, rotation_z, transform
from kinematics.root_frame import TOOL
from kinematics.tree.description import JointDescription
from kinematics.tree.fingers import Finger, Fingers
from obstacles.convex.piece import Piece
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle
from obstacles.shapes.shape import Box, Capsule, Cylinder, HalfSpace, Shape

#: Between the name of a tool and that of a part of it.
PART = "/"
#: The joint that moves the jaws, and states of it.
_OPENING, _OPEN, _CLOSED = "opening", "open", "closed"
_Z = np.array([0.0, 0.0, 1.0])
Grip = Literal["jaws", "suction", "none"]


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A shape of a tool, and where it is.

    Args:
        shape: Shape of the solid.
        T_part_solid: Pose in the frame of the tool or jaw, shape (4, 4).

    Raises:
        InvalidOption: The shape is a half-space.
    """

    shape: Shape
    T_part_solid: Array = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        if isinstance(self.shape, HalfSpace):
            raise InvalidOption(
                "a solid of a tool is a half-space: what an arm carries has an end",
                hint="Give a box.",
            )

    def pieces(self, name: str) -> tuple[Piece, ...]:
        """Convex pieces in the frame of the tool or jaw.

        Raises:
            InvalidScene: The pose is no rigid motion, or the mesh is none.
        """
        return Obstacle(name, self.shape, self.T_part_solid).pieces()


@dataclass(frozen=True, slots=True, eq=False)
class Jaw:
    """A finger that slides, or turns, with the opening of its tool.

    Args:
        T_tool_jaw: Frame of the jaw at an opening of 0, shape (4, 4).
        axis: Axis that it moves along or about, in its frame, shape (3,).
        solids: Solids in the frame of the jaw.
        travel: Way for an opening of one metre [m/m or rad/m].
        turns: Whether it turns about its axis.
    """

    T_tool_jaw: Array
    axis: Array
    solids: tuple[Solid, ...] = ()
    travel: float = 0.5
    turns: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_tool_jaw", rigid(self.T_tool_jaw, "the frame of a jaw"))
        object.__setattr__(self, "axis", numbers(self.axis, "the axis of a jaw", (3,)))


@dataclass(frozen=True, slots=True, eq=False)
class Tool(Remade):
    """A thing that an arm works with.

    Args:
        name: Name of the tool, a link's once it is mounted.
        tcp: Tips by name: frames in the frame of the tool, shape (4, 4) each.
        solids: Solids in the frame of the tool.
        link: Link that it is mounted on, in whose frame the tool is; the robot's tip where none is
            named.
        inertia: Mass properties in the frame of the tool; it weighs nothing where none are given.
        jaws: Jaws by name.
        grip: How it holds things.
        opening: Least and largest distance of the jaws [m].
        speed: Largest rate of the opening [m/s]; NaN where none is known.

    Raises:
        InvalidOption: A name is empty or means something else, there is no tip, jaws have no
            opening, or a number is out of range.
    """

    name: str
    tcp: Mapping[str, Array]
    solids: tuple[Solid, ...] = ()
    link: str | None = None
    inertia: Inertia | None = None
    jaws: Mapping[str, Jaw] = field(default_factory=dict)
    grip: Grip = "none"
    opening: tuple[float, float] | None = None
    speed: float = math.nan

    def __post_init__(self) -> None:
        for name in ("tcp", "jaws"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        _check_names(self)
        tips = {name: rigid(T, f"tip {name!r} of {self.name!r}") for name, T in self.tcp.items()}
        object.__setattr__(self, "tcp", MappingProxyType(tips))
        if (self.opening is None) != (not self.jaws):
            raise InvalidOption(
                f"tool {self.name!r}: jaws move with an opening: give both or neither",
                hint='Give "opening": [least, largest] and at least one finger.',
            )
        if self.opening is not None and not 0.0 <= self.opening[0] < self.opening[1] < math.inf:
            raise InvalidOption(
                f"tool {self.name!r}: opening is {list(self.opening)} m",
                hint="Give the least and a larger distance of the jaws, neither negative.",
            )
        for name, jaw in self.jaws.items():
            if not np.linalg.norm(jaw.axis) > 0.0:
                raise InvalidOption(f"tool {self.name!r}, finger {name!r}: its axis is 0")
        if self.grip == "jaws" and not self.jaws:
            raise InvalidOption(
                f"tool {self.name!r} grips with jaws and has no fingers",
                hint='Give fingers and opening, or "grip": "none".',
            )

    def tip(self, tcp: str | None) -> str:
        """The tip of a name, the only one where none is named.

        Raises:
            InvalidLinkName: There is no such tip, or several and none is named.
        """
        if tcp is None and len(self.tcp) == 1:
            return next(iter(self.tcp))
        if tcp is None or tcp not in self.tcp:
            found = f"no tip {tcp!r}" if tcp is not None else f"{len(self.tcp)} tips"
            raise InvalidLinkName(
                f"tool {self.name!r} has {found}",
                hint=f"Name one in tcp: {', '.join(self.tcp)}.",
                tool=self.name,
                tcp=list(self.tcp),
            )
        return tcp

    def part(self, name: str) -> str:
        """The link of a tip or jaw once the tool is mounted."""
        return f"{self.name}{PART}{name}"


def _check_names(tool: Tool) -> None:
    if not tool.name or tool.name == TOOL or PART in tool.name:
        raise InvalidOption(
            f"a tool can't be called {tool.name!r}",
            hint=f'Give it a name without "{PART}"; "{TOOL}" is the frame of the tip.',
        )
    if not tool.tcp:
        raise InvalidOption(
            f"tool {tool.name!r} has no tip",
            hint='Give at least one: "tcp": {"tip": {"position": [0.0, 0.0, 0.1]}}.',
        )
    parts = [*tool.tcp, *tool.jaws, _OPENING]
    for name in parts:
        if not name or PART in name or parts.count(name) > 1:
            raise InvalidOption(
                f"tool {tool.name!r}: {name!r} can't be the name of a tip or finger",
                hint=f'Each needs a name of its own without "{PART}"; "{_OPENING}" is the joint of '
                "the jaws.",
            )


@typed
def mount(robot: RobotGeometry, tool: Tool, tcp: str | None = None) -> RobotGeometry:
    """The robot with a tool, whose tip is that of the chain.

    The jaws stand open as far as they go; ``with_fingers`` puts them elsewhere.

    Args:
        robot: The arm.
        tool: The tool.
        tcp: Name of the tip; may be left out where the tool has one.

    Raises:
        InvalidLinkName: The robot has no such link or it stands still, the tool no such tip, or a
            name is a link's already.
        InvalidScene: A solid has no place.
    """
    tip = tool.part(tool.tip(tcp))
    chain = robot.chain
    carrier = _moving(chain, chain.link(tool.link or chain.tip_link), f"tool {tool.name!r}")
    T = carrier.T_joint_link

    def link(name: str, T_tool_part: Array, inertia: Inertia | None = None) -> Link:
        return Link(name, carrier.joint, T @ T_tool_part, inertia)

    joints, positions = _fingers(tool)
    added = [link(tool.name, np.eye(4), tool.inertia)]
    added += [link(tool.part(name), T_tool_tip) for name, T_tool_tip in tool.tcp.items()]
    added += [link(finger.joint.child, finger.motion(positions)) for finger in joints]
    _check_free(robot, tool, added)
    chain = replace(robot.chain, links=(*robot.chain.links, *added), tip_link=tip)
    groups = {tool.name: tool.solids}
    groups |= {tool.part(name): jaw.solids for name, jaw in tool.jaws.items()}
    solids = {
        name: [
            [piece.placed(chain.link(name).T_joint_link) for piece in shape.pieces(name)]
            for shape in shapes
        ]
        for name, shapes in groups.items()
    }
    states = dict(robot.fingers.states)
    if tool.opening is not None:
        for state, value in zip((_CLOSED, _OPEN), tool.opening, strict=True):
            states[tool.part(state)] = {tool.part(_OPENING): value}
    moved = Fingers(
        (*robot.fingers.joints, *joints), {**robot.fingers.positions, **positions}, states
    )
    return robot.with_solids(carrier.joint, solids, [carrier.name], chain=chain, fingers=moved)


@typed
def with_tip(robot: RobotGeometry, name: str, link: str, T_link_tip: ArrayLike) -> RobotGeometry:
    """The robot with another tip, such as a point of an object that it holds.

    Args:
        robot: The arm.
        name: Name of the tip.
        link: Link that carries it.
        T_link_tip: Frame of the tip, shape (4, 4).

    Raises:
        InvalidLinkName: There is no such link, it stands still, or the name is a link's already.
        InvalidPose: The frame is no rigid motion.
    """
    chain = robot.chain
    T_link_tip = rigid(T_link_tip, "T_link_tip")
    _moving(chain, chain.link(link), f"tip {name!r}")
    chain = with_frames(chain, [(name, link, T_link_tip)])
    return replace(robot, chain=replace(chain, tip_link=name))


def rigid(T: ArrayLike, what: str) -> Array:
    """A checked frame, shape (4, 4).

    Raises:
        InvalidOption: It is no array of 4 x 4 finite numbers.
        InvalidPose: It is no rigid motion.
    """
    matrix = numbers(T, what, (4, 4))
    if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise InvalidPose(f"{what}: the last row is not [0, 0, 0, 1]")
    return transform(from_matrix(matrix[:3, :3]), matrix[:3, 3])


def parts_of(name: str, names: Iterable[str]) -> list[str]:
    """What a name stands for: a tool's for its jaws as well, any other for itself.

    Args:
        name: Name of a link, obstacle or attached object.
        names: Names of the links that have solids.
    """
    return [name, *(other for other in names if other.startswith(name + PART))]


def _moving(chain: Chain, link: Link, what: str) -> Link:
    if not 0 <= link.joint < chain.n:
        raise InvalidLinkName(
            f"{what} is on {link.name!r}, which no joint of the chain carries",
            hint="Name a link that moves with the arm.",
            link=link.name,
        )
    return link


def _check_free(robot: RobotGeometry, tool: Tool, added: Iterable[Link]) -> None:
    taken = {*robot.chain.index, *robot.links, *robot.fingers.positions}
    for link in added:
        if link.name in taken:
            raise InvalidLinkName(
                f"tool {tool.name!r}: robot {robot.chain.name!r} has a link, joint or attached "
                f"object {link.name!r} already",
                hint="Give the tool another name.",
                link=link.name,
            )


def _fingers(tool: Tool) -> tuple[tuple[Finger, ...], dict[str, float]]:
    """Joints of the jaws, the one that leads first, and the opening that they stand at."""
    if tool.opening is None:
        return (), {}
    leader = tool.part(_OPENING)
    low, high = tool.opening

    def joint(name: str, T: Array, axis: Array, *, turns: bool, rate: float) -> JointDescription:
        kind = "revolute" if turns else "prismatic"
        lower, upper = sorted((rate * low, rate * high))
        nothing = math.nan
        return JointDescription(
            name, kind, tool.name, name, T, axis / np.linalg.norm(axis), lower, upper,
            abs(rate) * tool.speed, nothing, nothing, nothing,
        )  # fmt: skip

    found = [Finger(joint(leader, np.eye(4), _Z, turns=False, rate=1.0), leader)]
    for name, jaw in tool.jaws.items():
        one = joint(
            tool.part(name), jaw.T_tool_jaw, np.asarray(jaw.axis), turns=jaw.turns, rate=jaw.travel
        )
        found.append(Finger(one, leader, jaw.travel))
    return tuple(found), {leader: high}


Sizes = Mapping[str, float]
#: Default sizes of each form [m, rad, kg, m/s]; a mass of 0 is none.
SIZES: Mapping[str, Sizes] = {
    "parallel_jaw": {
        "opening": 0.085, "width": 0.12, "depth": 0.06, "height": 0.1, "finger_length": 0.05,
        "finger_width": 0.022, "finger_thickness": 0.01, "speed": 0.1, "mass": 0.9,
    },
    "three_jaw": {
        "opening": 0.1, "radius": 0.06, "height": 0.1, "finger_length": 0.06,
        "finger_width": 0.02, "finger_thickness": 0.012, "speed": 0.1, "mass": 1.2,
    },
    "suction_cup": {"radius": 0.02, "height": 0.03, "stem_radius": 0.01, "stem_length": 0.08,
                    "mass": 0.3},
    "torch": {"radius": 0.025, "length": 0.2, "neck_radius": 0.01, "neck_length": 0.12,
              "angle": 0.6, "stick_out": 0.015, "mass": 1.0},
    "spindle": {"radius": 0.04, "length": 0.18, "bit_radius": 0.004, "bit_length": 0.05,
                "mass": 2.0},
}  # fmt: skip


def parallel_jaw(name: str, link: str | None, size: Sizes) -> Tool:
    """Two opposing jaws along x; the tip is between their ends, the closed jaws meet in it.

    Args:
        name: Name of the tool.
        link: Link that it is mounted on.
        size: Sizes, as ``SIZES`` has them.
    """
    body = Box((size["width"], size["depth"], size["height"]))
    jaws = {"left": 0.0, "right": math.pi}
    return _gripper(name, link, size, body, jaws)


def three_jaw(name: str, link: str | None, size: Sizes) -> Tool:
    """Three jaws about z at 120 degrees, ``opening`` the diameter between them.

    Args:
        name: Name of the tool.
        link: Link that it is mounted on.
        size: Sizes, as ``SIZES`` has them.
    """
    body = Cylinder(size["radius"], size["height"])
    jaws = {f"jaw_{k + 1}": 2.0 * math.pi * k / 3.0 for k in range(3)}
    return _gripper(name, link, size, body, jaws)


def suction_cup(name: str, link: str | None, size: Sizes) -> Tool:
    """A cup on a stem; the tip is in the middle of its lip.

    Args:
        name: Name of the tool.
        link: Link that it is mounted on.
        size: Sizes, as ``SIZES`` has them.
    """
    stem, end = size["stem_length"], size["stem_length"] + size["height"]
    solids = (
        Solid(Cylinder(size["stem_radius"], stem), _up(0.5 * stem)),
        Solid(Cylinder(size["radius"], size["height"]), _up(stem + 0.5 * size["height"])),
    )
    inertia = _rod(size["mass"], size["stem_radius"], end)
    return Tool(name, {"tip": _up(end)}, solids, link, inertia, grip="suction")


def torch(name: str, link: str | None, size: Sizes) -> Tool:
    """A body along z and a neck bent by ``angle`` about y; the tip is at the end of the wire.

    Args:
        name: Name of the tool.
        link: Link that it is mounted on.
        size: Sizes, as ``SIZES`` has them.
    """
    length, neck = size["length"], size["neck_length"]
    T_neck = _up(length) @ transform(rotation_y(size["angle"]))
    solids = (
        Solid(Cylinder(size["radius"], length), _up(0.5 * length)),
        Solid(Capsule(size["neck_radius"], neck), T_neck @ _up(0.5 * neck)),
    )
    end = neck + size["neck_radius"] + size["stick_out"]
    return Tool(
        name, {"tip": T_neck @ _up(end)}, solids, link, _rod(size["mass"], size["radius"], length)
    )


def spindle(name: str, link: str | None, size: Sizes) -> Tool:
    """A motor and a bit along z; the tip is at the end of the bit, ``chuck`` at its beginning.

    Args:
        name: Name of the tool.
        link: Link that it is mounted on.
        size: Sizes, as ``SIZES`` has them.
    """
    length, bit = size["length"], size["bit_length"]
    solids = (
        Solid(Cylinder(size["radius"], length), _up(0.5 * length)),
        Solid(Cylinder(size["bit_radius"], bit), _up(length + 0.5 * bit)),
    )
    tips = {"tip": _up(length + bit)}
    return Tool(name, tips, solids, link, _rod(size["mass"], size["radius"], length))


#: What makes a tool of each form.
FORMS = {form.__name__: form for form in (parallel_jaw, three_jaw, suction_cup, torch, spindle)}


@typed
def built_in_tool(form: str, name: str, link: str | None = None, **sizes: float) -> Tool:
    """A built-in tool.

    Args:
        form: One of ``FORMS``.
        name: Name of the tool.
        link: Link that it is mounted on; the robot's tip where none is named.
        sizes: Sizes in place of the usual ones, as ``SIZES`` has them.

    Raises:
        InvalidOption: There is no such form, or it has no such size.
        InvalidScene: A size is none of a solid.
    """
    if form not in FORMS:
        raise InvalidOption(
            f"there is no built-in tool {form!r}", hint=f"There are: {', '.join(FORMS)}."
        )
    unknown = sorted(sizes.keys() - SIZES[form].keys())
    if unknown:
        raise InvalidOption(
            f"a {form} has no size {unknown[0]!r}", hint=f"It has: {', '.join(SIZES[form])}."
        )
    return FORMS[form](name, link, {**SIZES[form], **sizes})


def _gripper(
    name: str,
    link: str | None,
    size: Sizes,
    body: Box | Cylinder,
    angles: Mapping[str, float],
) -> Tool:
    """A body with equal jaws about z, whose inner faces meet on the axis."""
    height, length = size["height"], size["finger_length"]
    shape = Box((size["finger_thickness"], size["finger_width"], length))
    place = transform(position=[0.5 * size["finger_thickness"], 0.0, height + 0.5 * length])
    jaws = {
        jaw: Jaw(transform(rotation_z(angle)), np.array([1.0, 0.0, 0.0]), (Solid(shape, place),))
        for jaw, angle in angles.items()
    }
    return Tool(
        name,
        {"tip": _up(height + length)},
        (Solid(body, _up(0.5 * height)),),
        link,
        _body_inertia(size["mass"], body, 0.5 * height),
        jaws,
        "jaws",
        (0.0, size["opening"]),
        size["speed"],
    )


def _up(z: float) -> Array:
    return transform(position=[0.0, 0.0, z])


def _body_inertia(mass: float, body: Box | Cylinder, z: float) -> Inertia | None:
    """Mass properties of a homogeneous body on the axis."""
    if isinstance(body, Cylinder):
        return _rod(mass, body.radius, 2.0 * z)
    if mass == 0.0:
        return None
    x, y, h = body.size**2
    return Inertia(mass, np.array([0.0, 0.0, z]), np.diag([y + h, x + h, x + y]) * mass / 12.0)


def _rod(mass: float, radius: float, length: float) -> Inertia | None:
    """Mass properties of a homogeneous cylinder along z that begins at the flange."""
    if mass == 0.0:
        return None
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    tensor = np.diag([across, across, 0.5 * mass * radius**2])
    return Inertia(mass, np.array([0.0, 0.0, 0.5 * length]), tensor)

"""URDF: the XML description of a robot, read strictly.

Follows the URDF XML specification (wiki.ros.org/urdf/XML). What contradicts it, or can't be
built, is refused with the name of the link or joint; what is merely odd goes into ``lint``.

The links of a URDF: mass properties, collision geometry and where they sit.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidPose, InvalidRobotDescription
from kinematics.model.chain import Inertia
from kinematics.pose import from_quaternion, from_rpy, transform
from kinematics.readers.lint import URDF, unread_notes
from kinematics.readers.xml_reader import (
    Element,
    attribute,
    children,
    number,
    numbers,
    read_robot,
    single,
)
from kinematics.tree.description import (
    JOINT_TYPES,
    BoxGeometry,
    CapsuleGeometry,
    CollisionElement,
    CylinderGeometry,
    Geometry,
    JointDescription,
    LinkDescription,
    MeshGeometry,
    Mimic,
    RobotDescription,
    SphereGeometry,
)

#: Lengths [m], masses [kg] and moments of inertia [kg m^2] beyond these overflow later sums.
MAX_LENGTH = 1e6
MAX_MASS = 1e9
MAX_INERTIA = 1e12
#: Thickness of what has a size of 0 [m]: a micrometre, which no clearance shows.
PLATE = 1e-6
#: Moments of inertia are given to few digits: by so much, relative, they may miss a rule.
INERTIA_TOLERANCE = 1e-3
#: Moments [kg m^2] below this are rounding: a grain of 1 mg within 1 mm has 1e-12.
INERTIA_FLOOR = 1e-12


def read_origin(element: Element, where: str) -> Array:
    """The pose (4, 4) that the <origin> of ``element`` gives, the identity without one.

    Raises:
        InvalidRobotDescription: Its numbers are wrong.
    """
    origin = single(element, "origin", where)
    if origin is None:
        return np.eye(4)
    position = (0.0, 0.0, 0.0)
    if origin.get("xyz") is not None:
        position = _triple(origin, "xyz", where, bound=MAX_LENGTH)
    if origin.get("quat_xyzw") is None:
        angles = _triple(origin, "rpy", where) if origin.get("rpy") is not None else (0.0, 0.0, 0.0)
        return transform(from_rpy(angles), position)
    if origin.get("rpy") is not None:
        raise InvalidRobotDescription(f"<origin> of {where} has both 'rpy' and 'quat_xyzw'")
    try:
        return transform(from_quaternion(numbers(origin, "quat_xyzw", 4, where)), position)
    except InvalidPose as error:
        raise InvalidRobotDescription(f"<origin> of {where}: {error.message}") from None


def _triple(
    element: Element, name: str, where: str, *, bound: float = math.inf
) -> tuple[float, float, float]:
    x, y, z = numbers(element, name, 3, where, bound=bound)
    return x, y, z


def read_link(element: Element, lint: list[str]) -> LinkDescription:
    """Read one <link>.

    Args:
        element: The element.
        lint: List that gets remarks on what is odd but no fault.

    Raises:
        InvalidRobotDescription: It has no name, or a number or geometry is wrong.
    """
    name = attribute(element, "name", "the robot")
    where = f"link {name!r}"
    read = [_collision(e, where, lint) for e in children(element, "collision")]
    collisions = tuple(collision for collision in read if collision is not None)
    if not collisions:
        lint.append(no_solids(name))
    drawn = any(True for _ in children(element, "visual"))
    return LinkDescription(name, _inertia(element, where, lint), collisions, drawn)


def no_solids(name: str) -> str:
    """The note on a link that has no collision geometry."""
    return f"link {name!r} has no collision geometry: nothing is checked against it"


def _inertia(link: Element, where: str, lint: list[str]) -> Inertia | None:
    inertial = single(link, "inertial", where)
    if inertial is None:
        return None
    mass_element = single(inertial, "mass", where)
    tensor_element = single(inertial, "inertia", where)
    if mass_element is None or tensor_element is None:
        missing = "mass" if mass_element is None else "inertia"
        raise InvalidRobotDescription(
            f"<inertial> of {where} has no <{missing}>",
            hint="Give it, or leave <inertial> out as a whole.",
        )
    mass = number(mass_element, "value", where, bound=MAX_MASS)
    if mass < 0.0:
        raise InvalidRobotDescription(f"the mass of {where} is negative: {mass:g} kg")
    T_link_body = read_origin(inertial, where)
    tensor = _tensor(tensor_element, where)
    _lint_inertia(mass, tensor, where, lint)
    R = T_link_body[:3, :3]
    return Inertia(mass, T_link_body[:3, 3], R @ tensor @ R.T)


def _tensor(element: Element, where: str) -> Array:
    xx, yy, zz = (number(element, n, where, bound=MAX_INERTIA) for n in ("ixx", "iyy", "izz"))
    xy, xz, yz = (
        number(element, n, where, default=0.0, bound=MAX_INERTIA) for n in ("ixy", "ixz", "iyz")
    )
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _lint_inertia(mass: float, tensor: Array, where: str, lint: list[str]) -> None:
    low, middle, high = np.linalg.eigvalsh(tensor)
    slack = INERTIA_TOLERANCE * max(abs(low), abs(high)) + INERTIA_FLOOR
    if low < -slack:
        lint.append(f"the inertia of {where} is not positive semi-definite (eigenvalue {low:.3g})")
    elif high > low + middle + slack:
        lint.append(
            f"the inertia of {where} belongs to no body: its principal moment {high:.3g} is "
            f"larger than the sum of the others, {low + middle:.3g}"
        )
    if mass == 0.0 and high > 0.0:
        lint.append(f"{where} has mass 0 but an inertia of {high:.3g} kg m^2")


def _collision(element: Element, where: str, lint: list[str]) -> CollisionElement | None:
    """One <collision>; None where its shape has no extent."""
    geometry = read_geometry(element, where, lint)
    return None if geometry is None else CollisionElement(read_origin(element, where), geometry)


def read_geometry(element: Element, where: str, lint: list[str]) -> Geometry | None:
    """The shape of a <collision> or <visual>; None where it has no extent.

    Args:
        element: The element.
        where: The link, for messages.
        lint: List that gets remarks on what is odd but no fault.

    Raises:
        InvalidRobotDescription: It has none, several, or one with wrong numbers.
    """
    holder = single(element, "geometry", f"<{element.tag}> of {where}")
    shapes = [] if holder is None else [shape for shape in holder if shape.tag in _GEOMETRIES]
    if holder is None or len(shapes) != 1 or len(holder) != 1:
        found = [] if holder is None else [shape.tag for shape in holder]
        raise InvalidRobotDescription(
            f"<{element.tag}> of {where} must have one geometry, got {', '.join(found) or 'none'}",
            hint=f"One of: {', '.join(_GEOMETRIES)}.",
        )
    return _GEOMETRIES[shapes[0].tag](shapes[0], where, lint)


def _sizes(element: Element, names: tuple[str, ...], where: str) -> list[float]:
    """Sizes of a shape, none of them negative."""
    values = [number(element, name, where, bound=MAX_LENGTH) for name in names]
    for name, value in zip(names, values, strict=True):
        if value < 0.0:
            raise InvalidRobotDescription(
                f"{name!r} of <{element.tag}> of {where} is {value:g}, it must be positive"
            )
    return values


def _has_extent(element: Element, sizes: list[float], where: str, lint: list[str]) -> bool:
    """Whether a shape has no size of 0; a shape that has one is reported."""
    if min(sizes) > 0.0:
        return True
    lint.append(f"a collision <{element.tag}> of {where} has size 0: it is left out")
    return False


def _box(element: Element, where: str, lint: list[str]) -> BoxGeometry | None:
    size = _triple(element, "size", where, bound=MAX_LENGTH)
    if min(size) < 0.0:
        raise InvalidRobotDescription(f"'size' of <box> of {where} must be positive, got {size}")
    if not _has_extent(element, [max(size)], where, lint):
        return None
    if min(size) == 0.0:
        lint.append(f"a collision <box> of {where} is flat: it is taken {PLATE:g} m thick")
    x, y, z = (value or PLATE for value in size)
    return BoxGeometry((x, y, z))


def _sphere(element: Element, where: str, lint: list[str]) -> SphereGeometry | None:
    sizes = _sizes(element, ("radius",), where)
    return SphereGeometry(*sizes) if _has_extent(element, sizes, where, lint) else None


def _round(
    shape: type[CylinderGeometry | CapsuleGeometry], element: Element, where: str, lint: list[str]
) -> Geometry | None:
    radius, length = _sizes(element, ("radius", "length"), where)
    return shape(radius, length or PLATE) if _has_extent(element, [radius], where, lint) else None


def _mesh(element: Element, where: str, _lint: list[str]) -> MeshGeometry:
    uri = attribute(element, "filename", where)
    if element.get("scale") is None:
        return MeshGeometry(uri)
    words = element.get("scale", "").split()
    count = 1 if len(words) == 1 else 3
    scale = numbers(element, "scale", count, where, bound=MAX_LENGTH)
    if not all(scale):
        raise InvalidRobotDescription(f"'scale' of <mesh> of {where} is 0, so nothing is left")
    x, y, z = scale * 3 if count == 1 else scale
    return MeshGeometry(uri, (x, y, z))


_GEOMETRIES: Mapping[str, Callable[[Element, str, list[str]], Geometry | None]] = {
    "box": _box,
    "sphere": _sphere,
    "cylinder": partial(_round, CylinderGeometry),
    "capsule": partial(_round, CapsuleGeometry),
    "mesh": _mesh,
}


#: More links or joints than any robot has.
MAX_LINKS = 1000
#: An axis shorter than this names no direction.
MIN_AXIS = 1e-9

_MISSING = math.nan
_SOFT = ("soft_lower_limit", "soft_upper_limit")
_POSITION_TYPES = ("revolute", "prismatic")
#: Ranges between these are no turns that a joint makes, but may well be degrees [rad].
_DEGREES, _MOST_DEGREES = 44.0, 1500.0
_Named = TypeVar("_Named", LinkDescription, JointDescription)


def parse_urdf(text: str | bytes) -> RobotDescription:
    """Read a URDF text.

    Args:
        text: The XML text; bytes are decoded as its declaration says.

    Returns:
        The tree of links and joints, with warnings in ``lint``.

    Raises:
        InvalidRobotDescription: The text is no URDF or contradicts itself; the message says what,
            at which link or joint, and what to do.
    """
    foreign: list[str] = []
    robot = read_robot(text, "URDF", foreign)
    lint = unread_notes(robot, URDF, foreign)
    name = robot.get("name", "").strip()
    name = attribute(robot, "name", "the robot") if name else "robot"
    links = _index_by_name([read_link(e, lint) for e in _elements(robot, "link")], "link")
    joints = _index_by_name([_joint(e, lint) for e in _elements(robot, "joint")], "joint")
    if not links:
        raise InvalidRobotDescription("the URDF has no <link>")
    root = _root(links, joints)
    _check_mimics(joints)
    return RobotDescription(name, root, links, joints, tuple(lint))


def _elements(robot: Element, tag: str) -> list[Element]:
    found = list(children(robot, tag))
    if len(found) > MAX_LINKS:
        raise InvalidRobotDescription(f"there are {len(found)} {tag}s, at most {MAX_LINKS} may be")
    return found


def _index_by_name(items: list[_Named], kind: str) -> dict[str, _Named]:
    by_name: dict[str, _Named] = {}
    for item in items:
        if item.name in by_name:
            raise InvalidRobotDescription(
                f"two {kind}s are called {item.name!r}", hint="Every name must be used once."
            )
        by_name[item.name] = item
    return by_name


# ------------------------------------------------------------------------------------ joints


def _joint(element: Element, lint: list[str]) -> JointDescription:
    name = attribute(element, "name", "the robot")
    where = f"joint {name!r}"
    type_ = attribute(element, "type", where)
    if type_ not in JOINT_TYPES:
        raise InvalidRobotDescription(
            f"{where} has the unknown type {type_!r}", hint=f"One of: {', '.join(JOINT_TYPES)}."
        )
    lower, upper = _positions(element, type_, where, lint)
    _lint_unobeyed(element, type_, where, lint)
    limit = single(element, "limit", where)
    dynamics = single(element, "dynamics", where)
    moves = type_ in ("revolute", "continuous", "prismatic")
    quantities = ("velocity", "acceleration", "jerk", "effort")
    limits = {q: _limit(limit, q, where, lint if moves else []) for q in quantities}
    return JointDescription(
        name=name,
        type=type_,
        parent=_end(element, "parent", where),
        child=_end(element, "child", where),
        T_parent_joint=read_origin(element, where),
        axis=_axis(element, where, lint) if moves else np.array([1.0, 0.0, 0.0]),
        lower=lower,
        upper=upper,
        damping=_not_negative(dynamics, "damping", where),
        friction=_not_negative(dynamics, "friction", where),
        mimic=_mimic(element, where),
        soft_range=_soft_range(element, where) if moves else None,
        **limits,
    )


def _end(joint: Element, tag: str, where: str) -> str:
    end = single(joint, tag, where)
    if end is None:
        raise InvalidRobotDescription(f"{where} has no <{tag}>")
    return attribute(end, "link", where)


def _axis(joint: Element, where: str, lint: list[str]) -> Array:
    element = single(joint, "axis", where)
    if element is None:
        lint.append(f"{where} has no <axis>: it is x, as the URDF specification says")
        return np.array([1.0, 0.0, 0.0])
    axis = np.array(numbers(element, "xyz", 3, where, bound=MAX_LENGTH))
    length = float(np.linalg.norm(axis))
    if length < MIN_AXIS:
        raise InvalidRobotDescription(
            f"the <axis> of {where} has length {length:g}, so it names no direction",
            hint='Give a unit vector, for example xyz="0 0 1".',
        )
    # Dividing an axis that is already a unit vector would only stir its last digits.
    return axis if length == 1.0 else axis / length


def _positions(joint: Element, type_: str, where: str, lint: list[str]) -> tuple[float, float]:
    limit = single(joint, "limit", where)
    if type_ not in _POSITION_TYPES:
        ends = [] if limit is None else [limit.get("lower"), limit.get("upper")]
        if type_ == "continuous" and any(end is not None for end in ends):
            lint.append(
                f"{where} is continuous: its lower and upper limits are not used, as the URDF "
                "specification says; joint_limits may give it some"
            )
        return -math.inf, math.inf
    if limit is None or (limit.get("lower") is None and limit.get("upper") is None):
        lint.append(
            f"{where} is {type_} and has neither a lower nor an upper limit: unless joint_limits "
            "gives them, its range is unlimited"
        )
        return _MISSING, _MISSING
    lint += [
        f"{where} has no {side!r} limit: it is 0, as the URDF specification says"
        for side in ("lower", "upper")
        if limit.get(side) is None
    ]
    lower = number(limit, "lower", where, default=0.0)
    upper = number(limit, "upper", where, default=0.0)
    if lower > upper:
        # Only a joint of the chain needs its range, and that may be given in joint_limits.
        lint.append(
            f"{where} has the lower limit {lower:g} above its upper limit {upper:g}: its range is "
            "not known"
        )
    if lower == upper:
        lint.append(f"{where} can't move: both its limits are {lower:g}")
    if type_ == "revolute" and _DEGREES < upper - lower <= _MOST_DEGREES:
        lint.append(
            f"{where} turns from {lower:g} to {upper:g} rad, {(upper - lower) / math.tau:.0f} "
            "times around: if these are degrees, URDF has radians"
        )
    return lower, upper


def _lint_unobeyed(joint: Element, type_: str, where: str, lint: list[str]) -> None:
    """Tell what says something of a joint that can't be obeyed."""
    if type_ in ("fixed", "floating", "planar") and single(joint, "mimic", where) is not None:
        lint.append(f"{where} is {type_}: its <mimic> is not obeyed")
    safety = single(joint, "safety_controller", where)
    given = [] if safety is None else [side for side in _SOFT if safety.get(side) is not None]
    if len(given) == 1:
        (missing,) = set(_SOFT) - set(given)
        lint.append(
            f"{where} has a {given[0]} without a {missing}: it is not obeyed (MoveIt takes 0 for "
            "the other)"
        )


def _soft_range(joint: Element, where: str) -> tuple[float, float] | None:
    element = single(joint, "safety_controller", where)
    if element is None or any(element.get(side) is None for side in _SOFT):
        return None
    lower, upper = (number(element, side, where) for side in _SOFT)
    # Both 0 is what exporters write who know no such limits.
    return (lower, upper) if lower < upper else None


def _limit(limit: Element | None, quantity: str, where: str, lint: list[str]) -> float:
    value = _MISSING
    if limit is not None and limit.get(quantity) is not None:
        value = number(limit, quantity, where)
    if value <= 0.0:
        # Exporters write 0 or -1 for "not known"; a joint with speed 0 could not move at all.
        lint.append(f"the {quantity} limit of {where} is {value:g}: taken as not given")
        return _MISSING
    if math.isnan(value) and quantity == "velocity":
        lint.append(f"{where} has no velocity limit")
    return value


def _not_negative(element: Element | None, name: str, where: str) -> float:
    value = 0.0 if element is None else number(element, name, where, default=0.0)
    if value < 0.0:
        raise InvalidRobotDescription(f"the {name} of {where} is negative: {value:g}")
    return value


def _mimic(joint: Element, where: str) -> Mimic | None:
    element = single(joint, "mimic", where)
    if element is None:
        return None
    return Mimic(
        joint=attribute(element, "joint", where),
        multiplier=number(element, "multiplier", where, default=1.0),
        offset=number(element, "offset", where, default=0.0),
    )


# -------------------------------------------------------------------------------- connections


def _root(links: Mapping[str, LinkDescription], joints: Mapping[str, JointDescription]) -> str:
    carrier: dict[str, str] = {}
    for joint in joints.values():
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise InvalidRobotDescription(
                    f"joint {joint.name!r} has the unknown {end} link {link!r}",
                    hint=f"The links are: {_join_names(list(links))}.",
                )
        if joint.child in carrier:
            raise InvalidRobotDescription(
                f"link {joint.child!r} has two parents: it is the child of the joints "
                f"{carrier[joint.child]!r} and {joint.name!r}",
                hint="Closed loops can't be described; cut the loop at one joint.",
            )
        carrier[joint.child] = joint.name
    roots = [name for name in links if name not in carrier]
    if len(roots) > 1:
        raise InvalidRobotDescription(
            f"there are {len(roots)} roots, links that no joint carries: {_join_names(roots)}",
            hint="Join them with joints, or take out those that do not belong to the robot.",
        )
    _check_cycles(links, joints, carrier)
    return roots[0]


def _check_cycles(
    links: Mapping[str, LinkDescription],
    joints: Mapping[str, JointDescription],
    carrier: Mapping[str, str],
) -> None:
    grounded: set[str] = set()
    for name in links:
        walk: dict[str, None] = {}
        link = name
        while link in carrier and link not in grounded:
            if link in walk:
                cycle = [*list(walk)[list(walk).index(link) :], link]
                raise InvalidRobotDescription(
                    f"the links form a cycle: {_join_names(cycle[::-1], ' -> ')}",
                    hint="One link must be the root; every other hangs on one joint.",
                )
            walk[link] = None
            link = joints[carrier[link]].parent
        grounded.update(walk)


def _check_mimics(joints: Mapping[str, JointDescription]) -> None:
    for joint in joints.values():
        seen = [joint.name]
        one = joint
        while one.mimic is not None:
            leader = one.mimic.joint
            if leader not in joints:
                raise InvalidRobotDescription(
                    f"joint {one.name!r} mimics the unknown joint {leader!r}",
                    hint=f"The joints are: {_join_names(list(joints))}.",
                )
            if leader in seen:
                raise InvalidRobotDescription(f"joint {leader!r} mimics itself")
            seen.append(leader)
            one = joints[leader]


def _join_names(names: Sequence[str], separator: str = ", ", most: int = 20) -> str:
    more = f"{separator}... ({len(names)} in all)" if len(names) > most else ""
    return separator.join(names[:most]) + more

"""The links of a URDF: mass properties, collision geometry and where they sit."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidPose, InvalidRobotDescription
from kinematics.model.chain import Inertia
from kinematics.pose import from_quaternion, from_rpy, transform
from kinematics.readers.xml_reader import Element, attribute, children, number, numbers, single
from kinematics.tree.description import (
    BoxGeometry,
    CapsuleGeometry,
    CollisionElement,
    CylinderGeometry,
    Geometry,
    LinkDescription,
    MeshGeometry,
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


def _cylinder(element: Element, where: str, lint: list[str]) -> CylinderGeometry | None:
    radius, length = _sizes(element, ("radius", "length"), where)
    if not _has_extent(element, [radius], where, lint):
        return None
    return CylinderGeometry(radius, length or PLATE)


def _capsule(element: Element, where: str, lint: list[str]) -> CapsuleGeometry | None:
    radius, length = _sizes(element, ("radius", "length"), where)
    if not _has_extent(element, [radius], where, lint):
        return None
    return CapsuleGeometry(radius, length or PLATE)


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
    "cylinder": _cylinder,
    "capsule": _capsule,
    "mesh": _mesh,
}

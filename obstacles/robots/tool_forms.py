"""Built-in tools: a parallel jaw, three jaws, a suction cup, a torch and a spindle, by their sizes.

Each stands on its flange with z away from the arm. They are plain solids that hold the real thing
where their sizes are chosen so; the maker's own solids are nearer.
"""

import math
from collections.abc import Mapping

import numpy as np

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from kinematics.model.chain import Inertia
from kinematics.pose import rotation_y, rotation_z, transform
from obstacles.robots.tool import Jaw, Solid, Tool
from obstacles.shapes.shape import Box, Capsule, Cylinder

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
    finger = Box((size["finger_thickness"], size["finger_width"], size["finger_length"]))
    jaws = {"left": 0.0, "right": math.pi}
    return _gripper(name, link, size, body, (finger, jaws))


def three_jaw(name: str, link: str | None, size: Sizes) -> Tool:
    """Three jaws about z at 120 degrees, ``opening`` the diameter between them.

    Args:
        name: Name of the tool.
        link: Link that it is mounted on.
        size: Sizes, as ``SIZES`` has them.
    """
    body = Cylinder(size["radius"], size["height"])
    finger = Box((size["finger_thickness"], size["finger_width"], size["finger_length"]))
    jaws = {f"jaw_{k + 1}": 2.0 * math.pi * k / 3.0 for k in range(3)}
    return _gripper(name, link, size, body, (finger, jaws))


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
    fingers: tuple[Box, Mapping[str, float]],
) -> Tool:
    """A body with equal jaws about z, whose inner faces meet on the axis."""
    height, length = size["height"], size["finger_length"]
    shape, angles = fingers
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

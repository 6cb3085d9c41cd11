"""Visual geometry of the links of a URDF, with its colours. Faults are told, not refused."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidRobotDescription
from kinematics.readers.xml_reader import Element, children, numbers, read_robot, single
from kinematics.tree.description import Geometry
from kinematics.urdf.links import read_geometry, read_origin

#: Red, green, blue and opacity from 0 to 1.
Color: TypeAlias = tuple[float, float, float, float]

#: A colour without opacity, as some exporters write it, is opaque.
_RGB, _RGBA = 3, 4


@dataclass(frozen=True, slots=True, eq=False)
class VisualElement:
    """One drawn solid of a link.

    Args:
        T_link_element: The solid's frame in the link's frame, shape (4, 4).
        geometry: Shape of the element.
        color: Colour of the material; None where the URDF gives none.
    """

    T_link_element: Array
    geometry: Geometry
    color: Color | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_link_element", frozen(self.T_link_element))


@dataclass(frozen=True, slots=True)
class UrdfVisuals:
    """Visual geometry of a URDF.

    Args:
        links: Elements of each link that has some which can be read.
        faults: Links with an element that can't be read, and why.
    """

    links: Mapping[str, tuple[VisualElement, ...]]
    faults: Mapping[str, str]


def read_visuals(text: str | bytes) -> UrdfVisuals:
    """Read the visual geometry of a URDF.

    Args:
        text: The XML text, which ``parse_urdf`` took.

    Raises:
        InvalidRobotDescription: It is no URDF.
    """
    robot = read_robot(text, "URDF")
    colors = _colors(robot)
    links: dict[str, tuple[VisualElement, ...]] = {}
    faults: dict[str, str] = {}
    for link in children(robot, "link"):
        name = link.get("name", "")
        read: list[VisualElement] = []
        for element in children(link, "visual"):
            try:
                visual = _visual(element, f"link {name!r}", colors)
            except InvalidRobotDescription as error:
                faults[name] = error.message
                continue
            if visual is not None:
                read.append(visual)
        if read:
            links[name] = tuple(read)
    return UrdfVisuals(links, faults)


def _visual(element: Element, where: str, colors: Mapping[str, Color]) -> VisualElement | None:
    geometry = read_geometry(element, where, [])
    if geometry is None:
        return None
    material = single(element, "material", where)
    color = None
    if material is not None:
        color = _color(material) or colors.get(material.get("name", ""))
    return VisualElement(read_origin(element, where), geometry, color)


def _colors(robot: Element) -> dict[str, Color]:
    """Colours by the name of their material; links use what others define, too."""
    found: dict[str, Color] = {}
    visuals = (v for link in children(robot, "link") for v in children(link, "visual"))
    for holder in (robot, *visuals):
        for material in children(holder, "material"):
            color = _color(material)
            if color is not None:
                found.setdefault(material.get("name", ""), color)
    return found


def _color(material: Element) -> Color | None:
    """The colour that a material has itself; None where it has none that can be read."""
    for element in children(material, "color"):
        count = len(element.get("rgba", "").split())
        if count not in (_RGB, _RGBA):
            continue
        try:
            values = numbers(element, "rgba", count, "a material")
        except InvalidRobotDescription:
            continue
        red, green, blue, alpha = (min(max(float(v), 0.0), 1.0) for v in (*values, 1.0)[:_RGBA])
        return red, green, blue, alpha
    return None

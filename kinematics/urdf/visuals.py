"""Visual geometry of the links of a URDF, with its colours. Faults are reported, not refused.

Many vendors send no collision geometry: their links collide as they look.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from kinematics.errors import InvalidRobotDescription
from kinematics.readers.xml_reader import Element, children, numbers, read_robot, single
from kinematics.tree.description import CollisionElement, RobotDescription
from kinematics.urdf.urdf import no_solids, read_geometry, read_origin

#: Red, green, blue and opacity from 0 to 1.
Color: TypeAlias = tuple[float, float, float, float]

#: A colour without opacity, as some exporters write it, is opaque.
_RGB, _RGBA = 3, 4


@dataclass(frozen=True, slots=True, eq=False)
class VisualElement(CollisionElement):
    """One drawn solid of a link.

    Args:
        T_link_element: The solid's frame in the link's frame, shape (4, 4).
        geometry: Shape of the element.
        color: Colour of the material; None where the URDF gives none.
    """

    color: Color | None = None


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
        InvalidRobotDescription: The text is no URDF.
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


def with_visual_solids(description: RobotDescription, visuals: UrdfVisuals) -> RobotDescription:
    """The description with visual geometry where links have no collision geometry.

    A link of which something can't be read as it looks stays without: half of it would be no
    bound. ``lint`` tells which links were given solids and which were not.

    Args:
        description: The tree.
        visuals: Visual elements of the same URDF.
    """
    bare = [name for name, link in description.links.items() if not link.collisions]
    unread = [name for name in bare if name in visuals.faults]
    given = [name for name in bare if name in visuals.links and name not in unread]
    links = dict(description.links)
    for name in given:
        solids = (CollisionElement(v.T_link_element, v.geometry) for v in visuals.links[name])
        links[name] = replace(links[name], collisions=tuple(solids))
    settled = {no_solids(name) for name in given}
    lint = [line for line in description.lint if line not in settled]
    if given:
        lint.append(
            f"links collide as they look, as visual_solids asks: {', '.join(map(repr, given))}"
        )
    lint += [f"{visuals.faults[name]}: it gives link {name!r} no solids" for name in unread]
    return replace(description, links=links, lint=tuple(lint))

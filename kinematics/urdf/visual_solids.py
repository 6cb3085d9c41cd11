"""Links without collision geometry that collide as they look: many vendors send no other solids."""

from dataclasses import replace

from kinematics.tree.description import CollisionElement, RobotDescription
from kinematics.urdf.links import no_solids
from kinematics.urdf.visuals import UrdfVisuals


def with_visual_solids(description: RobotDescription, visuals: UrdfVisuals) -> RobotDescription:
    """The description with what links look like where they have no collision geometry.

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

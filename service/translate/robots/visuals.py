"""Visual geometry of stored robots: the meshes of their URDF, found among the files that came."""

import base64
from collections.abc import Iterator, Mapping
from functools import partial

from armwright_wire.robots.robot import MAX_MESHES, RobotBody
from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import Chain
from kinematics.readers.mesh_uri import resolve_mesh
from kinematics.tree.description import MeshGeometry
from kinematics.urdf.visuals import UrdfVisuals, read_visuals
from obstacles.robots.visual_geometry import VisualGeometry, visual_geometry

#: Visual mesh files that are kept of an archive, together [byte].
MAX_VISUAL_BYTES = 16 * 2**20
#: Reason of a link whose mesh is not among the files.
_ABSENT = "its mesh was not uploaded"
#: Links that one sentence names.
_MOST_NAMES = 8


def robot_visuals(body: RobotBody, chain: Chain) -> tuple[VisualGeometry, list[str]]:
    """The visual geometry of a robot's links, and what of it can't be drawn. Refuses nothing.

    Args:
        body: The request that stores it.
        chain: The robot.
    """
    if body.urdf is None:
        return VisualGeometry(), []
    files = {uri: base64.b64decode(text) for uri, text in (body.meshes or {}).items()}
    names = [link.name for link in chain.links]
    made = visual_geometry(read_visuals(body.urdf), names, partial(_find, files))
    return made, [*_lint(made)]


def _find(files: Mapping[str, bytes], uri: str) -> bytes:
    try:
        return resolve_mesh(uri, files)
    except InvalidRobotDescription:
        raise InvalidRobotDescription(_ABSENT) from None


def _lint(made: VisualGeometry) -> Iterator[str]:
    absent = [link for link, reason in made.missing if reason == _ABSENT]
    if absent:
        more = f" and {len(absent) - _MOST_NAMES} more" if len(absent) > _MOST_NAMES else ""
        yield (
            f"visual meshes of {', '.join(absent[:_MOST_NAMES])}{more} were not uploaded, or go "
            f"beyond the {MAX_VISUAL_BYTES // 2**20} MiB that are kept of an archive: collision "
            "geometry is drawn in their place"
        )
    for link, reason in made.missing:
        if link not in absent:
            yield f"visual of link {link!r}: {reason}: its collision geometry is drawn"


def kept_meshes(urdf: str, meshes: Mapping[str, bytes], colliding: set[str]) -> list[str]:
    """Names of the files of an archive that are kept, in its order.

    Those for collisions all stay; of those that are only seen, small ones first, what the bounds
    of size and number leave room for.

    Args:
        urdf: The description.
        meshes: Bytes by their path in the archive.
        colliding: File names, without folders, of meshes that links collide with.
    """
    # A name that differs in case alone is no match, but the one to tell of.
    folded = {name.lower() for name in colliding}
    kept = {name for name in meshes if _file(name).lower() in folded}
    seen = _visual_files(read_visuals(urdf))
    left = MAX_VISUAL_BYTES
    for name in sorted(meshes, key=lambda item: (len(meshes[item]), item)):
        if name in kept or _file(name) not in seen:
            continue
        left -= len(meshes[name])
        if left < 0 or len(kept) >= MAX_MESHES:
            break
        kept.add(name)
    return [name for name in meshes if name in kept]


def _visual_files(visuals: UrdfVisuals) -> set[str]:
    shapes = (item.geometry for items in visuals.links.values() for item in items)
    return {_file(shape.uri) for shape in shapes if isinstance(shape, MeshGeometry)}


def _file(path: str) -> str:
    return path.rpartition("/")[2]

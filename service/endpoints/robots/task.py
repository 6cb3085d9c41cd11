"""The functions that workers run for robots and scenes: values in, values out, nothing of HTTP.

Collision geometry of a robot, or what it looks like, as triangles, in workers.
"""

import base64
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from pydantic import ValidationError
from pydantic_core import to_json

from armwright_wire.robots.kinematics import FkRequest
from armwright_wire.robots.robot import (
    MAX_MESHES,
    BodySurface,
    GeometryAnswer,
    GeometryKind,
    RobotBody,
    RobotChanges,
)
from armwright_wire.scenes.scene import NamedScene
from armwright_wire.scenes.scene import Scene as SceneBody
from armwright_wire.scenes.tool import NamedTool, Tool
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotDescription
from kinematics.forward import link_poses
from kinematics.model.chain import Chain, Link
from kinematics.pose import align_z, inverse, transform
from kinematics.readers.mesh_uri import resolve_mesh
from kinematics.robots import builtin_urdf
from kinematics.tree.description import (
    CapsuleGeometry,
    CollisionElement,
    CylinderGeometry,
    MeshGeometry,
    SphereGeometry,
)
from kinematics.tree.fingers import Fingers
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.visuals import UrdfVisuals, read_visuals, with_visual_solids
from kinematics.urdf.writer import srdf_text, urdf_text, with_limits
from obstacles.collision.model.collision_model import pack
from obstacles.convex.piece import Piece, PieceKind
from obstacles.kept_files import keep_files_in, written_files
from obstacles.robots.robot_geometry import RobotGeometry, hulled
from obstacles.robots.visual_geometry import VisualBody, VisualGeometry, visual_geometry
from obstacles.scenes.scene import Scene
from service.endpoints.kinematics.task import fk_document, with_held
from service.storage.caches import disk_cache, prepared_files, worker_cache
from service.storage.caches.cache_key import Reference
from service.storage.caches.disk_cache import PreparedRobot
from service.translate import poses
from service.translate.poses import transform as pose_transform
from service.translate.robots import limits, robots, tools
from service.translate.robots.archive import read_archive
from service.validation import validation_problem
from service.viewer.document import Body, bodies, packed
from service.workers.result import RobotModel
from service.workers.task import task


@task
def finger_poses(robot: Reference, content: bytes) -> bytes:
    """Answer a request for forward kinematics that says where fingers stand.

    Args:
        robot: The robot.
        content: The request.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
        InvalidOption: A joint is no finger's, or stands outside its limits; lists are of another
            length than the configurations.
    """
    body = FkRequest.model_validate_json(content)
    geometry = worker_cache.robot(robot).geometry
    chain = with_held(geometry.chain, body)
    return to_json(fk_document(chain, body, _with_fingers(chain, geometry.fingers, body)))


def _with_fingers(chain: Chain, fingers: Fingers, body: FkRequest) -> Array:
    """Poses of all links, those behind fingers where these stand: shape (..., links, 4, 4)."""
    poses = link_poses(chain, body.joints)
    rows = poses.reshape(-1, *poses.shape[-3:])
    index = {link.name: i for i, link in enumerate(chain.links)}
    for row, positions in zip(rows, _positions(body, len(rows)), strict=True):
        moved = fingers.link_poses(chain, fingers.with_positions(positions))
        for name, T_joint_link in moved.items():
            T_root_joint = row[index[name]] @ inverse(chain.link(name).T_joint_link)
            row[index[name]] = T_root_joint @ T_joint_link
        for item in body.attached or ():
            assert item.pose is not None
            row[index[item.id]] = row[index[item.link]] @ pose_transform(item.pose)
    return rows.reshape(poses.shape)


def _positions(body: FkRequest, count: int) -> list[dict[str, float]]:
    given: dict[str, Any] = dict(body.fingers or {})
    for name, value in given.items():
        if isinstance(value, list) and (len(value) != count or np.ndim(body.joints) == 1):
            raise InvalidOption(
                f"fingers: {name!r} has {len(value)} positions for {count} configurations",
                hint="Give one number, or one for each configuration.",
                joint=name,
            )
    return [
        {name: float(v[i] if isinstance(v, list) else v) for name, v in given.items()}
        for i in range(count)
    ]


@task
def robot_geometry(robot: Reference, name: str, kind: GeometryKind = "collision") -> bytes:
    """The collision geometry of a robot as triangles in the frames of its links, or its visual one.

    Args:
        robot: The robot.
        name: Name of the robot.
        kind: "visual" for what it looks like; there, links that look like nothing that is known
            have their collision geometry, and a robot none of whose links does has no bodies.
    """
    geometry = worker_cache.robot(robot).geometry
    drawn = bodies(geometry, Scene())
    surfaces: list[BodySurface] = []
    if kind == "visual":
        looks = worker_cache.visuals(robot).bodies
        seen = {body.link for body in looks}
        drawn = [body for body in drawn if looks and body.name not in seen]
        surfaces = [_visual(body) for body in looks]
    surfaces += [_surface(geometry.chain, body) for body in drawn]
    answer = GeometryAnswer(robot=name, hash=geometry.content_hash, kind=kind, bodies=surfaces)
    return answer.model_dump_json().encode()


def _visual(body: VisualBody) -> BodySurface:
    color = None if body.color is None else list(body.color)
    return _in_frame(body, body.link, body.link, body.surface.vertices, color)


def _surface(chain: Chain, body: Body) -> BodySurface:
    link = _frame_link(chain, body)
    T = inverse(link.T_joint_link)
    vertices = body.surface.vertices @ T[:3, :3].T + T[:3, 3]
    return _in_frame(body, body.name, link.name, vertices)


def _in_frame(
    body: Body | VisualBody,
    link: str,
    frame: str,
    vertices: Array,
    color: list[float] | None = None,
) -> BodySurface:
    """The surface of a body of a link, its vertices in a frame."""
    return BodySurface(
        link=link,
        frame=frame,
        vertices=packed(vertices.astype("<f4")),
        faces=packed(body.surface.faces.astype("<u4")),
        simplified=body.simplified,
        color=color,
    )


def _frame_link(chain: Chain, body: Body) -> Link:
    """The body's own link, or another one that moves with the same joint."""
    own = chain.links[chain.index[body.name]]
    if own.joint == body.joint:
        return own
    return next(link for link in chain.links if link.joint == body.joint)


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


def table_urdf(robot: RobotGeometry) -> str:
    """The URDF of a robot that came as a table.

    Spheres, capsules and cylinders are written; comments name the links whose other solids are
    not, since URDF has only meshes for them.

    Args:
        robot: The robot with its solids.
    """
    solids: dict[str, list[CollisionElement]] = {}
    notes = []
    for piece, name in zip(robot.pieces, robot.links, strict=True):
        element = _element(piece)
        if element is None:
            notes.append(f"a solid of {name} is left out: it is no sphere, capsule or cylinder")
            continue
        T = inverse(robot.chain.link(name).T_joint_link) @ element.T_link_element
        solids.setdefault(name, []).append(CollisionElement(T, element.geometry))
    return urdf_text(robot.chain, solids, notes)


def _element(piece: Piece) -> CollisionElement | None:
    """A piece as URDF has it, in its owner's frame; None where URDF has no such shape."""
    T, corners = piece.T_owner_piece, piece.vertices
    if piece.kind == PieceKind.CYLINDER and piece.offset_radius == 0.0:
        return CollisionElement(T, CylinderGeometry(piece.radius, 2.0 * piece.half_height))
    if piece.kind != PieceKind.POLYTOPE or piece.offset_radius <= 0.0 or len(corners) > 2:
        return None
    center = transform(position=corners.mean(axis=0))
    if len(corners) == 1:
        return CollisionElement(T @ center, SphereGeometry(piece.offset_radius))
    axis = corners[1] - corners[0]
    shape = CapsuleGeometry(piece.offset_radius, float(np.linalg.norm(axis)))
    return CollisionElement(T @ center @ transform(align_z(axis)), shape)


#: Told of archives with MoveIt's limits in them.
_LIMITS_USED = "joint_limits are those of the archive's joint_limits.yaml"
_LIMITS_LEFT = "joint_limits of the request count: the archive's joint_limits.yaml is not read"


@task
def make_scene(content: bytes, folder: str, name: str) -> bytes:
    """Build a scene from a request that stores it, and keep it for all workers.

    Returns:
        The JSON document to be stored.

    Raises:
        InvalidScene: It can't be built; the message names the obstacle.
    """
    body = NamedScene.model_validate(
        SceneBody.model_validate_json(content).__dict__ | {"name": name}
    )
    document = body.model_dump_json(exclude_none=True).encode()
    prepare_scene(document, folder, name)
    return document


@task
def prepare_scene(document: bytes, folder: str, name: str) -> str:
    """Build a scene from its JSON document, cut its meshes and keep it for all workers.

    Returns:
        The content hash of the scene.

    Raises:
        InvalidScene: It can't be built; the message names the obstacle.
    """
    keep_files_in(prepared_files.decompositions(folder))
    with written_files() as written:
        scene: Scene = poses.scene(SceneBody.model_validate_json(document))
        scene.pieces()
    reference = Reference("scene", name, prepared_files.document_hash(document), folder)
    disk_cache.write(reference, scene)
    prepared_files.note_meshes(reference, written)
    return scene.content_hash


@task
def make_tool(content: bytes, name: str) -> bytes:
    """Check a tool that is to be stored.

    Args:
        content: The request.
        name: Name of the tool.

    Returns:
        The JSON document to be stored.

    Raises:
        ArmwrightError: The tool can't be made; the message says why.
    """
    body = NamedTool.model_validate(Tool.model_validate_json(content).__dict__ | {"name": name})
    made = tools.tool(body)
    for solid in (*made.solids, *(item for jaw in made.jaws.values() for item in jaw.solids)):
        solid.pieces(name)
    return body.model_dump_json(exclude_none=True).encode()


@task
def make_robot(content: bytes, folder: str) -> tuple[bytes, bytes]:
    """Build a robot from a request that stores it, and keep it for all workers.

    Returns:
        The JSON document to be stored, and the robot's model as it is answered.

    Raises:
        InvalidRobotDescription: It can't be built.
    """
    body = RobotBody.model_validate_json(content)
    document = body.model_dump_json(exclude_none=True).encode()
    return document, prepare_robot(document, folder)


@task
def prepare_robot(document: bytes, folder: str, notes: tuple[str, ...] = ()) -> bytes:
    """Build a robot from its JSON document and keep it for all workers.

    Args:
        document: Document of the robot.
        folder: Folder in which the result is kept.
        notes: Notes on what it was made of, for its lint.

    Returns:
        The model as it is answered, JSON.

    Raises:
        InvalidRobotDescription: It can't be built.
    """
    keep_files_in(prepared_files.decompositions(folder))
    body = RobotBody.model_validate_json(document)
    with written_files() as written:
        geometry, lint = robots.robot(body)
        tools.check_tools(geometry, body.tools or ())
        for solids in (geometry, hulled(geometry)):
            pack(solids)
        visuals, more = robot_visuals(body, geometry.chain)
        lint = [*notes, *lint, *more]
        answer = robots.robot_answer(geometry, lint, body.name, is_built_in=False, body=body)
    made = PreparedRobot.of(geometry, answer.model_dump_json().encode())
    reference = Reference("robot", body.name, prepared_files.document_hash(document), folder)
    disk_cache.write_visuals(reference, visuals)
    disk_cache.write(reference, made)
    prepared_files.note_meshes(reference, written)
    return made.answer


@task
def change_robot(document: bytes, content: bytes, folder: str) -> tuple[bytes, bytes]:
    """Build a stored robot with other limits or inertias, and keep it for all workers.

    Args:
        document: Stored document of the robot.
        content: The request.
        folder: Folder in which the result is kept.

    Returns:
        The JSON document to be stored, and the robot's model as it is answered.

    Raises:
        InvalidRobotDescription: A joint is unknown, or a limit out of its range.
    """
    body = RobotBody.model_validate_json(document)
    changes = RobotChanges.model_validate_json(content)
    changed = limits.changed(body, changes, robots.joint_names(body))
    new = changed.model_dump_json(exclude_none=True).encode()
    return new, prepare_robot(new, folder)


@task
def robot_model(robot: Reference) -> RobotModel:
    """The model of a robot as it is answered, with the sizes that the server goes by."""
    prepared = worker_cache.robot(robot)
    return RobotModel(prepared.answer, prepared.chain.n, len(prepared.chain.links))


@task
def robot_urdf(robot: Reference, document: bytes | None, merge_limits: bool = False) -> bytes:
    """The URDF of a robot: as it came, or written of its table.

    Args:
        robot: The robot.
        document: Stored document of the robot; None for a built-in one.
        merge_limits: Whether limits that were given beside the URDF are written into it.
    """
    if document is None:
        urdf: str | None = builtin_urdf(robot.name)
    else:
        urdf = RobotBody.model_validate_json(document).urdf
    if urdf is None:  # its limits are the table's
        return table_urdf(worker_cache.robot(robot).geometry).encode()
    if merge_limits:
        urdf = with_limits(urdf, worker_cache.chain(robot))
    return urdf.encode()


@task
def robot_srdf(robot: Reference) -> bytes:
    """The SRDF of a robot: its chain, its named states and the pairs that may touch."""
    geometry = worker_cache.robot(robot).geometry
    return srdf_text(geometry.chain, geometry.states, geometry.allowed).encode()


@task
def unpack_robot(content: bytes, fields: dict[str, object], folder: str) -> tuple[bytes, bytes]:
    """Build a robot from a .zip and keep it for all workers.

    Args:
        content: The archive.
        fields: Other fields of the robot's document.
        folder: Folder in which the result is kept.

    Returns:
        The robot's JSON document and its model as it is answered.

    Raises:
        InvalidRobotDescription: The archive or what is in it is not valid.
    """
    paths = map(fields.get, ("urdf_path", "srdf_path"))
    urdf_path, srdf_path = (None if path is None else str(path) for path in paths)
    archive = read_archive(content, urdf_path, srdf_path)
    # Meshes for display can be many times larger than those for collisions.
    colliding = _collision_files(archive.urdf, fields.get("visual_solids") is True)
    kept = kept_meshes(archive.urdf, archive.meshes, colliding)
    meshes = {name: base64.b64encode(archive.meshes[name]).decode() for name in kept}
    given = {"srdf": archive.srdf, "joint_limits": archive.joint_limits} | {
        name: value
        for name, value in fields.items()
        if value is not None and name not in ("urdf_path", "srdf_path")
    }
    try:
        body = RobotBody.model_validate({**given, "urdf": archive.urdf, "meshes": meshes or None})
    except ValidationError as error:
        problem = validation_problem(error.errors(), {})
        raise InvalidRobotDescription(f"the robot archive: {problem.detail}") from None
    document = body.model_dump_json(exclude_none=True).encode()
    notes = archive.notes
    if archive.joint_limits is not None:
        used = given["joint_limits"] is archive.joint_limits
        notes = (*notes, _LIMITS_USED if used else _LIMITS_LEFT)
    return document, prepare_robot(document, folder, notes)


def _collision_files(urdf: str, visual_solids: bool) -> set[str]:
    """Names, without folders, of the mesh files that links collide with."""
    description = parse_urdf(urdf)
    if visual_solids:
        description = with_visual_solids(description, read_visuals(urdf))
    solids = (part.geometry for link in description.links.values() for part in link.collisions)
    return {_file(part.uri) for part in solids if isinstance(part, MeshGeometry)}

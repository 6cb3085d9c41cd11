"""The functions that workers run for robots and scenes: values in, values out, nothing of HTTP."""

import base64

from pydantic import ValidationError

from armwright_wire.robots.robot import RobotBody, RobotChanges
from armwright_wire.scenes.scene import NamedScene
from armwright_wire.scenes.scene import Scene as SceneBody
from armwright_wire.scenes.tool import NamedTool, Tool
from kinematics.errors import InvalidRobotDescription
from kinematics.robots import builtin_urdf
from kinematics.tree.description import MeshGeometry
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.visuals import read_visuals, with_visual_solids
from kinematics.urdf.writer import srdf_text, with_limits
from obstacles.collision.model.collision_model import pack
from obstacles.kept_files import keep_files_in, written_files
from obstacles.robots.robot_geometry import hulled
from obstacles.scenes.scene import Scene
from service.storage.caches import disk_cache, prepared_files, worker_cache
from service.storage.caches.cache_key import Reference
from service.storage.caches.disk_cache import PreparedRobot
from service.translate import poses
from service.translate.robots import limits, robots, tools
from service.translate.robots.archive import read_archive
from service.translate.robots.urdf import table_urdf
from service.translate.robots.visuals import kept_meshes, robot_visuals
from service.validation import validation_problem
from service.workers.result import RobotModel
from service.workers.task import task

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
    urdf_path, srdf_path = (_text(fields.get(name)) for name in ("urdf_path", "srdf_path"))
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


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def _collision_files(urdf: str, visual_solids: bool) -> set[str]:
    """Names, without folders, of the mesh files that links collide with."""
    description = parse_urdf(urdf)
    if visual_solids:
        description = with_visual_solids(description, read_visuals(urdf))
    solids = (part.geometry for link in description.links.values() for part in link.collisions)
    return {part.uri.rpartition("/")[2] for part in solids if isinstance(part, MeshGeometry)}

"""Robots from files, as the documents that are uploaded to a service."""

import base64
import json
import re
from pathlib import Path
from typing import Any

from command_line.parameters import RobotSource
from command_line.problems import invalid_value

#: Characters that names of robots do not have.
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.-]")
_ROBOT_HINT = "Give the name of a robot (`armwright robots`), a .urdf, a folder, a .zip or a .json."


def is_file(source: RobotSource) -> bool:
    """Whether the robot is given by a path, and not by a name."""
    return Path(source.robot).exists() or "/" in source.robot or bool(Path(source.robot).suffix)


def robot_document(source: RobotSource) -> dict[str, Any]:
    """The upload that describes a robot of a file.

    Args:
        source: A .urdf, a folder that holds one, a .zip or the JSON of an upload.

    Raises:
        ProblemError: There is no such file, or it is of another kind.
        InvalidRobotDescription: The archive or a mesh can't be read.
    """
    path = Path(source.robot)
    if path.is_dir():
        document = _from_urdf(_only_urdf(path))
    elif not path.is_file():
        raise invalid_value("robot", f"there is no file {source.robot!r}", _ROBOT_HINT)
    elif path.suffix == ".urdf":
        document = _from_urdf(path)
    elif path.suffix == ".zip":
        document = _from_archive(path)
    elif path.suffix == ".json":
        document = read_json(path)
    else:
        raise invalid_value("robot", f"{path.name} is no robot description", _ROBOT_HINT)
    name = _NOT_IN_NAMES.sub("_", path.stem) or "robot"
    return {"name": name} | document | _options(source)


def read_json(path: Path) -> dict[str, Any]:
    """The JSON object of a file.

    Raises:
        ProblemError: It is no JSON object.
    """
    try:
        value = json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise invalid_value(str(path), f"it is not JSON: {error}") from None
    if not isinstance(value, dict):
        raise invalid_value(str(path), "a JSON object is needed")
    return value


def _options(source: RobotSource) -> dict[str, Any]:
    given: dict[str, Any] = {"base_link": source.base_link, "tip_link": source.tip_link}
    if source.srdf is not None:
        given["srdf"] = source.srdf.read_text("utf-8")
    if source.joint_limits is not None:
        path = source.joint_limits
        given["joint_limits"] = read_json(path) if path.suffix == ".json" else path.read_text()
    return {name: value for name, value in given.items() if value is not None}


def _only_urdf(folder: Path) -> Path:
    paths = sorted(folder.rglob("*.urdf"))
    if len(paths) == 1:
        return paths[0]
    names = ", ".join(str(path.relative_to(folder)) for path in paths[:10]) or "none"
    raise invalid_value(
        str(folder),
        f"which .urdf is meant is open; it holds {names}",
        "Give the path of the .urdf itself; a xacro file has to be expanded first.",
    )


def _from_urdf(path: Path) -> dict[str, Any]:
    from armwright.robot import read_mesh  # noqa: PLC0415
    from kinematics.description import MeshGeometry  # noqa: PLC0415
    from kinematics.urdf import parse_urdf  # noqa: PLC0415

    text = path.read_text("utf-8")
    solids = (part.geometry for link in parse_urdf(text).links.values() for part in link.collisions)
    names = sorted({part.uri for part in solids if isinstance(part, MeshGeometry)})
    meshes = {name: base64.b64encode(read_mesh(name, path.parent)).decode() for name in names}
    document: dict[str, Any] = {"urdf": text} | ({"meshes": meshes} if meshes else {})
    srdf = path.with_suffix(".srdf")
    return document | ({"srdf": srdf.read_text("utf-8")} if srdf.is_file() else {})


def _from_archive(path: Path) -> dict[str, Any]:
    from service.translate.archive import read_archive  # noqa: PLC0415

    archive = read_archive(path.read_bytes())
    meshes = {name: base64.b64encode(data).decode() for name, data in archive.meshes.items()}
    document: dict[str, Any] = {"urdf": archive.urdf} | ({"meshes": meshes} if meshes else {})
    return document | ({} if archive.srdf is None else {"srdf": archive.srdf})

"""Robots from files, as the documents that are uploaded to a service."""

import base64
import json
import re
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import yaml

from armwright_client.robots.sources import description_in, is_mjcf, urdf_text
from armwright_client.robots.urdf import MAX_VISUAL_BYTES, read_urdf
from armwright_wire.errors import InvalidArgument
from command_line.parameters import RobotSource
from command_line.problems import invalid_value

P = ParamSpec("P")
A = TypeVar("A")

#: Path that stands for standard input.
STANDARD_INPUT = "-"
#: Characters that names of robots do not have.
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.-]")
_ROBOT_HINT = (
    "Give the name of a robot (`armwright robots`), a .urdf, a .xacro, MJCF, a folder, a .zip or a "
    ".json."
)
#: What a robot of the package example-robot-data begins with.
_PACKAGE = "example-robot-data:"


def is_file(source: RobotSource) -> bool:
    """Whether the robot is given by a path, and not by a name."""
    text = source.robot
    if text == STANDARD_INPUT or text.startswith(_PACKAGE):
        return True
    return Path(text).exists() or "/" in text or bool(Path(text).suffix)


def robot_document(source: RobotSource) -> dict[str, Any]:
    """The upload that describes a robot of a file.

    Args:
        source: A .urdf, .xacro or MJCF, a folder that holds one, a .zip, the JSON of an upload, or
            ``example-robot-data:`` with the name of a URDF of that package; ``-`` is a URDF without
            meshes or the JSON, from standard input.

    Raises:
        ProblemError: There is no such file, or it is of another kind.
        InvalidRobotDescription: The archive or a mesh can't be read.
    """
    if source.robot == STANDARD_INPUT:
        text = standard_input()
        is_urdf = text.lstrip().startswith("<")
        document = {"urdf": text} if is_urdf else read_json(Path(STANDARD_INPUT))
        return {"name": "robot"} | document | options(source)
    path = Path(source.robot)
    if source.robot.startswith(_PACKAGE):
        path = _of_package(source.robot.removeprefix(_PACKAGE))
    path = described(description_in, path) if path.is_dir() else path
    if not path.is_file():
        raise invalid_value("robot", f"there is no file {source.robot!r}", _ROBOT_HINT)
    if path.suffix == ".urdf":
        document = _from_urdf(path, source.visual_solids)
    elif path.suffix == ".xacro" or is_mjcf(path):
        document = _from_source(path, source)
    elif path.suffix == ".zip":
        document = _from_archive(path)
    elif path.suffix == ".json":
        document = read_json(path)
    else:
        raise invalid_value("robot", f"{path.name} is no robot description", _ROBOT_HINT)
    return document | {"name": valid_name(document.get("name", path.stem))} | options(source)


def valid_name(text: str) -> str:
    """A name that robots may have, made of any text."""
    return _NOT_IN_NAMES.sub("_", text) or "robot"


def read_json(path: Path) -> dict[str, Any]:
    """The JSON object of a file; the same as YAML where the file is called so.

    Raises:
        ProblemError: It is no JSON object.
    """
    value = read_any(path)
    if not isinstance(value, dict):
        raise invalid_value(str(path), "a JSON object is needed")
    return value


def read_any(path: Path) -> Any:
    """The JSON or YAML value of a file, or of standard input for ``-``.

    Raises:
        ProblemError: It is no JSON.
    """
    is_input = str(path) == STANDARD_INPUT
    try:
        text = standard_input() if is_input else path.read_text("utf-8")
        return yaml.safe_load(text) if path.suffix in (".yaml", ".yml") else json.loads(text)
    except (ValueError, yaml.YAMLError) as error:
        raise invalid_value(str(path), f"it is not JSON: {error}") from None


@cache
def standard_input() -> str:
    """All of standard input, which can be read once only."""
    return sys.stdin.read()


def _of_package(name: str) -> Path:
    """The URDF of a robot of the installed package example-robot-data."""
    from importlib.metadata import PackageNotFoundError, distribution  # noqa: PLC0415

    try:
        files = distribution("example-robot-data").files or []
    except PackageNotFoundError:
        raise invalid_value(
            "robot", "example-robot-data is not installed", "pip install example-robot-data"
        ) from None
    urdfs = {file.stem: file for file in files if file.suffix == ".urdf"}
    if name not in urdfs:
        raise invalid_value(
            "robot",
            f"example-robot-data has no {name}.urdf",
            f"It has: {', '.join(sorted(urdfs))}.",
        )
    return Path(str(urdfs[name].locate())).resolve()


def options(source: RobotSource) -> dict[str, Any]:
    """What the options of a command say of a robot, as fields of its upload."""
    given: dict[str, Any] = {"base_link": source.base_link, "tip_link": source.tip_link}
    if source.srdf is not None:
        is_input = str(source.srdf) == STANDARD_INPUT
        given["srdf"] = standard_input() if is_input else described(urdf_text, source.srdf)
    if source.joint_limits is not None:
        path = source.joint_limits
        is_yaml = path.suffix != ".json" and str(path) != STANDARD_INPUT
        given["joint_limits"] = path.read_text() if is_yaml else read_json(path)
    if source.allow_suspected:
        given["allow_suspected"] = True
    if source.visual_solids:
        given["visual_solids"] = True
    if source.default_limits is not None:
        given["default_limits"] = _default_limits(source.default_limits)
    return {name: value for name, value in given.items() if value is not None}


def _default_limits(text: str) -> Any:
    """The rules of ``--default-limits``: JSON, or rules between commas."""
    if text.lstrip().startswith("{"):
        try:
            return json.loads(text)
        except ValueError as error:
            raise invalid_value("--default-limits", f"it is not JSON: {error}") from None
    rules = [rule.partition("=") for rule in text.split(",")]
    if not all(equals for _, equals, _ in rules):
        raise invalid_value(
            "--default-limits",
            f"{text!r} is no rule",
            "Give rules as acceleration=10 x velocity,jerk=10 x acceleration.",
        )
    return {limit.strip(): rule.strip() for limit, _, rule in rules}


def described(read: Callable[P, A], *args: P.args, **kwargs: P.kwargs) -> A:
    """What a reader of the client gives, its refusals as problems of the command."""
    try:
        return read(*args, **kwargs)
    except InvalidArgument as error:
        detail = str(error).removesuffix(f". {error.hint}")
        raise invalid_value("", detail, error.hint) from None


def xacro_arguments(pairs: Sequence[str]) -> dict[str, str]:
    """The values of ``--xacro name:=value``."""
    split = [pair.partition(":=") for pair in pairs]
    if not all(name and equals for name, equals, _ in split):
        raise invalid_value("--xacro", "an argument has no value", "Give it as name:=value.")
    return {name: value for name, _, value in split}


def _from_source(path: Path, source: RobotSource) -> dict[str, Any]:
    """The robot of a file that the client makes URDF of."""
    looks = MAX_VISUAL_BYTES if source.visual_solids else 0
    file = described(read_urdf, path, (), looks, xacro_arguments(source.xacro or ()))
    document: dict[str, Any] = {"name": file.name, "urdf": file.text}
    document |= {"meshes": dict(file.meshes)} if file.meshes else {}
    return document | ({} if file.srdf is None else {"srdf": file.srdf})


def _from_urdf(path: Path, visual_solids: bool) -> dict[str, Any]:
    from armwright.robot import read_mesh  # noqa: PLC0415
    from kinematics.tree.description import MeshGeometry  # noqa: PLC0415
    from kinematics.urdf.urdf import parse_urdf  # noqa: PLC0415
    from kinematics.urdf.visuals import read_visuals, with_visual_solids  # noqa: PLC0415

    text = path.read_text("utf-8")
    description = parse_urdf(text)
    if visual_solids:
        description = with_visual_solids(description, read_visuals(text))
    solids = (part.geometry for link in description.links.values() for part in link.collisions)
    names = sorted({part.uri for part in solids if isinstance(part, MeshGeometry)})
    meshes = {name: base64.b64encode(read_mesh(name, path.parent)).decode() for name in names}
    document: dict[str, Any] = {"urdf": text} | ({"meshes": meshes} if meshes else {})
    srdf = path.with_suffix(".srdf")
    return document | ({"srdf": srdf.read_text("utf-8")} if srdf.is_file() else {})


def _from_archive(path: Path) -> dict[str, Any]:
    from service.translate.robots.archive import read_archive  # noqa: PLC0415

    archive = read_archive(path.read_bytes())
    meshes = {name: base64.b64encode(data).decode() for name, data in archive.meshes.items()}
    document: dict[str, Any] = {"urdf": archive.urdf} | ({"meshes": meshes} if meshes else {})
    return document | ({} if archive.srdf is None else {"srdf": archive.srdf})

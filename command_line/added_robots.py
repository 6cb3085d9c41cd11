"""Robots that are added by name: where their descriptions come from, and where they are kept."""

import json
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import distributions
from pathlib import Path
from typing import Any, NamedTuple

from armwright_client.robots.sources import description_in, urdf_text
from armwright_client.robots.urdf import MAX_VISUAL_BYTES, read_urdf
from command_line.parameters import RobotSource
from command_line.problems import invalid_value
from command_line.robot_files import described, options, xacro_arguments

_INSTALL = 'pip install "armwright[descriptions]", or give the folder or file of a description.'
#: Endings of names in robot_descriptions: URDF first, then models of MuJoCo.
_ENDINGS = ("", "_description", "_mj_description")
_SUFFIXES = (".urdf", ".xacro")
#: Folders above a description that are looked through for its licence.
_LEVELS = 4


class Found(NamedTuple):
    """A description that was found.

    Args:
        path: Its file.
        source: Where it comes from, for people.
        licence: Its licence as it is told there; None where nothing tells one.
        arguments: Values of the arguments of a .xacro file.
        srdf: Text of the SRDF that comes with it.
        folders: Folders of its packages.
    """

    path: Path
    source: str
    licence: str | None
    arguments: Mapping[str, str] = {}
    srdf: str | None = None
    folders: tuple[Path, ...] = ()


def folder() -> Path:
    """The folder of the robots that were added on this machine."""
    from service.settings import Settings  # noqa: PLC0415  long, and not for built-in robots

    return Settings().data_dir / "robots"


def added(name: str) -> Path | None:
    """The document of a robot that was added on this machine, if there is one."""
    path = folder() / f"{name}.json"
    return path if "/" not in name and path.is_file() else None


def find(name: str) -> Found:
    """The description that is meant: a file or folder, or one of an installed package.

    Args:
        name: Path, or name of a robot: of ROS packages and Python packages that are installed, then
            of robot_descriptions, which fetches what it does not have.

    Raises:
        ProblemError: There is none, or it can't be fetched.
    """
    path = Path(name)
    if path.exists():
        path = described(description_in, path) if path.is_dir() else path
        return Found(path.resolve(), str(path.resolve()), licence_beside(path))
    found = next(_installed(name), None) or _public(name)
    if found is not None:
        return found
    known = _known()
    near = ", ".join(sorted(get_close_matches(name, known, 8, 0.4))) or "none"
    raise invalid_value(
        "robot",
        f"no installed description is called {name!r}",
        f"Similar names: {near}." if known else f"robot_descriptions has many: {_INSTALL}",
    )


def document_of(found: Found, source: RobotSource, name: str) -> dict[str, Any]:
    """The upload of a description that was found.

    Args:
        found: The description.
        source: What else is given of it.
        name: Name to be kept under.
    """
    arguments = {**found.arguments, **xacro_arguments(source.xacro or ())}
    given = arguments if found.path.suffix == ".xacro" else None
    file = described(read_urdf, found.path, found.folders, MAX_VISUAL_BYTES, given)
    document: dict[str, Any] = {"name": name, "urdf": file.text}
    document |= {"meshes": dict(file.meshes)} if file.meshes else {}
    srdf = found.srdf or file.srdf
    return document | ({} if srdf is None else {"srdf": srdf}) | options(source)


def keep(document: Mapping[str, Any]) -> Path:
    """Keep a robot on this machine, under a name that no other has.

    Raises:
        ProblemError: The name is taken.
    """
    path = folder() / f"{document['name']}.json"
    if path.exists():
        raise invalid_value(
            "robot",
            f"there is a robot {document['name']!r} already",
            "Give another name with --as.",
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document), "utf-8")
    return path


def licence_beside(path: Path) -> str | None:
    """The licence that a package.xml or a file beside or above a description tells."""
    for parent in [path.resolve(), *path.resolve().parents][1 : _LEVELS + 1]:
        manifest = parent / "package.xml"
        if manifest.is_file():
            told = re.findall(r"<license[^>]*>([^<]+)", manifest.read_text("utf-8", "replace"))
            if told:
                return f"{', '.join(text.strip() for text in told)} ({manifest})"
        files = sorted(parent.glob("LICEN[CS]E*"))
        if files:
            first = files[0].read_text("utf-8", "replace").strip().partition("\n")[0]
            return f"{first.strip()} ({files[0]})"
    return None


def _installed(name: str) -> Iterator[Found]:
    """Descriptions of packages of ROS and of Python that are installed."""
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        for package in (name, f"{name}_description"):
            share = Path(prefix) / "share" / package
            if share.is_dir():
                path = described(description_in, share)
                yield Found(path, f"package {package} in {prefix}", licence_beside(path))
    for owner in distributions():
        for file in owner.files or ():
            if file.suffix in _SUFFIXES and file.name.removesuffix(file.suffix) == name:
                path = Path(str(file.locate())).resolve()
                told: Any = owner.metadata
                licence = told.get("License-Expression") or told.get("License")
                yield Found(path, f"{owner.name} {owner.version}", licence_beside(path) or licence)


def _known() -> list[str]:
    try:
        from robot_descriptions._descriptions import DESCRIPTIONS  # noqa: PLC0415
    except ImportError:
        return []
    return list(DESCRIPTIONS)


def _public(name: str) -> Found | None:
    """A description that robot_descriptions has, or fetches; None where it knows none."""
    known = set(_known())
    module = next((name + ending for ending in _ENDINGS if name + ending in known), None)
    if module is None:
        return None
    from robot_descriptions._descriptions import DESCRIPTIONS  # noqa: PLC0415
    from robot_descriptions._repositories import REPOSITORIES  # noqa: PLC0415

    told = DESCRIPTIONS[module]
    repository = REPOSITORIES[told.repository]
    try:
        with redirect_stdout(sys.stderr):  # it tells there what it fetches
            files = vars(import_module(f"robot_descriptions.{module}"))
    except Exception as error:  # noqa: BLE001  (of git, of the network, of the disk)
        raise invalid_value(
            "robot",
            f"{module} can't be fetched from {repository.url}: {' '.join(str(error).split())}",
            "Fetch the repository by other means, and give its folder.",
        ) from None
    kind = next(kind for kind in ("URDF_PATH", "XACRO_PATH", "MJCF_PATH") if kind in files)
    srdf = files.get("SRDF_PATH") or files.get("SRDF_XACRO_PATH")
    text = None
    if srdf is not None and kind != "MJCF_PATH":
        arguments = files.get("SRDF_XACRO_ARGS") or {}
        text = described(urdf_text, Path(srdf), arguments if srdf.endswith(".xacro") else None)
    return Found(
        Path(files[kind]),
        f"{module} of robot_descriptions, {repository.url} at {repository.commit}",
        told.license_spdx,
        files.get("XACRO_ARGS") or {},
        text,
        (Path(files["PACKAGE_PATH"]), Path(files["REPOSITORY_PATH"])),
    )

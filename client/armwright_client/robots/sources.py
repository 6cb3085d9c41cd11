"""Descriptions of robots on this machine: which file is meant, and the URDF of xacro files.

xacro reads files, variables of the environment and expressions of Python where it is expanded. It
is expanded here, on the machine of whoever asks, and never by the service.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from armwright_wire.errors import InvalidArgument

_INSTALL = "pip install 'xacrodoc>=2.0.1', which the extra [xacro] of Armwright names"
_FILE = "file://"
#: A root element with a name: files of macros have none.
_NAMED = re.compile(r"<robot\b[^>]*\bname\s*=")
#: Files that a refusal names.
_SHOWN = 10
#: Packages that one description may find.
_MAX_PACKAGES = 100


@dataclass(frozen=True, slots=True)
class UrdfFile:
    """A URDF with its meshes.

    Args:
        name: Name as the description says.
        text: Text to send.
        meshes: Files in base64 by the URI that the text names them by.
        srdf: Text of the SRDF that was made with it.
    """

    name: str
    text: str
    meshes: Mapping[str, str]
    srdf: str | None = None


def description_in(folder: Path) -> Path:
    """The description that a folder holds: a .urdf, else a .xacro of a whole robot, else MJCF.

    Args:
        folder: Folder, looked through to its depth.

    Raises:
        InvalidArgument: It holds none, or several.
    """
    found = sorted(folder.rglob("*.urdf"))
    if not found:
        every = sorted(folder.rglob("*.xacro"))
        found = [
            file for file in every if not file.name.endswith(".srdf.xacro") and _is_whole(file)
        ]
        found = [file for file in found if file.name.endswith(".urdf.xacro")] or found
    if not found:
        models = [file for file in sorted(folder.rglob("*.xml")) if is_mjcf(file)]
        # A model that includes others is a scene with a robot in it.
        found = [file for file in models if "<include" not in _read(file)] or models
    if len(found) == 1:
        return found[0]
    names = ", ".join(str(file.relative_to(folder)) for file in found[:_SHOWN]) or "none"
    raise InvalidArgument(
        f"{folder}: which .urdf, .xacro or MJCF is meant is open; it holds {names}",
        hint="Give the path of the file itself.",
    )


def is_mjcf(path: Path) -> bool:
    """Whether a file is a model of MuJoCo."""
    if path.suffix.lower() not in (".xml", ".mjcf"):
        return False
    return "<mujoco" in _read(path)


def urdf_text(
    path: Path,
    arguments: Mapping[str, str] | None = None,
    package_dirs: Sequence[Path] = (),
) -> str:
    """The text of a URDF or SRDF; that of a .xacro file is made here.

    Args:
        path: Path of the file.
        arguments: Values of the arguments of a .xacro file, by name.
        package_dirs: Folders of packages that it finds, or that hold them; packages that hold the
            file, or lie beside those, are found without.

    Raises:
        OSError: The file can't be read.
        InvalidArgument: xacrodoc is not installed, the file can't be expanded, or there are
            arguments for a file that takes none.
    """
    if path.suffix.lower() == ".xacro":
        return _expanded(path, arguments or {}, package_dirs)
    if arguments:
        raise InvalidArgument(f"{path} is no .xacro file: it takes no arguments")
    return path.read_text(encoding="utf-8")


def _is_whole(path: Path) -> bool:
    return _NAMED.search(_read(path)) is not None


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def _expanded(path: Path, arguments: Mapping[str, str], package_dirs: Sequence[Path]) -> str:
    try:
        import xacro  # noqa: PLC0415
        from xacrodoc import packages  # noqa: PLC0415
    except ImportError:
        raise InvalidArgument(
            f"{path} is a xacro file, of which a URDF is made on this machine, and xacrodoc, which "
            "does that, is not installed",
            hint=_INSTALL,
        ) from None
    path.open().close()  # a file that is not there is no fault of xacro
    packages.reset()
    for _ in range(_MAX_PACKAGES):
        try:
            document = xacro.process_file(str(path), mappings=dict(arguments))
            break
        except Exception as error:  # noqa: BLE001  (xacro lets those of Python's own pass)
            cause = getattr(error, "exc", None) or error
            if not isinstance(cause, packages.PackageNotFoundError):
                raise InvalidArgument(
                    f"{path} can't be expanded: {' '.join(str(error).split())}",
                    hint="Arguments are given by name: xacro_args, or --xacro name:=value.",
                ) from None
            name = str(cause.args[0])
            packages.update_package_cache({name: _package(name, path, package_dirs)})
    else:
        raise InvalidArgument(f"{path} finds more than {_MAX_PACKAGES} packages")
    for banner in [node for node in document.childNodes if node.nodeType == node.COMMENT_NODE]:
        document.removeChild(banner)  # it tells paths of this machine
    for mesh in document.getElementsByTagName("mesh"):
        name = mesh.getAttribute("filename").removeprefix(_FILE)
        if name.startswith("/"):  # what $(find package) makes of a mesh
            mesh.setAttribute("filename", os.path.relpath(name, path.parent))
    return str(document.toxml())


def _package(name: str, path: Path, package_dirs: Sequence[Path]) -> Path:
    """The folder of a package that a .xacro file finds."""
    for folder in _folders(name, path.resolve(), package_dirs):
        if folder.is_dir():
            return folder
    raise InvalidArgument(
        f"{path} needs the package {name!r}, which is neither around it nor installed",
        hint="Give the folder that holds the package in package_dirs.",
    )


def _folders(name: str, path: Path, package_dirs: Sequence[Path]) -> Iterator[Path]:
    for start in package_dirs:
        yield start / name
        if start.resolve().name == name:
            yield start
    for start in path.parents:
        if start.name == name or is_package(start, name):
            yield start
        yield start / name


def is_package(folder: Path, name: str) -> bool:
    """Whether a folder is a package of ROS of a name, by its package.xml."""
    manifest = folder / "package.xml"
    return manifest.is_file() and f"<name>{name}</name>" in manifest.read_text("utf-8", "replace")

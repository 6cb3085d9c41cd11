"""URDF files and the meshes beside them: all for collisions, and visual ones that are there.

A mesh is named by a ``package://`` URI or a path relative to the URDF. It is looked for in turn

* for ``package://name/path``: as ``name/path`` or ``path`` in each of the package folders given,
  then in the URDF's folder and those above it, ``path`` only where the folder is called ``name``;
* for a relative path: beside the URDF, then in each of the package folders.

The service takes no path that leads out of what is uploaded. Where a URDF says ``../meshes/a.stl``,
the text that is sent names the mesh by a path that does not.
"""

import base64
import posixpath
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree as ET

from armwright_client.robots.mjcf import read_mjcf
from armwright_client.robots.sources import UrdfFile, description_in, is_mjcf, is_package, urdf_text
from armwright_wire.errors import InvalidArgument

_PACKAGE = "package://"
#: Visual mesh files that are sent by default, together [byte].
MAX_VISUAL_BYTES = 16 * 2**20
#: What the service reads; nothing else is sent, whatever a description names.
_SUFFIXES = (".stl", ".obj", ".ply", ".off", ".dae")


def read_urdf(
    path: Path,
    package_dirs: Sequence[Path] = (),
    max_visual_bytes: int = MAX_VISUAL_BYTES,
    xacro_args: Mapping[str, str] | None = None,
) -> UrdfFile:
    """Read a URDF, xacro or MJCF file, its collision meshes and the visual ones that are there.

    Args:
        path: Path of the file, or of a folder that holds one such file.
        package_dirs: Folders of packages, or that hold them.
        max_visual_bytes: Largest size of visual mesh files together [byte]; small ones go first.
        xacro_args: Values of the arguments of a xacro file, by name.

    Raises:
        OSError: A file can't be read.
        InvalidArgument: It is not XML, names meshes that are not there or that can't be sent, or a
            xacro or MJCF file can't be made a URDF.
    """
    path = description_in(path) if path.is_dir() else path
    if is_mjcf(path):
        return read_mjcf(path, max_visual_bytes)
    text = urdf_text(path, xacro_args, package_dirs)
    try:
        root = ET.fromstring(text)  # nosec B314
    except ET.ParseError as error:
        raise InvalidArgument(f"{path} is not XML: {error}") from None
    files = {uri: _find(uri, path.parent, package_dirs) for uri in _mesh_uris(root)}
    missing = [uri for uri, file in files.items() if file is None]
    if missing:
        raise InvalidArgument(
            f"{path} names collision meshes that are not there: {', '.join(missing)}",
            hint="Give the folder that holds the package in package_dirs.",
        )
    looks = _visual_files(root, path.parent, package_dirs, set(files), max_visual_bytes)
    meshes: dict[str, str] = {}
    for uri, file in {**files, **looks}.items():
        assert file is not None
        name = uri
        if _leads_out(uri):
            name = _path_inside(uri, {**files, **looks})
            text = _rename(text, uri, name)
        meshes[name] = base64.b64encode(file.read_bytes()).decode("ascii")
    return UrdfFile(root.get("name") or path.stem, text, meshes)


def _mesh_uris(root: ET.Element) -> list[str]:
    found = (mesh.get("filename", "") for mesh in root.iterfind(".//collision/geometry/mesh"))
    uris = list(dict.fromkeys(uri for uri in found if uri))
    for uri in uris:
        if Path(uri).suffix.lower() not in _SUFFIXES:
            raise InvalidArgument(
                f"collision mesh {uri!r} is of a kind that can't be sent",
                hint=f"Convert it to one of {', '.join(_SUFFIXES)}.",
            )
        if ":" in uri.removeprefix(_PACKAGE) or uri.startswith("/"):
            raise InvalidArgument(
                f"collision mesh {uri!r} is neither package:// nor relative",
                hint="Name meshes by package:// or by a path relative to the URDF.",
            )
    return uris


def _visual_files(
    root: ET.Element,
    folder: Path,
    package_dirs: Sequence[Path],
    taken: set[str],
    left: int,
) -> dict[str, Path]:
    """Visual meshes that are there and can be sent, by URI: small ones first, as many as fit."""
    found: dict[str, Path] = {}
    for mesh in root.iterfind(".//visual/geometry/mesh"):
        uri = mesh.get("filename", "")
        if not uri or uri in taken or Path(uri).suffix.lower() not in _SUFFIXES:
            continue
        if ":" in uri.removeprefix(_PACKAGE) or uri.startswith("/") or "&" in uri:
            continue
        file = _find(uri, folder, package_dirs)
        if file is not None:
            found[uri] = file
    kept: dict[str, Path] = {}
    for uri, file in sorted(found.items(), key=lambda item: item[1].stat().st_size):
        left -= file.stat().st_size
        if left < 0:
            break
        kept[uri] = file
    return kept


def _find(uri: str, folder: Path, package_dirs: Sequence[Path]) -> Path | None:
    return next((file for file in _candidates(uri, folder, package_dirs) if file.is_file()), None)


def _candidates(uri: str, folder: Path, package_dirs: Sequence[Path]) -> Iterator[Path]:
    if not uri.startswith(_PACKAGE):
        for start in (folder, *package_dirs):
            yield start / unquote(uri)
        return
    # Three slashes are a common slip: the path is never one from the root of this machine.
    path = unquote(uri.removeprefix(_PACKAGE)).lstrip("/")
    package, _, rest = path.partition("/")
    for start in package_dirs:
        yield start / path
        yield start / rest
    own = folder.resolve()
    for start in (own, *own.parents):
        yield start / path
        if start.name == package or is_package(start, package):
            yield start / rest


def _leads_out(uri: str) -> bool:
    return posixpath.normpath(unquote(uri.removeprefix(_PACKAGE))).startswith("..")


def _path_inside(uri: str, taken: Mapping[str, object]) -> str:
    """A path inside the upload for a mesh that leads out of its folder."""
    path = posixpath.normpath(uri.removeprefix(_PACKAGE))
    depth = path.count("../")
    name = f"above_{depth}/{path[3 * depth :]}"
    while name in taken:
        name = f"above/{name}"
    return name


def _rename(text: str, uri: str, name: str) -> str:
    """The text of a description with one mesh named differently.

    Raises:
        InvalidArgument: The URI is written with entities that are not looked for.
    """
    renamed = text
    for quote in ('"', "'"):
        old, new = (f"{quote}{escape(one, quote=False)}{quote}" for one in (uri, name))
        renamed = renamed.replace(old, new)
    if renamed == text:
        raise InvalidArgument(f"collision mesh {uri!r} is written in a way that can't be renamed")
    return renamed

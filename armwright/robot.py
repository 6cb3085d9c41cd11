"""Robots by name, from files and from Denavit-Hartenberg rows."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from kinematics.dh import chain_from_dh
from kinematics.dh_table import Convention, DhRow, DhTable
from kinematics.errors import InvalidRobotDescription
from kinematics.robots import builtin_names, builtin_srdf, builtin_urdf
from kinematics.serial_chain import serial_chain
from kinematics.srdf import Semantics, check_semantics, parse_srdf
from kinematics.urdf import parse_urdf
from obstacles.robot_geometry import RobotGeometry, robot_geometry

#: Prefix of ROS's mesh names: package://<package>/<path in it>.
_PACKAGE = "package://"


def load_robot(
    source: str | Path | DhTable | Sequence[DhRow | Mapping[str, Any]],
    *,
    srdf: str | Path | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    joint_limits: Mapping[str, Mapping[str, float]] | None = None,
    convention: Convention = "standard",
) -> RobotGeometry:
    """The robot of a name, a URDF file or a Denavit-Hartenberg table, with its collision geometry.

    Args:
        source: Name of a built-in robot (``builtin_names``), path of a URDF file, DH table, or
            its rows (``DhRow`` or mappings of its fields). Mesh files are found relative to the
            URDF's folder; for ``package://name/path`` also in the folder ``name`` above it.
        srdf: Path of the SRDF that belongs to a URDF.
        base_link: First link of the chain; may be left out where there is one choice.
        tip_link: Last link of the chain, likewise.
        joint_limits: By joint, then by quantity (velocity, acceleration, jerk, ...), in place of
            those of the URDF [rad, m, s].
        convention: How DH rows are read, "standard" or "modified".

    Raises:
        InvalidRobotDescription: The file, the table or a mesh is not valid, or there is neither
            a built-in robot nor a file of that name.
    """
    if isinstance(source, DhTable):
        return robot_geometry(chain_from_dh("robot", source))
    if isinstance(source, str | Path):
        if isinstance(source, str) and source in builtin_names() and not Path(source).is_file():
            return _from_urdf(
                builtin_urdf(source),
                source,
                None,
                parse_srdf(builtin_srdf(source)),
                (base_link, tip_link),
                joint_limits,
            )
        path = _require_file(Path(source))
        semantics = (
            None if srdf is None else parse_srdf(_require_file(Path(srdf)).read_text("utf-8"))
        )
        return _from_urdf(
            path.read_text("utf-8"),
            path.stem,
            path.parent,
            semantics,
            (base_link, tip_link),
            joint_limits,
        )
    rows = tuple(row if isinstance(row, DhRow) else DhRow(**row) for row in source)
    return robot_geometry(chain_from_dh("robot", DhTable(convention, rows)))


def _from_urdf(
    urdf: str,
    name: str,
    folder: Path | None,
    semantics: Semantics | None,
    ends: tuple[str | None, str | None],
    joint_limits: Mapping[str, Mapping[str, float]] | None,
) -> RobotGeometry:
    description = parse_urdf(urdf)
    if semantics is not None:
        check_semantics(semantics, description)
    chain = serial_chain(
        description, *ends, joint_limits=dict(joint_limits or {}), semantics=semantics
    )

    def mesh(uri: str) -> bytes:
        return _mesh(uri, folder)

    return robot_geometry(replace(chain, name=name), description, mesh, semantics)


def _require_file(path: Path) -> Path:
    if not path.is_file():
        raise InvalidRobotDescription(
            f"there is neither a built-in robot nor a file {str(path)!r}",
            hint=f"Built in are: {', '.join(builtin_names())}.",
        )
    return path


@lru_cache(maxsize=64)
def _mesh(uri: str, folder: Path | None) -> bytes:
    for path in _mesh_paths(uri, folder):
        if path.is_file():
            return path.read_bytes()
    raise InvalidRobotDescription(
        f"the mesh {uri!r} was not found",
        hint="Mesh files are looked up relative to the URDF's folder and, for package:// names, "
        "in the folder of that package above it.",
        mesh=uri,
    )


def _mesh_paths(uri: str, folder: Path | None) -> list[Path]:
    """Files that a mesh name may mean."""
    if folder is None:
        return []
    if uri.startswith(_PACKAGE):
        package, _, rest = uri.removeprefix(_PACKAGE).partition("/")
        return [
            *(parent / package / rest for parent in (folder, *folder.resolve().parents)),
            *(parent / rest for parent in folder.resolve().parents if parent.name == package),
            folder / rest,
        ]
    return [folder / uri.removeprefix("file://")]

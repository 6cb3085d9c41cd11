"""Robots by name, from files and from Denavit-Hartenberg rows."""

from base64 import b64decode
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from kinematics.caches.bounded_cache import bounded_cache
from kinematics.errors import InvalidRobotDescription
from kinematics.model.dh import Convention, DhRow, DhTable, chain_from_dh
from kinematics.readers.lint import tidy
from kinematics.readers.mesh_uri import resolve_mesh
from kinematics.robots import builtin_names, builtin_srdf, builtin_urdf
from kinematics.root_frame import root_notes, tool_notes
from kinematics.tree.fingers import fingers
from kinematics.tree.joint_limits import (
    apply_rules,
    limits_of_chain,
    moveit_joint_limits,
    moveit_notes,
)
from kinematics.tree.serial_chain import select, serial_chain
from kinematics.tree.srdf import Semantics, check_semantics, named_states, parse_srdf
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.visuals import read_visuals, with_visual_solids
from obstacles.collision.kept_robot import keep_robot
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.robots.touching_pairs import suspected_pairs

#: Prefix of ROS's mesh names: package://<package>/<path in it>.
_PACKAGE = "package://"
#: Files that readers of the client, on this machine, make URDF of: xacro and MJCF.
_CONVERTED = (".xacro", ".xml", ".mjcf")


def load_robot(
    source: str | Path | DhTable | Sequence[DhRow | Mapping[str, Any]],
    *,
    srdf: str | Path | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    joint_limits: Mapping[str, Mapping[str, float]] | Path | None = None,
    default_limits: Mapping[str, str] | None = None,
    held: Mapping[str, float] | None = None,
    visual_solids: bool = False,
    xacro_args: Mapping[str, str] | None = None,
    convention: Convention = "standard",
) -> RobotGeometry:
    """The robot of a name, a file (URDF, xacro or MJCF) or a DH table, with its collision geometry.

    Poses are in the frame of the root link. Pairs that are suspected to touch, named states and
    what is odd are in ``suspected``, ``states`` and ``lint`` of the robot.

    Args:
        source: Name of a built-in robot (``builtin_names``), path of a URDF, xacro or MJCF file or
            of a folder that holds one, DH table, or its rows (``DhRow`` or mappings of its fields).
            Mesh files are found relative to the URDF's folder; for ``package://name/path`` also in
            the folder ``name`` above it.
        srdf: Path of the SRDF that belongs to a URDF.
        base_link: Link that the chain begins at; may be left out.
        tip_link: Last link of the chain; the likely tip if left out.
        joint_limits: Limits by joint ("*" for all of them), then by quantity (velocity,
            acceleration, jerk, ...), in place of those of the URDF [rad, m, s]; or the path of a
            MoveIt ``joint_limits.yaml``.
        default_limits: Rules for limits that nothing else gives: {"acceleration": "10 x velocity"}.
        held: Positions of joints off the chain [rad or m].
        visual_solids: Links of a URDF without collision geometry collide as they look.
        xacro_args: Values of the arguments of a xacro file, by name.
        convention: How DH rows are read, "standard" or "modified".

    Raises:
        InvalidRobotDescription: The file, the table or a mesh is not valid, or there is neither
            a built-in robot nor a file of that name.
    """
    if isinstance(source, str | Path):
        asked = _Asked(base_link, tip_link, joint_limits, held or {}, visual_solids)
        robot = _of_file(source, srdf, asked, xacro_args)
    else:
        table = source if isinstance(source, DhTable) else _table(source, convention)
        robot = robot_geometry(chain_from_dh("robot", table))
    if not default_limits:
        return robot
    limits, _ = apply_rules(robot.chain.limits, default_limits, robot.chain.joint_names)
    return replace(robot, chain=replace(robot.chain, limits=limits))


class _Asked(NamedTuple):
    """Fields of ``load_robot`` that choose the chain of a URDF, its limits and its solids."""

    base_link: str | None
    tip_link: str | None
    joint_limits: Mapping[str, Mapping[str, float]] | Path | None
    held: Mapping[str, float]
    visual_solids: bool


def _table(rows: Sequence[DhRow | Mapping[str, Any]], convention: Convention) -> DhTable:
    return DhTable(
        convention, tuple(row if isinstance(row, DhRow) else DhRow(**row) for row in rows)
    )


def _of_file(
    source: str | Path,
    srdf: str | Path | None,
    asked: _Asked,
    xacro_args: Mapping[str, str] | None,
) -> RobotGeometry:
    """The robot of a built-in name or of a file."""
    if isinstance(source, str) and source in builtin_names() and not Path(source).is_file():
        semantics = parse_srdf(builtin_srdf(source))
        robot = _from_urdf(builtin_urdf(source), source, _mesh_beside(None), semantics, asked)
        keep_robot(robot)
        return robot
    path = Path(source)
    text = None if srdf is None else _require_file(Path(srdf)).read_text("utf-8")
    if path.is_dir() or path.suffix.lower() in _CONVERTED or xacro_args:
        urdf, mesh, made = _converted(path, asked.visual_solids, xacro_args)
        text = made if text is None else text
    else:
        urdf, mesh = _require_file(path).read_text("utf-8"), _mesh_beside(path.parent)
    semantics_of_file = None if text is None else parse_srdf(text)
    return _from_urdf(urdf, path.stem, mesh, semantics_of_file, asked)


def _mesh_beside(folder: Path | None) -> Callable[[str], bytes]:
    return lambda uri: read_mesh(uri, folder)


def _converted(
    path: Path, visual_solids: bool, xacro_args: Mapping[str, str] | None
) -> tuple[str, Callable[[str], bytes], str | None]:
    """URDF of a file of another form, its meshes, and the SRDF that comes with it."""
    from armwright_client.robots.urdf import MAX_VISUAL_BYTES, read_urdf  # noqa: PLC0415

    try:
        looks = MAX_VISUAL_BYTES if visual_solids else 0
        file = read_urdf(path if path.is_dir() else _require_file(path), (), looks, xacro_args)
    except ValueError as error:
        raise InvalidRobotDescription(str(error)) from None
    meshes = {name: b64decode(data) for name, data in file.meshes.items()}
    return file.text, partial(resolve_mesh, uploaded=meshes), file.srdf


def _from_urdf(
    urdf: str,
    name: str,
    mesh: Callable[[str], bytes],
    semantics: Semantics | None,
    asked: _Asked,
) -> RobotGeometry:
    description = parse_urdf(urdf)
    if asked.visual_solids:
        description = with_visual_solids(description, read_visuals(urdf))
    lint = list(description.lint)
    if semantics is not None:
        lint += check_semantics(semantics, description)
    ends = (asked.base_link, asked.tip_link)
    chosen = select(description, *ends, held=asked.held, semantics=semantics)
    limits, unused = _joint_limits(asked.joint_limits, chosen.joints, description.joints)
    chain = serial_chain(
        description, *ends, held=asked.held, joint_limits=limits, semantics=semantics
    )

    robot = robot_geometry(replace(chain, name=name), description, mesh, semantics)
    robot = replace(robot, fingers=fingers(description, chosen, semantics))
    if semantics is not None:
        states, partial = named_states(chain, semantics)
        robot = replace(robot, states=states)
        lint += partial
    if semantics is None or not semantics.names_allowed_pairs:
        robot = replace(robot, suspected=suspected_pairs(robot))
    lint += [*chosen.lint, *unused, *root_notes(chain), *tool_notes(chain)]
    return replace(robot, lint=tuple(tidy([*lint, *robot.lint])))


def _joint_limits(
    source: Mapping[str, Mapping[str, float]] | Path | None,
    joints: Collection[str],
    known: Collection[str],
) -> tuple[Mapping[str, Mapping[str, float]], list[str]]:
    """Limits of the joints of a chain, and notes on what of a file is not used."""
    if isinstance(source, Path):
        text = source.read_text("utf-8")
        limits, lint = limits_of_chain(moveit_joint_limits(text), joints, known)
        return limits, [*lint, *moveit_notes(text)]
    return source or {}, []


def _require_file(path: Path) -> Path:
    if not path.is_file():
        raise InvalidRobotDescription(
            f"there is neither a built-in robot nor a file {str(path)!r}",
            hint=f"Built in are: {', '.join(builtin_names())}.",
        )
    return path


@bounded_cache(maxsize=64)
def read_mesh(uri: str, folder: Path | None) -> bytes:
    """The bytes of a mesh file of a URDF.

    Args:
        uri: The name that the URDF gives it.
        folder: Folder of the URDF; None where there is no file.

    Raises:
        InvalidRobotDescription: There is no such file.
    """
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
        package, _, rest = uri.removeprefix(_PACKAGE).lstrip("/").partition("/")
        return [
            *(parent / package / rest for parent in (folder, *folder.resolve().parents)),
            *(parent / rest for parent in folder.resolve().parents if parent.name == package),
            folder / rest,
        ]
    return [folder / uri.removeprefix("file://")]

"""Robots to upload: descriptions in files, archives and tables."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self, TypedDict, Unpack

from armwright_client.robots.sources import urdf_text
from armwright_client.robots.urdf import MAX_VISUAL_BYTES, read_urdf
from armwright_wire.robots.robot import (
    ArchiveFields,
    DefaultLimits,
    DhTable,
    JointLimits,
    Motor,
    RobotBody,
    RobotCalibration,
    RobotInertias,
)
from armwright_wire.scenes.tool import NamedTool


class RobotOptions(TypedDict, total=False):
    """Options of any upload.

    Args:
        base_link: First link of the chain; poses are in the root frame all the same, unless this is
            work that a positioner moves beside the arm: then they are in its frame.
        tip_link: Last link of the chain; the likely tip if left out.
        joint_limits: Limits by the joint's name, "*" for all of the chain; or the text of a MoveIt
            `joint_limits.yaml`.
        default_limits: Rules for limits that nothing else gives.
        held: Positions of joints off the chain [rad or m].
        motors: Motors of a URDF, by joint; "*" for every joint that is not named.
        inertias: Bodies and drives in place of the description's.
        calibration: Corrections of joints' frames, or the text of a maker's file.
        allow_suspected: Let pairs touch that `Robot.suspected_collisions` would tell.
        tools: Tools of the robot, which requests for it name.
        visual_solids: Whether links of a URDF without collision geometry collide as they look.
    """

    base_link: str
    tip_link: str
    allow_suspected: bool
    visual_solids: bool
    joint_limits: dict[str, JointLimits] | str
    default_limits: DefaultLimits
    held: dict[str, float]
    motors: dict[str, Motor]
    inertias: RobotInertias
    calibration: RobotCalibration | str
    tools: list[NamedTool]


class ArchiveOptions(RobotOptions, total=False):
    """Options of an archive, with those of any upload.

    Args:
        urdf_path: Path in the archive of the .urdf file that is meant, or the end of it.
        srdf_path: Path in the archive of the .srdf file that belongs to it, or the end of it.
    """

    urdf_path: str
    srdf_path: str


class RobotUpload(RobotBody):
    """A robot as URDF or as a Denavit-Hartenberg table; files are read here."""

    @classmethod
    def from_urdf(
        cls,
        path: Path | str,
        *,
        name: str | None = None,
        srdf: Path | str | None = None,
        package_dirs: Iterable[Path | str] = (),
        visuals: bool = True,
        xacro_args: Mapping[str, str] | None = None,
        **options: Unpack[RobotOptions],
    ) -> Self:
        """Read a URDF, xacro or MJCF file and the meshes it names.

        A .xacro file is expanded here, which needs xacrodoc; an MJCF file is compiled here, which
        needs mujoco, and has its own SRDF if none is given. The service does neither.

        Meshes are looked for beside the URDF, in the folders above it and in `package_dirs`, as
        `armwright_client.robots.urdf` says. Visual ones that are missing are left out.

        Args:
            path: Path of the file, or of a folder that holds one.
            name: Name to be stored under; the name in the URDF if left out.
            srdf: Path of an SRDF file, .xacro or not.
            package_dirs: Folders of packages, or that hold folders of packages.
            visuals: Whether visual meshes are sent, too: up to 16 MiB of them, small ones first.
            xacro_args: Values of the arguments of a xacro file, by name.
            options: Options that the description leaves open.

        Raises:
            OSError: A file can't be read.
            InvalidArgument: The URDF is not XML, meshes are missing, or a xacro or MJCF file can't
                be made a URDF.
        """
        folders = [Path(folder) for folder in package_dirs]
        description = read_urdf(Path(path), folders, MAX_VISUAL_BYTES if visuals else 0, xacro_args)
        return cls.of(
            name=name or description.name,
            urdf=description.text,
            srdf=description.srdf if srdf is None else urdf_text(Path(srdf), None, folders),
            meshes=dict(description.meshes) or None,
            **options,
        )

    @classmethod
    def from_dh(cls, name: str, table: DhTable, **options: Unpack[RobotOptions]) -> Self:
        """A robot of a Denavit-Hartenberg table."""
        return cls(name=name, dh=table, **options)


@dataclass(frozen=True, slots=True)
class RobotArchive:
    """A .zip with a URDF, its meshes and perhaps an SRDF.

    Args:
        name: Name to be stored under.
        content: Content of the file.
        options: Options that the description leaves open.
    """

    name: str
    content: bytes
    options: ArchiveOptions | RobotOptions = field(default_factory=ArchiveOptions)

    @classmethod
    def from_file(
        cls, path: Path | str, *, name: str | None = None, **options: Unpack[ArchiveOptions]
    ) -> Self:
        """The archive in a file, to be stored under the file's name if no other is given.

        Raises:
            OSError: The file can't be read.
        """
        return cls(name or Path(path).stem, Path(path).read_bytes(), options)

    def fields(self) -> dict[str, str]:
        """Form fields beside the file."""
        given = ArchiveFields.of(name=self.name, **self.options)
        values = given.model_dump(exclude_unset=True)
        return {
            name: value if isinstance(value, str) else json.dumps(value)
            for name, value in values.items()
        }

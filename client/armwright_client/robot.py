"""Robots: descriptions to upload, and the models that the service makes of them."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self, TypedDict, Unpack

from pydantic import Field, model_validator

from armwright_client.base import Answer, Positive, Request
from armwright_client.dh_table import DerivedDh, DhTable
from armwright_client.motor import Motor
from armwright_client.urdf import MAX_VISUAL_BYTES, read_urdf


class JointLimits(Request):
    """Limits that a description leaves out or that are to be tightened."""

    lower: float | None = None
    upper: float | None = None
    velocity: Positive | None = None
    acceleration: Positive | None = None
    jerk: Positive | None = None
    effort: Positive | None = None


class DefaultLimits(Request):
    """Rules for limits that are known nowhere else, such as "10 x velocity"."""

    acceleration: str | None = None
    jerk: str | None = None


class RobotOptions(TypedDict, total=False):
    """Options of any upload.

    Args:
        base_link: Where the chain begins; poses are in the root frame all the same, unless this is
            work that a positioner moves beside the arm: then they are in its frame.
        tip_link: Where it ends; the likely tip if left out.
        joint_limits: By the joint's name, "*" for all of the chain; or the text of a MoveIt
            `joint_limits.yaml`.
        default_limits: Rules for limits that nothing else gives.
        held: Positions of joints off the chain [rad or m].
        motors: Of a URDF, by joint; "*" for every joint that is not named.
        allow_suspected: Let pairs touch that `Robot.suspected_collisions` would tell.
        visual_solids: Of a URDF: links without collision geometry collide as they look.
    """

    base_link: str
    tip_link: str
    allow_suspected: bool
    visual_solids: bool
    joint_limits: dict[str, JointLimits] | str
    default_limits: DefaultLimits
    held: dict[str, float]
    motors: dict[str, Motor]


class ArchiveOptions(RobotOptions, total=False):
    """Options of an archive, with those of any upload.

    Args:
        urdf_path: Which .urdf file is meant, by its path in the archive or the end of it.
        srdf_path: Which .srdf file belongs to it, likewise.
    """

    urdf_path: str
    srdf_path: str


class RobotFields(Request):
    """Fields of an upload beside the description; see `RobotOptions`."""

    name: str
    base_link: str | None = None
    tip_link: str | None = None
    joint_limits: dict[str, JointLimits] | str | None = None
    default_limits: DefaultLimits | None = None
    allow_suspected: bool | None = None
    visual_solids: bool | None = None
    held: dict[str, float] | None = None
    motors: dict[str, Motor] | None = None


class ArchiveFields(RobotFields):
    """Fields of an archive; see `ArchiveOptions`."""

    urdf_path: str | None = None
    srdf_path: str | None = None


class RobotChanges(Request):
    """Limits of a stored robot that change; those of other joints and quantities stay.

    Args:
        joint_limits: By the joint's name, "*" for all; or the text of a `joint_limits.yaml`.
        default_limits: Rules in place of those of before.
    """

    joint_limits: dict[str, JointLimits] | str | None = None
    default_limits: DefaultLimits | None = None


class RobotUpload(RobotFields):
    """A robot as URDF or as a Denavit-Hartenberg table.

    Args:
        name: To be stored under.
        urdf: Its text.
        srdf: Its text: the chain and the pairs of links that may touch.
        dh: A table instead of a URDF.
        meshes: Files in base64 by the URI that the URDF names them by.
        base_link: Where the chain begins.
        tip_link: Where it ends; the likely tip if left out.
        joint_limits: By the joint's name, "*" for all; or the text of a `joint_limits.yaml`.
        default_limits: Rules for limits that nothing else gives.
        held: Positions of joints off the chain [rad or m].
        motors: Of a URDF, by joint; "*" for every joint that is not named.
    """

    urdf: str | None = None
    srdf: str | None = None
    dh: DhTable | None = None
    meshes: dict[str, str] | None = None

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if (self.urdf is None) == (self.dh is None):
            raise ValueError("give urdf or dh, not both")
        return self

    @classmethod
    def from_urdf(
        cls,
        path: Path | str,
        *,
        name: str | None = None,
        srdf: Path | str | None = None,
        package_dirs: Iterable[Path | str] = (),
        visuals: bool = True,
        **options: Unpack[RobotOptions],
    ) -> Self:
        """Read a URDF file and the meshes it names.

        Meshes are looked for beside the URDF, in the folders above it and in `package_dirs`, as
        `armwright_client.urdf` says. Visual ones that are missing are left out.

        Args:
            path: Of the URDF file.
            name: To be stored under; the name in the URDF if left out.
            srdf: Of an SRDF file.
            package_dirs: Folders of packages, or that hold folders of packages.
            visuals: Whether visual meshes are sent, too: up to 16 MiB of them, small ones first.
            options: What the description leaves open.

        Raises:
            OSError: A file can't be read.
            InvalidArgument: The URDF is not XML, or meshes are missing.
        """
        folders = [Path(folder) for folder in package_dirs]
        description = read_urdf(Path(path), folders, MAX_VISUAL_BYTES if visuals else 0)
        return cls(
            name=name or description.name,
            urdf=description.text,
            srdf=None if srdf is None else Path(srdf).read_text(encoding="utf-8"),
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
        name: To be stored under.
        content: Of the file.
        options: What the description leaves open.
    """

    name: str
    content: bytes
    options: ArchiveOptions = field(default_factory=ArchiveOptions)

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
        values = given.model_dump(exclude_none=True)
        return {
            name: value if isinstance(value, str) else json.dumps(value)
            for name, value in values.items()
        }


class Limits(Answer):
    """Limits in the order of the joints; None where there is none."""

    lower: list[float | None]
    upper: list[float | None]
    velocity: list[float | None]
    acceleration: list[float | None]
    jerk: list[float | None]
    effort: list[float | None]


class RobotSummary(Answer):
    """A robot in the list."""

    name: str
    built_in: bool = False
    joints: int | None = None


class RobotList(Answer):
    """A page of the robots; `next` is the `after` of the next page, if there is one."""

    robots: list[RobotSummary]
    next: str | None = None


class SuspectedPair(Answer):
    """Two links that touch where the robot surely may stand, and where that is."""

    pair: tuple[str, str]
    reason: str


class FingerJoint(Answer):
    """A joint of a gripper that others may follow.

    Args:
        position: Where the robot holds it [rad or m].
        lower: Least position; None without a limit.
        upper: Largest position; None without a limit.
    """

    position: float
    lower: float | None = None
    upper: float | None = None


class Robot(Answer):
    """The model of a robot.

    Args:
        name: Of the robot.
        built_in: Whether it is always there.
        hash: Of the model, as answers to plans give it.
        joint_names: The order of every joint vector.
        joint_types: In the same order.
        limits: In the same order.
        links: All of them.
        frame: The root link, in whose frame all poses are.
        base_link: First link of the chain.
        tip_link: Last link of the chain, whose pose goals are for.
        states: Named configurations of the SRDF.
        default_limits: Rules of the upload.
        held: Positions of joints off the chain, of the upload [rad or m].
        fingers: Joints of the gripper that `fingers` of requests may move.
        motors: By joint, of a table's rows or of the upload; None where it has none.
        dh: Derived from the joint axes.
        wrist: "spherical", "three_parallel" or "none".
        allowed_collisions: Pairs of links that may touch.
        allowed_collision_reasons: For each of these pairs.
        suspected_collisions: Without an SRDF: pairs that touch in the zero pose, in a named state
            or often at random; they are checked unless the upload says `allow_suspected`.
        lint: What is odd in the description.
    """

    name: str
    built_in: bool = False
    hash: str | None = None
    joint_names: list[str]
    joint_types: list[str]
    limits: Limits
    links: list[str]
    frame: str | None = None
    base_link: str
    tip_link: str
    states: dict[str, list[float]] = Field(default_factory=dict)
    default_limits: DefaultLimits | None = None
    held: dict[str, float] | None = None
    fingers: dict[str, FingerJoint] = Field(default_factory=dict)
    motors: dict[str, Motor] | None = None
    dh: DerivedDh | None = None
    wrist: str
    allowed_collisions: list[list[str]]
    allowed_collision_reasons: list[str] | None = None
    suspected_collisions: list[SuspectedPair] = Field(default_factory=list)
    lint: list[str]

"""Reach of an arm: which poses it takes in a scene, and where its base should stand."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, TypedDict

from pydantic import Field

from armwright_client.base import (
    PLAIN,
    Answer,
    InFrame,
    Matrix,
    Names,
    NonNegative,
    Positive,
    Request,
    Rows,
    Vector,
    Vector3,
)
from armwright_client.check import Attached, AttachedObjects
from armwright_client.pose import Pose
from armwright_client.scene import AllowedPair, AllowedPairs, SceneReference

if TYPE_CHECKING:
    Poses: TypeAlias = Sequence[Pose]
else:
    Poses = Annotated[list[Pose], PLAIN]


class ReachTolerance(Request):
    """Deviation that is allowed from each pose, in its own frame.

    Args:
        free: Axes about which any angle will do.
        x: Least and largest deviation along x [m].
        y: Along y [m].
        z: Along z [m].
        rx: About x [rad].
        ry: About y [rad].
        rz: About z [rad].
        samples: Values tried on each of these axes.
    """

    free: Names = Field(default_factory=list)
    x: Vector | None = None
    y: Vector | None = None
    z: Vector | None = None
    rx: Vector | None = None
    ry: Vector | None = None
    rz: Vector | None = None
    samples: int = 12


class ReachBox(Request):
    """A box of the workspace with a grid of points, each with all orientations.

    Args:
        size: Lengths of its edges [m].
        pose: Of its centre.
        spacing: Largest distance of neighbouring points [m].
        orientations: Quaternions x, y, z, w.
    """

    size: Vector3
    pose: Pose
    spacing: Positive
    orientations: Rows = Field(default_factory=lambda: [[0.0, 0.0, 0.0, 1.0]])


class BaseRegion(Request):
    """Candidates for the base on a rectangle of the floor.

    Args:
        x: Least and largest [m].
        y: Least and largest [m].
        z: Height of the base [m].
        spacing: Largest distance of neighbouring candidates [m].
        yaws: Angles about z, evenly over a turn.
    """

    x: Vector
    y: Vector
    z: float = 0.0
    spacing: Positive
    yaws: int = 8


class ReachOptions(TypedDict, total=False):
    """Options of a question about reach; see `ReachRequest`.

    Args:
        frame: A link that stands still; the root frame if left out.
        link: The link to bring to the poses; the tip if left out.
        tolerance: Deviation that is allowed.
        scene: A stored scene's name, or a scene.
        attached: Objects that the robot holds.
        allowed_collisions: Pairs that may touch.
        margin: Distance to be kept from obstacles [m].
        choice: What makes the best configuration; the first one found will do with ``first``.
        clearance: Measure clearances.
        joints: Answer the best configurations.
        bases: Candidates for the base.
        base_region: Candidates on the floor.
        timeout: Deadline [s].
        seed: Of the numeric search.
    """

    frame: str | None
    link: str | None
    tolerance: ReachTolerance | None
    scene: SceneReference | None
    attached: Sequence[Attached] | None
    allowed_collisions: AllowedPairs | None
    margin: float
    choice: Literal["manipulability", "clearance", "limits", "first"]
    clearance: bool
    joints: bool | None
    bases: Sequence[Pose] | None
    base_region: BaseRegion | None
    timeout: float | None
    seed: int


class ReachRequest(Request):
    """Task poses, what stands around, and perhaps candidates for the base.

    Args:
        poses: A list of poses.
        box: A grid of poses instead.
        frame: A link that stands still; the root frame if left out.
        link: The link to bring to the poses; the tip if left out.
        tolerance: Deviation that is allowed.
        scene: A stored scene's name, or a scene.
        attached: Objects that the robot holds.
        allowed_collisions: Pairs that may touch.
        margin: Distance to be kept from obstacles [m].
        choice: What makes the best configuration; the first one found will do with ``first``.
        clearance: Measure clearances.
        joints: Answer the best configurations.
        bases: Candidates for the base.
        base_region: Candidates on the floor.
        format: "json", "svg" for a picture, or "glb" for a coloured mesh.
        timeout: Deadline [s].
        seed: Of the numeric search.
    """

    poses: Poses | None = None
    box: ReachBox | None = None
    frame: str | None = None
    link: str | None = None
    tolerance: ReachTolerance | None = None
    scene: SceneReference | None = None
    attached: AttachedObjects | None = None
    allowed_collisions: AllowedPairs | None = None
    margin: NonNegative = 0.0
    choice: Literal["manipulability", "clearance", "limits", "first"] = "manipulability"
    clearance: bool = True
    joints: bool | None = None
    bases: Poses | None = None
    base_region: BaseRegion | None = None
    format: Literal["json", "svg", "glb"] = "json"
    timeout: Positive | None = None
    seed: int = 0


class ReachGrid(Answer):
    """Order of the arrays of a box: x changes slowest, then y, z and the orientation.

    Args:
        shape: Numbers along x, y, z and of orientations.
        axes: Coordinates along the box's axes [m].
    """

    shape: list[int]
    axes: Matrix


class BaseAnswer(Answer):
    """One candidate for the base; figures are the worst of the poses that are reached.

    Args:
        index: Number of the candidate.
        pose: Where it stands.
        reached: How many of the poses.
        clearance: [m].
        manipulability: Product of the Jacobian's singular values.
        limit_distance: Share of half its range left to the joint nearest to a limit.
        unreached: Numbers of the first poses that are not reached.
    """

    index: int
    pose: Pose
    reached: int
    clearance: float | None = None
    manipulability: float | None = None
    limit_distance: float | None = None
    unreached: list[int]


class ReachAnswer(InFrame):
    """Reach of the poses in their order; with candidates for the base that from the best one.

    Args:
        count: How many poses.
        reached: How many of them are reached.
        statuses: Names of the numbers in status.
        status: Of each pose.
        branches: Branches of inverse kinematics that are free of collision.
        samples: Deviations within the tolerance that are reached.
        manipulability: Product of the Jacobian's singular values.
        clearance: Of the best configuration [m].
        limit_distance: Share of half its range left to the joint nearest to a limit.
        joints: The best configurations.
        joint_names: Base to tip.
        grid: Order of the arrays of a box.
        bases: Candidates for the base, best first.
        allowed_collisions: All pairs that were not kept apart, the deepest they are.
    """

    count: int
    reached: int
    statuses: list[str]
    status: list[int]
    branches: list[int]
    samples: list[int]
    manipulability: list[float | None]
    clearance: list[float | None]
    limit_distance: list[float | None]
    joints: list[list[float] | None] | None = None
    joint_names: list[str]
    grid: ReachGrid | None = None
    bases: list[BaseAnswer] | None = None
    allowed_collisions: list[AllowedPair] = Field(default_factory=list)

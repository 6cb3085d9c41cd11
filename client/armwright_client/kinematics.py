"""Forward and inverse kinematics and Jacobians."""

from typing import Literal, TypedDict

from armwright_client.base import (
    Answer,
    Matrix,
    OptionsList,
    Request,
    Rows,
    Vector,
    Vector3,
    VectorLike,
)
from armwright_client.pose import Pose
from armwright_client.scene import SceneReference

JacobianKind = Literal["geometric", "analytic_zyz"]
IkMethod = Literal["auto", "analytic", "numeric", "gradient", "constrained"]


class FkRequest(Request):
    """Configurations whose link poses are asked for."""

    joints: Vector | Rows
    link: str | None = None


class FkAnswer(Answer):
    """Poses in the base frame.

    Args:
        pose: Of the link asked for, or of the tip.
        links: Of every link.
    """

    pose: Pose
    links: dict[str, Pose]


class FkBatch(Answer):
    """Poses of many configurations, in their order; see `FkAnswer`."""

    pose: list[Pose]
    links: dict[str, list[Pose]]


class JacobianOptions(TypedDict, total=False):
    """Which Jacobian is asked for.

    Args:
        link: The tip if left out.
        point: A point fixed to the link, in its frame [m]; its origin if left out.
        kind: "geometric" if left out.
    """

    link: str
    point: VectorLike
    kind: JacobianKind


class JacobianRequest(Request):
    """Configurations whose Jacobians are asked for."""

    joints: Vector | Rows
    link: str | None = None
    point: Vector3 | None = None
    kind: JacobianKind = "geometric"


class JacobianAnswer(Answer):
    """A Jacobian.

    Args:
        jacobian: 6 x n, linear rows first.
        rank: Of the matrix.
        singular_values: Largest first.
        manipulability: Their product.
    """

    jacobian: Matrix
    rank: int
    singular_values: list[float]
    manipulability: float


class JacobianBatch(Answer):
    """Jacobians of many configurations, in their order; see `JacobianAnswer`."""

    jacobian: list[Matrix]
    rank: list[int]
    singular_values: list[list[float]]
    manipulability: list[float]


class IkOptions(TypedDict, total=False):
    """What can be asked of inverse kinematics beyond the pose.

    Args:
        link: The tip if left out.
        seed_joints: Where to look first; solutions near it are better.
        method: "auto" if left out.
        all_solutions: Also those that are outside limits or in collision, with the reason.
        max_solutions: At most so many.
        scene: To be free of collisions in.
        constraints: Beyond the pose.
        timeout: [s].
        seed: Of the random generator.
    """

    link: str
    seed_joints: VectorLike
    method: IkMethod
    all_solutions: bool
    max_solutions: int
    scene: SceneReference
    constraints: OptionsList
    timeout: float
    seed: int


class IkRequest(Request):
    """A pose to be reached; see `IkOptions`."""

    pose: Pose
    link: str | None = None
    seed_joints: Vector | None = None
    method: IkMethod = "auto"
    all_solutions: bool = False
    max_solutions: int | None = None
    scene: SceneReference | None = None
    constraints: OptionsList | None = None
    timeout: float | None = None
    seed: int = 0


class IkSolution(Answer):
    """A configuration that reaches the pose, and how well.

    Args:
        joints: [rad or m].
        branch: Name of the closed form's branch.
        position_error: [m].
        orientation_error: [rad].
        within_limits: Whether every joint is.
        collision_free: None where no scene was given.
        rejected_because: Why it can't be used, if so.
    """

    joints: list[float]
    branch: str | None = None
    position_error: float
    orientation_error: float
    within_limits: bool
    collision_free: bool | None = None
    rejected_because: str | None = None


class IkAnswer(Answer):
    """Solutions, best first."""

    solutions: list[IkSolution]

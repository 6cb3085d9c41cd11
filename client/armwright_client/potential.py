"""The artificial potential of an arm on its way to a goal."""

from typing import Literal, TypedDict

from pydantic import Field

from armwright_client.base import (
    Answer,
    Matrix,
    NonNegative,
    Positive,
    Request,
    Rows,
    Vector,
)
from armwright_client.scene import AllowedPair, Engine, SceneReference


class PotentialOptions(Request):
    """Weights of the potential and how far obstacles are felt.

    Args:
        attractive_weights: Pull towards the goal [N/m]: one for all control points, or one each.
        attractive_cap: Distance beyond which the pull no longer grows [m].
        repulsive_weights: Push away from obstacles [N m^3], likewise.
        influence_distance: Distance within which obstacles are felt [m].
        least_distance: Nearer than this, the potential goes on along its tangent [m].
        preset: Preset of the planner that options left out are taken from; "notes" if left out.
        control_points: Origins of the DH frames, or points along the links.
        point_radii: Radius of the arm about the origins [m]: one for all, or one each.
        joint_weight: Pull in joint space [N m].
    """

    attractive_weights: NonNegative | Vector | None = None
    attractive_cap: Positive | None = None
    repulsive_weights: NonNegative | Vector | None = None
    influence_distance: Positive | None = None
    least_distance: Positive | None = None
    preset: Literal["notes", "quick", "thorough"] | None = None
    control_points: Literal["origins", "links"] | None = None
    point_radii: NonNegative | Vector | None = None
    joint_weight: NonNegative | None = None


class PotentialSettings(TypedDict, total=False):
    """Settings of the potential field and of its computation.

    Args:
        options: Weights and reach of the field.
        frame: Of an inline scene that names none: a link that stands still, or "tool".
        engine: Projection onto obstacles: closed forms ("exact") or FCL's distance query.
        timeout: Deadline [s].
    """

    options: PotentialOptions | None
    frame: str | None
    engine: Engine
    timeout: float | None


class PotentialRequest(Request):
    """Configurations, a goal and what is in the way.

    Args:
        joints: One configuration, or a list of them [rad or m].
        goal_joints: The goal [rad or m].
        scene: A stored scene's name, or a scene.
        frame: Of an inline scene that names none: a link that stands still, or "tool".
        options: Weights of the field and how far it reaches.
        engine: What projects onto obstacles: closed forms ("exact") or FCL's distance query.
        timeout: [s].
    """

    joints: Vector | Rows
    goal_joints: Vector
    scene: SceneReference | None = None
    frame: str | None = None
    options: PotentialOptions | None = None
    engine: Engine = "exact"
    timeout: Positive | None = None


class ControlPoint(Answer):
    """A point of the arm that is pulled to its goal and pushed away by obstacles.

    Args:
        joint: The joint that carries it.
        origin: Where it is [m].
        radius: Of the arm about it [m].
        goal: Where it is at the goal [m].
        attractive_force: [N].
        repulsive_force: Of all obstacles together [N].
        projection: The nearest point of the nearest obstacle [m].
        distance: To it [m], negative inside.
        obstacle: Which one that is.
    """

    joint: str
    origin: list[float]
    radius: float = 0.0
    goal: list[float]
    attractive_force: list[float]
    repulsive_force: list[float]
    projection: list[float] | None = None
    distance: float | None = None
    obstacle: str | None = None


class PotentialAnswer(Answer):
    """The potential and where it comes from.

    Args:
        potential: U [J].
        gradient: Its slope in joint space.
        joint_force: Minus the slope: what a descent follows.
        control_points: Base to tip.
        allowed_collisions: All pairs that were not kept apart, and how deep they are.
    """

    potential: float
    gradient: list[float]
    joint_force: list[float]
    control_points: list[ControlPoint]
    allowed_collisions: list[AllowedPair] = Field(default_factory=list)


class PotentialBatch(Answer):
    """The potential at many configurations, in their order; see `PotentialAnswer`."""

    potential: list[float]
    gradient: Matrix
    joint_force: Matrix
    control_points: list[list[ControlPoint]]
    allowed_collisions: list[AllowedPair] = Field(default_factory=list)

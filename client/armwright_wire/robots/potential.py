"""The artificial potential on the wire."""

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from armwright_wire.base import (
    AS_LIST,
    JOINTS_EXAMPLE,
    MAX_BATCH,
    MAX_JOINTS,
    Answer,
    Body,
    Frame,
    Joints,
    JointVector,
    Label,
    Matrix,
    NonNegative,
    Point,
    Positive,
    Timeout,
)
from armwright_wire.scenes.check import AllowedAnswers
from armwright_wire.scenes.scene import Engine, SceneReference
from armwright_wire.scenes.tool import WithTool

Weight = Annotated[float, Field(ge=0.0, le=1e9)]
_OfJoints = Field(min_length=1, max_length=MAX_JOINTS)
Weights = Weight | Annotated[Sequence[Weight], AS_LIST, _OfJoints]
Radii = NonNegative | Annotated[Sequence[NonNegative], AS_LIST, _OfJoints]
#: Fields answered at once: with all their control points about a megabyte a thousand.
MAX_FIELDS = MAX_BATCH


class OwnPoint(Body):
    """A point that the field acts on."""

    link: Label = Field(examples=["panda_link4"])
    """link that carries it"""
    point: Point
    """position in that link's frame [m]"""


class PotentialOptions(Body):
    """Weights of the field and how far it reaches; what is left out is as planning has it."""

    attractive_weights: Weights | None = Field(None, examples=[[1.0] * 7])
    """c_i, pull towards the goal [N/m], 1 if left out: one number, or one for each control point"""
    attractive_cap: Positive | None = None
    """d, distance beyond which the pull no longer grows [m], 0.2 if left out"""
    repulsive_weights: Weights | None = None
    """η_i, push away from obstacles [N m³], 2e-4 if left out"""
    influence_distance: Positive | None = None
    """ρ_0, distance within which obstacles are felt [m], 0.1 if left out"""
    least_distance: Positive | None = None
    """ρ_m, nearer than this and inside, the potential goes on along its tangent [m], 1e-3 if left
    out
    """
    preset: Literal["notes", "quick", "thorough"] = "notes"
    """the planner's preset that options left out are taken from: quick and thorough have points
    along the links and a pull in joint space
    """
    control_points: (
        Literal["origins", "links"]
        | Annotated[list[OwnPoint], Field(min_length=1, max_length=MAX_JOINTS)]
        | None
    ) = None
    """origins O_i of the DH frames, points along the links' solids, or points of one's own"""
    point_radii: Radii | None = Field(None, examples=[0.05])
    """radius of the arm about origins or own points [m]: one number, or one for each; 0 if left out
    """
    joint_weight: NonNegative | None = None
    """pull in joint space, U = k |q − q_goal|²/2 [N m]"""


class PotentialRequest(WithTool):
    """Configurations on the way to a goal, and what is in the way."""

    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    goal_joints: JointVector = Field(examples=[[0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]])
    """configuration that the field pulls to [rad or m]"""
    scene: SceneReference | None = Field(None, examples=["table"])
    frame: Frame | None = None
    """of an inline scene that names none"""
    options: PotentialOptions | None = None
    engine: Engine = Field("exact", examples=["fcl"])
    """what projects the control points onto obstacles: closed forms, or FCL's distance query"""
    timeout: Timeout | None = None


class ControlPoint(Answer):
    """A point of the arm that is pulled to its goal and pushed away by obstacles."""

    joint: str = Field(examples=["panda_joint7"])
    """the joint that carries it"""
    origin: list[float]
    """O_i, origin of frame i of the DH table, for the last joint of the tip, or a point along a
    link [m]
    """
    radius: float
    """of the arm about it [m]: an obstacle is felt from there on"""
    goal: list[float]
    """where it is at the goal [m]"""
    attractive_force: list[float]
    """[N]"""
    repulsive_force: list[float]
    """of all obstacles together [N]"""
    projection: list[float] | None
    """π(O_i) onto the nearest obstacle [m]; null where there is none"""
    distance: float | None
    """to it [m], negative inside"""
    obstacle: str | None = Field(examples=["table_top"])
    """which one that is"""


class PotentialAnswer(Answer):
    """The potential; with many configurations each field is a list."""

    potential: float | list[float]
    """U(q) [J]"""
    gradient: list[float] | Matrix
    """∇_q U [N m or N]"""
    joint_force: list[float] | Matrix
    """−∇_q U, what the descent follows"""
    control_points: list[ControlPoint] | list[list[ControlPoint]]
    """points that are pulled and pushed, from the base on"""
    allowed_collisions: AllowedAnswers = Field(default_factory=list)

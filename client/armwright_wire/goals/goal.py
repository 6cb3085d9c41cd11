"""Starts and goals of motions, costs of goals and preferred clearance, on the wire."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Self, TypeAlias

from pydantic import Field, model_validator

from armwright_wire.base import (
    JOINTS_EXAMPLE,
    Answer,
    Beside,
    Body,
    BodyWithRules,
    Frame,
    JointVector,
    Label,
    NonNegative,
    Positive,
    VectorLike,
)
from armwright_wire.pose import AnyPose, PoseInFrame
from armwright_wire.scenes.check import Margin

MAX_GOALS = 1_000

Tolerance = Annotated[Positive, Field(le=10.0)]


class Start(BodyWithRules):
    """Start of the motion."""

    one_of: ClassVar[tuple[str, ...]] = ("joints", "state", "plan")
    only_beside: ClassVar[Beside] = {
        "at": ("plan",),
        "velocities": ("joints", "state"),
        "accelerations": ("joints", "state"),
    }

    joints: JointVector | None = Field(None, examples=[JOINTS_EXAMPLE])
    state: Label | None = Field(None, description="a named state of the robot", examples=["home"])
    velocities: JointVector | None = Field(
        None,
        description="there; at rest if left out. Planners that optimise nothing brake to rest "
        "first",
    )
    accelerations: JointVector | None = Field(
        None, description="there, likewise; any that keep the limits if left out"
    )

    plan: Label | None = Field(
        None,
        description="of a plan: a kept one, whose motion is left at `at` in the same state; where "
        "no motion from there is proved, its stop is answered",
    )
    at: NonNegative | None = Field(None, description="instant of its trajectory [s]")

    @model_validator(mode="after")
    def _check_form(self) -> "Start":
        if self.plan is not None and self.at is None:
            raise ValueError("plan needs at: the instant at which its motion is left")
        return self


class SingleGoal(BodyWithRules):
    """A configuration, or a pose of the tip within tolerances."""

    one_of: ClassVar[tuple[str, ...]] = ("joints", "state", "pose")
    only_beside: ClassVar[Beside] = {
        "position_tolerance": ("pose",),
        "orientation_tolerance": ("pose",),
        "frame": ("pose",),
        "velocities": ("joints", "state"),
        "accelerations": ("joints", "state"),
    }

    joints: JointVector | None = Field(None, examples=[[0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]])
    state: Label | None = Field(None, description="a named state of the robot", examples=["home"])
    pose: PoseInFrame | None = None
    frame: Frame | None = None
    velocities: JointVector | None = Field(
        None, description="at the joints, for a motion that is optimised; at rest if left out"
    )
    accelerations: JointVector | None = Field(
        None, description="there, likewise; any that keep the limits if left out"
    )
    position_tolerance: Tolerance | None = Field(
        None,
        description="how far off the tip may end if nothing is right there, 1e-4 if left out [m]",
    )
    orientation_tolerance: Tolerance | None = Field(
        None,
        description="how far turned it may end if nothing is right there, 1e-3 if left out [rad]",
    )


class Goal(SingleGoal):
    """Goal of the motion: one, or any of several."""

    one_of: ClassVar[tuple[str, ...]] = ("joints", "state", "pose", "any_of")

    any_of: Annotated[list[SingleGoal], Field(min_length=1, max_length=MAX_GOALS)] | None = Field(
        None, description="goals of which one is to be reached"
    )

    @classmethod
    def at_state(cls, state: str) -> Self:
        """A named state of the robot as the goal."""
        return cls(state=state)

    @classmethod
    def at_joints(
        cls,
        joints: VectorLike,
        *,
        velocities: VectorLike | None = None,
        accelerations: VectorLike | None = None,
    ) -> Self:
        """A configuration as the goal [rad or m], for an optimised motion passed at a velocity."""
        return cls.of(joints=joints, velocities=velocities, accelerations=accelerations)

    @classmethod
    def at_pose(
        cls,
        pose: AnyPose,
        *,
        position_tolerance: float | None = None,
        orientation_tolerance: float | None = None,
    ) -> Self:
        """A pose of the tip as the goal, within tolerances [m, rad]."""
        return cls.of(
            pose=pose,
            position_tolerance=position_tolerance,
            orientation_tolerance=orientation_tolerance,
        )

    @classmethod
    def among(cls, goals: Sequence["GoalLike"]) -> Self:
        """Goal that is any of several."""
        return cls(any_of=[SingleGoal(**given_fields(as_goal(goal))) for goal in goals])


#: A goal, or a pose or configuration that is one.
GoalLike: TypeAlias = SingleGoal | AnyPose | VectorLike


def as_goal(goal: GoalLike) -> Goal:
    """The goal that is meant by a pose or a configuration."""
    if isinstance(goal, Goal):
        return goal
    if isinstance(goal, SingleGoal):
        return Goal(**given_fields(goal))
    if isinstance(goal, AnyPose):
        return Goal.at_pose(goal)
    return Goal.at_joints(goal)


def given_fields(part: Body) -> dict[str, Any]:
    """The fields of a part of a request that are not None."""
    return {name: value for name, value in part if value is not None}


#: As planning has it; tests compare the two [m].
DEFAULT_PREFERRED = 0.02
MAX_PREFERRED = 1.0


class Clearance(Body):
    """Distances from obstacles: one to keep wherever there is room, one to keep always."""

    preferred: Annotated[NonNegative, Field(le=MAX_PREFERRED)] = Field(
        DEFAULT_PREFERRED,
        description="kept wherever there is room [m]; a quarter of it, 5 mm at most, between the "
        "robot's own links; 0 prefers no distance",
    )
    least: Margin | None = Field(None, description="another name of margin [m]")

    def check_margin(self, margin: float) -> None:
        """Refuse a margin that is given beside another least clearance.

        Raises:
            ValueError: They differ.
        """
        if self.least is not None and margin not in {0.0, self.least}:
            raise ValueError("margin and clearance.least are one distance: give one of them")


class CloseSpanAnswer(Answer):
    """A span of the motion that is nearer to something than preferred."""

    begins: float = Field(description="[s]")
    ends: float = Field(description="[s]")
    distance: float = Field(description="the least in it, margins of obstacles taken off [m]")
    pair: tuple[str, str] = Field(description="the two bodies that come so near")


class ClearanceAnswer(Answer):
    """Preferred distances, and where the motion does not keep them."""

    preferred: float = Field(description="from obstacles [m]")
    own_links: float = Field(description="between the robot's own links [m]")
    least: float = Field(description="the margin that the certificate proves [m]")
    time_below: float = Field(description="time in which the motion is nearer than preferred [s]")
    period: float = Field(description="between two instants that were looked at [s]")
    spans: list[CloseSpanAnswer] = Field(
        description="spans of time nearer than preferred, in their order"
    )


class GoalCosts(Body):
    """Weights of what a goal configuration costs; those left out keep their default."""

    # Defaults are those of planning; tests compare the two.

    motion_time: NonNegative = Field(
        1.0,
        description="of the time of the straight joint motion from the start [1/s]",
    )
    joint_limits: NonNegative = Field(
        0.5,
        description="of the nearness to a joint limit: 1 at a limit, 0 from 15 % of the range",
    )
    manipulability: NonNegative = Field(
        0.2,
        description="of its lack: 1 at a singularity, 0 at the best configuration",
    )
    clearance: NonNegative = Field(
        0.2, description="of the nearness of obstacles: 1 in contact, 0 from 5 cm"
    )
    turns: NonNegative = Field(0.2, description="of each joint that turns by more than half a turn")


class ConfigurationAnswer(Answer):
    """The configuration that was chosen for a pose, what it costs, and why it is not another."""

    branch: str | None = Field(
        None, description="name of its branch; null where the arm has no closed form"
    )
    limit_share: float = Field(
        description="distance of the joint nearest to its limit, as a share of the joint's range"
    )
    costs: dict[str, float] = Field(
        description="what it costs, weighted, by the names of `goal_costs`; `motion_time` is "
        "that of the straight joint motion to it",
        examples=[{"motion_time": 0.61, "joint_limits": 0.0, "turns": 0.0}],
    )
    found: int = Field(description="free configurations that were found")
    cheaper: int = Field(description="those of them that cost less, clearance left out")
    at_limit: int = Field(description="those of them within 2 % of a joint limit")
    reason: str = Field(
        description="why it was chosen",
        examples=["It costs the least of 8 free configurations."],
    )

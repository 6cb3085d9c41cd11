"""Tours to be planned: goals with alternatives, an order that some of them need, two ends."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.placement import place
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.options import Options
from planning.problem import Goal, JointGoal
from planning.reach.tolerance import Tolerance
from planning.tours.order import check_order
from planning.values.preferred_clearance import PreferredClearance

#: Goals of one tour.
MAX_GOALS = 500
#: Rounds of search and proof that can be asked for.
MAX_ROUNDS = 1_000
#: Configurations of all goals together: tables of their times take 130 megabytes.
MAX_CONFIGURATIONS = 4_000


@dataclass(frozen=True, slots=True, eq=False)
class TourGoal:
    """One goal of a tour: any of several configurations and poses, and a stay there.

    Args:
        id: Its name.
        alternatives: Any one of these is to be reached.
        tolerance: By how much the tool may deviate from poses, as free axes do.
        dwell: How long the arm stays [s].
        group: Goals of one group are visited one after another, with no other between them.

    Raises:
        InvalidGoal: There is no alternative, or the stay is negative.
    """

    id: str
    alternatives: tuple[Goal, ...]
    tolerance: Tolerance = field(default_factory=Tolerance)
    dwell: float = 0.0
    group: str | None = None

    def __post_init__(self) -> None:
        if not self.alternatives:
            raise InvalidGoal(f"goal {self.id!r} has neither a configuration nor a pose")
        if not (np.isfinite(self.dwell) and self.dwell >= 0.0):
            raise InvalidGoal(f"goal {self.id!r}: dwell is {self.dwell}; it must be 0 or more")


@dataclass(frozen=True, slots=True, eq=False)
class TourProblem:
    """Goals to be visited in the order that takes the least time.

    Args:
        robot: The arm with its geometry.
        scene: The obstacles; the frame "tool" is where the tool is at the start.
        goals: 2 to 500 goals.
        start: Where the tour begins, shape (n,) [rad or m]; None for any goal.
        end: "any" goal, back at the "start", or a configuration (n,).
        precedence: Pairs of names, of goals or groups: the first is visited before the second.
        margin: Distance to keep from obstacles beyond their own margins [m].
        start_state_tolerance: A configuration this little outside a limit is snapped onto it
            [rad or m]; None for what a measured start may miss, and a goal by rounding.
        constraints: What every leg has to hold at every instant; their clearance raises the margin.

    Raises:
        InvalidGoal: Too few or too many goals, two of one name, an unknown name, or an order that
            contradicts itself; the message names the goals.
        InvalidRobotState: A joint vector has the wrong length or is not finite.
    """

    robot: RobotGeometry
    scene: Scene
    goals: tuple[TourGoal, ...]
    start: Array | None = None
    end: Literal["any", "start"] | Array = "any"
    precedence: tuple[tuple[str, str], ...] = ()
    margin: float = 0.0
    start_state_tolerance: float | None = None
    constraints: ConstraintSet | None = None

    def __post_init__(self) -> None:
        chain = self.robot.chain
        if self.constraints is not None:
            object.__setattr__(self, "margin", max(self.margin, self.constraints.margin))
        if not 2 <= len(self.goals) <= MAX_GOALS:
            raise InvalidGoal(
                f"a tour has {len(self.goals)} goal(s); it takes 2 to {MAX_GOALS}",
                hint="Plan a single motion by plan, and split longer tours by groups.",
            )
        if self.start is not None:
            start = chain.state(self.start, "start.joints")
            object.__setattr__(self, "start", frozen(start))
            object.__setattr__(self, "scene", place(self.scene, chain, start))
        if not isinstance(self.end, str):
            end = chain.state(self.end, "end.joints")
            object.__setattr__(self, "end", frozen(end))
        elif self.end == "start" and self.start is None:
            raise InvalidGoal(
                "the tour is to end at its start, and no start is given",
                hint="Give a start, or let the tour end at any goal.",
            )
        for i, goal in enumerate(self.goals):
            for alternative in goal.alternatives:
                if isinstance(alternative, JointGoal):
                    chain.state(alternative.joints, f"goals[{i}].joints")
        check_order(self.names, self.groups, self.precedence)

    @property
    def names(self) -> Sequence[str]:
        """Names of the goals."""
        return [goal.id for goal in self.goals]

    @property
    def groups(self) -> Sequence[str | None]:
        """Groups of the goals."""
        return [goal.group for goal in self.goals]


def _quick_options() -> Options:
    return Options(clearance=PreferredClearance(0.0))


@dataclass(frozen=True, slots=True)
class TourOptions:
    """Options of planning a tour.

    Args:
        planning: Of every leg; its timeout is that of the whole tour, its seed that of all. Legs
            keep no preferred clearance where none is asked for: it costs time, and the tour is to
            take the least.
        rounds: Rounds of search and proof after the first tour that is proved.
        leg_timeout: Longest that one leg is planned [s]; planners end before it on all but very
            slow machines, after a number of edges.
        allow_partial: Whether a tour that leaves goals out is an answer.

    Raises:
        InvalidGoal: A value is out of its range.
    """

    planning: Options = field(default_factory=_quick_options)
    rounds: int = 20
    leg_timeout: float = 10.0
    allow_partial: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.rounds <= MAX_ROUNDS:
            raise InvalidGoal(f"rounds is {self.rounds}; it must be from 0 to {MAX_ROUNDS}")
        if not self.leg_timeout > 0.0:
            raise InvalidGoal(f"leg_timeout is {self.leg_timeout}; it must be positive")

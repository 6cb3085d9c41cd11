"""Tours to be planned: goals with alternatives, an order that some of them need, two ends."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from typing import Literal

import numpy as np

from kinematics.arrays import Array, Indices, frozen
from kinematics.errors import InvalidGoal
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.placement import place
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.options import Options
from planning.problem import Goal, JointGoal
from planning.reach.evaluation import Tolerance
from planning.values.preferences import PreferredClearance

Pairs = Sequence[tuple[str, str]]
#: Configurations of all goals together: tables of their times take 130 megabytes.
MAX_CONFIGURATIONS = 4_000


@dataclass(frozen=True, slots=True, eq=False)
class TourGoal:
    """One goal of a tour: any of several configurations and poses, and a stay there.

    Args:
        id: Name of the object.
        alternatives: Any one of these is to be reached.
        tolerance: Deviations that the tool may have from poses, as free axes do.
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
        start: Beginning of the tour, shape (n,) [rad or m]; None for any goal.
        end: "any" goal, back at the "start", or a configuration (n,).
        precedence: Pairs of names, of goals or groups: the first is visited before the second.
        margin: Distance to keep from obstacles beyond their own margins [m].
        start_state_tolerance: A configuration this little outside a limit is snapped onto it
            [rad or m]; None for what a measured start may miss, and a goal by rounding.
        constraints: Constraints that every leg has to hold at every instant; their clearance raises
            the margin.

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
        # Goals of one tour.
        max_goals = 500
        if not 2 <= len(self.goals) <= max_goals:
            raise InvalidGoal(
                f"a tour has {len(self.goals)} goal(s); it takes 2 to {max_goals}",
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


@dataclass(frozen=True, slots=True)
class TourOptions:
    """Options of planning a tour.

    Args:
        planning: Options of every leg; its timeout is that of the whole tour, its seed that of all.
            Legs keep no preferred clearance where none is asked for: it costs time, and the tour is
            to take the least.
        rounds: Rounds of search and proof after the first tour that is proved.
        leg_timeout: Longest that one leg is planned [s]; planners end before it on all but very
            slow machines, after a number of edges.
        allow_partial: Whether a tour that leaves goals out is an answer.

    Raises:
        InvalidGoal: A value is out of its range.
    """

    planning: Options = field(default_factory=lambda: Options(clearance=PreferredClearance(0.0)))
    rounds: int = 20
    leg_timeout: float = 10.0
    allow_partial: bool = False

    def __post_init__(self) -> None:
        # Rounds of search and proof that can be asked for.
        max_rounds = 1_000
        if not 0 <= self.rounds <= max_rounds:
            raise InvalidGoal(f"rounds is {self.rounds}; it must be from 0 to {max_rounds}")
        if not self.leg_timeout > 0.0:
            raise InvalidGoal(f"leg_timeout is {self.leg_timeout}; it must be positive")


def check_order(names: Sequence[str], groups: Sequence[str | None], precedence: Pairs) -> None:
    """Check that there is an order of the goals that keeps all rules.

    Args:
        names: Names of the goals, shape (m,).
        groups: Group of each goal, shape (m,).
        precedence: Pairs of goals or groups, the first before the second.

    Raises:
        InvalidGoal: A name stands twice or is unknown, or the rules contradict each other; the
            message names the goals of the cycle.
    """
    numbers: dict[str, int] = {}
    for i, name in enumerate(names):
        if name in numbers:
            raise InvalidGoal(
                f"goals[{numbers[name]}] and goals[{i}] have the same id {name!r}",
                hint="Give every goal an id of its own, or leave the ids out.",
                id=name,
                indices=[numbers[name], i],
            )
        numbers[name] = i
    for group in groups:
        if group is not None and group in numbers:
            raise InvalidGoal(
                f"{group!r} is the id of goals[{numbers[group]}] and the name of a group",
                hint="Rename one of them: precedence names both.",
            )
    known = {*names, *(group for group in groups if group is not None)}
    for i, pair in enumerate(precedence):
        for name in pair:
            if name not in known:
                raise InvalidGoal(
                    f"precedence[{i}] names {name!r}, which is neither a goal nor a group",
                    hint="Name goals by their id, or by their number as a string without ids.",
                )
    cycle = _cycle(names, groups, goal_pairs(names, groups, precedence))
    if cycle:
        raise InvalidGoal(
            f"no order keeps the precedence: {' before '.join(cycle)}",
            hint="Remove one pair of the cycle; goals of a group are visited one after another.",
            cycle=list(cycle),
        )


def goal_pairs(
    names: Sequence[str], groups: Sequence[str | None], precedence: Pairs
) -> list[tuple[int, int]]:
    """Pairs of goals, the first before the second, with groups replaced by their goals.

    Args:
        names: Names of the goals, shape (m,).
        groups: Group of each goal, shape (m,).
        precedence: Pairs of goals or groups.
    """
    members: dict[str, list[int]] = {}
    for i, (name, group) in enumerate(zip(names, groups, strict=True)):
        members.setdefault(name, []).append(i)
        if group is not None:
            members.setdefault(group, []).append(i)
    pairs = {(a, b) for x, y in precedence for a in members[x] for b in members[y]}
    return sorted(pairs)


def precedence_table(pairs: Sequence[tuple[int, int]], stops: int) -> tuple[Indices, Indices]:
    """Place at which the followers of each stop begin, and these in rows of one array.

    Args:
        pairs: Numbers of stops, the first before the second.
        stops: How many stops there are, start and end among them.
    """
    rows = sorted(pairs)
    count = np.bincount(np.array([a for a, _ in rows], dtype=np.int64), minlength=stops)
    first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    return first, np.array([b for _, b in rows], dtype=np.int64)


def group_numbers(groups: Sequence[str | None]) -> Indices:
    """Number of each goal's group, a number of its own for a goal without one, shape (m,)."""
    numbers: dict[str, int] = {}
    count = len(groups)
    answer = []
    for i, group in enumerate(groups):
        answer.append(i if group is None else numbers.setdefault(group, count + len(numbers)))
    return np.array(answer, dtype=np.int64)


def _cycle(
    names: Sequence[str], groups: Sequence[str | None], pairs: Sequence[tuple[int, int]]
) -> Sequence[str]:
    """Names along a cycle of goals inside their groups, or of groups among each other.

    The first one stands at the end again; empty where there is none.
    """
    order: TopologicalSorter[str] = TopologicalSorter()
    for a, b in pairs:
        inside = groups[a] is not None and groups[a] == groups[b]
        before, after = (names[k] if inside else groups[k] or names[k] for k in (a, b))
        order.add(before)
        order.add(after, before)
    try:
        order.prepare()
    except CycleError as found:
        return tuple(found.args[1])
    return ()

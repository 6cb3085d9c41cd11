"""One planner at one problem: a rung of the ladder, whichever it is."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from kinematics.errors import InvalidOption
from obstacles.checker import Checker
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.goal_region import GoalRegion
from planning.constrained.projected_rrt import Manifold, MoreGoals, connect
from planning.deadline import Deadline
from planning.field.planner import QUICK, FieldOptions, potential_field
from planning.optimize.options import OPTIMIZE
from planning.options import Options
from planning.problem import PoseGoal, Problem
from planning.ready import Ready
from planning.result import Attempt, Descent
from planning.sampling.planners import PLANNERS as SAMPLING_PLANNERS
from planning.sampling.planners import checked
from planning.sampling.search import sample
from planning.search.rrt_connect import grow
from planning.search.straight_line import straight_line

PLANNERS = (
    "auto", "straight_line", "potential_field", "cartesian", OPTIMIZE, *SAMPLING_PLANNERS,
)  # fmt: skip

#: Share of the time that is left, and goals (the nearest), that the ladder's field may spend.
_FIELD_SHARE = 0.1
_FIELD_GOALS = 2
#: Edges after which the ladder's own trees give way to OMPL's, and those grown in the hulls of the
#: robot's solids to such as are grown with its exact pieces.
_MOST_EDGES = 200_000
_MOST_EDGES_IN_HULLS = 20_000


def check_options(options: Options) -> None:
    """Check the planner's name and its own options before any work is done.

    Raises:
        InvalidOption: There is no such planner or option, or a value is out of its range.
    """
    planner, given = options.planner, options.planner_options
    if planner not in PLANNERS:
        raise InvalidOption(
            f"there is no planner {planner!r}",
            hint=f"Choose one of: {', '.join(PLANNERS)}.",
            planners=list(PLANNERS),
        )
    if planner in ("auto", "straight_line", "cartesian"):
        if given:
            raise InvalidOption(
                f"planner {planner!r} has no options",
                hint="Name the planner that planner_options are for.",
            )
    elif planner == "potential_field":
        FieldOptions.of(given)
    else:
        checked(planner, given)


@dataclass(frozen=True, slots=True)
class Rung:
    """One planner at one problem.

    Args:
        planner: Its name.
        problem: What is to be planned.
        ready: Start, goals and what is noted of them.
        checker: Proves motions free.
        options: What the request says; its planner options belong to the planner it names.
        deadline: When to stop.
    """

    planner: str
    problem: Problem
    ready: Ready
    checker: Checker
    options: Options
    deadline: Deadline

    def run_planner(self) -> Attempt:
        """Run the planner."""
        if self.planner == "straight_line":
            return self._straight_line()
        if self.planner == "potential_field":
            return self._field()
        return self._sample()

    def _straight_line(self) -> Attempt:
        waypoints, motions = straight_line(self.checker, self.ready.start, self.ready.goals)
        if waypoints is not None or motions[0].pair is None:
            return Attempt(waypoints, "Proved free.")
        return Attempt(None, f"Blocked: {motions[0].pair[0]} and {motions[0].pair[1]}.")

    def _field(self) -> Attempt:
        if isinstance(self.checker, ConstrainedChecker) and self.options.planner == "auto":
            return Attempt(None, "Left out: its forces know nothing of constraints.")
        alone = self.options.planner != "auto"
        parameters = FieldOptions.of(self.options.planner_options) if alone else QUICK
        share = 1.0 if alone else _FIELD_SHARE
        goals = self.ready.goals if alone else self.ready.goals[:_FIELD_GOALS]
        found = potential_field(
            self.problem.robot, self.checker, self.problem.scene, self.ready.start, goals,
            parameters, self.options.seed, Deadline.after(share * self.deadline.remaining),
        )  # fmt: skip
        descent = Descent(found.visited, found.potentials, found.iterations)
        if found.waypoints is not None:
            return Attempt(found.waypoints, found.detail, descent=descent)
        details = {
            "joints": found.visited[-1].tolist(),
            "potential": float(found.potentials[-1]),
            "iterations": found.iterations,
        }
        return Attempt(None, found.detail, details=details)

    def _more_goals(self, checker: ConstrainedChecker) -> MoreGoals | None:
        poses = tuple(goal for goal in self.problem.goals if isinstance(goal, PoseGoal))
        return GoalRegion(checker, poses).near if poses else None

    def _sample(self) -> Attempt:
        if isinstance(self.checker, ConstrainedChecker) and self.planner == "rrt_connect":
            way, walks = connect(
                Manifold(self.checker), self.ready.start, self.ready.goals, self.options.seed,
                self.deadline, self._more_goals(self.checker),
            )  # fmt: skip
            return Attempt(way, f"{walks} walks along the constraints.")
        if self.options.planner == "auto":
            return self._grow()
        return self._by_name(self.options.planner_options)

    def _grow(self) -> Attempt:
        """The ladder's own trees, and OMPL's where they do not meet."""
        exact = self.checker is self.ready.checkers[-1]
        found = grow(
            self.checker, self.ready.start, self.ready.goals, self.options.seed, self.deadline,
            _MOST_EDGES if exact else _MOST_EDGES_IN_HULLS,
        )  # fmt: skip
        detail = f"{found.edges} edges checked"
        detail += "." if found.runs == 1 else f" in {found.runs} runs."
        if found.waypoints is not None or self.deadline.passed or not exact:
            return Attempt(found.waypoints, detail)
        other = self._by_name({})
        return replace(other, detail=f"{detail} OMPL: {other.detail}")

    def _by_name(self, options: Mapping[str, Any]) -> Attempt:
        return sample(
            self.planner, self.problem.robot.chain, self.checker, self.ready.start,
            self.ready.goals, options, self.options.seed, self.deadline,
        )  # fmt: skip

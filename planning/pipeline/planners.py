"""Planners by name, and the cascade that plans where none is named."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from kinematics.errors import InvalidOption
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.projected_rrt import ProjectedRrt
from planning.field.options import FieldOptions
from planning.field.planner import PotentialField
from planning.options import Options
from planning.planner import Planner, Query
from planning.problem import Problem
from planning.result import Attempt
from planning.sampling.planners import PLANNERS as OMPL_PLANNERS
from planning.sampling.search import OmplPlanner
from planning.search.rrt_connect import RrtConnect
from planning.search.straight_line import StraightLine
from planning.tool_paths.planner import Cartesian
from planning.values.optimize_options import OPTIMIZE


@dataclass(frozen=True, slots=True)
class ByConstraints:
    """Two planners of one name, one of them for paths under constraints.

    Args:
        free: Plans where no constraint holds along the path.
        constrained: Plans where one does.
    """

    free: Planner
    constrained: Planner

    @property
    def name(self) -> str:
        """Name of the first planner."""
        return self.free.name

    @property
    def needs_goals(self) -> bool:
        """Whether one of them needs goal configurations."""
        return self.free.needs_goals or self.constrained.needs_goals

    def plan(self, query: Query) -> Attempt:
        """Search with the planner that suits the checker."""
        constrained = isinstance(query.checker, ConstrainedChecker)
        return (self.constrained if constrained else self.free).plan(query)


#: Planners tried in turn where none is named.
CASCADE: tuple[Planner, ...] = (
    StraightLine(),
    ByConstraints(
        RrtConnect(fallback=OmplPlanner.of("rrt_connect", {})), ProjectedRrt("rrt_connect")
    ),
)


def choose_fallback(options: Options) -> tuple[Planner, ...]:
    """Return the planner of OMPL's that a potential field falls back on; none of other planners.

    Args:
        options: The planner's name and its options.

    Raises:
        InvalidOption: OMPL has no planner of that name, or an option is wrong.
    """
    if options.planner != "potential_field":
        return ()
    name = FieldOptions.of(options.planner_options).fallback
    if name is None:
        return ()
    if name not in OMPL_PLANNERS:
        raise InvalidOption(
            f"planner_options.fallback: OMPL has no planner {name!r}",
            hint=f"Choose one of: {', '.join(OMPL_PLANNERS)}; or null for none.",
            planners=list(OMPL_PLANNERS),
        )
    return (_ompl_planner(name, {}),)


def with_reserve(planners: tuple[Planner, ...]) -> tuple[Planner, ...]:
    """Planners that lead the tool, with more of its tolerance left to the proof; none of others."""
    # Part of the tolerance that the second search uses: proofs miss by a few percent.
    return tuple(replace(one, share=0.6) for one in planners if isinstance(one, Cartesian))


def _ompl_planner(name: str, options: Mapping[str, Any]) -> Planner:
    """One of OMPL's planners; RRT-Connect has a projected one for paths under constraints."""
    planner = OmplPlanner.of(name, options)
    return ByConstraints(planner, ProjectedRrt(name)) if name == "rrt_connect" else planner


#: Names of all planners.
PLANNERS = ("auto", "straight_line", "potential_field", "cartesian", OPTIMIZE, *OMPL_PLANNERS)


def choose_planners(problem: Problem, options: Options) -> tuple[Planner, ...]:
    """Return the planners to be tried in turn, with their options checked.

    Args:
        problem: What is to be planned.
        options: The planner's name and its options.

    Raises:
        InvalidOption: There is no such planner or option, or a value is out of its range.
        InvalidGoal: The planner does not take goals like those of the problem.
    """
    name = options.planner
    if name not in PLANNERS:
        raise InvalidOption(
            f"there is no planner {name!r}",
            hint=f"Choose one of: {', '.join(PLANNERS)}.",
            planners=list(PLANNERS),
        )
    if name in OMPL_PLANNERS:
        return (_ompl_planner(name, options.planner_options),)
    if name == "potential_field":
        return (PotentialField(FieldOptions.of(options.planner_options)),)
    if options.planner_options:
        raise InvalidOption(
            f"planner {name!r} has no options",
            hint="Name the planner that planner_options are for.",
        )
    if name == "cartesian":
        return (Cartesian.of(problem, options),)
    return (StraightLine(),) if name == "straight_line" else CASCADE

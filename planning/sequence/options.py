"""Options of the search for the stages of a task."""

from collections.abc import Callable
from dataclasses import dataclass, field

from planning.sequence.result import SequencePlan
from planning.values.goal_costs import GoalCosts


@dataclass(frozen=True, slots=True)
class TaskOptions:
    """Options of the search.

    Args:
        timeout: Seconds for everything.
        improve: Seconds to look for a shorter answer after the first one.
        allow_partial: Whether the first stages are an answer where not all can be done.
        observer: Called with the share of the work that is done, from 0 to 1, and the stage.
        offer: Called with each proved answer that is the best so far.
        goal_costs: Weights by which configurations of poses are chosen.
    """

    timeout: float = 5.0
    improve: float = 0.0
    allow_partial: bool = False
    observer: Callable[[float, str], None] | None = field(default=None, repr=False, compare=False)
    offer: "Callable[[SequencePlan], None] | None" = field(default=None, repr=False, compare=False)
    goal_costs: GoalCosts = field(default_factory=GoalCosts)

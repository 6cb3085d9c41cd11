"""Batches of planning problems: requests and answers."""

from typing import Annotated, Any, Self

from pydantic import Field

from armwright_client.base import (
    Answer,
    NonNegative,
    Options,
    Positive,
    Request,
)
from armwright_client.certificate import Collisions, LimitValues
from armwright_client.check import AttachedObjects, FingerPositions
from armwright_client.clearance import Clearance, GoalCosts
from armwright_client.constraint import Constraints
from armwright_client.goal import Goal, GoalLike, Start, as_goal
from armwright_client.plan import Plan, PlanRequest, Timing
from armwright_client.planner import PlannerName
from armwright_client.problem import Problem
from armwright_client.scene import AllowedPairs, SceneReference


class BatchProblem(Request):
    """One of many problems; what is left out is taken from the batch, see `PlanOptions`."""

    robot: str | None = None
    start: Start | None = None
    goal: Goal | None = None
    scene: SceneReference | None = None
    frame: str | None = None
    planner: PlannerName | None = None
    planner_options: Options | None = None
    constraints: Constraints | None = None
    attached: AttachedObjects | None = None
    fingers: FingerPositions | None = None
    allowed_collisions: AllowedPairs | None = None
    margin: NonNegative | None = None
    clearance: Clearance | None = None
    goal_costs: GoalCosts | None = None
    collisions: Collisions | None = None
    start_state_tolerance: NonNegative | None = None
    timing: Timing | None = None
    limits: LimitValues | None = None
    timeout: Positive | None = None
    seed: int | None = None

    @classmethod
    def towards(cls, goal: "GoalLike", **given: Any) -> Self:
        """The way to a goal; `given` are other fields."""
        return cls.of(goal=as_goal(goal), **given)


class BatchRequest(BatchProblem):
    """Many problems, to be answered in order."""

    problems: list[PlanRequest | BatchProblem]


class BatchAnswer(Answer):
    """Result of each problem, in order.

    Args:
        results: A plan, or the problem document that says why there is none.
        succeeded: How many plans there are.
        failed: How many there are not.
    """

    results: list[Annotated[Plan | Problem, Field(union_mode="left_to_right")]]
    succeeded: int
    failed: int

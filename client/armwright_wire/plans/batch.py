"""Many planning problems in one request."""

from copy import copy
from typing import Any, ClassVar, Self, cast

from pydantic import ConfigDict, Field, create_model, model_validator
from pydantic.config import JsonDict
from pydantic.fields import FieldInfo

from armwright_wire.base import JOINTS_EXAMPLE, Answer, Body, Name, Timeout, Wire, is_given
from armwright_wire.goals.goal import Goal, GoalLike, Start, as_goal
from armwright_wire.plans.job import Problem
from armwright_wire.plans.plan import PlanAnswer, PlanRequest
from armwright_wire.scenes.scene import SceneReference

#: What every problem needs, from the batch or of its own.
_NEEDED = ("robot", "start", "goal")


class _Needs(Body):
    documented_by: ClassVar[tuple[type[Wire], ...]] = (PlanRequest,)

    robot: Name | None = Field(None, examples=["panda"])
    """name of a stored or built-in robot"""
    scene: SceneReference | None = Field(None, examples=["table"])
    start: Start | None = None
    goal: Goal | None = None
    timeout: Timeout | None = None
    """for all stages of one problem [s]"""

    @classmethod
    def towards(cls, goal: GoalLike, **given: Any) -> Self:
        """The way to a goal; `given` are other fields."""
        return cls.of(goal=as_goal(goal), **given)


def _optional(field: FieldInfo) -> tuple[Any, FieldInfo]:
    """A field of a plan that may be left out."""
    left_out = copy(field)
    left_out.default, left_out.default_factory = None, None
    left_out.annotation = cast(Any, field.annotation) | None
    return left_out.annotation, left_out


#: Fields that no check of a request looks at together with others, if it has both.
_ENDS = {"start", "goal"}
#: Answers of batches are kept as jobs, not one by one as plans.
_NOT_KEPT = "keep"
_FIELDS: dict[str, Any] = {
    name: _optional(field)
    for name, field in PlanRequest.model_fields.items()
    if name not in _Needs.model_fields and name != _NOT_KEPT
}

#: Whatever a plan takes, nothing of it required.
PartialPlan: type[_Needs] = create_model(
    "PartialPlan",
    __base__=_Needs,
    __module__=__name__,
    __doc__="A motion to be planned; what is left out is taken from the batch.",
    **_FIELDS,
)


def as_part(problem: PlanRequest | PartialPlan) -> PartialPlan:
    """A problem as a batch takes it, of a request for one plan perhaps."""
    if isinstance(problem, PartialPlan):
        return problem
    return PartialPlan(**_fields(problem))


def _given_somewhere(name: str) -> JsonDict:
    """The JSON schema of batches in which a field is given once, or with each problem."""
    each: JsonDict = {"properties": {"problems": {"items": is_given(name)}}}
    return {"anyOf": [is_given(name), each]}


class BatchRequest(PartialPlan):
    """Many motions to be planned; what stands beside `problems` holds for each that lacks it."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "robot": "panda",
                    "scene": "table",
                    "start": {"joints": [*JOINTS_EXAMPLE]},
                    "timeout": 5.0,
                    "problems": [
                        {"goal": {"joints": [0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]}},
                        {"goal": {"joints": [1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]}, "seed": 2},
                    ],
                }
            ],
            "allOf": [_given_somewhere(name) for name in _NEEDED],
        }
    )

    problems: list[PartialPlan] = Field(
        min_length=1, description="the motions to be planned, in the order of the answer"
    )

    @model_validator(mode="after")
    def _check_complete(self) -> "BatchRequest":
        for index, problem in enumerate(self.problems):
            for name in _NEEDED:
                if getattr(problem, name) is None and getattr(self, name) is None:
                    raise ValueError(
                        f"problems[{index}] has no {name}: give it there, or once for all of them"
                    )
        return self

    def plan_request(self, index: int, **changes: Any) -> PlanRequest:
        """A problem with what the batch gives for all of them."""
        return PlanRequest.model_validate(
            {**_fields(self), **_fields(self.problems[index]), **changes}
        )


class PlanRequests:
    """The problems of a batch as requests of their own, one after the other.

    Most problems of a batch differ by their ends alone: they are copies of one that was validated.

    Args:
        batch: The batch.
    """

    def __init__(self, batch: BatchRequest) -> None:
        self._batch = batch
        self._first: dict[frozenset[str], PlanRequest] = {}

    def __getitem__(self, index: int) -> PlanRequest:
        given = _fields(self._batch.problems[index])
        names = frozenset(given)
        if not names <= _ENDS:
            return self._batch.plan_request(index)
        first = self._first.get(names)
        if first is None:
            first = self._first[names] = self._batch.plan_request(index)
        return first.model_copy(update=given)


def _fields(part: Body) -> dict[str, Any]:
    values, names = vars(part), PlanRequest.model_fields
    return {
        name: values[name]
        for name in part.model_fields_set
        if values[name] is not None and name in names and name != _NOT_KEPT
    }


class BatchAnswer(Answer):
    """Results of the problems, in the order of the request."""

    results: list[PlanAnswer | Problem]
    """the plan, whose status is "success", or the problem document, whose status is a number"""
    succeeded: int
    """number of problems that were answered with a plan"""
    failed: int
    """number of problems that were answered with a problem document"""

"""The kinds of problems: what the `type` of a problem document points to."""

from pydantic import Field

from armwright_wire.base import Answer
from service.http.errors import KINDS
from service.http.json_route import json_router
from service.problem import ProblemError

router = json_router("problems", "/v1/problems")


class ProblemKind(Answer):
    """One kind of problem."""

    code: str = Field(examples=["GOAL_IN_COLLISION"], description="of the problem")
    status: int = Field(examples=[422], description="the usual HTTP status")
    title: str = Field(
        examples=["The goal configuration is in collision"],
        description="the kind of problem in words",
    )
    cure: str = Field(description="what can be done about it, beside the hint of the occurrence")


class ProblemKinds(Answer):
    """All kinds of problems."""

    problems: list[ProblemKind] = Field(description="all there are")


@router.get("", summary="All kinds of problems")
async def list_problems() -> ProblemKinds:
    """Every code that an error can carry."""
    return ProblemKinds(problems=[_kind(code) for code in KINDS])


@router.get("/{code}", summary="One kind of problem")
async def get_problem(code: str) -> ProblemKind:
    """Description of a problem's code."""
    if code not in KINDS:
        raise ProblemError(
            "NOT_FOUND",
            f"there is no kind of problem named {code!r}",
            hint="GET /v1/problems lists those there are.",
        )
    return _kind(code)


def _kind(code: str) -> ProblemKind:
    kind = KINDS[code]
    return ProblemKind(code=code, status=kind.status, title=kind.title, cure=kind.hint)

"""A check for schemathesis: what follows the schema is answered, or refused for a stated reason.

Schemathesis takes every refusal of a body that follows the schema for a fault of the schema. The
reasons below are what OpenAPI can't say: what is stored, what a robot has, what several fields
mean together. Whatever OpenAPI can say (types, names, ranges, lengths) is no reason here, so a
schema that allows too much is found.
"""

import re
from typing import Any
from uuid import uuid4

import schemathesis
from schemathesis import Case, CheckContext, HookContext, Response

#: Codes of problems that depend on more than the form of a request, and why.
REASONS = {
    "INVALID_ROBOT_STATE": "how many joints there are depends on the robot",
    "INVALID_ROBOT_DESCRIPTION": "texts in URDF, SRDF and YAML have grammars of their own",
    "INVALID_SCENE": "solids must have a volume; texts of MoveIt have a grammar of their own",
    "INVALID_GOAL_CONSTRAINTS": "links and joints depend on the robot",
    "INVALID_LINK_NAME": "links depend on the robot",
    "INVALID_OBJECT_NAME": "objects depend on the scene",
    "INVALID_GROUP_NAME": "groups depend on the robot",
    "INVALID_REQUEST": "what can be asked depends on the robot",
    "INVALID_MOTION_PLAN": "a motion of the caller may not be continuous",
    "MISSING_LIMIT": "which limits there are depends on the robot",
    "MISSING_INERTIA": "which inertias there are depends on the robot",
    "START_STATE_INVALID": "limits depend on the robot",
    "GOAL_STATE_INVALID": "limits depend on the robot",
    "START_STATE_IN_COLLISION": "depends on robot and scene",
    "GOAL_IN_COLLISION": "depends on robot and scene",
    "START_STATE_VIOLATES_PATH_CONSTRAINTS": "depends on robot and constraints",
    "GOAL_VIOLATES_PATH_CONSTRAINTS": "depends on robot and constraints",
    "NO_IK_SOLUTION": "depends on the robot",
    "PLANNING_FAILED": "there may be no motion",
    "OUT_OF_MEMORY": "what a request takes is not seen in its form",
    "PRECONDITION_FAILED": "depends on what is stored",
    "PAYLOAD_TOO_LARGE": "schemas have no size of a whole",
    "METHOD_NOT_ALLOWED": "built-in robots are read only",
    "TIMED_OUT": "the deadline that was asked for passed",
    "STORAGE_UNAVAILABLE": "not ready for a moment",
}
#: What plans motions, or asks about states before it does.
_OF_MOTIONS = (
    "/v1/plan", "/v1/plan/batch", "/v1/plans", "/v1/plans/{id}/replay", "/v1/tasks", "/v1/tours",
    "/v1/robots/{name}/potential", "/v1/robots/{name}/ik", "/v1/robots/{name}/reach",
)  # fmt: skip
#: The only operations that may be refused for some of the reasons; others for all operations.
ONLY: dict[str, tuple[str, ...]] = {
    "INVALID_ROBOT_DESCRIPTION": ("/v1/robots", "/v1/robots/{name}", "/v1/convert"),
    "START_STATE_INVALID": (*_OF_MOTIONS, "/v1/simulate"),
    "GOAL_STATE_INVALID": _OF_MOTIONS,
    "START_STATE_IN_COLLISION": _OF_MOTIONS,
    "GOAL_IN_COLLISION": _OF_MOTIONS,
    "START_STATE_VIOLATES_PATH_CONSTRAINTS": _OF_MOTIONS,
    "GOAL_VIOLATES_PATH_CONSTRAINTS": _OF_MOTIONS,
    "NO_IK_SOLUTION": _OF_MOTIONS,
    "PLANNING_FAILED": _OF_MOTIONS,
    "METHOD_NOT_ALLOWED": ("/v1/robots/{name}",),
    "STORAGE_UNAVAILABLE": ("/readyz",),
}
#: Header of requests that may be refused for what is stored.
_CONDITION = "if-match"
#: Smallest body that may be too large [byte].
_LARGE = 65_536
#: Operations that take parts of other requests, whose form depends on what is kept.
OF_KEPT_PLANS = ("/v1/plans", "/v1/plans/{id}/replay")
#: What a schema can say. All other words are of rules of several fields, or of the longest deadline
#: that a server allows.
_SCHEMA_WORDS = re.compile(
    r"unknown field|field is required|Input should|at (least|most) \d+ (item|character)"
    r"|valid (string|number|integer|list|dictionary|boolean)"
    r"|exactly one of|give both or neither|give it there, or once|belongs to two states",
)


#: JSON Schema takes 1.0 for an integer. Here integers are written without a point or an exponent,
#: as everywhere in strict JSON; no schema can say that.
_WHOLE_NUMBER = "Input should be a valid integer"


@schemathesis.hook  # type: ignore[untyped-decorator, unused-ignore]
def before_call(context: HookContext, case: Case, kwargs: dict[str, Any]) -> None:  # noqa: ARG001
    """Give each request with an idempotency key one of its own.

    Keys are drawn from a few; a key that was used before is refused, whatever the request says, and
    nothing of it would be tried.
    """
    if case.headers and case.meta is not None and case.meta.generation.mode.is_positive:
        for name in [name for name in case.headers if name.lower() == "idempotency-key"]:
            case.headers[name] = uuid4().hex


@schemathesis.check  # type: ignore[untyped-decorator, unused-ignore]
def refused_for_a_stated_reason(_: CheckContext, response: Response, case: Case) -> None:
    """A request that follows the schema is answered or refused for one of the reasons."""
    meta = case.meta
    if meta is None or not meta.generation.mode.is_positive or response.status_code < 400:
        return
    if response.status_code in (401, 403, 404, 409, 429):
        return
    problem = response.json()
    code, detail = problem["code"], problem["detail"]
    of_kept_plans = case.operation.path in OF_KEPT_PLANS and code == "VALIDATION_ERROR"
    if (code in REASONS and _may_have(code, response, case)) or of_kept_plans:
        return
    if code == "VALIDATION_ERROR" and not _SCHEMA_WORDS.search(detail.replace(_WHOLE_NUMBER, "")):
        return
    raise AssertionError(f"{code} is no stated reason to refuse this: {detail}")


def _may_have(code: str, response: Response, case: Case) -> bool:
    """Whether this request, of all requests, may be refused for a reason."""
    if code == "PRECONDITION_FAILED":
        return any(name.lower() == _CONDITION for name in response.request.headers)
    if code == "PAYLOAD_TOO_LARGE":
        return len(response.request.body or b"") >= _LARGE
    return case.operation.path in ONLY.get(code, (case.operation.path,))


@schemathesis.check  # type: ignore[untyped-decorator, unused-ignore]
def faults_of_the_server_are_none(_: CheckContext, response: Response, case: Case) -> None:
    """No answer is a fault of the server; a deadline that passed (504) and 503 are not."""
    assert response.status_code < 500 or response.status_code in (503, 504), response.text[:500]
    assert case is not None

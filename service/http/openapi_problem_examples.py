"""One example of each kind of problem, in the OpenAPI document.

They stand once, in the document's components; every error answer refers to those that it may be.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

from service.http.cures import CURES
from service.http.errors import KINDS, document
from service.problem import ProblemError


class _Occurrence(NamedTuple):
    """One occurrence of a problem, beside its title and cure."""

    instance: str
    stage: str
    detail: str
    details: dict[str, Any]


def _occurrence(instance: str, stage: str, detail: str, **details: Any) -> _Occurrence:
    return _Occurrence(instance, stage, detail, details)


_PLAN = "/v1/plan"
#: By code.
_OCCURRENCES = {
    "START_STATE_IN_COLLISION": _occurrence(
        _PLAN, "start", "at the start, 'panda_hand' and 'shelf' overlap by 0.012 m",
        pair=["panda_hand", "shelf"], depth=0.012,
    ),
    "GOAL_IN_COLLISION": _occurrence(
        _PLAN, "goal", "at the goal, 'panda_hand' and 'shelf' overlap by 0.012 m",
        pair=["panda_hand", "shelf"], depth=0.012,
    ),
    "START_STATE_INVALID": _occurrence(
        _PLAN, "start", "start: joint 'panda_joint4' is at 0.2, outside -3.0718 to -0.0698",
        joint="panda_joint4", value=0.2,
    ),
    "GOAL_STATE_INVALID": _occurrence(
        _PLAN, "goal", "goal: joint 'panda_joint4' is at 0.2, outside -3.0718 to -0.0698",
        joint="panda_joint4", value=0.2,
    ),
    "START_STATE_VIOLATES_PATH_CONSTRAINTS": _occurrence(
        _PLAN, "start", "the tool is tilted by 0.31 rad at the start, 0.1 rad are allowed"
    ),
    "GOAL_VIOLATES_PATH_CONSTRAINTS": _occurrence(
        _PLAN, "goal", "the tool is tilted by 0.31 rad at the goal, 0.1 rad are allowed"
    ),
    "NO_IK_SOLUTION": _occurrence(
        "/v1/robots/ur5e/ik", "inverse_kinematics",
        "no configuration brings 'tool0' to the pose: the nearest attempt stays 0.142 m away",
    ),
    "PLANNING_FAILED": _occurrence(
        _PLAN, "path", "rrt_connect found no path: the trees did not meet"
    ),
    "INVALID_MOTION_PLAN": _occurrence(
        "/v1/validate", "limits", "joint 'elbow_joint' exceeds its velocity limit at 0.41 s",
        joint="elbow_joint", time=0.41,
    ),
    "TIMED_OUT": _occurrence(_PLAN, "path", "the deadline of 2 s passed while a path was searched"),
    "INVALID_LINK_NAME": _occurrence(
        "/v1/robots/ur5e/fk", "request", "robot 'ur5e' has no link 'gripper'"
    ),
    "INVALID_OBJECT_NAME": _occurrence(
        "/v1/check", "scene", "the scene has no object named 'shelf'"
    ),
    "INVALID_GOAL_CONSTRAINTS": _occurrence(
        _PLAN, "goal", "goal: the quaternion of the pose has the norm 0"
    ),
    "INVALID_ROBOT_STATE": _occurrence(
        "/v1/robots/ur5e/fk", "request", "joints: 7 numbers, the robot has 6 joints"
    ),
    "CRASH": _occurrence(_PLAN, "worker", "the worker process died while it computed the answer"),
    "INVALID_ROBOT_DESCRIPTION": _occurrence(
        "/v1/robots", "urdf", "joint 'elbow' names the link 'forearm', which is missing"
    ),
    "INVALID_SCENE": _occurrence(
        "/v1/scenes", "scene", "obstacle 'table': size[2] is 0, it needs to be positive"
    ),
    "MISSING_LIMIT": _occurrence(
        _PLAN, "timing", "joint 'elbow_joint' has no acceleration limit", joint="elbow_joint"
    ),
    "MISSING_INERTIA": _occurrence(
        "/v1/robots/arm/dynamics", "dynamics", "link 'forearm' has no mass", link="forearm"
    ),
    "INVALID_REQUEST": _occurrence(
        "/v1/plan", "request", "the request has both Content-Length and Transfer-Encoding"
    ),
    "VALIDATION_ERROR": _occurrence(
        _PLAN, "request", "goal: is missing",
        errors=[{"path": "goal", "problem": "is missing"}], count=1,
    ),
    "IDEMPOTENCY_KEY_REUSED": _occurrence(
        "/v1/plan/batch", "request", "this Idempotency-Key came with another request before"
    ),
    "UNAUTHENTICATED": _occurrence(_PLAN, "request", "the request shows no API key"),
    "FORBIDDEN": _occurrence(
        "/v1/robots", "request",
        "this needs an API key of the scope admin; the one that was shown has read",
    ),
    "QUOTA_EXCEEDED": _occurrence("/v1/scenes", "storage", "this tenant has stored all it may"),
    "NOT_FOUND": _occurrence(
        "/v1/robots/ur5x", "request", "there is no robot named 'ur5x'"
    ),
    "METHOD_NOT_ALLOWED": _occurrence(_PLAN, "request", "/v1/plan does not have the method GET"),
    "REQUEST_TIMEOUT": _occurrence(_PLAN, "request", "the body did not arrive within 30 s"),
    "CONFLICT": _occurrence(
        "/v1/robots", "storage", "there already is a robot named 'example_arm'"
    ),
    "PRECONDITION_FAILED": _occurrence(
        "/v1/scenes/example_table", "storage", "the scene is not the one that If-Match names"
    ),
    "PAYLOAD_TOO_LARGE": _occurrence(
        "/v1/robots", "request", "the body is larger than 67108864 bytes"
    ),
    "UNSUPPORTED_MEDIA_TYPE": _occurrence(
        _PLAN, "request", "this endpoint takes JSON, not text/plain"
    ),
    "HOST_NOT_ALLOWED": _occurrence(
        _PLAN, "request", "this service does not answer for the host 'other.example'"
    ),
    "OUT_OF_MEMORY": _occurrence(_PLAN, "worker", "the worker needed more memory than it may take"),
    "OVERLOADED": _occurrence(_PLAN, "queue", "too many requests wait"),
    "NOT_READY": _occurrence("/readyz", "start", "the workers start"),
    "STORAGE_UNAVAILABLE": _occurrence(
        "/v1/robots", "storage", "the storage can't be used now: database is locked"
    ),
}  # fmt: skip


def components(codes: Iterable[str]) -> dict[str, Any]:
    """The examples, by code, as the document's components have them.

    Args:
        codes: Kinds of problems that answers of the document refer to.
    """
    return {code: {"summary": KINDS[code].title, "value": _problem(code)} for code in sorted(codes)}


def references(codes: Iterable[str]) -> dict[str, Any]:
    """The examples of one answer, by code.

    Args:
        codes: Kinds of problems that it may be.
    """
    return {code: {"$ref": f"#/components/examples/{code}"} for code in codes}


def _problem(code: str) -> dict[str, Any]:
    told = _OCCURRENCES[code]
    problem = ProblemError(code, told.detail, hint=CURES[code], stage=told.stage, **told.details)
    return document(problem, told.instance)

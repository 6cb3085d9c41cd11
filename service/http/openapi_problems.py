"""Problems that each operation may answer, by status, in the OpenAPI document, with examples."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from http import HTTPStatus
from typing import Any, NamedTuple

from service.http.errors import KINDS, PROBLEM_HINTS, PROBLEM_MEDIA_TYPE, document
from service.problem import ProblemError


class _Occurrence(NamedTuple):
    """One occurrence of a problem, beside its title and hint."""

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
    "CERTIFICATE_DISPUTED": _occurrence(
        _PLAN,
        "audit",
        "a second look by other code does not agree with the proof: frame of panda_link5",
    ),
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
    problem = ProblemError(
        code, told.detail, hint=PROBLEM_HINTS[code], stage=told.stage, **told.details
    )
    return document(problem, told.instance)


Operation = dict[str, Any]

#: Of every operation: keys, hosts, load, and what can happen to any server.
_ANYWHERE = (
    "UNAUTHENTICATED", "FORBIDDEN", "HOST_NOT_ALLOWED", "OVERLOADED", "CRASH", "NOT_READY",
    "STORAGE_UNAVAILABLE",
)  # fmt: skip
#: Of operations that take a body.
_BODY = ("VALIDATION_ERROR", "REQUEST_TIMEOUT", "PAYLOAD_TOO_LARGE", "UNSUPPORTED_MEDIA_TYPE")
#: Of operations that compute in a worker.
_COMPUTING = ("INVALID_REQUEST", "TIMED_OUT", "OUT_OF_MEMORY", "IDEMPOTENCY_KEY_REUSED", "CONFLICT")
_ROBOT = ("INVALID_ROBOT_STATE", "INVALID_LINK_NAME")
_SCENE = ("INVALID_SCENE", "INVALID_OBJECT_NAME")
_MOTION = (*_ROBOT, *_SCENE, "INVALID_MOTION_PLAN", "MISSING_LIMIT")
_PLANNING = (
    *_MOTION, "START_STATE_IN_COLLISION", "GOAL_IN_COLLISION", "START_STATE_INVALID",
    "GOAL_STATE_INVALID", "START_STATE_VIOLATES_PATH_CONSTRAINTS",
    "GOAL_VIOLATES_PATH_CONSTRAINTS", "NO_IK_SOLUTION", "PLANNING_FAILED",
    "INVALID_GOAL_CONSTRAINTS", "MISSING_INERTIA",
)  # fmt: skip
_DYNAMICS = (*_ROBOT, "MISSING_INERTIA")
_DESCRIPTION = ("INVALID_ROBOT_DESCRIPTION", "MISSING_LIMIT")
#: Shown where an answer may be any other fault of the request or of the service.
_ANY_OTHER = {"4XX": "METHOD_NOT_ALLOWED", "5XX": "CRASH"}
#: Of single operations, beside those of their form.
_MORE: dict[str, tuple[str, ...]] = {
    "create_robot": (*_DESCRIPTION, "QUOTA_EXCEEDED"),
    "change_robot": (*_DESCRIPTION, "CONFLICT", "PRECONDITION_FAILED"),
    "delete_robot": ("CONFLICT", "PRECONDITION_FAILED"),
    "get_robot": ("TIMED_OUT",),
    "get_urdf": ("TIMED_OUT", "INVALID_ROBOT_DESCRIPTION"),
    "get_srdf": ("TIMED_OUT",),
    "get_geometry": ("TIMED_OUT",),
    "create_scene": ("INVALID_SCENE", "QUOTA_EXCEEDED"),
    "put_scene": ("INVALID_SCENE", "QUOTA_EXCEEDED", "PRECONDITION_FAILED"),
    "delete_scene": ("PRECONDITION_FAILED",),
    "project": _SCENE,
    "fk": _ROBOT,
    "jacobian": _ROBOT,
    "velocity": _ROBOT,
    "wrench": _ROBOT,
    "ik": (*_ROBOT, *_SCENE, "NO_IK_SOLUTION", "INVALID_GOAL_CONSTRAINTS"),
    "check": (*_ROBOT, *_SCENE),
    "potential": (*_ROBOT, *_SCENE),
    "reach": (*_ROBOT, *_SCENE),
    "plan": (*_PLANNING, "CERTIFICATE_DISPUTED"),
    "plan_batch": (),
    "tour": _PLANNING,
    "validate": (*_MOTION, "CERTIFICATE_DISPUTED"),
    "export": _MOTION,
    "retime": ("INVALID_MOTION_PLAN", "MISSING_LIMIT", "INVALID_ROBOT_STATE"),
    "simplify": (*_ROBOT, *_SCENE, "INVALID_MOTION_PLAN"),
    "convert": ("INVALID_MOTION_PLAN",),
    "dynamics": _DYNAMICS,
    "forward_dynamics": _DYNAMICS,
    "regressor": _DYNAMICS,
    "equations": ("TIMED_OUT", "VALIDATION_ERROR"),
    "simulate": (*_DYNAMICS, *_SCENE, "INVALID_MOTION_PLAN", "MISSING_LIMIT"),
    "cancel_job": ("CONFLICT",),
    "import_plan": ("CONFLICT", "QUOTA_EXCEEDED"),
}


def add_problems(document: dict[str, Any]) -> None:
    """List the problems of every operation, by status, each with an example.

    Args:
        document: The OpenAPI document with its jobs and schemas; responses are added.
    """
    shown = set(_ANY_OTHER.values())
    for path, operations in document["paths"].items():
        for operation in operations.values():
            by_status = defaultdict(list)
            for code in sorted(set(_codes(path, operation))):
                by_status[KINDS[code].status].append(code)
            responses = operation["responses"]
            for status, codes in sorted(by_status.items()):
                response = responses.setdefault(str(status), _response(status, codes))
                response["content"][PROBLEM_MEDIA_TYPE]["examples"] = references(codes)
                shown |= set(codes)
            for pattern, code in _ANY_OTHER.items():  # the last word, as no status of its own
                if pattern in responses:
                    responses[pattern] = responses.pop(pattern)
                    content = responses[pattern]["content"]
                    responses[pattern]["content"] = {
                        kind: {**media, "examples": references([code])}
                        for kind, media in content.items()
                    }
    document["components"]["examples"] = components(shown)


def _codes(path: str, operation: Operation) -> Iterator[str]:
    """Codes of the problems that an operation may answer."""
    yield from _ANYWHERE
    yield from _MORE.get(operation["operationId"], ())
    if "{" in path:
        yield "NOT_FOUND"
    if "requestBody" in operation:
        yield from _BODY
        yield "NOT_FOUND"  # of a robot or a scene that the body names
    if "202" in operation["responses"]:
        yield from _COMPUTING


def _response(status: int, codes: list[str]) -> dict[str, Any]:
    """The answer of one status: its problems, and their schema."""
    lines = [f"* `{code}`: {KINDS[code].title}" for code in codes]
    return {
        "description": "\n".join([f"{HTTPStatus(status).phrase}", *lines]),
        "content": {PROBLEM_MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }

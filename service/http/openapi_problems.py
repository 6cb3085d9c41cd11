"""Problems that each operation may answer, by status, in the OpenAPI document, with examples."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from http import HTTPStatus
from typing import Any

from service.http.errors import KINDS, PROBLEM_MEDIA_TYPE, document
from service.problem import ProblemError


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
    kind = KINDS[code]
    assert kind.example is not None
    told = dict(kind.example)
    instance = told.pop("instance")
    problem = ProblemError(code, hint=kind.hint, **told.pop("details"), **told)
    return document(problem, instance)


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
    "fit": (*_ROBOT, "INVALID_MOTION_PLAN"),
    "simplify": (*_ROBOT, *_SCENE, "INVALID_MOTION_PLAN"),
    "convert": ("INVALID_MOTION_PLAN",),
    "dynamics": _DYNAMICS,
    "forward_dynamics": _DYNAMICS,
    "regressor": _DYNAMICS,
    "identify": _DYNAMICS,
    "calibrate": _ROBOT,
    "excitation": (*_ROBOT, *_SCENE, "MISSING_LIMIT", "START_STATE_INVALID", "PLANNING_FAILED"),
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

"""Problem documents: every kind, and details of any value as strict JSON."""

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.errors import ArmwrightError, InvalidScene
from service.http.errors import (
    KINDS,
    document,
    headers_of,
    plain,
    problem_of,
    problem_response,
    status_of,
)
from service.validation import ProblemError, from_fields, unexpected_fault
from tests.service.robots import FIELDS

#: Of the contract, by code.
STATUSES = {
    "TIMED_OUT": 504, "PREEMPTED": 409, "CRASH": 500, "CERTIFICATE_DISPUTED": 500,
    "UNAUTHENTICATED": 401, "NOT_FOUND": 404,
    "METHOD_NOT_ALLOWED": 405, "REQUEST_TIMEOUT": 408, "CONFLICT": 409, "PAYLOAD_TOO_LARGE": 413,
    "UNSUPPORTED_MEDIA_TYPE": 415, "OVERLOADED": 429, "NOT_READY": 503,
    "PRECONDITION_FAILED": 412, "HOST_NOT_ALLOWED": 421, "OUT_OF_MEMORY": 422,
    "STORAGE_UNAVAILABLE": 503, "FORBIDDEN": 403, "QUOTA_EXCEEDED": 403,
}  # fmt: skip


@pytest.mark.parametrize("code", KINDS)
def test_a_code_has_the_status_of_the_contract(code: str) -> None:
    made = document(ProblemError(code, "what is wrong"), "/v1/x")
    assert made["status"] == status_of(ProblemError(code, "")) == STATUSES.get(code, 422)
    assert made["type"] == f"/v1/problems/{code}"
    assert made["title"] == KINDS[code].title
    assert (made["code"], made["detail"], made["instance"]) == (code, "what is wrong", "/v1/x")
    assert (made["stage"], made["hint"], made["details"]) == (None, None, {})


def test_an_unlisted_code_is_a_fault_of_the_request() -> None:
    assert status_of(ProblemError("FROM_THE_FUTURE", "")) == 422
    assert document(ProblemError("FROM_THE_FUTURE", ""), "/")["title"]


def test_a_problem_may_have_another_status() -> None:
    assert status_of(ProblemError("PREEMPTED", "", status=499)) == 499


def test_a_problem_may_say_when_to_ask_again() -> None:
    assert headers_of(ProblemError("OVERLOADED", "")) == {}
    assert headers_of(ProblemError("OVERLOADED", "", retry_after=3)) == {"Retry-After": "3"}
    closing = ProblemError("PAYLOAD_TOO_LARGE", "", headers={"Connection": "close"}, retry_after=0)
    assert headers_of(closing) == {"Connection": "close", "Retry-After": "0"}


def test_a_fault_found_by_the_domain_keeps_its_words_and_values() -> None:
    error = InvalidScene("the box is flat", hint="Make it thicker.", obstacle="box", stage="scene")
    problem = problem_of(error)
    assert (problem.code, problem.detail, problem.hint) == (
        "INVALID_SCENE", "the box is flat", "Make it thicker.",
    )  # fmt: skip
    assert problem.stage == "scene"
    assert problem.details == {"obstacle": "box"}
    assert from_fields("X", "m", None, {1: 2}).details == {"1": 2}  # type: ignore[dict-item]


def test_every_error_of_the_domain_has_a_listed_code() -> None:
    pending, seen = [ArmwrightError], set()
    while pending:
        kind = pending.pop()
        pending += kind.__subclasses__()
        if kind.__module__.startswith(("kinematics", "planning", "obstacles", "dynamics")):
            seen.add(kind.code)
    assert len(seen) > 5
    assert seen <= KINDS.keys()


def test_a_fault_of_ours_names_a_reference_and_nothing_else(
    caplog: pytest.LogCaptureFixture,
) -> None:
    try:
        raise RuntimeError("secret")
    except RuntimeError:
        problem = unexpected_fault("GET /v1/x", index=3)
    made = json.dumps(document(problem, "/v1/x"))
    assert "secret" not in made
    assert problem.details["index"] == 3
    assert problem.details["reference"] in caplog.text
    assert "secret" in caplog.text
    other = unexpected_fault("task", trace="Traceback of a worker")
    assert other.details["reference"] != problem.details["reference"]
    assert "Traceback of a worker" in caplog.text


# ---------------------------------------------------------------------------------- values


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (None, None),
        (True, True),
        (3, 3),
        (0.5, 0.5),
        (math.nan, None),
        (math.inf, None),
        (np.float64(0.5), 0.5),
        (np.float64(math.nan), None),
        (np.int64(3), 3),
        (np.bool_(True), True),
        (np.array([[1.0, math.inf]]), [[1.0, None]]),
        (("a", 1), ["a", 1]),
        ({"a"}, ["a"]),
        ({1: {"b": (2,)}}, {"1": {"b": [2]}}),
        (b"x", "b'x'"),
        (1j, "1j"),
        ("\ud800", "?"),
        ("é", "é"),
    ],
)
def test_a_value_becomes_what_strict_json_can_carry(value: Any, expected: Any) -> None:
    made = plain(value)
    assert made == expected
    assert type(made) is type(expected)
    json.dumps(made, allow_nan=False).encode("utf-8")


def test_long_texts_are_cut() -> None:
    assert plain("x" * 2000) == "x" * 2000
    assert plain("x" * 2001) == "x" * 2000 + "…"
    assert len(next(iter(plain({"x" * 9999: 1})))) == 2001


def test_depth_has_an_end() -> None:
    value: Any = 1
    for _ in range(100):
        value = [value]
    made, depth = plain(value), 0
    while isinstance(made, list):
        made, depth = made[0], depth + 1
    assert depth == 8
    assert isinstance(made, str)


json_like = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=25)
@given(details=st.dictionaries(st.text(), json_like, max_size=4), text=st.text())
def test_any_problem_can_be_answered(details: dict[str, Any], text: str) -> None:
    problem = from_fields("INVALID_REQUEST", text, text, details)
    response = problem_response(problem, "/v1/x")
    parsed = json.loads(bytes(response.body))
    assert response.status_code == parsed["status"] == 422
    assert response.headers["content-type"] == "application/problem+json"
    assert set(parsed) == FIELDS

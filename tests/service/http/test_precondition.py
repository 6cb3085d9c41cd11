"""Conditional requests: If-Match and If-None-Match against what exists."""

from typing import Any

import httpx
import pytest
from fastapi import Request

from service.http.request_headers import check_precondition
from service.problem import ProblemError
from tests.service.robots import answer, problem


def passes(current: str | None, **headers: str) -> bool:
    raw = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    try:
        check_precondition(Request({"type": "http", "headers": raw}), current)
    except ProblemError as error:
        return error.code != "PRECONDITION_FAILED"
    return True


@pytest.mark.parametrize(
    ("value", "current", "expected"),
    [('"a"', "a", True), ('"a"', "b", False), ('"a"', None, False), ("*", "a", True),
     ("*", None, False), ('"b", "a"', "a", True), ('W/"a"', "a", False), ("a", "a", False),
     ("", "a", False)],
)  # fmt: skip
def test_if_match_wants_what_it_names(value: str, current: str | None, expected: bool) -> None:
    assert passes(current, if_match=value) is expected


@pytest.mark.parametrize(
    ("value", "current", "expected"),
    [('"a"', "a", False), ('"a"', "b", True), ('"a"', None, True), ("*", "a", False),
     ("*", None, True)],
)  # fmt: skip
def test_if_none_match_wants_something_else(
    value: str, current: str | None, expected: bool
) -> None:
    assert passes(current, if_none_match=value) is expected


def test_a_scene_is_replaced_and_deleted_only_as_it_was_seen(client: httpx.Client) -> None:
    path, empty = "/v1/scenes/conditional", dict[str, Any](obstacles=[])
    box = {"id": "a", "shape": {"type": "sphere", "radius": 1}, "pose": {"position": [0, 0, 9]}}
    refused = client.put(path, json=empty, headers={"If-Match": "*"})
    problem(refused, 412, "PRECONDITION_FAILED")
    answer(client.put(path, json=empty, headers={"If-None-Match": "*"}), 201)
    first = client.get(path).headers["etag"]
    problem(
        client.put(path, json=empty, headers={"If-None-Match": "*"}), 412, "PRECONDITION_FAILED"
    )
    answer(client.put(path, json={"obstacles": [box]}, headers={"If-Match": first}))
    for method, body in (("PUT", empty), ("DELETE", None)):
        late = client.request(method, path, json=body, headers={"If-Match": first})
        assert (
            client.get(path).headers["etag"] in problem(late, 412, "PRECONDITION_FAILED")["detail"]
        )
    assert client.get(path).json()["obstacles"][0]["id"] == "a"
    second = client.get(path).headers["etag"]
    assert client.delete(path, headers={"If-Match": second}).status_code == 204

"""Routes of strict JSON: content types, preferences, and bodies as models."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from fastapi import Request
from hypothesis import given
from hypothesis import strategies as st

from armwright_wire.robots.kinematics import FkRequest
from service.http.json_route import JsonRequest, prefers_async, require_json
from service.problem import ProblemError


def strict(content: bytes, model: Any = FkRequest) -> JsonRequest:
    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": content, "more_body": False}

    scope = {"type": "http", "headers": [], "app": SimpleNamespace(state=SimpleNamespace())}
    return JsonRequest(Request(scope, receive), model)


@pytest.mark.parametrize(
    "media_type",
    ["application/json", "APPLICATION/JSON", " application/json ; charset=utf-8",
     "application/merge-patch+json", "application/vnd.a-b.c+json"],
)  # fmt: skip
def test_json_of_any_name_is_json(media_type: str) -> None:
    require_json(media_type)


@pytest.mark.parametrize(
    "media_type",
    [None, "", "text/json", "application/jsonp", "application/json5", "application/+json",
     "application/xml", "multipart/form-data; boundary=x", "text/plain; application/json"],
)  # fmt: skip
def test_other_types_are_refused_by_name(media_type: str | None) -> None:
    with pytest.raises(ProblemError) as refused:
        require_json(media_type)
    assert refused.value.code == "UNSUPPORTED_MEDIA_TYPE"
    name = (media_type or "").split(";")[0]
    assert (name or "without a content type") in refused.value.detail


@pytest.mark.parametrize(
    ("values", "asked"),
    [([], False), ([""], False), (["respond-async"], True), (["Respond-Async"], True),
     (["return=minimal, respond-async; wait=5"], True), (["return=minimal", "respond-async"], True),
     (["respond-async=true"], True), (["respond-asynchronously"], False),
     (["wait=respond-async"], False), (["x; respond-async"], False)],
)  # fmt: skip
def test_the_preference_is_read_as_its_standard_has_it(values: list[str], asked: bool) -> None:
    assert prefers_async(values) is asked


@given(st.lists(st.text(alphabet="abcdefgh-=;, ", max_size=20), max_size=4))
def test_no_other_preference_defers(values: list[str]) -> None:
    assert prefers_async(values) is False
    assert prefers_async([*values, "respond-async"]) is True


def test_a_body_is_read_once_and_follows_its_model() -> None:
    async def scenario() -> None:
        request = strict(b'{"joints": [0, 1.5]}')
        body = await request.read(FkRequest)
        assert body.joints == [0.0, 1.5]
        assert await request.json() == {"joints": [0, 1.5]}

    asyncio.run(scenario())

"""Hosts, conditions, content types, idempotency keys and digests of answers."""

import asyncio
import json
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
from fastapi import Request, Response
from hypothesis import given
from hypothesis import strategies as st

from armwright_wire.robots.kinematics import FkRequest
from service.http.idempotency import answer_once
from service.http.json_route import JsonRequest, prefers_async, require_json
from service.http.keeping import answer_digest, compared
from service.http.layer.request_checks import allowed_host, is_foreign
from service.http.request_headers import FIELDS, check_precondition, first_values
from service.storage.store import Store
from service.validation import ProblemError
from tests.service.jobs.stored import opened
from tests.service.robots import answer, problem

NONE: frozenset[str] = frozenset()


@pytest.mark.parametrize(
    "header",
    ["127.0.0.1", "127.0.0.1:8000", "localhost", "LOCALHOST:80", "armwright", "[::1]", "[::1]:8000",
     "10.1.2.3:8000", "192.168.0.7"],
)  # fmt: skip
def test_addresses_and_names_without_a_dot_are_allowed(header: str) -> None:
    assert allowed_host(header, NONE)


@pytest.mark.parametrize(
    "header",
    ["evil.example", "evil.example:8000", "EVIL.example.", "127.0.0.1.evil.example", "1.2.3.4.5",
     "localhost.evil.example", "a b", "", "x/y", "evil.example@localhost", "[::1", "x:y", "x:",
     "[evil.example]", "x,localhost"],
)  # fmt: skip
def test_other_names_are_not(header: str) -> None:
    assert not allowed_host(header, NONE)
    assert not allowed_host(header, frozenset({"arm.example", ".arms.example"}))


def test_names_on_the_list_are_allowed() -> None:
    names = frozenset({"arm.example", ".arms.example"})
    for header in ("arm.example", "ARM.example:443", "arm.example.", "a.arms.example"):
        assert allowed_host(header, names)
    for header in ("sub.arm.example", "armsx.example", "arms.example", "xarms.example"):
        assert not allowed_host(header, names)
    assert allowed_host("anything.example", frozenset({"*"}))
    assert not allowed_host("no host", frozenset({"*"}))


@pytest.mark.parametrize(
    ("origin", "site", "foreign"),
    [
        (None, None, False),  # no browser
        (None, "none", False),  # typed by a person
        (None, "same-origin", False),
        (None, "cross-site", True),
        ("http://arm.example:8000", "same-origin", False),
        ("https://arm.example:8000", None, False),  # a proxy with TLS in front
        ("https://arm.example", "same-origin", False),  # and one that changes Host
        ("http://evil.example", "cross-site", True),
        ("http://evil.example", None, True),
        ("http://arm.example:9000", "same-site", True),
        ("http://arm.example:8000.evil.example", None, True),
        ("null", None, True),
        ("null", "cross-site", True),
        ("https://own.example", "cross-site", False),  # on the list
        ("https://own.example.evil.example", "cross-site", True),
    ],
)
def test_changes_by_pages_of_other_origins_are_foreign(
    origin: str | None, site: str | None, foreign: bool
) -> None:
    assert is_foreign(origin, site, "arm.example:8000", ("https://own.example",)) == foreign
    assert not is_foreign(origin, site, "arm.example:8000", ("*",))


@pytest.mark.parametrize("method", ["POST", "PUT", "PATCH", "DELETE"])
def test_a_page_elsewhere_changes_nothing(client: httpx.Client, method: str) -> None:
    foreign: list[dict[str, str]] = [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
    ]
    form = {"file": ("arm.zip", b"PK", "application/zip")}
    for headers in foreign:
        answer = client.request(method, "/v1/robots", headers=headers, files=form)
        assert answer.status_code == 403
        assert answer.json()["code"] == "FORBIDDEN"
        assert "ARMWRIGHT_CORS_ORIGINS" in answer.json()["hint"]
        assert client.get("/v1/robots", headers=headers).status_code == 200  # says nothing to it
    own = {"Origin": f"http://{client.base_url.netloc.decode()}", "Sec-Fetch-Site": "same-origin"}
    for headers in ({}, own):
        answer = client.request(method, "/v1/scenes", headers=headers, json={"name": "x y"})
        assert answer.status_code in (405, 422)


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


ANSWER: dict[str, Any] = {
    "planner": "rrt",
    "stages": [{"name": "rrt", "milliseconds": 3.25}],
    "path": {"joints": [[0.1, -0.0], [1e-300, 2.0]]},
}


def content(**changes: Any) -> bytes:
    return json.dumps(ANSWER | changes).encode()


def test_measured_times_do_not_count() -> None:
    slower = content(stages=[{"name": "rrt", "milliseconds": 99.0}], plan_id="x")
    assert answer_digest(slower) == answer_digest(content())
    assert compared(content(), slower).differences == []


@pytest.mark.parametrize(
    ("changes", "pointer"),
    [
        ({"planner": "prm"}, "/planner"),
        ({"stages": []}, "/stages"),
        ({"path": {"joints": [[0.1, -0.0], [1.0000000000000002e-300, 2.0]]}}, "/path/joints/1/0"),
        ({"a/b~": 1}, "/a~1b~0"),
    ],
)
def test_any_other_value_counts(changes: dict[str, Any], pointer: str) -> None:
    assert answer_digest(content(**changes)) != answer_digest(content())
    assert compared(content(), content(**changes)).differences == [pointer]


def test_no_more_than_twenty_differences_are_named() -> None:
    assert (
        len(compared(json.dumps([0] * 30).encode(), json.dumps([1] * 30).encode()).differences)
        == 20
    )


CREATED = Response(
    b'{"a":1}', 201, {"Location": "/v1/scenes/a", "X-Other": "x"}, "application/json"
)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with opened(tmp_path) as made:
        yield made


def request(
    store: Store, key: str | None, body: bytes = b"{}", method: str = "POST", path: str = "/x"
) -> Request:
    headers = [] if key is None else [(b"idempotency-key", key.encode("latin-1"))]

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body, "more_body": False}

    app = SimpleNamespace(state=SimpleNamespace(store=store))
    scope = {
        "type": "http", "method": method, "path": path, "headers": headers, "app": app,
        "query_string": b"", "scheme": "http", "server": ("test", 80), "root_path": "",
        FIELDS: first_values({"headers": headers}),
    }  # fmt: skip
    return Request(scope, receive)


class Handler:
    """Answers with what it is given, and counts."""

    def __init__(self, response: Response | Exception = CREATED) -> None:
        self.response = response
        self.calls = 0

    async def __call__(self, request: Request) -> Response:
        self.calls += 1
        if isinstance(self.response, Exception):
            raise self.response
        return self.response


def ask(handler: Callable[[Request], Awaitable[Response]], asked: Request) -> Response:
    return asyncio.run(answer_once(asked, handler))


def code_of(handler: Handler, asked: Request) -> str:
    with pytest.raises(ProblemError) as refused:
        ask(handler, asked)
    return refused.value.code


def test_a_repeated_request_is_answered_as_the_first_one(store: Store) -> None:
    handler = Handler()
    first = ask(handler, request(store, "k"))
    again = ask(handler, request(store, "k"))
    assert handler.calls == 1
    assert (again.status_code, bytes(again.body)) == (201, bytes(first.body))
    assert again.headers["location"] == "/v1/scenes/a"
    assert again.headers["content-type"] == "application/json"
    assert again.headers["idempotency-replayed"] == "true"
    assert "idempotency-replayed" not in first.headers
    assert "x-other" not in again.headers


@pytest.mark.parametrize(("key", "method"), [(None, "POST"), ("k", "PUT"), ("k", "GET")])
def test_without_a_key_or_where_nothing_is_created_each_request_is_handled(
    store: Store, key: str | None, method: str
) -> None:
    handler = Handler()
    for _ in range(2):
        ask(handler, request(store, key, method=method))
    assert handler.calls == 2


@pytest.mark.parametrize("status", [200, 204, 400, 409, 422, 500, 503])
def test_only_what_was_created_or_accepted_is_kept(store: Store, status: int) -> None:
    handler = Handler(Response(b"", status))
    for _ in range(2):
        assert ask(handler, request(store, "k")).status_code == status
    assert handler.calls == 2
    accepted = Handler(Response(b"{}", 202))
    for _ in range(2):
        assert ask(accepted, request(store, "k")).status_code == 202
    assert accepted.calls == 1


@pytest.mark.parametrize("error", [ValueError("x"), ProblemError("INVALID_SCENE", "x")])
def test_a_request_that_fails_gives_its_key_back(store: Store, error: Exception) -> None:
    with pytest.raises(type(error)):
        ask(Handler(error), request(store, "k"))
    handler = Handler()
    assert ask(handler, request(store, "k", b"other body")).status_code == 201
    assert handler.calls == 1


def test_a_request_that_is_cancelled_gives_its_key_back(store: Store) -> None:
    async def scenario() -> None:
        async def never(request: Request) -> Response:
            await asyncio.Event().wait()
            raise AssertionError

        task = asyncio.ensure_future(answer_once(request(store, "k"), never))
        await asyncio.sleep(0.05)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert (await answer_once(request(store, "k"), Handler())).status_code == 201

    asyncio.run(scenario())


def test_a_second_request_does_not_wait_for_the_first(store: Store) -> None:
    async def scenario() -> None:
        go_on = asyncio.Event()

        async def slow(request: Request) -> Response:
            await go_on.wait()
            return CREATED

        first = asyncio.ensure_future(answer_once(request(store, "k"), slow))
        await asyncio.sleep(0.05)
        with pytest.raises(ProblemError) as conflict:
            await answer_once(request(store, "k"), slow)
        assert (conflict.value.code, conflict.value.retry_after) == ("CONFLICT", 1)
        go_on.set()
        await first
        again = await answer_once(request(store, "k"), slow)
        assert again.headers["idempotency-replayed"] == "true"

    asyncio.run(scenario())


@pytest.mark.parametrize(
    ("key", "fits"),
    [("a", True), ("x" * 255, True), ("x" * 256, False), ("", False), ("a\tb", False),
     ("é", False), ("a b", True), ("~!", True)],
)  # fmt: skip
def test_a_key_is_printable_ascii_of_some_length(store: Store, key: str, fits: bool) -> None:
    handler = Handler()
    if fits:
        ask(handler, request(store, key))
    else:
        assert code_of(handler, request(store, key)) == "VALIDATION_ERROR"
    assert handler.calls == int(fits)

import asyncio
import json
import os
import random
import signal
import socket
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Request

from kinematics.errors import ArmwrightError, InvalidScene, MissingLimit
from service.app import create_app
from service.http.compute import compute
from service.http.errors import KINDS
from service.recipe import RECIPE
from service.settings import Settings
from service.version import VERSION
from service.workers.supervisor import WorkerSupervisor
from tests.service import chores
from tests.service.processes import alive, wait_until
from tests.service.server import serving

FIELDS = {"type", "title", "status", "detail", "instance", "code", "stage", "hint", "details"}
LIMIT = 256 * 1024
JSON = {"Content-Type": "application/json"}
BOX = {"id": "box", "shape": {"type": "box", "size": [1, 1, 1]}, "pose": {"position": [0, 0, 1]}}


def add_mishaps(app: FastAPI) -> None:
    async def stumble() -> None:
        raise RuntimeError("a secret")

    async def blame() -> None:
        raise MissingLimit("joint j1 has no acceleration limit", hint="Give it.", joint="j1")

    async def not_finite() -> None:
        raise InvalidScene(
            "x", depth=float("nan"), stage="scene", odd=object, nested=[{1: "a\ud800"}]
        )

    async def nap(request: Request) -> Any:
        return await compute(request, chores.nap.job(30.0), timeout=20.0)

    async def overrun(request: Request) -> Any:
        return await compute(request, chores.burn.job(), timeout=0.1)

    async def die(request: Request) -> Any:
        return await compute(request, chores.die.job())

    async def too_long(request: Request) -> Any:
        return await compute(request, chores.burn.job(), timeout=1e6)

    for mishap in (stumble, blame, not_finite, nap, overrun, die, too_long):
        app.router.add_api_route(f"/mishaps/{mishap.__name__}", mishap)


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    settings = Settings(
        data_dir=tmp_path_factory.mktemp("data"),
        workers=1,
        queue_limit=1,
        max_body_size=LIMIT,
        body_timeout=0.5,
    )
    app = create_app(settings)
    add_mishaps(app)
    return app


@pytest.fixture(scope="module")
def client(app: FastAPI) -> Iterator[httpx.Client]:
    with pytest.MonkeyPatch.context() as patch:
        more = (*RECIPE.modules, "tests.service.chores")
        patch.setattr("service.app.RECIPE", RECIPE._replace(modules=more))
        with serving(app) as client:
            yield client


def problem(response: httpx.Response, status: int, code: str) -> dict[str, Any]:
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    document: dict[str, Any] = json.loads(response.content, parse_constant=pytest.fail)
    assert set(document) == FIELDS
    assert (document["status"], document["code"]) == (status, code)
    assert document["title"] == KINDS[code].title
    assert document["detail"]
    assert "Traceback" not in response.text
    return document


def post(client: httpx.Client, content: bytes | str, path: str = "/v1/scenes") -> httpx.Response:
    return client.post(path, content=content, headers=JSON)


def test_health_and_readiness(client: httpx.Client) -> None:
    assert client.get("/healthz").json() == {"status": "ok", "version": VERSION}
    ready = client.get("/readyz").json()
    assert (ready["status"], ready["workers"]) == ("ready", 1)


def test_not_ready_before_workers_are_warm(tmp_path: Path) -> None:
    app = create_app(Settings(data_dir=tmp_path, workers=1))

    async def ask() -> tuple[httpx.Response, httpx.Response]:
        async with app.router.lifespan_context(app):
            transport = httpx.ASGITransport(app=app)
            async with httpx.AsyncClient(transport=transport, base_url="http://x") as client:
                return await client.get("/readyz"), await client.get("/healthz")

    ready, health = asyncio.run(ask())
    problem(ready, 503, "NOT_READY")
    assert int(ready.headers["retry-after"]) >= 1
    assert health.status_code == 200


def test_a_scene_from_its_making_to_its_end(client: httpx.Client) -> None:
    scene = {"name": "one", "obstacles": [BOX], "allowed_collisions": [["a", "box"]]}
    created = client.post("/v1/scenes", json=scene)
    assert created.status_code == 201
    assert created.headers["location"] == "/v1/scenes/one"
    assert created.json()["version"] == 1
    problem(client.post("/v1/scenes", json=scene), 409, "CONFLICT")
    stored = client.get("/v1/scenes/one")
    assert stored.json() == scene
    replaced = client.put("/v1/scenes/one", json={"obstacles": []})
    assert (replaced.status_code, replaced.json()["version"]) == (200, 2)
    assert client.get("/v1/scenes/one").headers["etag"] != stored.headers["etag"]
    assert client.put("/v1/scenes/two", json=stored.json() | {"name": "two"}).status_code == 201
    problem(client.put("/v1/scenes/two", json=stored.json()), 422, "VALIDATION_ERROR")
    problem(client.put("/v1/scenes/%20x", json={"obstacles": []}), 422, "VALIDATION_ERROR")
    first = client.get("/v1/scenes", params={"limit": 1}).json()
    assert ([s["name"] for s in first["scenes"]], first["next"]) == (["one"], "one")
    second = client.get("/v1/scenes", params={"limit": 1, "after": first["next"]}).json()
    assert ([s["name"] for s in second["scenes"]], second["next"]) == (["two"], None)
    for name in ("one", "two"):
        assert client.delete(f"/v1/scenes/{name}").status_code == 204
        problem(client.delete(f"/v1/scenes/{name}"), 404, "NOT_FOUND")
        problem(client.get(f"/v1/scenes/{name}"), 404, "NOT_FOUND")


def test_the_domain_has_the_last_word_on_a_scene(client: httpx.Client) -> None:
    shape = {"type": "mesh", "stl_base64": "bm8gc3Rs"}
    body = {"name": "bad", "obstacles": [BOX | {"shape": shape}]}
    problem(client.post("/v1/scenes", json=body), 422, "INVALID_SCENE")
    problem(client.get("/v1/scenes/bad"), 404, "NOT_FOUND")


def test_an_idempotency_key_gives_the_same_answer_again(client: httpx.Client) -> None:
    body = {"name": "keyed", "obstacles": []}
    headers = {"Idempotency-Key": "key 1"}
    first = client.post("/v1/scenes", json=body, headers=headers)
    again = client.post("/v1/scenes", json=body, headers=headers)
    assert (first.status_code, again.status_code) == (201, 201)
    assert again.content == first.content
    assert again.headers["location"] == first.headers["location"]
    other = client.post("/v1/scenes", json=body | {"name": "other"}, headers=headers)
    problem(other, 422, "IDEMPOTENCY_KEY_REUSED")
    problem(client.post("/v1/scenes", json=body), 409, "CONFLICT")
    refused = client.post("/v1/scenes", json=body, headers={"Idempotency-Key": "x" * 256})
    problem(refused, 422, "VALIDATION_ERROR")


def test_a_failed_request_gives_its_key_back(client: httpx.Client) -> None:
    headers = {"Idempotency-Key": "key 2"}
    body = {"name": "corrected", "obstacles": [BOX]}
    wrong = client.post("/v1/scenes", json=body | {"extra": 1}, headers=headers)
    problem(wrong, 422, "VALIDATION_ERROR")
    assert client.post("/v1/scenes", json=body, headers=headers).status_code == 201


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_numbers_that_json_does_not_have(client: httpx.Client, number: str) -> None:
    text = json.dumps({"name": "n", "obstacles": [BOX]}).replace("[0, 0, 1]", f"[0, 0, {number}]")
    document = problem(post(client, text), 422, "VALIDATION_ERROR")
    assert document["details"]["errors"][0]["path"] == "obstacles[0].pose.position[2]"


def test_a_number_too_large_for_a_float(client: httpx.Client) -> None:
    text = json.dumps({"name": "n", "obstacles": [BOX]}).replace("[0, 0, 1]", "[0, 0, 1e999]")
    document = problem(post(client, text), 422, "VALIDATION_ERROR")
    assert document["details"]["errors"][0]["path"] == "obstacles[0].pose.position[2]"


@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"shap": 1}, "obstacles[0].shap"),
        ({"shape": {"type": "box", "size": [1, 1]}}, "obstacles[0].shape.size"),
        ({"shape": {"type": "box", "size": [1, True, 1]}}, "obstacles[0].shape.size[1]"),
        ({"shape": {"type": "box", "size": [1, "1", 1]}}, "obstacles[0].shape.size[1]"),
        ({"shape": {"type": "box", "size": [1, 0, 1]}}, "obstacles[0].shape.size[1]"),
        ({"shape": {"type": "box"}}, "obstacles[0].shape.size"),
        ({"shape": {"type": "blob"}}, "obstacles[0].shape"),
        ({"shape": {"type": ["box"]}}, "obstacles[0].shape"),
        ({"shape": None}, "obstacles[0].shape"),
        (
            {"pose": {"position": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 2]}},
            "obstacles[0].pose.quaternion_xyzw",
        ),
    ],
)
def test_a_refusal_names_the_field(client: httpx.Client, change: dict[str, Any], path: str) -> None:
    response = client.post("/v1/scenes", json={"name": "n", "obstacles": [BOX | change]})
    document = problem(response, 422, "VALIDATION_ERROR")
    assert [error["path"] for error in document["details"]["errors"]] == [path]
    assert path in document["detail"]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"nonsense",
        b'{"name": "a",}',
        b'"\xff\xfe"',
        b'{"name": "\xed\xa0\x80"}',
        b'{"name": "\\ud800", "obstacles": []}',
        b'{"name": "a\\u0000", "obstacles": []}',
        b"[" * 100_000,
        b'{"a":' * 50_000,
        b"1" * 5_000,
        b'{"name": ' + b"9" * 400 + b"}",
        b"null",
        b"[]",
        b'"text"',
        b"\x00",
        '{"name": "a"}'.encode("utf-16"),
        b"\xef\xbb\xbf{}",
        b'{"' + b"k" * 100_000 + b'": 1}',
    ],
)
def test_bodies_that_are_no_request(client: httpx.Client, content: bytes) -> None:
    document = problem(post(client, content), 422, "VALIDATION_ERROR")
    assert len(document["detail"]) < 3_000


def test_duplicate_names_in_json_are_taken_as_the_last_one(client: httpx.Client) -> None:
    text = '{"name": "x", "name": "doubled", "obstacles": []}'
    assert post(client, text).json()["name"] == "doubled"


@pytest.mark.parametrize("media_type", ["text/plain", "application/x-www-form-urlencoded", ""])
def test_other_content_types(client: httpx.Client, media_type: str) -> None:
    response = client.post("/v1/scenes", content=b"{}", headers={"Content-Type": media_type})
    problem(response, 415, "UNSUPPORTED_MEDIA_TYPE")


def test_json_with_a_charset_is_json(client: httpx.Client) -> None:
    headers = {"Content-Type": "Application/JSON; charset=utf-8"}
    body = b'{"name": "charset", "obstacles": []}'
    assert client.post("/v1/scenes", content=body, headers=headers).status_code == 201


def test_paths_and_methods_that_are_not_there(client: httpx.Client) -> None:
    problem(client.get("/v2/scenes"), 404, "NOT_FOUND")
    problem(client.get("/v1/scenes/"), 404, "NOT_FOUND")
    problem(client.get("/v1/scenes/%00%ff%2e%2e"), 404, "NOT_FOUND")
    response = client.patch("/v1/scenes/x")
    problem(response, 405, "METHOD_NOT_ALLOWED")
    assert response.headers["allow"] == "GET, PUT, DELETE"
    problem(client.get("/v1/scenes", params={"limit": "many"}), 422, "VALIDATION_ERROR")


def test_a_body_that_is_announced_too_large(client: httpx.Client) -> None:
    document = problem(post(client, b" " * (LIMIT + 1)), 413, "PAYLOAD_TOO_LARGE")
    assert document["details"]["max_body_size"] == LIMIT
    problem(post(client, b" " * LIMIT), 422, "VALIDATION_ERROR")


def test_a_body_that_grows_too_large(client: httpx.Client) -> None:
    chunks = (b" " * 10_000 for _ in range(LIMIT // 10_000 + 20))
    response = client.post("/v1/scenes", content=chunks, headers=JSON)
    problem(response, 413, "PAYLOAD_TOO_LARGE")


def test_a_body_that_stops_arriving(client: httpx.Client) -> None:
    with socket.create_connection((client.base_url.host, client.base_url.port or 0)) as raw:
        raw.settimeout(5.0)
        raw.sendall(
            b"POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
            b"Content-Length: 100\r\n\r\n{"
        )
        start = time.monotonic()
        answer = b"".join(iter(lambda: raw.recv(65536), b""))
        assert answer.startswith(b"HTTP/1.1 408")
        assert b'"REQUEST_TIMEOUT"' in answer
        assert time.monotonic() - start < 2.0


def test_faults_of_the_caller(client: httpx.Client) -> None:
    document = problem(client.get("/mishaps/blame"), 422, "MISSING_LIMIT")
    assert document["hint"] == "Give it."
    assert document["details"] == {"joint": "j1"}
    assert document["instance"] == "/mishaps/blame"
    document = problem(client.get("/mishaps/not_finite"), 422, "INVALID_SCENE")
    assert document["stage"] == "scene"
    assert document["details"]["depth"] is None


def test_mistakes_of_ours_leak_nothing(
    client: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    document = problem(client.get("/mishaps/stumble"), 500, "CRASH")
    assert "secret" not in json.dumps(document)
    assert document["details"]["reference"] in caplog.text
    assert "a secret" in caplog.text


def test_crash_overrun_and_overlong_timeout(client: httpx.Client) -> None:
    document = problem(client.get("/mishaps/die"), 500, "CRASH")
    assert "SIGSEGV" in document["detail"]
    start = time.monotonic()
    problem(client.get("/mishaps/overrun"), 504, "TIMED_OUT")
    assert time.monotonic() - start < 3.0  # the crashed worker is being replaced meanwhile
    problem(client.get("/mishaps/too_long"), 422, "VALIDATION_ERROR")
    assert client.get("/readyz").status_code == 200


def test_a_client_that_leaves_frees_the_worker(client: httpx.Client, app: FastAPI) -> None:
    supervisor = app.state.supervisor
    with pytest.raises(httpx.ReadTimeout):
        client.get("/mishaps/nap", timeout=0.3)
    assert wait_until(lambda: supervisor.busy == 0, 2.0)
    assert client.post("/v1/scenes", json={"name": "after", "obstacles": []}).status_code == 201


def _occupied(supervisor: WorkerSupervisor, count: int) -> bool:
    return supervisor.busy + supervisor.waiting == count


def test_overload_is_told_at_once(client: httpx.Client, app: FastAPI) -> None:
    supervisor = app.state.supervisor
    waiting = []
    address = (client.base_url.host, client.base_url.port or 0)
    try:
        for count in (1, 2):
            waiting.append(socket.create_connection(address))
            waiting[-1].sendall(b"GET /mishaps/nap HTTP/1.1\r\nHost: x\r\n\r\n")
            assert wait_until(partial(_occupied, supervisor, count), 5.0)
        start = time.monotonic()
        response = client.get("/mishaps/nap")
        problem(response, 429, "OVERLOADED")
        assert int(response.headers["retry-after"]) >= 1
        assert time.monotonic() - start < 1.0
        assert client.get("/healthz").status_code == 200
    finally:
        for connection in waiting:
            connection.close()
    assert wait_until(lambda: supervisor.busy + supervisor.waiting == 0, 5.0)


def test_a_killed_worker_is_replaced(client: httpx.Client, app: FastAPI) -> None:
    # The test before had its worker ended: another is being started in its place.
    supervisor = app.state.supervisor
    assert wait_until(lambda: (supervisor.alive, supervisor.spare) == (1, 1), 10.0)
    pids = supervisor.pids
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    assert wait_until(lambda: not any(map(alive, pids)), 2.0)
    assert client.put("/v1/scenes/again", json={"obstacles": [BOX]}).status_code == 201


def test_the_published_document(client: httpx.Client) -> None:
    document = client.get("/openapi.json").json()
    assert document["info"]["title"] == "Armwright"
    assert document["info"]["version"] == VERSION
    assert set(document["components"]["schemas"]["Problem"]["properties"]) == FIELDS
    assert "HTTPValidationError" not in json.dumps(document)
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            if not path.startswith("/mishaps"):
                content = operation["responses"]["4XX"]["content"]
                assert list(content) == ["application/problem+json"], (path, method)
    assert client.get("/docs").status_code == 200


def test_the_type_of_a_problem_can_be_looked_up(client: httpx.Client) -> None:
    document = client.get("/nowhere").json()
    assert client.get(document["type"]).json()["title"] == document["title"]
    assert len(client.get("/v1/problems").json()["problems"]) == len(KINDS)
    problem(client.get("/v1/problems/NONSENSE"), 404, "NOT_FOUND")


def _subclasses(cls: type[ArmwrightError]) -> Iterator[type[ArmwrightError]]:
    yield cls
    for child in cls.__subclasses__():
        yield from _subclasses(child)


def test_every_error_of_the_domain_has_its_kind() -> None:
    assert {error.code for error in _subclasses(ArmwrightError)} <= set(KINDS)


# ------------------------------------------------------------------------------------------ fuzz

_ATOMS: tuple[Any, ...] = (
    None, True, False, 0, -1, 1.5, 1e308, -1e308, 1e-308, 10**30, "", "a", "\u0000", "é😀", "panda",
    [], {}, [[]], [0, 0, 0], [0, 0, 0, 1], [1e308] * 3, "x" * 5_000, {"type": "box"}, {"": None},
)  # fmt: skip


def _junk(source: random.Random, schema: Any, components: dict[str, Any], depth: int = 0) -> Any:
    """Something that nearly follows a schema."""
    if source.random() < 0.12 or depth > 6 or not isinstance(schema, dict):
        return source.choice(_ATOMS)
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return _junk(source, components[name], components, depth + 1)
    for union in ("anyOf", "oneOf"):
        if union in schema:
            return _junk(source, source.choice(schema[union]), components, depth + 1)
    if "const" in schema or "enum" in schema:
        return schema.get("const", source.choice(schema.get("enum", [0])))
    kind = schema.get("type")
    if kind == "object":
        required = schema.get("required", [])
        return {
            name: _junk(source, part, components, depth + 1)
            for name, part in schema.get("properties", {}).items()
            if (name in required and source.random() > 0.05) or source.random() < 0.3
        }
    if kind == "array":
        length = schema.get("minItems", source.randrange(3))
        return [_junk(source, schema.get("items"), components, depth + 1) for _ in range(length)]
    if kind in ("number", "integer"):
        return source.choice(
            (0, 1, 2, 0.5, -0.5, schema.get("minimum", 0), schema.get("maximum", 9))
        )
    return source.choice(("a", "b", "box", "panda", "table"))


def test_junk_never_brings_the_service_down(client: httpx.Client) -> None:
    source = random.Random(20_261_121)
    document = client.get("/openapi.json").json()
    components = document["components"]["schemas"]
    operations = [
        (method, path, operation)
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
        if method in ("post", "put", "delete") and not path.startswith("/mishaps")
    ]
    assert operations
    statuses: dict[int, int] = {}
    for _ in range(600):
        method, path, operation = source.choice(operations)
        for parameter in ("name", "id"):
            path = path.replace(
                f"{{{parameter}}}", source.choice(("a", "panda", "%00", "é", "..a"))
            )
        content_schemas = operation.get("requestBody", {}).get("content", {})
        schema = content_schemas.get("application/json", {}).get("schema")
        content = json.dumps(_junk(source, schema, components)).encode()
        if source.random() < 0.2:
            cut = source.randrange(len(content) + 1)
            content = content[:cut] + source.randbytes(source.randrange(1, 5)) + content[cut:]
        response = client.request(method, path, content=content, headers=JSON)
        statuses[response.status_code] = statuses.get(response.status_code, 0) + 1
        assert response.status_code < 500 or response.status_code == 503, (
            path,
            content,
            response.text,
        )
        if response.status_code >= 400:
            problem(response, response.status_code, response.json()["code"])
    assert statuses[422] > 50
    assert client.get("/readyz").status_code == 200

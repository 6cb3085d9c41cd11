"""HTTP of the service: documents, keys, problems, faults and overload."""

import asyncio
import json
import socket
import time
from functools import partial
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI

from service.app import create_app
from service.http.errors import KINDS
from service.settings import Settings
from service.version import VERSION
from service.workers.supervisor import WorkerSupervisor
from tests.service.http.exchange import BOX
from tests.service.processes import wait_until
from tests.service.robots import FIELDS, problem
from tests.times import quickest


@pytest.fixture
def app(faulty_app: FastAPI) -> FastAPI:
    return faulty_app


@pytest.fixture
def client(faulty_client: httpx.Client) -> httpx.Client:
    return faulty_client


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
    names, after = [], ""
    while after is not None:
        page = client.get("/v1/scenes", params={"limit": 1, "after": after}).json()
        assert len(page["scenes"]) == 1
        names.append(page["scenes"][0]["name"])
        assert page["next"] in (names[-1], None)
        after = page["next"]
    assert names == sorted(set(names)), "other tests' scenes may stand between"
    assert {"one", "two"} <= set(names)
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


def test_paths_and_methods_that_are_not_there(client: httpx.Client) -> None:
    problem(client.get("/v2/scenes"), 404, "NOT_FOUND")
    problem(client.get("/v1/scenes/"), 404, "NOT_FOUND")
    problem(client.get("/v1/scenes/%00%ff%2e%2e"), 404, "NOT_FOUND")
    response = client.patch("/v1/scenes/x")
    problem(response, 405, "METHOD_NOT_ALLOWED")
    assert response.headers["allow"] == "GET, PUT, DELETE"
    problem(client.get("/v1/scenes", params={"limit": "many"}), 422, "VALIDATION_ERROR")


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
    # The crashed worker is being replaced meanwhile, so it may be late once.
    start = time.monotonic()
    problem(client.get("/mishaps/overrun"), 504, "TIMED_OUT")
    assert time.monotonic() - start < 10.0, "it would burn for hours"
    problem(client.get("/mishaps/too_long"), 422, "VALIDATION_ERROR")
    assert client.get("/readyz").status_code == 200


def test_a_client_that_leaves_frees_the_worker(client: httpx.Client, app: FastAPI) -> None:
    supervisor = app.state.supervisor
    with pytest.raises(httpx.ReadTimeout):
        client.get("/mishaps/nap", timeout=0.3)
    assert wait_until(lambda: supervisor.busy == 0, 10.0), "long before the time of the nap is up"
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
            assert wait_until(partial(_occupied, supervisor, count), 20.0)

        def attempt() -> float:
            start = time.monotonic()
            response = client.get("/mishaps/nap")
            problem(response, 429, "OVERLOADED")
            assert int(response.headers["retry-after"]) >= 1
            return time.monotonic() - start

        assert quickest(attempt, 1.0) < 1.0
        assert client.get("/healthz").status_code == 200
    finally:
        for connection in waiting:
            connection.close()
    assert wait_until(lambda: supervisor.busy + supervisor.waiting == 0, 20.0)


def test_the_published_document(client: httpx.Client) -> None:
    document = client.get("/openapi.json").json()
    assert document["info"]["title"] == "Armwright API"
    assert document["info"]["version"] == VERSION
    assert set(document["components"]["schemas"]["Problem"]["properties"]) == FIELDS
    assert "HTTPValidationError" not in json.dumps(document)
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            if not path.startswith("/mishaps"):
                content = operation["responses"]["4XX"]["content"]
                assert list(content) == ["application/problem+json"], (path, method)


def test_the_type_of_a_problem_can_be_looked_up(client: httpx.Client) -> None:
    document = client.get("/nowhere").json()
    assert client.get(document["type"]).json()["title"] == document["title"]
    assert len(client.get("/v1/problems").json()["problems"]) == len(KINDS)
    problem(client.get("/v1/problems/NONSENSE"), 404, "NOT_FOUND")

"""Large bodies through a worker, and large answers compressed beside the event loop."""

import asyncio
import gzip
import json
import threading
import time
import zlib
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Response
from starlette.middleware import gzip as middleware_module

from armwright_wire.plans.plan import PlanRequest
from armwright_wire.scenes.scene import Scene
from service.endpoints.large_body import outline
from service.http.json_route import INLINE_BYTES
from service.http.layer.middleware import ServiceMiddleware
from service.http.metrics import Metrics
from service.http.request_headers import accepts_gzip
from service.settings import Settings
from service.workers.result import TaskProblem
from tests.service.planning import BODY
from tests.service.robots import (
    DETOUR,
    FLOOR,
    HOME,
    POST,
    answer,
    bench,
    problem,
    scene,
    stuck,
)  # fmt: skip
from tests.times import quickest

#: Blanks are JSON, too: they make a small body large.
BLANK = b" " * (INLINE_BYTES + 1)
PLAN = DETOUR | {"scene": scene(FLOOR)}


def large(client: httpx.Client, path: str, body: Any, method: str = "POST") -> httpx.Response:
    content = BLANK + (body if isinstance(body, bytes) else json.dumps(body).encode())
    headers = {"Content-Type": "application/json"}
    return client.request(method, path, content=content, headers=headers)


def test_rules_of_a_large_body_are_checked_on_the_whole_of_it(client: httpx.Client) -> None:
    """With constraints no pose is needed."""
    path = "/v1/robots/panda/ik"
    region = {"type": "sphere", "center": [0.4, 0.1, 0.5], "radius": 0.05}
    place = {"type": "position", "region": region}
    body = {"method": "constrained", "constraints": [place]}
    solutions = answer(client.post(path, json=body))["solutions"]
    assert solutions
    assert answer(large(client, path, body))["solutions"] == solutions
    detail = problem(large(client, path, body | {"constraints": []}), 422, "VALIDATION_ERROR")
    assert "give exactly one of pose, poses" in json.dumps(detail)


def test_a_large_body_is_answered_as_a_small_one(client: httpx.Client) -> None:
    small = answer(client.post("/v1/plan", json=PLAN))
    assert answer(large(client, "/v1/plan", PLAN))["trajectory"] == small["trajectory"]
    path = "/v1/robots/panda/fk"
    for joints in (HOME, [HOME] * 3):
        body = {"joints": joints}
        assert answer(large(client, path, body)) == answer(client.post(path, json=body))
    name = {"name": "large", **scene(POST)}
    assert answer(large(client, "/v1/scenes", name), 201)["version"] == 1
    assert answer(client.get("/v1/scenes/large")) == name
    again = large(client, "/v1/scenes/large", scene(FLOOR), "PUT")
    assert answer(again)["version"] == 2
    robot = answer(large(client, "/v1/robots", bench("large")), 201)
    assert robot == answer(client.get("/v1/robots/large"))
    stored = client.post("/v1/plan/batch", json={"problems": [PLAN, PLAN | {"seed": 2}]})
    assert stored.status_code == 202
    batch = large(client, "/v1/plan/batch", {"problems": [PLAN]})
    assert batch.status_code == 202
    with client.stream("GET", f"{batch.headers['location']}/events") as response:
        list(response.iter_text())
    result = answer(client.get(batch.headers["location"]))["result"]
    assert result["results"][0]["trajectory"] == small["trajectory"]


@pytest.mark.parametrize(
    "body",
    [
        b"{",
        b"",
        b"[]",
        json.dumps(PLAN | {"extra": 1}).encode(),
        json.dumps(PLAN | {"scene": "nowhere"}).encode(),
        json.dumps(PLAN).replace("-0.785", "NaN", 1).encode(),
        json.dumps(PLAN | {"scene": scene(FLOOR, FLOOR)}).encode(),
        json.dumps(PLAN).replace("0.785", '"0.785"', 1).encode(),
    ],
)
def test_a_large_body_is_refused_as_a_small_one(client: httpx.Client, body: bytes) -> None:
    refused = large(client, "/v1/plan", body)
    headers = {"Content-Type": "application/json"}
    small = client.post("/v1/plan", content=b" " + body, headers=headers)
    document = problem(refused, small.status_code, small.json()["code"])
    if document["detail"].startswith("the body is not valid JSON"):
        document["detail"] = small.json()["detail"]  # which tells another column
        document["details"] = small.json()["details"]
    assert document == small.json()


def test_an_outline_has_what_the_server_looks_at() -> None:
    options = {"range": 0.5, "text": "x" * 5000}
    body = json.dumps(PLAN | {"planner_options": options, "scene": scene(FLOOR, POST)}).encode()
    found = outline("armwright_wire.plans.plan:PlanRequest", body)
    assert isinstance(found, PlanRequest)
    assert (found.robot, found.timeout) == ("panda", 60.0)
    assert found.planner_options == {"range": 0.5, "text": "x" * 64}
    assert isinstance(found.scene, Scene)
    assert found.scene.obstacles is not None
    assert [obstacle.id for obstacle in found.scene.obstacles] == ["floor"], "the first for all"
    refused = outline("armwright_wire.plans.plan:PlanRequest", b"{}")
    assert isinstance(refused, TaskProblem)
    assert refused.code == "VALIDATION_ERROR"


def test_rules_of_several_fields_hold_for_large_bodies(client: httpx.Client) -> None:
    """Rules are checked once more when the framework gets the outline: it must not break them."""
    lines = {"motions": [{"type": "lin", "to": {"position": [0.4, 0.1, 0.6]}}]}
    cartesian = PLAN | {"planner": "cartesian", "planner_options": lines, "goal": None}
    segments = [{"t0": 0.0, "t1": 1.0, "coefficients": [[0.0, 1.0]]}]
    motion = {"trajectory": {"joint_names": ["a"], "segments": segments}, "sample_period": 0.5}
    for path, body in (("/v1/plan", cartesian), ("/v1/convert", motion)):
        small = client.post(path, json=body)
        assert large(client, path, body).status_code == small.status_code
        assert large(client, path, body).json().get("detail") == small.json().get("detail")


def test_a_large_moveit_scene_is_stored(client: httpx.Client) -> None:
    count = 3000
    text = "world:\n  collision_objects:\n" + "".join(
        f"    - id: box_{i}\n"
        f"      primitives: [{{type: 1, dimensions: [0.01, 0.01, 0.01]}}]\n"
        f"      primitive_poses: [{{position: {{x: {i % 60}.0, y: {i // 60}.0, z: 9.0}}, "
        "orientation: {x: 0, y: 0, z: 0, w: 1}}]\n"
        for i in range(count)
    )
    assert len(text) > 256 * 1024
    answer(client.post("/v1/scenes", json={"name": "moveit_large", "moveit": text}), 201)
    body = {"points": [[7.0, 3.0, 9.5]]}
    projected = answer(client.post("/v1/scenes/moveit_large/project", json=body))
    assert len(projected["projections"][0]) == count
    nearest = min(projected["projections"][0], key=lambda item: item["distance"])
    assert nearest["obstacle"] == f"box_{3 * 60 + 7}"
    assert nearest["distance"] == pytest.approx(0.495)


def test_a_body_of_half_a_million_fields_is_refused_at_once(client: httpx.Client) -> None:
    body = json.dumps(PLAN | {f"field_{i}": i for i in range(600_000)}).encode()
    headers = {"Content-Type": "application/json"}

    def attempt() -> float:
        began = time.perf_counter()
        response = client.post("/v1/plan", content=body, headers=headers)
        took = time.perf_counter() - began
        assert "more than 500000 fields" in problem(response, 422, "VALIDATION_ERROR")["detail"]
        return took

    assert quickest(attempt, 2.0) < 2.0, "reading 11 MB is most of it"


def test_reading_and_validating_are_part_of_the_timeout(client: httpx.Client) -> None:
    """Seventeen megabytes, a way that does not exist: the answer comes when the time is up."""
    content = json.dumps(stuck("late", 1.0)).encode() + b" " * 17_000_000
    answer(client.post("/v1/robots", json=bench("late")), 201)
    headers = {"Content-Type": "application/json"}

    def attempt() -> float:
        began = time.monotonic()
        response = client.post("/v1/plan", content=content, headers=headers)
        assert response.status_code in (422, 504)
        return time.monotonic() - began

    # With the grace in which a task ends itself.
    assert quickest(attempt, 1.0 + 0.5 + 0.2) < 1.0 + 0.5 + 0.2


COMPRESSION_PLAN = BODY


def raw(client: httpx.Client, encoding: str) -> tuple[httpx.Headers, bytes]:
    """Headers of a plan's answer, and its body as it passes the wire."""
    with client.stream(
        "POST", "/v1/plan", json=COMPRESSION_PLAN, headers={"Accept-Encoding": encoding}
    ) as response:
        return response.headers, b"".join(response.iter_raw())


def test_an_answer_is_compressed_where_gzip_is_accepted(client: httpx.Client) -> None:
    plain_headers, plain = raw(client, "identity")
    headers, packed = raw(client, "gzip")
    assert "content-encoding" not in plain_headers
    assert headers["content-encoding"] == "gzip"
    assert "Accept-Encoding" in headers["vary"]
    unpacked, expected = json.loads(gzip.decompress(packed)), json.loads(plain)
    assert unpacked["trajectory"] == expected["trajectory"]
    assert len(packed) < 0.6 * len(plain)


@pytest.mark.parametrize(("size", "elsewhere"), [(8_000, False), (31_000, False), (40_000, True)])
def test_large_answers_are_compressed_beside_the_event_loop(
    size: int, elsewhere: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads = list[int]()

    class Noting:
        """A module like zlib that notes which thread compresses."""

        def __getattr__(self, name: str) -> Any:
            return getattr(zlib, name)

        def compressobj(self, *args: Any, **kwargs: Any) -> Any:
            packer = zlib.compressobj(*args, **kwargs)

            class Packer:
                def compress(self, data: bytes) -> bytes:
                    threads.append(threading.get_ident())
                    return packer.compress(data)

                def flush(self) -> bytes:
                    return packer.flush()

            return Packer()

    monkeypatch.setattr(middleware_module, "zlib", Noting())
    app, loops = FastAPI(), list[int]()

    @app.get("/x")
    async def answer() -> Response:
        loops.append(threading.get_ident())
        return Response(b"0123456789" * (size // 10), media_type="application/json")

    settings = Settings(data_dir=tmp_path)
    layer = ServiceMiddleware(app, app, settings, Metrics(app))

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(layer)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.get("/x", headers={"Accept-Encoding": "gzip"})

    answered = asyncio.run(ask())
    assert answered.headers["content-encoding"] == "gzip"
    assert len(answered.content) == size
    assert threads
    assert (threads != loops) is elsewhere


@pytest.mark.parametrize(
    ("accepted", "taken"),
    [
        (b"gzip", True), (b"br, gzip;q=0.5", True), (b"gzip;q=0.001", True), (b"", False),
        (b"gzip;q=0", False), (b"identity, gzip ; q=0.000", False), (b"xgzip", False),
    ],
)  # fmt: skip
def test_a_quality_of_zero_refuses_it(accepted: bytes, taken: bool) -> None:
    assert accepts_gzip({"headers": [(b"accept-encoding", accepted)]}) is taken


def test_short_answers_stay_as_they_are(client: httpx.Client) -> None:
    answer = client.get("/healthz", headers={"Accept-Encoding": "gzip"})
    assert "content-encoding" not in answer.headers

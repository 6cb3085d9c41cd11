"""Workers that are killed, servers that are started again, and what survives of it."""

import os
import signal
import threading
import time
from pathlib import Path

import httpx
import pytest

from service.app import create_app
from service.settings import Settings
from tests.service.conftest import Served
from tests.service.processes import wait_until
from tests.service.robots import (
    DETOUR,
    answer,
    bench,
    problem,
    stuck,
)
from tests.service.server import serving

BODY = DETOUR
#: No way exists, so it is worked on until the time is up.
STUCK = stuck("killed", 20.0)


def test_a_worker_killed_in_a_plan_costs_that_plan_alone(served: Served) -> None:
    client, supervisor = served.client, served.supervisor
    answer(client.post("/v1/robots", json=bench("killed")), 201)
    responses: list[httpx.Response] = []
    asking = threading.Thread(target=lambda: responses.append(client.post("/v1/plan", json=STUCK)))
    asking.start()
    assert wait_until(lambda: supervisor.busy == 1, 5.0)
    time.sleep(0.2)
    (victim,) = supervisor.busy_pids
    os.kill(victim, signal.SIGKILL)
    asking.join(5.0)
    document = problem(responses[0], 500, "CRASH")
    assert "SIGKILL" in document["detail"]
    assert "Traceback" not in responses[0].text
    start = time.monotonic()
    for _ in range(4):
        answer(client.post("/v1/plan", json=BODY))
    assert time.monotonic() - start < 5.0
    assert wait_until(lambda: (supervisor.alive, supervisor.spare) == (2, 1), 5.0)


def test_a_client_that_leaves_stops_its_plan(served: Served) -> None:
    client, supervisor = served.client, served.supervisor
    client.post("/v1/robots", json=bench("killed"))
    with pytest.raises(httpx.TimeoutException):
        client.post("/v1/plan", json=STUCK, timeout=0.5)
    assert wait_until(lambda: supervisor.busy == 0, 2.0)
    answer(client.post("/v1/plan", json=BODY))


def test_robots_and_scenes_outlive_the_server(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, workers=1)
    with serving(create_app(settings)) as client:
        model = answer(client.post("/v1/robots", json=bench("kept")), 201)
        answer(client.post("/v1/scenes", json={"name": "kept", **BODY["scene"]}), 201)
        before = answer(client.post("/v1/plan", json=BODY | {"scene": "kept"}))
    with serving(create_app(settings)) as client:
        assert answer(client.get("/v1/robots/kept")) == model
        after = answer(client.post("/v1/plan", json=BODY | {"scene": "kept"}))
        fk = answer(client.post("/v1/robots/kept/fk", json={"joints": [0.1, 0.2]}))
        assert set(fk["links"]) == {"base", "lower", "upper", "tip"}
    assert after["trajectory"] == before["trajectory"]
    assert after["certificate"] == before["certificate"]
    assert after["reproducibility"] == before["reproducibility"]

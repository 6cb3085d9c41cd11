"""Pages for tests, each made once, and the browser that shows them."""

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser

from armwright_wire.plans.task import TaskRequest
from tests.planning.sequence import fingers
from tests.service.conftest import Served
from tests.service.robots import DETOUR
from tests.service.test_tours import GOALS
from tests.service.test_tours import body as tour_body
from tests.service.viewer.browser import browsing
from tests.service.viewer.pages import fetch

BLOCKED = {"goal": {"pose": {"position": [0.42, 0.28, 0.5], "rpy": [3.14, 0.0, 0.0]}}}


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    with browsing() as opened:
        yield opened


@pytest.fixture(scope="session")
def plan(served: Served) -> bytes:
    ball = {"type": "sphere", "radius": 0.02}
    pose = {"position": [0.0, 0.0, 0.15]}
    held = {"id": "tool", "link": "panda_hand", "shape": ball, "pose": pose}
    return fetch(served.client, "/v1/plan", DETOUR | {"attached": [held]})


@pytest.fixture(scope="session")
def failure(served: Served) -> bytes:
    return fetch(served.client, "/v1/plan", DETOUR | BLOCKED)


@pytest.fixture(scope="session")
def tour(served: Served) -> bytes:
    return fetch(served.client, "/v1/tours", tour_body(goals=GOALS[:2], rounds=0))


@pytest.fixture(scope="session")
def task(served: Served) -> bytes:
    """A gripper opens, grasps a crate, and lifts it."""
    robot = {"name": "view_claws", "urdf": fingers.urdf(), "srdf": fingers.srdf()}
    assert served.client.post("/v1/robots", json=robot).status_code == 201
    example: Any = TaskRequest.model_json_schema()["examples"][0]
    grasp = example["stages"][2] | {
        "touch_links": ["panda_hand", "claw_left_plate", "claw_right_plate"],
        "touch_depth": 0.006,  # the plates are as far in the crate as it is wider than they open
    }
    stages = [{"kind": "open"}, *example["stages"][:2], grasp, *example["stages"][3:6]]
    changes = {"robot": "view_claws", "stages": stages, "improve": 0.0}
    return fetch(served.client, "/v1/tasks", example | changes)

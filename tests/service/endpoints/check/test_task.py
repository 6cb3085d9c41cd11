"""Collision checks and projections in process: what has to be prepared, limits of an answer."""

import json
from typing import Any

import numpy as np
import pytest

from armwright_wire.scenes.scene import ProjectAnswer
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from service.endpoints.check.task import project
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.workers.result import TaskProblem

STORED = Reference("scene", "stored", "1" * 64, "")


@pytest.fixture
def balls(monkeypatch: pytest.MonkeyPatch) -> list[Obstacle]:
    """Three balls along x, in place of a scene that is kept in a file."""
    made = []
    for i in range(3):
        T = np.eye(4)
        T[0, 3] = float(i)
        made.append(Obstacle(f"ball{i}", Sphere(0.25), T))
    monkeypatch.setattr(worker_cache, "scene", lambda source: Scene(tuple(made)))
    return made


def projections(points: Any, engine: str = "exact") -> Any:
    content = project(STORED, json.dumps({"points": points, "engine": engine}).encode())
    assert isinstance(content, bytes)
    answer = json.loads(content)
    ProjectAnswer.model_validate(answer)
    return answer["projections"]


@pytest.mark.parametrize(("engine", "most"), [("exact", 6), ("fcl", 3)])
def test_an_answer_has_so_many_projections_at_most(
    balls: list[Obstacle], monkeypatch: pytest.MonkeyPatch, engine: str, most: int
) -> None:
    monkeypatch.setattr("service.endpoints.check.task._MAX_PROJECTIONS", 6)
    monkeypatch.setattr("service.endpoints.check.task._MAX_FCL_PROJECTIONS", 3)
    points = [[0.0, 1.0, 0.0]] * (most // 3)
    assert len(projections(points, engine)) == most // 3
    body = json.dumps({"points": [*points, points[0]], "engine": engine}).encode()
    refused = project(STORED, body)
    assert isinstance(refused, TaskProblem)
    assert refused.code == "PAYLOAD_TOO_LARGE"
    assert f"at most {most}" in refused.message

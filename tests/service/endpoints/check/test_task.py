"""Collision checks and projections in process: verdicts, one and many, limits of an answer."""

import json
from typing import Any

import numpy as np
import pytest

from armwright_wire.scenes.check import CheckAnswer
from armwright_wire.scenes.scene import ProjectAnswer
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from service.endpoints.check.task import check, project
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.workers.result import CacheMiss, TaskProblem
from tests.planning.scenes import HOME
from tests.service.endpoints.ask import PANDA, answer_of

BALL = {"id": "ball", "shape": {"type": "sphere", "radius": 0.1},
        "pose": {"position": [0.3, 0.0, 0.6]}}  # fmt: skip


def verdict(joints: Any, *obstacles: dict[str, Any], **fields: Any) -> Any:
    body = {"robot": "panda", "joints": joints, "scene": {"obstacles": list(obstacles)}} | fields
    return answer_of(check, PANDA, body, CheckAnswer)


def moved(distance: float) -> dict[str, Any]:
    """The ball so far above the robot, in the line of its first axis [m]."""
    return BALL | {"pose": {"position": [0.0, 0.0, distance]}}


def test_a_free_configuration_keeps_its_distance() -> None:
    near, far = (verdict(HOME.tolist(), moved(z))["clearance"] for z in (3.0, 4.0))
    for z in (3.0, 4.0):
        answer = verdict(HOME.tolist(), moved(z))
        assert answer["valid"]
        assert answer["collisions"] == []
        assert answer["limit_violations"] == []
    assert near <= far
    # The links themselves are nearer to each other than the ball is.
    assert verdict(HOME.tolist())["clearance"] == pytest.approx(far)


def test_a_collision_names_both_and_how_deep() -> None:
    answer = verdict(HOME.tolist(), BALL | {"shape": {"type": "sphere", "radius": 0.5}})
    assert not answer["valid"]
    assert answer["clearance"] < 0.0
    pairs = {tuple(item["pair"]) for item in answer["collisions"]}
    assert any("ball" in pair for pair in pairs)
    assert all(item["depth"] > 0.0 for item in answer["collisions"])
    deepest = max(item["depth"] for item in answer["collisions"])
    assert -answer["clearance"] == pytest.approx(deepest, rel=1e-6)


def test_a_margin_is_kept_from_obstacles() -> None:
    ball = moved(1.5)
    assert verdict(HOME.tolist(), ball)["valid"]
    assert not verdict(HOME.tolist(), ball | {"margin": 5.0})["valid"]
    assert not verdict(HOME.tolist(), ball, margin=5.0)["valid"]


def test_pairs_that_may_touch_do_not_collide() -> None:
    ball = BALL | {"shape": {"type": "sphere", "radius": 0.5}}
    links = {name for item in verdict(HOME.tolist(), ball)["collisions"] for name in item["pair"]}
    pairs = [["ball", name] for name in sorted(links - {"ball"})]
    answer = verdict(HOME.tolist(), ball, allowed_collisions=pairs)
    assert answer["collisions"] == []
    told = [i["pair"] for i in answer["allowed_collisions"] if i["reason"] == "request"]
    assert told == [sorted(pair) for pair in pairs]


def test_a_joint_outside_its_limits_is_named() -> None:
    joints = HOME.copy()
    joints[3] = 0.5
    answer = verdict(joints.tolist())
    assert not answer["valid"]
    (violation,) = answer["limit_violations"]
    assert violation["joint"] == "panda_joint4"
    assert violation["value"] == 0.5
    assert violation["limit"] == pytest.approx(-0.0698, abs=1e-3)


def test_many_configurations_are_answered_as_each_alone() -> None:
    rows = [HOME.tolist(), (HOME + 0.3).tolist(), [0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0]]
    together = verdict(rows, BALL)
    alone = [verdict(row, BALL) for row in rows]
    for name in ("valid", "clearance", "clearance_pair", "collisions", "limit_violations"):
        assert together[name] == [single[name] for single in alone], name
    assert verdict(rows[:1], BALL)["valid"] == [alone[0]["valid"]], "a list of one stays a list"


def test_a_scene_that_is_not_prepared_is_missed() -> None:
    lost = Reference("scene", "lost", "0" * 64, "/nowhere")
    body = json.dumps({"robot": "panda", "joints": HOME.tolist(), "scene": "lost"}).encode()
    assert check(PANDA, lost, body) == CacheMiss(lost)
    assert project(lost, json.dumps({"points": [[0, 0, 0]]}).encode()) == CacheMiss(lost)


# ------------------------------------------------------------------------------- projections

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


@pytest.mark.parametrize("engine", ["exact", "fcl"])
def test_every_point_is_projected_onto_every_obstacle(balls: list[Obstacle], engine: str) -> None:
    points = np.array([[0.0, 1.0, 0.0], [0.1, 0.0, 0.0], [5.0, 0.0, 0.0]])
    rows = projections(points.tolist(), engine)
    assert [len(row) for row in rows] == [3, 3, 3]
    for point, row in zip(points, rows, strict=True):
        for i, item in enumerate(row):
            center = np.array([float(i), 0.0, 0.0])
            away = point - center
            distance = np.linalg.norm(away)
            assert item["obstacle"] == f"ball{i}"
            assert item["distance"] == pytest.approx(distance - 0.25, abs=1e-6)
            expected = center + 0.25 * away / distance
            np.testing.assert_allclose(item["projection"], expected, atol=1e-5)


def test_a_scene_without_obstacles_has_no_projections(balls: list[Obstacle]) -> None:
    balls.clear()
    assert projections([[0.0, 0.0, 0.0]] * 2) == [[], []]


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

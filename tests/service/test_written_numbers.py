"""Numbers that are written with few decimals, at every endpoint that takes a pose."""

from typing import Any

import httpx
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.service.robots import HOME, problem

POSITION = [0.45, 0.1, 0.4]
BLOCK = {"type": "box", "size": [0.02, 0.02, 0.02]}
FAR = {"id": "far", "shape": BLOCK}


def rotation(seed: int) -> Any:
    """A rotation near the one of the tool that looks down."""
    near = Rotation.from_rotvec(np.random.default_rng(seed).uniform(-0.4, 0.4, 3))
    return (near * Rotation.from_euler("x", np.pi)).as_matrix()


def written(seed: int, decimals: int, factor: float = 1.0) -> list[list[float]]:
    rows: list[list[float]] = (factor * rotation(seed)).round(decimals).tolist()
    return rows


def requests(rows: list[list[float]]) -> dict[str, tuple[str, dict[str, Any], str]]:
    """Path, body and place of the matrix of a request to each endpoint."""
    pose = {"position": POSITION, "rotation_matrix": rows}
    far = {"position": [1.5, 1.5, 0.2], "rotation_matrix": rows}
    plan = {"robot": "panda", "start": {"joints": HOME}, "timeout": 20.0}
    obstacles = {"scene": {"obstacles": [FAR | {"pose": far}]}}
    return {
        "ik": ("/v1/robots/panda/ik", {"pose": pose, "seed_joints": HOME}, "pose"),
        "goal": ("/v1/plan", plan | {"goal": {"pose": pose}}, "goal.pose"),
        "obstacle": (
            "/v1/check",
            {"robot": "panda", "joints": HOME} | obstacles,
            "scene.obstacles[0].pose",
        ),
        "convert": ("/v1/poses/convert", {"pose": {"rotation_matrix": rows}}, "pose"),
        "reach": ("/v1/robots/panda/reach", {"poses": [pose]}, "poses[0]"),
    }


NAMES = pytest.mark.parametrize("name", list(requests([])))


def test_what_was_rounded_of_a_stored_scene_is_told_where_it_is_used(client: httpx.Client) -> None:
    path, body, place = requests(written(3, 4))["obstacle"]
    stored = {"name": "rounded_poses", **body["scene"]}
    assert client.post("/v1/scenes", json=stored).status_code == 201
    notes = [
        client.post(path, json=body | {"scene": scene}).json()["notes"]
        for scene in ("rounded_poses", body["scene"])
    ]
    assert notes[0] == notes[1]
    (note,) = notes[0]
    assert note.startswith(f"{place}.rotation_matrix is a rotation within rounding only")


@NAMES
@pytest.mark.parametrize("decimals", [3, 5])
def test_a_matrix_of_few_decimals_is_taken_and_told(
    client: httpx.Client, name: str, decimals: int
) -> None:
    path, body, place = requests(written(decimals, decimals))[name]
    answer = client.post(path, json=body)
    assert answer.status_code == 200, answer.text
    notes = answer.json()["notes"]
    assert any(note.startswith(f"{place}.rotation_matrix is a rotation within") for note in notes)
    path, body, _ = requests(rotation(decimals).tolist())[name]
    assert not client.post(path, json=body).json().get("notes")


@NAMES
def test_a_matrix_that_is_no_rotation_is_refused_with_the_cure(
    client: httpx.Client, name: str
) -> None:
    mirrored = (rotation(1) @ np.diag([1.0, 1.0, -1.0])).round(4).tolist()
    for rows in (written(1, 4, 1.002), mirrored):
        path, body, place = requests(rows)[name]
        detail = problem(client.post(path, json=body), 422, "VALIDATION_ERROR")["detail"]
        assert f"{place}.rotation_matrix" in detail
        assert "three decimals" in detail


def test_a_transform_is_taken_wherever_a_pose_is(client: httpx.Client) -> None:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = written(2, 4), POSITION
    pose = {"transform": T.tolist()}
    given: dict[str, dict[str, Any]] = {
        "ik": {"pose": pose},
        "goal": {"goal": {"pose": pose}},
        "obstacle": {"scene": {"obstacles": [FAR | {"pose": pose}]}},
        "convert": {"pose": pose},
        "reach": {"poses": [pose]},
    }
    for name, (path, body, _) in requests(written(2, 4)).items():
        answer = client.post(path, json=body | given[name])
        assert answer.status_code == 200, (name, answer.text)
    forms = client.post("/v1/poses/convert", json={"pose": {"transform": T.tolist()}}).json()
    again = {"pose": {"transform": forms["pose"]["transform"]}, "seed_joints": HOME}
    assert client.post("/v1/robots/panda/ik", json=again).status_code == 200


def test_a_norm_that_is_off_is_told(client: httpx.Client) -> None:
    pose = {"position": POSITION, "quaternion_xyzw": [1.0, 0.0, 0.0, 0.04]}
    answer = client.post("/v1/robots/panda/ik", json={"pose": pose, "seed_joints": HOME}).json()
    assert answer["notes"] == ["pose.quaternion_xyzw has norm 1.0008: it was normalised."]


def test_a_start_measured_hardly_above_a_limit_is_moved_onto_it(client: httpx.Client) -> None:
    limits = client.get("/v1/robots/panda").json()["limits"]
    start = list(HOME)
    start[6] = limits["upper"][6] * 1.0001
    body = {"robot": "panda", "start": {"joints": start}, "goal": {"joints": HOME}}
    answer = client.post("/v1/plan", json=body).json()
    assert answer["certificate"]["verified"], answer
    assert answer["path"]["joints"][0][6] == limits["upper"][6]
    assert "start was outside a limit by 0.00029" in answer["notes"][0]
    for refused in (body | {"start_state_tolerance": 1e-6}, body | {"goal": {"joints": start}}):
        assert client.post("/v1/plan", json=refused).status_code == 422
    velocity = [*[0.0] * 6, -1.0001 * limits["velocity"][6]]
    states = {"from": {"position": start, "velocity": velocity}, "to": {"position": HOME}}
    timed = client.post("/v1/retime", json={"robot": "panda"} | states).json()
    assert timed["certificate"]["verified"], timed
    assert [note.split(" was")[0] for note in timed["notes"][:2]] == [
        "The position of from",
        "The velocity of from",
    ]


def test_tables_of_rounded_numbers_are_taken_and_told_in_lint(client: httpx.Client) -> None:
    row = {"type": "revolute", "a": 0.3, "alpha": 0.0, "d": 0.1, "theta": 0.0, "lower": -1.0}
    row |= {"upper": 1.0, "mass": 1.0}
    row["inertia"] = [[0.02, 0.0012, 0.0], [0.0013, 0.02, 0.0], [0.0, 0.0, 0.02]]
    base = {"position": [0.0, 0.0, 0.1], "rotation_matrix": written(3, 4)}
    table = {"convention": "standard", "rows": [row], "base": base}
    answer = client.post("/v1/robots", json={"name": "rounded", "dh": table}).json()
    assert [text.split(" is ")[0] for text in answer["lint"][:2]] == [
        "dh.rows[0].inertia",
        "dh.base.rotation_matrix",
    ]
    client.delete("/v1/robots/rounded")

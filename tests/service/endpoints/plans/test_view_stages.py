"""Pages of kept tasks and tours: parts on one timeline, objects with the hand that holds them."""

import json
import re
from typing import Any

import numpy as np
import pytest

from armwright_wire.plans.task import TaskAnswer, TaskRequest
from armwright_wire.plans.tour import TourAnswer
from kinematics.errors import InvalidOption
from kinematics.forward import forward, joint_frames
from kinematics.robots import builtin_chain
from service.endpoints.plans.view import swept, view
from service.endpoints.tasks.task import plan_sequence
from service.endpoints.tours.task import tour
from tests.service.endpoints.ask import PANDA, PLANAR, answer_of, problem_of
from tests.service.robots import HOME

TASK: Any = TaskRequest.model_json_schema()["examples"][0] | {"improve": 0.0}


def document(operation: str, robot: Any, body: dict[str, Any], **result: Any) -> dict[str, Any]:
    """What the page of a kept answer or problem shows."""
    kept = {"operation": operation, "request": body, "proved_here": True, **result}
    content = view(robot, None, json.dumps(kept).encode())
    assert isinstance(content, bytes)
    found = re.search(rb'type="application/json">(.*?)</script>', content, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


@pytest.fixture(scope="module")
def task() -> tuple[dict[str, Any], dict[str, Any]]:
    """The answer to the pick and place, and what its page shows."""
    answer = answer_of(plan_sequence, PANDA, TASK, TaskAnswer)
    return answer, document("POST /v1/tasks", PANDA, TASK, answer=answer)


def place(data: dict[str, Any], name: str, time: float, q: Any) -> Any:
    """Where a page draws what is carried, as its script does, shape (4, 4)."""
    carrier = [item for item in data["carriers"][name] if item["begins"] <= time][-1]
    frame = np.reshape(carrier["frame"], (4, 4)).T
    if carrier["joint"] < 0:
        return frame
    tip = np.reshape(data["tip"]["frame"], (4, 4)).T
    assert carrier["joint"] == data["tip"]["joint"]
    return forward(builtin_chain("panda"), q) @ np.linalg.inv(tip) @ frame


def test_the_stages_of_a_task_share_a_timeline(task: Any) -> None:
    answer, data = task
    assert [item["begins"] for item in data["stages"]] == [s["begins"] for s in answer["stages"]]
    assert data["stages"][1]["label"] == "1: approach"
    assert data["motion"]["breaks"][-1] == pytest.approx(answer["duration"])
    for stage, item in zip(answer["stages"], data["stages"], strict=True):
        # Numbers of stages and alternatives are those of the answer, from 0 on.
        assert item["label"].startswith(f"{stage['index']}: ")
        told = next(text for text in data["sentences"] if f"Stage {item['label']};" in text)
        assert (f"choice {stage['choice']}" in told) == (stage["choice"] is not None)
    assert all(f"Stage {item['label']}; proved" in " ".join(data["sentences"])
               for item in data["stages"])  # fmt: skip
    for name in ("tool_speed", "torque", "clearance"):
        times = data["motion"][name]["times"]
        assert times == sorted(times)
        assert times[-1] == pytest.approx(answer["duration"])


def test_the_crate_moves_with_the_hand_from_where_it_stood_to_where_it_is_put(task: Any) -> None:
    answer, data = task
    assert [b["kind"] for b in data["bodies"] if b["name"] == "crate"] == ["moved"]
    assert [b["kind"] for b in data["bodies"] if b["name"] == "table"] == ["obstacle"]
    (stood,) = (o for o in TASK["scene"]["obstacles"] if o["id"] == "crate")
    (put,) = answer["stages"][-1]["after"]["objects"]
    before, after = (place(data, "crate", time, HOME)[:3, 3] for time in (0.0, answer["duration"]))
    np.testing.assert_allclose(before, stood["pose"]["position"])
    np.testing.assert_allclose(after, put["pose"]["position"])
    held = [s for s in answer["stages"] if s["after"]["attached"]]
    # Where a stage begins to hold it or no longer does, the crate jumps nowhere.
    first = [row[0] for row in held[0]["trajectory"]["segments"][0]["coefficients"]]
    np.testing.assert_allclose(
        place(data, "crate", held[0]["begins"], first)[:3, 3], before, atol=1e-6
    )
    end = answer["stages"][held[-1]["index"] + 1]
    last = [row[0] for row in end["trajectory"]["segments"][0]["coefficients"]]
    np.testing.assert_allclose(
        place(data, "crate", end["begins"] - 1e-9, last)[:3, 3], after, atol=1e-5
    )


def test_clearance_of_a_stage_is_about_what_is_held_in_it(task: Any) -> None:
    answer, data = task
    curve = data["motion"]["clearance"]
    for stage in answer["stages"]:
        end = stage["begins"] + stage["trajectory"]["duration"]
        measured = [
            value
            for time, value in zip(curve["times"], curve["values"], strict=True)
            if stage["begins"] < time < end and value is not None
        ]
        proved = stage["certificate"]["min_clearance"]
        if measured and proved is not None:
            assert min(measured) >= proved - 1e-6


def test_the_legs_of_a_tour_share_a_timeline_with_its_stays() -> None:
    goals = [{"id": name, "joints": q, "dwell": 0.5} for name, q in
             (("a", [0.5, 0.5]), ("b", [1.0, -0.5]))]  # fmt: skip
    body = {"robot": "planar_rr", "start": {"joints": [0.0, 0.0]}, "end": "start", "goals": goals}
    answer = answer_of(tour, PLANAR, body, TourAnswer)
    data = document("POST /v1/tours", PLANAR, body, answer=answer)
    names = [item["label"] for item in data["stages"]]
    first, second = answer["order"]
    assert names == [f"0: start to {first}", f"1: {first} to {second}", f"2: {second} to end"]
    assert data["motion"]["breaks"][-1] == pytest.approx(answer["time"])
    assert "legs proved: 3 of 3" in data["sentences"][0]
    assert "Stays take 1.000 s" in data["sentences"][1]


def test_tasks_and_tours_without_an_answer_show_where_they_begin() -> None:
    ball = {"type": "sphere", "radius": 0.2}
    rock = {"id": "rock", "shape": ball, "pose": {"position": [0.3, 0.0, 0.5]}}
    move = {"kind": "move", "goal": {"joints": HOME}}
    inside = TASK | {"scene": {"obstacles": [rock]}, "stages": [move]}
    refused = problem_of(plan_sequence, PANDA, inside)
    problem = {"title": "No", "code": refused.code, "detail": refused.message, "stage": "task"}
    data = document("POST /v1/tasks", PANDA, inside, problem=problem)
    start, goal = data["configurations"]
    assert (start["label"], start["joints"]) == ("start", HOME)
    assert (goal["label"], goal["verdict"]) == ("goal of stage 0", "rejected")
    assert start["cause"] == "collision"
    assert "rock" in start["near"]["pair"]
    assert start["near"]["distance"] < 0.0
    assert data["motion"] is None
    assert "'panda_hand' and 'rock'" in " ".join(data["sentences"])
    body = {"robot": "planar_rr", "start": {"joints": [0.0, 0.0]},
            "goals": [{"id": "a", "joints": [0.5, 0.5]}, {"joints": [9.0, 0.0]}]}  # fmt: skip
    problem = {"title": "No", "code": "X", "detail": "nothing", "stage": "goal"}
    data = document("POST /v1/tours", PLANAR, body, problem=problem)
    assert [item["label"] for item in data["configurations"]] == ["start", "goal a", "goal 1"]


def windings(stl: bytes, points: Any) -> Any:
    """How many closed surfaces of an STL hold each point: solid angles over 4 pi."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("end", "<u2")])
    corners = np.frombuffer(stl, record, offset=84)["corners"].astype(float)
    found = []
    for point in points:
        a, b, c = np.moveaxis(corners - point, 1, 0)
        x, y, z = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        dots = [np.einsum("ij,ij->i", p, q) * r for p, q, r in ((a, b, z), (b, c, x), (c, a, y))]
        found.append(2.0 * np.arctan2(volume, x * y * z + sum(dots)).sum() / (4.0 * np.pi))
    return np.array(found)


def test_the_swept_space_of_a_task_holds_the_wrist_and_what_is_carried(task: Any) -> None:
    answer, data = task
    some = answer | {"stages": [s for s in answer["stages"] if s["kind"] == "lift"]}
    kept = json.dumps({"operation": "POST /v1/tasks", "request": TASK, "answer": some}).encode()
    mesh = swept(PANDA, None, kept, "stl", 0.05)
    assert isinstance(mesh, bytes)
    points = []
    for stage in some["stages"]:
        segment = stage["trajectory"]["segments"][-1]
        half = 0.5 * (segment["t1"] - segment["t0"])
        q = [np.polynomial.Polynomial(row)(half) for row in segment["coefficients"]]
        time = stage["begins"] + segment["t0"] + half
        points.append(joint_frames(builtin_chain("panda"), q)[-2][:3, 3])
        if stage["after"]["attached"]:
            corner = place(data, "crate", time, q) @ [0.024, 0.024, 0.049, 1.0]
            points.append(corner[:3])
    inside = windings(mesh, points)
    assert np.all(inside > 0.99)
    assert windings(mesh, [[0.0, 0.0, 3.0]]) == pytest.approx(0.0, abs=1e-6)


def test_what_has_no_motion_sweeps_nothing() -> None:
    kept = json.dumps({"operation": "POST /v1/check", "request": {}, "answer": {}}).encode()
    with pytest.raises(InvalidOption, match="no motion"):
        swept(PANDA, None, kept, "glb", 0.01)

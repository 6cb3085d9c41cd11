"""The command ``armwright view``: pages of answers in files."""

import json
from pathlib import Path
from typing import Any

import pytest

from command_line.backends.endpoints import PLAN
from command_line.backends.local import LocalBackend
from service.http.keeping import answer_digest
from tests.command_line.commands import Run
from tests.service.robots import ASIDE, HOME


def test_an_answer_of_plan_has_a_page(run: Run, tmp_path: Path) -> None:
    goal = ",".join(map(str, ASIDE))
    motion = tmp_path / "plan.json"
    words = ("--start", ",".join(map(str, HOME)), "--goal", goal, "--timeout", "60")
    assert run("plan", "panda", *words, "-o", str(motion)).code == 0
    made = run("view", str(motion), "--robot", "panda")
    assert made.code == 0, made.err
    page = (tmp_path / "plan.html").read_text()
    assert page.startswith("<!doctype html>")
    assert "POST /v1/validate" in page
    treeless = run("view", str(motion), "--robot", "panda", "--tree")
    assert treeless.code == 3
    assert "POST /v1/validate have no tree" in treeless.err
    refused = run("view", str(motion))
    assert refused.code == 3
    assert "--robot" in refused.err


@pytest.mark.parametrize("text", ["{}", '{"path": 1}'])
def test_a_file_without_a_motion_is_refused(run: Run, tmp_path: Path, text: str) -> None:
    file = tmp_path / "other.json"
    file.write_text(text)
    refused = run("view", str(file), "--robot", "panda")
    assert refused.code == 3
    assert "neither a plan nor a trajectory" in refused.err
    assert run("view", str(tmp_path / "none.json")).code == 3


ASKED: dict[str, Any] = {
    "robot": "planar_rr",
    "start": {"joints": [0.0, 0.5]},
    "goal": {"joints": [1.0, -0.4]},
    "seed": 1,
    "timeout": 60.0,
}
BALL = {
    "id": "ball",
    "shape": {"type": "sphere", "radius": 0.1},
    "pose": {"position": [-0.5, 0.0, 2.3]},
}


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A bundle of a plan near a stored scene, as a service makes it."""
    monkeypatch.setattr("command_line.backends.local.cache_folder", lambda: tmp_path / "cache")
    scene, request = {"name": "room", "obstacles": [BALL]}, ASKED | {"scene": "room"}
    backend = LocalBackend()
    with backend._stored(scene, "room") as reference:
        told = backend._answer(PLAN, "planar_rr", reference, request)
    return {
        "armwright_bundle": 1, "operation": "POST /v1/plan", "version": "1", "seed": 1,
        "status": "succeeded", "digest": answer_digest(told), "robot": "planar_rr",
        "robot_document": None, "scene": "room", "scene_document": json.dumps(scene),
        "request": json.dumps(request), "answer": told.decode(),
    }  # fmt: skip


def page(run: Run, folder: Path, document: dict[str, Any], *words: str) -> str:
    file = folder / "document.json"
    file.write_text(json.dumps(document))
    made = run("view", str(file), *words)
    assert made.code == 0, made.err
    return (folder / "document.html").read_text()


def test_a_bundle_is_proved_anew(run: Run, tmp_path: Path, bundle: dict[str, Any]) -> None:
    shown = page(run, tmp_path, bundle)
    assert "Everything that the request names is proved" in shown
    assert "against scene room of 1 obstacle" in shown
    moved = json.loads(bundle["scene_document"])
    moved["obstacles"][0]["pose"]["position"][2] = 1.0
    answer = json.loads(bundle["answer"])
    answer["certificate"]["min_clearance"] = 7.0
    motion = json.loads(bundle["answer"])
    motion["trajectory"]["segments"][0]["coefficients"][0][0] += 1e-6
    for change in (
        {"scene_document": json.dumps(moved)},
        {"answer": json.dumps(answer)},
        {"answer": json.dumps(motion)},
        {"request": json.dumps(json.loads(bundle["request"]) | {"margin": 0.05})},
    ):
        forged = bundle | change
        forged["digest"] = answer_digest(forged["answer"].encode())
        shown = page(run, tmp_path, forged)
        assert "Not proved here" in shown
        assert "Everything that the request names is proved" not in shown
        assert "7000.0 mm" not in shown


def test_a_bundle_of_another_form_is_refused(
    run: Run, tmp_path: Path, bundle: dict[str, Any]
) -> None:
    for field, value in [
        ("robot_document", "{}"),
        ("scene_document", "{}"),
        ("scene_document", "no JSON"),
        ("request", "[]"),
        ("digest", None),
    ]:
        file = tmp_path / "broken.json"
        file.write_text(json.dumps(bundle | {field: value}))
        result = run("view", str(file), "--output", str(tmp_path / "page.html"))
        assert result.code == 3
        assert field in result.err


def test_no_robot_of_a_bundle_takes_the_place_of_a_built_in_one(
    run: Run, tmp_path: Path, bundle: dict[str, Any]
) -> None:
    thin = {"type": "revolute", "a": 1.0, "alpha": 0.0, "d": 0.0, "theta": 0.0}
    rows = [thin | {"lower": -3.0, "upper": 3.0, "velocity": 2.0, "acceleration": 5.0}] * 2
    table = {"convention": "standard", "rows": rows}
    forged = json.dumps({"name": "planar_rr", "dh": table})
    honest = page(run, tmp_path, bundle)
    assert page(run, tmp_path, bundle | {"robot_document": forged}) == honest


def test_an_answer_of_somebody_is_proved_anew(
    run: Run, tmp_path: Path, bundle: dict[str, Any]
) -> None:
    """The certificate of the file plays no part."""
    forged = json.loads(bundle["answer"])
    forged["certificate"]["min_clearance"] = 7.0
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps({"obstacles": [BALL]}))
    words = ("--robot", "planar_rr", "--scene", str(scene))
    shown = page(run, tmp_path, forged, *words)
    assert "Everything that the request names is proved" in shown
    assert "7000.0 mm" not in shown
    alone = page(run, tmp_path, forged, "--robot", "planar_rr")
    assert "against the robot itself only" in alone
    through = {"id": "ball", "shape": {"type": "sphere", "radius": 1.5}}
    through["pose"] = {"position": [0.0, 0.0, 1.4]}
    scene.write_text(json.dumps({"obstacles": [through]}))
    shown = page(run, tmp_path, forged, *words)
    assert "Not proved here" in shown
    assert "Everything that the request names is proved" not in shown


def test_a_bundle_is_replayed_and_compared(
    run: Run, tmp_path: Path, bundle: dict[str, Any]
) -> None:
    file, new = tmp_path / "plan.json", tmp_path / "new.json"
    file.write_text(json.dumps(bundle))
    told = run("replay", str(file), "-o", str(new))
    assert (told.code, told.out) == (0, "the answer is the same\n")
    assert answer_digest(new.read_bytes()) == bundle["digest"]
    changed = run("replay", str(file), "--changes", '{"margin": 0.01}', "--json")
    assert changed.code == 0, changed.err
    found = json.loads(changed.out)
    assert not found["same"]
    assert "/certificate/premises/margin" in found["differences"]
    assert found["answer"]["certificate"]["premises"]["margin"] == 0.01
    forged = json.loads(bundle["answer"])
    forged["certificate"]["min_clearance"] = 7.0
    text = json.dumps(forged)
    file.write_text(json.dumps(bundle | {"answer": text, "digest": answer_digest(text.encode())}))
    other = run("replay", str(file))
    assert other.code == 1
    assert other.out == "the answer is another, at:\n/certificate/min_clearance\n"


def test_a_replay_of_a_failure_fails_the_same(
    run: Run, tmp_path: Path, bundle: dict[str, Any]
) -> None:
    goal: dict[str, Any] = {"pose": {"position": [9.0, 0.0, 9.0]}}
    file, far = tmp_path / "plan.json", json.dumps({"goal": goal | {"joints": None}})
    file.write_text(json.dumps(bundle))
    failed = run("replay", str(file), "--changes", far, "--json")
    assert failed.code == 4, failed.err
    problem = json.loads(failed.out)
    assert problem["code"] == "NO_IK_SOLUTION"
    request = json.loads(bundle["request"]) | {"goal": goal}
    kept = {"operation": "POST /v1/plan", "request": request, "problem": problem}
    file.write_text(json.dumps(kept))
    scene = tmp_path / "room.json"
    scene.write_text(bundle["scene_document"])
    words = ("replay", str(file), "--robot", "planar_rr", "--scene", str(scene))
    assert run(*words).out == "the answer is the same\n"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--keep"], "only a service keeps plans"),
        (["--changes", "[1]"], "are no fields"),
        (["--changes", '{"star": 1}'], "star"),
    ],
)
def test_a_replay_says_what_it_can_not_do(
    run: Run, tmp_path: Path, bundle: dict[str, Any], words: list[str], told: str
) -> None:
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(bundle))
    refused = run("replay", str(file), *words)
    assert refused.code == 3
    assert told in refused.err
    file.write_text(bundle["answer"])
    alone = run("replay", str(file), "--robot", "planar_rr")
    assert (alone.code, "--whole" in alone.err) == (3, True)

"""Every door that takes a kept plan, with a task, a tour and a seam: works, or refuses by name."""

import asyncio
import json
from pathlib import Path
from typing import Any, NamedTuple, get_args

import httpx
import pytest
from mcp import Client as McpClient

from armwright_client import AsyncClient, Client, ValidationFailed
from armwright_wire.motions.export import Format
from command_line.mcp_server import mcp_server
from kinematics.forward import forward
from kinematics.pose import to_quaternion
from kinematics.robots import builtin_chain
from tests.command_line.commands import Run, runner
from tests.planning.witness.problems import checker, rejected
from tests.service.robots import answer, problem, solid

HOME = [0.0, -1.4, 1.5, -1.7, -1.57, 0.0]
AWAY = [0.4, -1.2, 1.3, -1.7, -1.5, 0.2]
TIP = forward(builtin_chain("ur5e"), HOME)
CELL = {"obstacles": [solid("post", "box", [-0.8, -0.5, 0.2], size=[0.1, 0.1, 0.5])]}
STREAMS = ("egm", "rsi")


def pose(y: float) -> dict[str, Any]:
    turn = to_quaternion(TIP[:3, :3]).tolist()
    return {"position": (TIP[:3, 3] + [0.0, y, 0.0]).tolist(), "quaternion_xyzw": turn}


ASKED: dict[str, Any] = {
    "robot": "ur5e", "start": {"joints": HOME}, "scene": "doors", "keep": True, "timeout": 60.0,
    "seed": 3, "witness": True,
}  # fmt: skip
SIGNAL = {"kind": "signal", "output": 2, "value": True}
BODIES: dict[str, tuple[str, dict[str, Any]]] = {
    "task": ("/v1/tasks", {"improve": 0.0, "stages": [
        {"kind": "move", "goal": {"joints": AWAY}}, {"kind": "wait", "duration": 0.5}, SIGNAL]}),
    "tour": ("/v1/tours", {"end": "start", "goals": [
        {"id": "a", "joints": AWAY, "dwell": 0.3}, {"id": "b", "joints": [-0.4, *HOME[1:]]}]}),
    "seam": ("/v1/plan", {"goal": {"pose": pose(0.1)}, "planner": "cartesian", "planner_options": {
        "tool_speed": 0.1, "waypoints": [{"pose": pose(y)} for y in (0.0, 0.05, 0.1)]}}),
}  # fmt: skip
PARTS = {"task": 3, "tour": 3, "seam": 1}


class Kept(NamedTuple):
    """A kept plan, its id and its answer."""

    kind: str
    id: str
    answer: dict[str, Any]
    client: httpx.Client

    def get(self, door: str = "", **query: Any) -> httpx.Response:
        return self.client.get(f"/v1/plans/{self.id}{door}", params=query)

    def post(self, door: str, **body: Any) -> httpx.Response:
        return self.client.post(f"/v1/plans/{self.id}{door}", json=body)


@pytest.fixture(scope="module", params=list(BODIES))
def kept(request: pytest.FixtureRequest, client: httpx.Client) -> Kept:
    kind: str = request.param
    if client.get("/v1/scenes/doors").status_code == 404:
        answer(client.post("/v1/scenes", json={"name": "doors", **CELL}), 201)
    path, body = BODIES[kind]
    made = answer(client.post(path, json=ASKED | body))
    return Kept(kind, made["plan_id"], made, client)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setattr("command_line.backends.local.cache_folder", lambda: tmp_path / "cache")
    return runner(capsys)


def test_it_is_listed_replayed_taken_elsewhere_and_forgotten(kept: Kept) -> None:
    listed = answer(kept.client.get("/v1/plans", params={"robot": "ur5e"}))["plans"]
    assert kept.id in [one["id"] for one in listed]
    assert answer(kept.get())["answer"] == {k: v for k, v in kept.answer.items() if k != "plan_id"}
    assert answer(kept.post("/replay"))["same"]
    changed = answer(kept.post("/replay", changes={"margin": 0.005}, keep_replay=True))
    assert any("premises/margin" in one for one in changed["differences"])
    taken = answer(kept.client.post("/v1/plans", json=answer(kept.get("/bundle"))), 201)
    assert taken["proved_here"]
    for one in (changed["plan_id"], taken["id"]):
        assert kept.client.delete(f"/v1/plans/{one}").status_code == 204
        problem(kept.client.get(f"/v1/plans/{one}"), 404, "NOT_FOUND")


def test_each_part_has_a_witness_that_is_accepted(kept: Kept) -> None:
    for part in range(PARTS[kept.kind]):
        assert (
            rejected(checker().read(kept.get("/witness", form="compact", part=part).content))
            is None
        )
    beyond = problem(kept.get("/witness", part=PARTS[kept.kind]), 422, "VALIDATION_ERROR")
    assert beyond["detail"] == f"this kept plan has no part {PARTS[kept.kind]}"


def test_it_has_a_page_a_space_and_perhaps_a_tree_and_a_stop(kept: Kept) -> None:
    page = kept.get("/view")
    assert page.text.startswith("<!doctype html>")
    assert "proved" in page.text
    assert len(kept.get("/swept", format="stl", tolerance=0.2).content) > 84
    tree, stop = kept.get("/view", tree=True), kept.post("/stop", at=0.3)
    if kept.kind == "seam":
        assert tree.status_code == 200
        assert answer(stop)["certificate"]["verified"]
    else:
        assert "have no tree" in problem(tree, 422, "VALIDATION_ERROR")["detail"]
        refused = problem(stop, 422, "VALIDATION_ERROR")
        assert f"/v1/{kept.kind}s: this kept plan has no single motion" in refused["detail"]
        assert "/v1/validate" in refused["hint"]
        part = (kept.answer.get("stages") or kept.answer["legs"])[0]
        proof = {"robot": "ur5e", "scene": "doors", "trajectory": part["trajectory"], "keep": True}
        again = answer(kept.client.post("/v1/validate", json=proof))["plan_id"]
        assert answer(kept.client.post(f"/v1/plans/{again}/stop", json={"at": 0.1}))["certificate"]


@pytest.mark.parametrize("form", get_args(Format))
def test_it_is_written_in_each_format(kept: Kept, form: str) -> None:
    body = {"plan": kept.id, "format": form, "sample_period": 0.05}
    if form in STREAMS:
        del body["sample_period"]
    told = kept.client.post("/v1/export", json=body)
    if kept.kind == "task" and form in STREAMS:
        refused = problem(told, 422, "VALIDATION_ERROR")
        assert (
            refused["detail"] == f"format: {form} streams positions alone, the program has signal 2"
        )
        return
    file = answer(told)
    assert file["proved"]
    # The arm stays at one goal of the tour, which is a part of its program too.
    assert len(file["parts"]) == PARTS[kept.kind] + (kept.kind == "tour")


def test_the_client_has_all_of_them(kept: Kept) -> None:
    with Client(str(kept.client.base_url)) as there:
        plans = there.plans
        assert kept.id in [one.id for one in plans.iterate("ur5e")]
        assert plans.get(kept.id).id == kept.id
        assert plans.replay(kept.id).same
        assert plans.bundle(kept.id).robot == "ur5e"
        assert plans.view(kept.id).startswith(b"<!doctype html>")
        assert rejected(checker().read(plans.witness(kept.id, part=PARTS[kept.kind] - 1))) is None
        assert there.export_plan(kept.id, "csv").proved
        if kept.kind == "seam":
            assert plans.stop(kept.id, 0.3).certificate.verified
        else:
            with pytest.raises(ValidationFailed, match="no single motion"):
                plans.stop(kept.id, 0.3)


def files(kept: Kept, folder: Path) -> dict[str, Path]:
    """A kept plan as a document, as a bundle and as its answer alone."""
    found = {"kept": kept.get().text, "bundle": kept.get("/bundle").text,
             "answer": json.dumps(kept.answer)}  # fmt: skip
    paths = {name: folder / f"{name}.json" for name in found}
    for name, path in paths.items():
        path.write_text(found[name])
    return paths


def test_the_shell_shows_and_writes_it(kept: Kept, run: Run, tmp_path: Path) -> None:
    url, scene, csv = (
        str(kept.client.base_url),
        tmp_path / "cell.json",
        str(tmp_path / "motion.csv"),
    )
    scene.write_text(json.dumps(CELL))
    there = run("view", kept.id, "--url", url, "-o", str(tmp_path / "page.html"))
    assert there.code == 0, there.err
    again = run("replay", kept.id, "--url", url)
    assert (again.code, again.out) == (0, "the answer is the same\n"), again.err
    for name, path in files(kept, tmp_path).items():
        words = ["--scene", str(scene)] if name != "bundle" else []
        robot = ["--robot", "ur5e"] if name == "answer" else []
        shown = run("view", str(path), *words, *robot)
        needed = words or ([] if kept.kind != "seam" else ["--scene", str(scene)])
        written = run("export", "ur5e", str(path), "--format", "csv", *needed, "-o", csv)
        if name == "answer" and kept.kind != "seam":
            assert (shown.code, written.code) == (3, 3)
            assert "--whole" in shown.err
            assert "`--whole`" in written.err
            continue
        assert shown.code == 0, shown.err
        if name != "answer":
            here = run("replay", str(path), *words, "--robot", "ur5e")
            assert here.out.startswith("the answer is the same"), here.err + here.out
        assert written.code == 0, written.err
        assert "PROVED free of collisions" in Path(csv).read_text()


def test_the_shell_proves_no_program_against_nothing(kept: Kept, run: Run, tmp_path: Path) -> None:
    """A name of a scene means nothing here, and no option is passed over."""
    path = files(kept, tmp_path)["kept"]
    words = ("export", "ur5e", str(path), "--format", "csv", "--different-scene")
    empty = tmp_path / "empty.json"
    empty.write_text('{"obstacles": []}')
    if kept.kind != "seam":
        refused = run(*words)
        assert refused.code == 3
        assert "there is no scene file 'doors'" in refused.err
        assert "--margin" in run(*words, "--scene", str(empty), "--margin", "0.1").err
    other = run(*words[:-1], "--scene", str(empty))
    assert "its proof is against 1 obstacle(s), here are 0" in other.err
    assert "itself only" in run(*words, "--scene", str(empty)).out


@pytest.mark.parametrize("name", ["kept", "bundle", "answer"])
def test_the_shell_takes_one_motion_or_names_the_many(
    kept: Kept, run: Run, tmp_path: Path, name: str
) -> None:
    path, scene = str(files(kept, tmp_path)[name]), tmp_path / "cell.json"
    scene.write_text(json.dumps(CELL))
    around, witness = ["--scene", str(scene)], tmp_path / "motion.witness"
    for words in (
        ["witness", "ur5e", path, *around, "-o", str(witness)], ["validate", "ur5e", path, *around],
        ["convert", path], ["retime", "ur5e", path],
        ["sweep", "ur5e", path, "-o", str(tmp_path / "motion.stl"), "--tolerance", "0.2"],
    ):  # fmt: skip
        told = run(*words)
        if kept.kind == "seam":
            assert told.code == 0, (words, told.err)
        else:
            assert told.code == 3, words
            assert f"it holds the {PARTS[kept.kind]} motions of a task or tour" in told.err, words
    if kept.kind == "seam":
        assert rejected(checker().read(witness.read_bytes())) is None


def test_tools_of_language_models_explain_show_and_prove_it(kept: Kept) -> None:
    url = str(kept.client.base_url)

    async def call(tool: str, **arguments: str) -> Any:
        async with AsyncClient(url) as there, McpClient(mcp_server(there, url)) as tools:
            return await tools.call_tool(tool, arguments)

    def ask(tool: str, **arguments: str) -> Any:
        return asyncio.run(call(tool, **arguments))

    told = ask("explain", plan_id=kept.id)
    assert not told.is_error, told.content
    says = told.structured_content["says"]
    assert not ask("view", plan_id=kept.id).is_error
    proof = ask("validate", motion=kept.id)
    if kept.kind == "seam":
        assert proof.structured_content["proved"]
        return
    assert "carry their own proof" in proof.content[0].text
    duration = kept.answer["time" if kept.kind == "tour" else "duration"]
    assert says[0] == f"{duration:.3f} s in all."
    assert len(says) == 1 + PARTS[kept.kind]
    assert all(", proved" in line for line in says[1:])

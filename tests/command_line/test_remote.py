"""Commands that ask a service: the same answers as in process, and its refusals."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from rich.status import Status

from service.app import create_app
from service.settings import Settings
from tests.command_line.commands import Run
from tests.service.robots import ASIDE, BOX_OBJ, FLOOR, POST, bench, urdf
from tests.service.server import serving

REACH = {"poses": [{"position": [1, 0, 1]}]}
TASK = {"stages": [{"kind": "wait", "duration": 1}]}
TOUR = {
    "goals": [{"id": "near", "joints": [0.2, 0.0]}, {"id": "far", "joints": [0.4, 0.0]}],
    "rounds": 0,
}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    app = create_app(Settings(data_dir=tmp_path_factory.mktemp("remote"), workers=1))
    with serving(app) as client:
        yield client


@pytest.fixture
def url(client: httpx.Client) -> str:
    return str(client.base_url)


def test_a_service_answers_as_this_process_does(run: Run, url: str, tmp_path: Path) -> None:
    floor = tmp_path / "floor.json"
    floor.write_text(json.dumps({"obstacles": [FLOOR]}))
    for words in (
        ("project", str(floor), "--points", "0.1,0.2,0.3", "--json"),
        ("fk", "panda", "-q", "home", "--json"),
        ("ik", "ur5e", "--pose", "0.4,0.1,0.5,3.14159,0,0", "--json"),
        ("check", "panda", "-q", "home", "--json"),
        ("robots", "panda", "--json"),
    ):
        there, here = run(*words, "--url", url), run(*words)
        assert there.code == here.code == 0, there.err
        for name, value in there.json.items():
            assert here.json[name] == value, name
    assert not run("scenes", "--json", "--url", url).json["scenes"], "the file's is forgotten"


def test_a_stored_scene_is_named(run: Run, client: httpx.Client, url: str, tmp_path: Path) -> None:
    assert client.post("/v1/scenes", json={"name": "posts", "obstacles": [POST]}).is_success
    assert "posts" in run("scenes", "--url", url).out
    goal = ",".join(map(str, ASIDE))
    words = ("--start", "home", "--goal", goal, "--scene", "posts", "--url", url)
    plan = tmp_path / "plan.json"
    answer = run("plan", "panda", *words, "-o", str(plan), "--timeout", "30")
    assert answer.code == 0, answer.err
    assert "\nproved\n" in answer.out
    there = run("validate", "panda", str(plan), "--scene", "posts", "--url", url)
    assert there.code == 0
    assert run("convert", str(plan), "--format", "csv", "--url", url).out.startswith("time,")


def test_a_robot_of_a_file_is_uploaded_for_one_command(
    run: Run, client: httpx.Client, url: str, tmp_path: Path
) -> None:
    (tmp_path / "box.obj").write_text(BOX_OBJ)
    path = tmp_path / "arm.urdf"
    path.write_text(urdf("box.obj"))
    before = client.get("/v1/robots").json()
    words = ("fk", str(path), "-q", "0.3,0.4", "--json")
    there, here = run(*words, "--url", url), run(*words)
    assert there.code == 0, there.out
    assert there.json["pose"] == here.json["pose"]
    assert client.get("/v1/robots").json() == before


def test_problems_of_a_service_are_shown_as_those_of_this_process(run: Run, url: str) -> None:
    for words in (("fk", "panda", "-q", "0,0"), ("ik", "panda", "--pose", "5,0,0,0,0,0")):
        there, here = run(*words, "--url", url), run(*words)
        assert there.code == here.code
        assert there.err == here.err
    unknown = run("fk", "nobody", "-q", "0", "--json", "--url", url)
    assert (unknown.code, json.loads(unknown.out)["code"]) == (3, "NOT_FOUND")


def test_a_service_is_looked_at_by_the_doctor(run: Run, url: str) -> None:
    answer = run("doctor", "--json", "--url", url)
    service = next(item for item in answer.json["findings"] if item["part"] == "service")
    assert service["state"] == "ok"
    assert "1 workers" in service["detail"]


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The stages that a terminal shows."""
    for name, value in (("TTY_COMPATIBLE", "1"), ("TTY_INTERACTIVE", "1"), ("TERM", "xterm")):
        monkeypatch.setenv(name, value)
    shown: list[str] = []
    monkeypatch.setattr(Status, "update", lambda _, stage: shown.append(stage))
    return shown


def test_a_terminal_shows_the_stages_of_a_service(
    run: Run, client: httpx.Client, url: str, stages: list[str]
) -> None:
    words = ("plan", "planar_rr", "--start", "0,0", "--goal", "1,1", "--timeout", "60", "--json")
    kept = client.get("/v1/plans").json()["plans"]
    there, here = run(*words, "--url", url), run(*words)
    assert there.code == 0, there.out
    assert {"straight_line", "certificate"} <= set(stages)
    assert there.json["trajectory"] == here.json["trajectory"]
    assert there.json.keys() == here.json.keys()
    assert client.get("/v1/plans").json()["plans"] == kept
    assert client.get("/v1/jobs").json()["jobs"][0]["operation"] == "POST /v1/plan"
    nowhere = run(*words[:5], "9,9", "--url", url)
    assert nowhere.code == 4
    assert "GOAL_STATE_INVALID" in nowhere.err


@pytest.mark.parametrize(
    ("command", "body", "operation"),
    [
        (("reach",), REACH, "POST /v1/robots/planar_rr/reach"),
        (("task", "--start", "0,0"), TASK, "POST /v1/tasks"),
        (("tour", "--start", "0,0"), TOUR, "POST /v1/tours"),
    ],
    ids=["reach", "task", "tour"],
)
def test_long_commands_are_jobs_of_a_service_on_a_terminal(
    run: Run,
    client: httpx.Client,
    url: str,
    stages: list[str],
    tmp_path: Path,
    command: tuple[str, ...],
    body: dict[str, object],
    operation: str,
) -> None:
    request = tmp_path / "request.json"
    request.write_text(json.dumps(body))
    words = (command[0], "planar_rr", str(request), *command[1:], "--timeout", "60", "--json")
    there, here = run(*words, "--url", url), run(*words)
    assert there.code == 0, there.out
    assert there.json.keys() == here.json.keys()
    assert len(stages) >= 2
    assert client.get("/v1/jobs").json()["jobs"][0]["operation"] == operation


def test_who_interrupts_a_command_ends_its_job(
    run: Run,
    client: httpx.Client,
    url: str,
    stages: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupt(_: Status, stage: str) -> None:
        stages.append(stage)
        if stage == "rrt_star":
            raise KeyboardInterrupt

    monkeypatch.setattr(Status, "update", interrupt)
    # It looks for shorter paths until its time is up.
    words = ("plan", "planar_rr", "--start", "0,0", "--goal", "1,1", "--planner", "rrt_star")
    answer = run(*words, "--timeout", "100", "--url", url)
    assert answer.code == 130
    assert "Traceback" not in answer.err
    job = client.get("/v1/jobs").json()["jobs"][0]
    assert client.get(f"/v1/jobs/{job['id']}").json()["status"] == "cancelled"


def test_a_service_that_is_not_there_has_its_exit_code(run: Run) -> None:
    answer = run("fk", "panda", "-q", "home", "--url", "http://127.0.0.1:9")
    assert answer.code == 7
    assert "http://127.0.0.1:9" in answer.err
    assert "Traceback" not in answer.err
    assert run("fk", "panda", "-q", "home", "--url", "nonsense").code == 3


def test_pages_come_from_a_service_and_from_its_bundles(
    run: Run, client: httpx.Client, url: str, tmp_path: Path
) -> None:
    place = {"name": "viewed", "obstacles": [FLOOR]}
    assert client.post("/v1/robots", json=bench("viewed_arm")).is_success
    assert client.post("/v1/scenes", json=place).is_success
    body = {"robot": "viewed_arm", "scene": "viewed", "joints": [[0.1, 0.2], [1.9, 1.9]]}
    plan_id = client.post("/v1/check", json=body | {"keep": True}).json()["plan_id"]
    file = tmp_path / "service.html"
    shown = run("view", plan_id, "--url", url, "-o", str(file))
    assert shown.code == 0, shown.err
    bundle = tmp_path / "plan.json"
    bundle.write_bytes(client.get(f"/v1/plans/{plan_id}/bundle").content)
    shown = run("view", str(bundle))
    assert shown.code == 0, shown.err
    pages = [path.read_text() for path in (file, tmp_path / "plan.html")]
    bodies = [re.search(r'"bodies":\[.*?\]', page) for page in pages]
    assert bodies[0] is not None
    assert bodies[1] is not None
    assert bodies[0][0] == bodies[1][0]
    assert run("view", "0" * 32, "--url", url).code == 3

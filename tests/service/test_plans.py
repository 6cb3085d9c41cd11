"""Kept plans over HTTP: kept, listed, replayed with changes, and taken to another installation."""

import json
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest

from armwright_client import Client
from armwright_wire.plans.kept_plan import Bundle, KeptPlan, PlanList, ReplayAnswer
from service.app import create_app
from service.http.keeping import answer_digest
from service.settings import Settings
from tests.service.jobs.requests import ended, submit
from tests.service.robots import FLOOR, HOME, answer, bench, problem, scene, solid
from tests.service.schemas.bodies import BUNDLE
from tests.service.server import serving

ARM = "kept_arm"
PLAN: dict[str, Any] = {
    "robot": ARM,
    "scene": "kept_scene",
    "start": {"joints": [-1.0, 0.4]},
    "goal": {"joints": [1.0, -0.4]},
    "planner": "rrt_connect",
    "timeout": 20.0,
    "seed": 5,
}
#: In the way of the outstretched arm: the elbow has to bend.
BAR = solid("bar", "box", [0.0, 0.0, 0.59], size=[0.1, 0.4, 0.1])
STAGE = {"name": "kept_scene", **scene(FLOOR, BAR)}


@pytest.fixture(scope="module")
def here(client: httpx.Client) -> httpx.Client:
    answer(client.post("/v1/robots", json=bench(ARM)), 201)
    answer(client.post("/v1/scenes", json=STAGE), 201)
    return client


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """Another installation, with neither the robot nor the scene."""
    data = tmp_path_factory.mktemp("elsewhere")
    with serving(create_app(Settings(data_dir=data, workers=1))) as client:
        yield client


@pytest.fixture(scope="module")
def plan(here: httpx.Client) -> dict[str, Any]:
    """A plan that was kept."""
    return answer(here.post("/v1/plan", json=PLAN | {"keep": True}))


def replay(client: httpx.Client, plan_id: str, **body: Any) -> dict[str, Any]:
    given = answer(client.post(f"/v1/plans/{plan_id}/replay", json=body))
    ReplayAnswer.model_validate(given)
    return given


def stored(client: httpx.Client, plan_id: str) -> dict[str, Any]:
    given = answer(client.get(f"/v1/plans/{plan_id}"))
    KeptPlan.model_validate(given)
    return given


def test_an_answer_is_kept_only_where_that_is_asked_for(here: httpx.Client) -> None:
    check = {"robot": "panda", "joints": HOME}
    count = len(answer(here.get("/v1/plans"))["plans"])
    for body in (check, check | {"keep": False}):
        response = here.post("/v1/check", json=body)
        assert "plan_id" not in response.json()
        assert "location" not in response.headers
    assert len(answer(here.get("/v1/plans"))["plans"]) == count
    response = here.post("/v1/check", json=check | {"keep": True})
    assert response.headers["location"] == f"/v1/plans/{response.json()['plan_id']}"


def test_a_kept_plan_has_all_that_it_came_from(here: httpx.Client, plan: dict[str, Any]) -> None:
    kept = stored(here, plan["plan_id"])
    assert kept["request"] == PLAN | {"keep": True}
    assert {"plan_id": kept["id"], **kept["answer"]} == plan
    assert kept["operation"] == "POST /v1/plan"
    assert kept["status"] == "succeeded"
    assert kept["seed"] == 5
    assert kept["version"] == plan["reproducibility"]["versions"]["armwright"]
    scene_tag = here.get("/v1/scenes/kept_scene").headers["etag"]
    assert kept["scene"] == {"name": "kept_scene", "hash": scene_tag.strip('"')}
    assert kept["robot"]["name"] == ARM
    assert len(kept["robot"]["hash"]) == 64
    listed = answer(here.get("/v1/plans", params={"robot": ARM}))
    PlanList.model_validate(listed)
    assert kept["id"] in [item["id"] for item in listed["plans"]]


def test_inverse_kinematics_and_proofs_are_kept(here: httpx.Client, plan: dict[str, Any]) -> None:
    body = {"robot": ARM, "trajectory": plan["trajectory"], "keep": True}
    proof = answer(here.post("/v1/validate", json=body))
    assert stored(here, proof["plan_id"])["answer"]["verified"]
    pose = answer(here.post(f"/v1/robots/{ARM}/fk", json={"joints": [0.3, 0.4]}))["pose"]
    body = {"pose": pose, "axes": ["x", "z"], "keep": True}
    solved = answer(here.post(f"/v1/robots/{ARM}/ik", json=body))
    kept = stored(here, solved["plan_id"])
    assert kept["robot"]["name"] == ARM
    assert kept["operation"] == f"POST /v1/robots/{ARM}/ik"
    assert replay(here, kept["id"])["same"]


def test_the_space_of_a_kept_motion_is_a_mesh(here: httpx.Client, plan: dict[str, Any]) -> None:
    path = f"/v1/plans/{plan['plan_id']}/swept"
    with Client(str(here.base_url)) as client:
        glb = client.plans.swept(plan["plan_id"], tolerance=0.02)
    assert glb[:4] == b"glTF"
    response = here.get(path, params={"format": "stl", "tolerance": 0.02})
    assert response.headers["content-disposition"].endswith('.stl"')
    assert len(response.content) == 84 + 50 * int.from_bytes(response.content[80:84], "little")
    proof = {"robot": ARM, "trajectory": plan["trajectory"], "keep": True}
    validated = answer(here.post("/v1/validate", json=proof))["plan_id"]
    again = here.get(f"/v1/plans/{validated}/swept", params={"format": "stl", "tolerance": 0.02})
    assert again.content == response.content
    problem(here.get(path, params={"format": "obj"}), 422, "VALIDATION_ERROR")
    checked = {"robot": ARM, "joints": [0.0, 0.0], "keep": True}
    still = answer(here.post("/v1/check", json=checked))["plan_id"]
    told = problem(here.get(f"/v1/plans/{still}/swept"), 422, "VALIDATION_ERROR")
    assert "no motion" in told["detail"]


def test_a_failure_is_kept_with_its_reason(here: httpx.Client) -> None:
    body = PLAN | {"keep": True, "start": {"joints": [1.9, 1.9]}, "margin": 0.3}
    response = here.post("/v1/plan", json=body)
    refused = problem(response, 422, "START_STATE_IN_COLLISION")
    plan_id = refused["details"]["plan_id"]
    assert response.headers["location"] == f"/v1/plans/{plan_id}"
    kept = stored(here, plan_id)
    assert kept["status"] == "failed"
    assert kept["code"] == kept["problem"]["code"] == refused["code"]
    again = replay(here, plan_id)
    assert again["same"]
    assert again["problem"]["code"] == refused["code"]


def test_malformed_requests_are_not_kept(here: httpx.Client) -> None:
    count = len(answer(here.get("/v1/plans"))["plans"])
    for wrong, status, code in (
        ({"timeout": 1e4}, 422, "VALIDATION_ERROR"),
        ({"robot": "nobody"}, 404, "NOT_FOUND"),
        ({"unknown": 1}, 422, "VALIDATION_ERROR"),
    ):
        problem(here.post("/v1/plan", json=PLAN | {"keep": True} | wrong), status, code)
    assert len(answer(here.get("/v1/plans"))["plans"]) == count


def test_answers_of_jobs_are_kept_unless_refused(here: httpx.Client) -> None:
    job = ended(here, submit(here, PLAN))
    plan_id = job["result"]["plan_id"]
    assert job["location"] == f"/v1/plans/{plan_id}"
    assert stored(here, plan_id)["job"] == job["id"]
    job = ended(here, submit(here, PLAN | {"keep": False}))
    assert "plan_id" not in job["result"]
    job = ended(here, submit(here, {}, f"/v1/plans/{plan_id}/replay"))
    assert job["result"]["same"]
    assert stored(here, job["result"]["plan_id"])["replay_of"] == plan_id


def test_changes_are_merged_into_the_request(here: httpx.Client, plan: dict[str, Any]) -> None:
    changes = {"goal": {"joints": [0.5, -0.4]}, "seed": None, "timing": {"velocity_scaling": 0.5}}
    again = replay(here, plan["plan_id"], changes=changes)
    assert not again["same"]
    assert "/path/joints" in " ".join(again["differences"])
    assert again["answer"]["path"]["joints"][-1] == [0.5, -0.4]
    assert again["answer"]["reproducibility"]["seed"] == 0
    url = f"/v1/plans/{plan['plan_id']}/replay"
    problem(here.post(url, json={"changes": {"unknown": 1}}), 422, "VALIDATION_ERROR")
    problem(here.post(url, json={"changes": {"robot": "nobody"}}), 404, "NOT_FOUND")


def test_a_replay_has_the_robot_and_scene_of_its_plan(here: httpx.Client) -> None:
    place = {"name": "moved", **scene(FLOOR)}
    answer(here.post("/v1/scenes", json=place), 201)
    plan_id = answer(here.post("/v1/plan", json=PLAN | {"scene": "moved", "keep": True}))["plan_id"]
    wall = {"id": "wall", "shape": {"type": "box", "size": [2, 2, 2]}}
    crowded = scene(FLOOR, {**wall, "pose": {"position": [0, 0, 0.9]}})
    answer(here.put("/v1/scenes/moved", json=crowded))
    assert replay(here, plan_id)["same"]
    blocked = replay(here, plan_id, documents="current")
    assert blocked["problem"]["code"] == "START_STATE_IN_COLLISION"
    assert here.delete("/v1/scenes/moved").status_code == 204
    assert replay(here, plan_id)["same"]
    url = f"/v1/plans/{plan_id}/replay"
    problem(here.post(url, json={"documents": "current"}), 404, "NOT_FOUND")


def test_another_installation_replays_a_bundle_to_the_same_bytes(
    here: httpx.Client, elsewhere: httpx.Client, plan: dict[str, Any]
) -> None:
    response = here.get(f"/v1/plans/{plan['plan_id']}/bundle")
    assert response.headers["content-disposition"].startswith("attachment")
    bundle = answer(response)
    Bundle.model_validate(bundle)
    imported = elsewhere.post("/v1/plans", json=bundle)
    summary = answer(imported, 201)
    assert imported.headers["location"] == f"/v1/plans/{summary['id']}"
    again = replay(elsewhere, summary["id"])
    assert again["same"], again["differences"]
    assert again["digest"] == stored(here, plan["plan_id"])["digest"]
    assert json.dumps(again["answer"]["trajectory"]) == json.dumps(plan["trajectory"])
    assert json.dumps(again["answer"]["certificate"]) == json.dumps(plan["certificate"])
    problem(elsewhere.get(f"/v1/robots/{ARM}"), 404, "NOT_FOUND")


def test_a_bundle_that_was_changed_is_refused(here: httpx.Client, plan: dict[str, Any]) -> None:
    bundle = answer(here.get(f"/v1/plans/{plan['plan_id']}/bundle"))
    changed = json.dumps(json.loads(bundle["answer"]) | {"planner": "other"})
    for field, value in [
        ("answer", changed),
        ("request", "[]"),
        ("request", ""),
        ("answer", ""),
        ("status", "failed"),
        ("operation", "POST /v1/robots"),
        ("operation", "POST /v1/nothing"),
        ("digest", "0" * 64),
        ("robot_document", "{}"),
        ("robot_document", "no JSON"),
        ("robot_document", '{"name": "a", "urdf": 3}'),
        ("scene_document", "{}"),
        ("scene_document", '{"obstacles": [{"id": "a"}]}'),
        ("armwright_bundle", 2),
    ]:
        response = here.post("/v1/plans", json=bundle | {field: value})
        refused = problem(response, 422, "VALIDATION_ERROR")
        assert field in refused["detail"]


def test_bundles_name_the_operations_that_can_be_kept(here: httpx.Client) -> None:
    document = answer(here.get("/openapi.json"))
    keepable = set()
    for path, methods in document["paths"].items():
        body = methods.get("post", {}).get("requestBody", {}).get("content", {})
        name = body.get("application/json", {}).get("schema", {}).get("$ref", "").split("/")[-1]
        if "keep" in document["components"]["schemas"].get(name, {}).get("properties", {}):
            keepable.add(path.replace("{name}", ARM))
    bundle = BUNDLE | {"robot": ARM}
    assert "/v1/plan" in keepable
    for path in keepable:
        Bundle.model_validate(bundle | {"operation": f"POST {path}"})


def test_a_bundle_whose_answer_is_of_something_else_has_no_page(here: httpx.Client) -> None:
    odd = json.dumps({"joints": [[0.0], [0.0, 1.0]]})
    for request, content in (("{}", "{}"), (odd, odd)):
        bundle = BUNDLE | {
            "operation": "POST /v1/check", "status": "succeeded", "request": request,
            "answer": content, "digest": answer_digest(content.encode()), "robot": "planar_rr",
            "robot_document": None, "scene": None, "scene_document": None,
        }  # fmt: skip
        kept = answer(here.post("/v1/plans", json=bundle), 201)
        problem(here.get(f"/v1/plans/{kept['id']}/view"), 422, "VALIDATION_ERROR")


# ------------------------------------------------------------------------- bundles from outside


def imported(client: httpx.Client, bundle: dict[str, Any]) -> dict[str, Any]:
    """A bundle as it is kept elsewhere, its digest that of its answer."""
    digest = answer_digest(bundle["answer"].encode())
    summary = answer(client.post("/v1/plans", json=bundle | {"digest": digest}), 201)
    kept = stored(client, summary["id"])
    listed = answer(client.get("/v1/plans", params={"limit": 1}))["plans"][0]
    assert summary["proved_here"] == kept["proved_here"] == listed["proved_here"]
    return kept


def page_of(client: httpx.Client, kept: dict[str, Any]) -> str:
    response = client.get(f"/v1/plans/{kept['id']}/view")
    assert response.status_code in (200, 422), response.text
    return response.text


def changed(bundle: dict[str, Any], part: str, place: tuple[Any, ...], value: Any) -> Any:
    """A bundle of which one value of a text is another."""
    document = json.loads(bundle[part])
    holder = document
    for name in place[:-1]:
        holder = holder[name]
    holder[place[-1]] = value
    return bundle | {part: json.dumps(document)}


def numbers(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], float]]:
    """Numbers of a JSON value that are no measured times, with their places."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for name, item in items if isinstance(value, dict | list) else ():
        if isinstance(item, float) and name != "milliseconds":
            yield (*at, name), item
        elif isinstance(item, dict | list):
            yield from numbers(item, (*at, name))


@pytest.fixture(scope="module")
def genuine(here: httpx.Client, plan: dict[str, Any]) -> dict[str, Any]:
    return answer(here.get(f"/v1/plans/{plan['plan_id']}/bundle"))


def test_a_bundle_that_says_the_truth_is_proved_again(
    here: httpx.Client, elsewhere: httpx.Client, genuine: dict[str, Any], plan: dict[str, Any]
) -> None:
    assert stored(here, plan["plan_id"])["proved_here"] is True
    kept = imported(elsewhere, genuine)
    assert kept["proved_here"] is True
    page = page_of(elsewhere, kept)
    assert "Everything that the request names is proved" in page
    assert "Proved here" in page
    assert "Not proved here" not in page


FORGED = {
    "collisions ignored": ("request", ("collisions",), "ignore"),
    "another start": ("request", ("start", "joints"), [-1.0, 0.401]),
    "another margin": ("request", ("margin",), 0.2),
    "pairs that may touch": ("request", ("allowed_collisions",), [["upper", "bar"]]),
    "something held": (
        "request",
        ("attached",),
        [solid("rod", "sphere", [0.0, 0.0, 0.3], radius=0.02) | {"link": "upper"}],
    ),
    "robot hash": ("answer", ("reproducibility", "robot_hash"), "0" * 64),
    "scene hash of the premises": ("answer", ("certificate", "premises", "scene_hash"), "0" * 64),
    "no obstacle": ("scene_document", ("obstacles",), [FLOOR]),
    "clearance": ("answer", ("certificate", "min_clearance"), 9.0),
    "text of the certificate": ("answer", ("certificate", "method"), "by hand"),
    "reasons": ("answer", ("certificate", "proved", "reasons"), ["none"]),
    "notes": ("answer", ("notes",), ["all is well"]),
    "limits of the robot": ("robot_document", ("joint_limits", "elbow", "acceleration"), 5.5),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_bundle_is_not_proved_here(
    elsewhere: httpx.Client, genuine: dict[str, Any], name: str
) -> None:
    kept = imported(elsewhere, changed(genuine, *FORGED[name]))
    assert kept["proved_here"] is False
    page = page_of(elsewhere, kept)
    assert "Everything that the request names is proved" not in page
    assert "Nothing collides at any instant" not in page


def test_no_number_of_an_answer_can_be_changed(
    elsewhere: httpx.Client, genuine: dict[str, Any]
) -> None:
    random = np.random.default_rng(8)
    places = [*numbers(json.loads(genuine["answer"]))]
    for k in random.choice(len(places), 12, replace=False):
        place, value = places[k]
        forged = changed(genuine, "answer", place, value + 1e-9 * max(1.0, abs(value)))
        kept = imported(elsewhere, forged)
        assert kept["proved_here"] is False, place
        assert "Not proved here" in page_of(elsewhere, kept)


def test_a_forged_task_check_and_proof_are_not_proved_here(
    here: httpx.Client, elsewhere: httpx.Client, plan: dict[str, Any]
) -> None:
    stage = {"kind": "move", "goal": {"joints": [0.5, 0.5]}}
    asked: dict[str, dict[str, Any]] = {
        "tasks": {"robot": "planar_rr", "start": {"joints": [0.0, 0.0]}, "stages": [stage]},
        "check": {"robot": ARM, "joints": [[0.3, 0.4], [-1.2, 0.1]], "scene": "kept_scene"},
        "validate": {"robot": ARM, "trajectory": plan["trajectory"], "scene": "kept_scene"},
    }
    forged = {
        "tasks": (("stages", 0, "certificate", "min_clearance"), 7.0),
        "check": (("valid",), [True, True]),
        "validate": (("min_clearance",), 7.0),
    }
    for name, body in asked.items():
        told = answer(here.post(f"/v1/{name}", json=body | {"keep": True}))
        bundle = answer(here.get(f"/v1/plans/{told['plan_id']}/bundle"))
        assert imported(elsewhere, bundle)["proved_here"] is True, name
        if name == "check":
            bundle = changed(bundle, "answer", ("clearance",), [7.0, 7.0])
        place, value = forged[name]
        kept = imported(elsewhere, changed(bundle, "answer", place, value))
        assert kept["proved_here"] is False
        page = page_of(elsewhere, kept)
        assert "Not proved here" in page
        assert "7000.0 mm" not in page


def test_a_motion_that_is_not_proved_is_not_proved_here(here: httpx.Client) -> None:
    body = {"robot": ARM, "scene": "kept_scene", "keep": True}
    segment = {"t0": 0.0, "t1": 9.0, "coefficients": [[-1.0, 2.0 / 9.0], [0.0, 0.0]]}
    told = answer(here.post("/v1/validate", json=body | {"trajectory": {"segments": [segment]}}))
    assert told["verified"] is False
    kept = stored(here, told["plan_id"])
    assert kept["proved_here"] is False
    assert "Not proved" in page_of(here, kept)


def test_a_robot_that_the_request_does_not_name_is_not_drawn_as_proved(
    elsewhere: httpx.Client, genuine: dict[str, Any]
) -> None:
    assert imported(elsewhere, genuine | {"robot": "another_arm"})["proved_here"] is False

"""Tasks of several stages over HTTP: proved again by validate, chained, refused where wrong."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_client import (
    Client,
    CloseStage,
    Scene,
)
from armwright_wire.plans.task import TaskAnswer, TaskRequest
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from tests.planning.sequence import fingers
from tests.service.jobs.requests import ended, submit
from tests.service.robots import HOME, answer, problem, solid

EXAMPLE: Any = TaskRequest.model_json_schema()["examples"][0]
TASK: dict[str, Any] = EXAMPLE | {"improve": 0.0, "timeout": 30.0}


def plan(client: httpx.Client, **changes: Any) -> Any:
    planned = answer(client.post("/v1/tasks", json=TASK | changes))
    TaskAnswer.model_validate(planned)
    return planned


def stages(*changes: tuple[int, dict[str, Any]]) -> list[dict[str, Any]]:
    """The stages of the example, some of them changed."""
    made = [dict(stage) for stage in TASK["stages"]]
    for k, change in changes:
        made[k] = {n: v for n, v in (made[k] | change).items() if v is not None}
    return made


def test_every_stage_is_proved_anew_by_validate(client: httpx.Client) -> None:
    planned = plan(client)
    assert planned["status"] == "success"
    places: dict[str, Any] = {}
    fingers: dict[str, float] = {}
    for stage in planned["stages"]:
        # The certificate is about what is held in the stage: the same is told to validate.
        held = stage["after"]["attached"]
        if stage["kind"] == "detach":
            places = {o["id"]: {"pose": o["pose"]} for o in stage["after"]["objects"]}
        scene = [o | places.get(o["id"], {}) for o in TASK["scene"]["obstacles"]]
        allowed = [item["pair"] for item in stage["certificate"]["allowed_collisions"]]
        body = {"robot": "panda", "scene": {"obstacles": scene}, "attached": held,
                "trajectory": stage["trajectory"], "fingers": fingers,
                "allowed_collisions": allowed}  # fmt: skip
        fingers = stage["after"]["fingers"]
        certificate = answer(client.post("/v1/validate", json=body))
        assert certificate["verified"], (stage["kind"], certificate["violation"])
        assert certificate["min_clearance"] == pytest.approx(
            stage["certificate"]["min_clearance"], abs=1e-6
        )
        # Told with these numbers, robot and scene are the same to the last bit.
        assert certificate["premises"] == stage["certificate"]["premises"]
        assert certificate["premises"]["attached"] == [item["id"] for item in held]
        if stage["kind"] == "lift":
            asked = body | {"format": "csv", "premises": stage["certificate"]["premises"]}
            told = answer(client.post("/v1/export", json=asked))
            assert "holding crate" in told["content"]
            refused = client.post("/v1/export", json=asked | {"attached": []})
            words = problem(refused, 422, "VALIDATION_ERROR")["detail"]
            assert "has the robot hold crate, here it holds nothing" in words
    ends = [s["begins"] + s["trajectory"]["duration"] for s in planned["stages"]]
    assert planned["duration"] == pytest.approx(ends[-1])
    assert [s["begins"] for s in planned["stages"][1:]] == pytest.approx(ends[:-1])


def test_a_task_goes_on_where_the_one_before_ended(client: httpx.Client) -> None:
    first = plan(client, stages=TASK["stages"][:6])
    after = first["stages"][-1]["after"]
    assert [item["id"] for item in after["attached"]] == ["crate"]
    last = first["stages"][-1]["trajectory"]["segments"][-1]
    t = last["t1"] - last["t0"]
    q = [sum(c * t**k for k, c in enumerate(row)) for row in last["coefficients"]]
    second = plan(client, start={"joints": q}, stages=TASK["stages"][6:], **after)
    done = second["stages"][-1]["after"]
    assert done["attached"] == []
    assert [item["id"] for item in done["objects"]] == ["crate"]
    at = done["objects"][0]["pose"]["position"]
    assert np.abs(np.array(at) - [0.5, 0.25, 0.15]).max() <= 0.05 + 1e-9


def test_an_object_that_was_moved_before_is_told_though_no_stage_moves_it(
    client: httpx.Client,
) -> None:
    (crate,) = (o for o in TASK["scene"]["obstacles"] if o["id"] == "crate")
    x, y, z = crate["pose"]["position"]
    there = {"id": "crate", "pose": {"position": [x, y - 0.1, z]}}
    waited = plan(client, stages=[{"kind": "wait", "duration": 0.1}], objects=[there])
    (told,) = waited["stages"][-1]["after"]["objects"]
    assert told["id"] == "crate"
    assert told["pose"]["position"] == pytest.approx([x, y - 0.1, z])


def test_it_is_a_job_with_progress_where_that_is_asked_for(client: httpx.Client) -> None:
    job = ended(client, submit(client, TASK, "/v1/tasks"))
    assert job["status"] == "succeeded"
    assert len(job["result"]["stages"]) == len(TASK["stages"])


@pytest.mark.parametrize(
    ("changes", "index", "code", "message"),
    [
        ({"stages": [{"kind": "detach", "object": "crate"}]}, 0, "VALIDATION_ERROR", "to be held"),
        ({"stages": [{"kind": "place", "poses": [{"position": [0.5, 0.2, 0.2]}]}]}, 0,
         "VALIDATION_ERROR", "held"),
        ({"stages": stages((8, {"region": None, "poses": [
            {"position": [0.5, 0.2, 0.2], "frame": "moon"}]}))}, 8, "INVALID_LINK_NAME", "moon"),
        ({"stages": stages((4, {"object": "box"}))}, 4, "INVALID_OBJECT_NAME", "'box'"),
        ({"stages": stages((2, {"touch_links": ["claw"]}))}, 2, "INVALID_LINK_NAME", "'claw'"),
        ({"stages": stages((8, {"region": None, "poses": [
            {"position": [0.5, 0.2, 0.2], "frame": "panda_link5"}]}))}, 8, "INVALID_LINK_NAME",
         "panda_link5"),
        ({"stages": stages((12, {"goal": None, "end_of": "nowhere"}))}, 12, "VALIDATION_ERROR",
         "nowhere"),
        ({"stages": stages((12, {"goal": {"joints": [0.0]}}))}, 12, "INVALID_ROBOT_STATE", "7"),
        ({"stages": [{"kind": "move", "goal": {"pose": {"position": [0.5, 0.2, 0.3]},
                                               "position_tolerance": 0.01}}]}, 0,
         "VALIDATION_ERROR", "position_tolerance"),
        ({"stages": stages((5, {"distance": [0.3, 0.2]}))}, 5, "VALIDATION_ERROR", "distance"),
        ({"stages": [{"kind": "move", "goal": {"joints": [*HOME]}, "blend": 0.1}]}, 0,
         "VALIDATION_ERROR", "no free motion follows"),
        ({"stages": stages((8, {"region": {"pose": {"position": [3.0, 0.0, 0.2]}}}))}, 8,
         "PLANNING_FAILED", "out_of_reach"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_stage_and_cure(
    client: httpx.Client, changes: dict[str, Any], index: int, code: str, message: str
) -> None:
    told = problem(client.post("/v1/tasks", json=TASK | changes), 422, code)
    assert message in told["detail"]
    assert told["details"]["index"] == index
    assert told["hint"]


def test_the_deadline_of_a_task_is_told(client: httpx.Client) -> None:
    told = problem(client.post("/v1/tasks", json=TASK | {"timeout": 0.01}), 504, "TIMED_OUT")
    assert told["hint"]


def test_the_first_stages_are_answered_only_where_that_is_asked_for(client: httpx.Client) -> None:
    grasp = {"grasps": [{"position": [0, 0, 0.02], "rpy": [np.pi, 0, 0]}], "region": None}
    changed = stages((2, grasp), (5, {"distance": [2.0, 2.0]}))
    asked = TASK | {"stages": changed}
    told = problem(client.post("/v1/tasks", json=asked), 422, "PLANNING_FAILED")
    assert told["details"]["index"] == 5
    partial = plan(client, stages=changed, allow_partial=True)
    assert partial["status"] == "partial"
    assert [stage["index"] for stage in partial["stages"]] == [0, 1, 2, 3, 4]
    assert partial["failure"]["index"] == 5


@pytest.fixture
def claws(client: httpx.Client) -> str:
    """Name of the Panda whose fingers move."""
    body = {"name": "claws", "urdf": fingers.urdf(), "srdf": fingers.srdf()}
    assert client.post("/v1/robots", json=body).status_code in (201, 409)
    return "claws"


def test_check_plan_and_validate_have_the_fingers_where_they_are_told(
    client: httpx.Client, claws: str
) -> None:
    # A ball where the left plate is at 0.055 and not at 0: beside the middle of the hand.
    at = forward(builtin_chain("panda"), np.array(HOME), "panda_hand") @ [0.0, 0.055, 0.13, 1.0]
    ball = solid("ball", "sphere", at[:3].tolist(), radius=0.003)
    there = [HOME[0] + 0.5, *HOME[1:]]
    body: dict[str, Any] = {"robot": claws, "scene": {"obstacles": [ball]}}
    wide = {"fingers": {"claw_left": 0.055}}
    assert answer(client.post("/v1/check", json=body | {"joints": HOME}))["valid"]
    touched = answer(client.post("/v1/check", json=body | wide | {"joints": HOME}))
    assert [sorted(hit["pair"]) for hit in touched["collisions"]] == [["ball", "claw_left_plate"]]
    asked = body | {"start": {"joints": HOME}, "goal": {"joints": there}}
    planned = answer(client.post("/v1/plan", json=asked))
    told = problem(client.post("/v1/plan", json=asked | wide), 422, "START_STATE_IN_COLLISION")
    assert sorted(told["details"]["pair"]) == ["ball", "claw_left_plate"]
    motion = body | {"trajectory": planned["trajectory"]}
    assert answer(client.post("/v1/validate", json=motion))["verified"]
    certificate = answer(client.post("/v1/validate", json=motion | wide))
    assert not certificate["verified"]
    assert sorted(certificate["violation"]["pair"]) == ["ball", "claw_left_plate"]
    for path, given in (("check", {"joints": HOME}), ("validate", motion), ("plan", asked)):
        unknown = body | given | {"fingers": {"panda_joint1": 0.1}}
        refused = problem(client.post(f"/v1/{path}", json=unknown), 422, "VALIDATION_ERROR")
        assert "claw_left" in refused["hint"]
    with Client(str(client.base_url)) as connected:
        around = Scene.model_validate(body["scene"])
        seen = connected.check(claws, HOME, scene=around, fingers=wide["fingers"])
    assert not seen.valid


def test_fingers_move_and_the_next_task_begins_where_they_are(
    client: httpx.Client, claws: str
) -> None:
    touches = ["panda_hand", "claw_left_plate", "claw_right_plate"]
    # The plates close to 5 mm less than the crate is wide on either side.
    grip = {"touch_links": touches, "touch_depth": 0.02}
    asked = [{"kind": "open"}, *stages((2, grip))[:5]]
    first = plan(client, robot=claws, stages=asked)
    assert first["stages"][0]["fingers"]["joint_names"] == ["claw_left", "claw_right"]
    assert first["stages"][1]["fingers"] is None
    after = first["stages"][-1]["after"]
    assert after["fingers"] == {"claw_left": 0.025}
    last = first["stages"][-1]["trajectory"]["segments"][-1]["coefficients"]
    joints = [row[0] for row in last]
    opens = {"kind": "open", "joints": {"claw_left": 0.03}}
    going = {"robot": claws, "start": {"joints": joints}}
    second = plan(client, **going, stages=[opens], allowed_collisions=[["crate", "table"]], **after)
    (segment,) = second["stages"][0]["fingers"]["segments"]
    assert [row[0] for row in segment["coefficients"]] == pytest.approx([0.025, 0.025])
    assert second["stages"][0]["after"]["fingers"] == {"claw_left": 0.03}
    wide = TASK | going | {"stages": [{"kind": "open", "state": "wide"}]}
    told = problem(client.post("/v1/tasks", json=wide), 422, "VALIDATION_ERROR")
    assert told["details"]["index"] == 0
    assert "open, close" in told["hint"]
    with Client(str(client.base_url)) as connected:
        stage = CloseStage(joints={"claw_left": 0.0})
        closed = connected.plan_task(claws, HOME, [stage], fingers={"claw_left": 0.02})
    motion = closed.stages[0].fingers
    assert motion is not None
    assert motion.sample([0.0])[0] == pytest.approx([0.02, 0.02])
    assert closed.stages[0].after.as_options()["fingers"] == {"claw_left": 0.0}


def test_a_kept_task_is_seen_and_exported_with_the_tools_it_had(client: httpx.Client) -> None:
    mill = {"form": {"type": "spindle", "length": 0.1}}
    answer(client.put("/v1/tools/mill", json=mill), 201)
    home = [0.0, -1.4, 1.5, -1.67, -1.57, 0.0]
    stages = [
        {"kind": "move", "goal": {"joints": [0.5, *home[1:]]}},
        {"kind": "signal", "output": 3},
        {"kind": "move", "goal": {"joints": home}, "tool": "mill"},
    ]
    body = {"robot": "ur5e", "start": {"joints": home}, "stages": stages, "keep": True}
    body |= {"margins": {"links": {"forearm_link": 0.01}}, "timeout": 20.0}
    planned = answer(client.post("/v1/tasks", json=body))
    assert planned["stages"][2]["certificate"]["premises"]["tool"] == "mill/tip"
    answer(client.put("/v1/tools/mill", json={"form": {"type": "torch"}}))
    plan_id = planned["plan_id"]
    assert client.get(f"/v1/plans/{plan_id}/view").status_code == 200
    asked = {"plan": plan_id, "format": "urscript_movej", "blend": 0.02}
    made = answer(client.post("/v1/export", json=asked))
    assert made["proved"], made["unproved"]
    assert [part["kind"] for part in made["parts"]] == ["move", "signal", "move"]
    assert made["content"].index("set_standard_digital_out(3, True)") < made["content"].index(
        "take_mill()"
    )
    told = [part["certificate"]["premises"] for part in made["parts"]]
    assert told == [stage["certificate"]["premises"] for stage in planned["stages"]]
    again = answer(client.post(f"/v1/plans/{plan_id}/replay", json={}))
    assert again["same"], again["differences"]
    problem(client.post("/v1/export", json=asked | {"plan": "nothing"}), 404, "NOT_FOUND")
    both = asked | {"robot": "ur5e"}
    problem(client.post("/v1/export", json=both), 422, "VALIDATION_ERROR")


def test_a_seam_is_exported_by_the_id_of_its_plan(client: httpx.Client) -> None:
    points = [{"point": [0.45, y, 0.35], "normal": [0, 0, 1]} for y in (-0.1, 0.1)]
    options = {"waypoints": points, "tolerance": {"free": ["rz"]}, "tool_speed": 0.1}
    body = {"robot": "ur5e", "start": {"joints": [0.0, -1.4, 1.5, -1.67, -1.57, 0.0]},
            "planner": "cartesian", "planner_options": options, "keep": True,
            "timeout": 20.0}  # fmt: skip
    plan_id = answer(client.post("/v1/plan", json=body))["plan_id"]
    made = answer(client.post("/v1/export", json={"plan": plan_id, "format": "rapid"}))
    assert made["proved"]
    assert "MoveAbsJ" in made["content"]

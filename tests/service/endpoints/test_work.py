"""Blocks, tools by stage and programs as requests ask for them, called in this process."""

import io
import json
import re
from base64 import b64decode
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

import armwright as aw
from armwright_wire.motions.export import ExportAnswer
from armwright_wire.plans.task import TaskAnswer
from armwright_wire.plans.tour import TourAnswer
from armwright_wire.pose import Pose
from kinematics.errors import ArmwrightError, InvalidOption
from kinematics.pose import inverse
from service.endpoints.export.task import export
from service.endpoints.plans.view import swept, view
from service.endpoints.tasks.task import plan_sequence
from service.endpoints.tours.task import tour
from service.storage.caches.cache_key import builtin_reference
from service.storage.caches.mounts import mount_of, with_tools
from service.translate.poses import transform as transform_of_pose
from tests.planning.pinocchio_arm import PinocchioArm
from tests.service.endpoints.ask import PANDA, answer_of, problem_of
from tests.service.robots import solid

TENDING = Path(__file__).parents[3] / "examples" / "machine_tending.yaml"
TASK: dict[str, Any] = {"robot": "ur5e"} | yaml.safe_load(TENDING.read_text("utf-8"))
HOME = TASK["start"]["joints"]
UR = builtin_reference("ur5e")


def transform_of(pose: dict[str, Any]) -> Any:
    return transform_of_pose(Pose.model_validate(pose))


def no_tool(name: str) -> bytes:
    raise AssertionError(name)


def mounted(body: dict[str, Any]) -> Any:
    return replace(UR, mount=mount_of(body, no_tool))


def solved(**changes: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    body = TASK | changes
    return body, answer_of(plan_sequence, mounted(body), body, TaskAnswer)


@cache
def tending() -> dict[str, Any]:
    return solved()[1]


def program(operation: str, body: dict[str, Any], answer: Any, **more: Any) -> dict[str, Any]:
    plan = {"operation": operation, "request": body, "answer": answer}
    asked = {"plan": plan, "sample_period": 0.05, "ports": {"speed": 2}} | more
    made: dict[str, Any] = answer_of(export, mounted(body), asked, ExportAnswer)
    return made


def test_every_part_comes_to_its_chuck_and_the_tool_changes() -> None:
    stages = tending()["stages"]
    items = [stage["item"] for stage in stages]
    assert items == ["part_1"] * 15 + ["part_2"] * 15 + ["part_3"] * 15 + [None] * 5
    assert all(stage["certificate"]["verified"] for stage in stages)
    said = [(s["kind"], s["event"]["port"]) for s in stages if s["event"] is not None]
    assert said == [("signal", 3), ("wait_for", 1)] * 3 + [("set", "speed")] * 2
    tips = [stage["certificate"]["premises"]["tool"] for stage in stages]
    assert tips == ["parallel_jaw/tip"] * 46 + ["spindle/tip"] * 4
    placed = {one["id"]: one["pose"]["position"] for one in stages[-1]["after"]["objects"]}
    for k in range(3):
        assert placed[f"part_{k + 1}"] == pytest.approx([0.4 + 0.12 * k, -0.3, 0.083], abs=1e-4)


def test_the_page_and_the_space_of_the_work() -> None:
    kept = {"operation": "POST /v1/tasks", "request": TASK, "answer": tending(),
            "proved_here": True}  # fmt: skip
    content = view(mounted(TASK), None, json.dumps(kept).encode())
    assert isinstance(content, bytes)
    found = re.search(rb'type="application/json">(.*?)</script>', content, re.DOTALL)
    assert found is not None
    data = json.loads(found[1])
    assert {"part_1", "part_2", "part_3"} == set(data["carriers"])
    assert len(data["stages"]) == 50
    # A hull for each piece and cell of time: one stage with the jaws, and one with the spindle.
    two = [tending()["stages"][k] for k in (45, 49)]
    some = kept | {"answer": tending() | {"stages": two}}
    mesh = swept(mounted(TASK), None, json.dumps(some).encode(), "stl", 0.1)
    assert isinstance(mesh, bytes)


@pytest.mark.parametrize("form", ["urscript_movej", "urscript_servoj", "rapid", "krl", "csv",
                                  "ros2_control", "joint_trajectory_json"])  # fmt: skip
def test_the_work_is_one_proved_program(form: str) -> None:
    blend = {"blend": 0.02} if form in ("urscript_movej", "rapid", "krl") else {}
    made = program("POST /v1/tasks", TASK, tending(), format=form, **blend)
    assert made["proved"], [p for p in made["parts"] if p["certificate"]["violation"]]
    assert [part["kind"] for part in made["parts"]] == [s["kind"] for s in tending()["stages"]]
    assert made["certificate"] is None
    held = [tuple(p["certificate"]["premises"]["attached"]) for p in made["parts"]]
    assert held == [tuple(i["id"] for i in s["after"]["attached"]) for s in tending()["stages"]]
    assert (max(made["blends"]) > 0.005) is bool(blend)
    if form == "joint_trajectory_json":
        kinds = [next(iter(step)) for step in json.loads(made["content"])["steps"]]
        assert kinds.count("gripper") == 6
        assert kinds.count("wait_for") == 3


def test_the_work_is_one_recording() -> None:
    made = program("POST /v1/tasks", TASK, tending(), format="mcap", sample_period=0.01)
    assert (made["proved"], made["file_name"]) == (True, "armwright.mcap")
    rows: dict[str, list[Any]] = {}
    for _, channel, one in make_reader(io.BytesIO(b64decode(made["content"]))).iter_messages():
        rows.setdefault(channel.topic, []).append((one.log_time * 1e-9, json.loads(one.data)))
    stages = tending()["stages"]
    assert [one["name"].split(":")[0] for _, one in rows["/certificate"]] == [
        str(stage["index"]) for stage in stages
    ]
    assert all(one["message"].startswith("Proved") for _, one in rows["/certificate"])
    duration = sum(stage["trajectory"]["duration"] for stage in stages)
    assert rows["/tf"][-1][0] == pytest.approx(duration, abs=1e-6)
    left = [{row["id"] for row in one["entities"]} for _, one in rows["/scene"]]
    assert {"part_1", "part_2", "part_3"} <= left[0]
    assert any("part_1" not in names and "part_2" in names for names in left)


def test_a_program_is_of_the_scene_that_was_planned_in() -> None:
    body = json.loads(json.dumps(TASK))
    body["scene"]["obstacles"][0]["pose"]["position"][2] -= 0.001
    plan = {"operation": "POST /v1/tasks", "request": body, "answer": tending()}
    asked = {"plan": plan, "format": "csv"}
    with pytest.raises(InvalidOption, match="under other premises"):
        export(mounted(body), None, json.dumps(asked).encode())
    broken = {"operation": "POST /v1/tasks", "request": TASK, "answer": {"stages": [{}]}}
    with pytest.raises(InvalidOption, match="do not belong together"):
        export(mounted(TASK), None, json.dumps({"plan": broken, "format": "csv"}).encode())


def test_a_tour_is_a_program_with_its_stays() -> None:
    other, third = [0.5, -1.3, 1.4, -1.6, -1.5, 0.2], [0.9, -1.2, 1.3, -1.6, -1.5, 0.0]
    body = {"robot": "ur5e", "start": {"joints": HOME}, "end": "start",
            "goals": [{"joints": other, "dwell": 0.5}, {"joints": third}],
            "timeout": 20}  # fmt: skip
    answer = answer_of(tour, UR, body, TourAnswer)
    made = program("POST /v1/tours", body, answer, format="urscript_movej")
    assert made["proved"]
    assert [part["kind"] for part in made["parts"]] == ["leg", "wait", "leg", "leg"]
    assert "sleep(0.5)" in made["content"]


def test_blocks_of_grids_stacks_and_fallbacks() -> None:
    crates = [f"crate_{k}" for k in range(3)]
    obstacles = [
        solid("bench", "box", [0.55, 0.0, 0.0], size=[0.8, 1.2, 0.04]),
        *(solid(name, "box", [0.4 + 0.1 * k, 0.3, 0.04], size=[0.04] * 3)
          for k, name in enumerate(crates)),
    ]  # fmt: skip
    pick: list[dict[str, Any]] = [
        {"kind": "move"}, {"kind": "approach", "distance": [0.03, 0.08]},
        {"kind": "grasp", "object": "{object}", "grasps": {"top": {}},
         "touch_links": ["parallel_jaw"], "support": "bench", "name": "pick"},
        {"kind": "close", "until": "contact"}, {"kind": "attach", "object": "{object}"},
        {"kind": "lift", "distance": [0.05, 0.1], "frame": "object", "direction": [0, 0, 1]},
        {"kind": "move"},
        {"kind": "approach", "distance": [0.02, 0.05], "direction": [0, 0, -1], "frame": "root"},
    ]  # fmt: skip
    leave = [{"kind": "open"}, {"kind": "detach"}, {"kind": "retreat", "distance": [0.05, 0.1]}]
    stack = {"pose": {"position": [0.45, -0.3, 0.04]}, "step": [0, 0, 0.04]}
    # Nothing can be put where nobody reaches.
    far = {"pose": {"position": [2.5, -0.3, 0.04]}, "step": [0, 0, 0.04]}
    places = [{"kind": "place", "stack": one, "support": "bench"} for one in (far, stack)]
    body: dict[str, Any] = {
        "robot": "ur5e", "tool": "parallel_jaw", "start": {"joints": HOME}, "timeout": 60,
        "scene": {"obstacles": obstacles},
        "stages": [{"fallback": [
            [{"for_each": {"object": crates}, "stages": [*pick, place, *leave]}]
            for place in places]}],
    }  # fmt: skip
    answer = answer_of(plan_sequence, mounted(body), body, TaskAnswer)
    stands = {
        one["id"]: one["pose"]["position"] for one in answer["stages"][-1]["after"]["objects"]
    }
    for k, name in enumerate(crates):
        assert stands[name] == pytest.approx([0.45, -0.3, 0.04 + 0.04 * k], abs=1e-4)
    assert answer["stages"][0]["item"] == "alternative 1, crate_0"
    assert [s["name"] for s in answer["stages"] if s["name"]] == [f"pick {n}" for n in crates]
    full = stack | {"count": [1, 1, 2]}
    body["stages"] = [{"for_each": {"object": crates}, "stages": [
        *pick, {"kind": "place", "grid": full, "support": "bench"}, *leave]}]  # fmt: skip
    with pytest.raises(ArmwrightError, match="all 2 places of the grid are taken"):
        plan_sequence(mounted(body), None, json.dumps(body).encode())


def test_the_shortest_order_is_answered_with_what_it_saved() -> None:
    spots = [0.35, -0.35, 0.45, -0.45]
    body: dict[str, Any] = {"robot": "ur5e", "start": {"joints": HOME}, "timeout": 60}
    names = [f"spot_{k}" for k in range(4)]
    # Each spot is an obstacle, in whose frame the tool goes down.
    body["scene"] = {"obstacles": [
        solid(name, "box", [0.5, y, 0.1], size=[0.02] * 3)
        for name, y in zip(names, spots, strict=True)
    ]}  # fmt: skip
    aims = [
        {"kind": "move"}, {"kind": "approach", "distance": [0.05, 0.1]},
        {"kind": "grasp", "object": "{object}",
         "grasps": [{"position": [0, 0, 0.1], "rpy": [np.pi, 0, 0]}]},
        {"kind": "retreat", "distance": [0.05, 0.1]},
    ]  # fmt: skip
    each = {"for_each": {"object": names}, "order": "shortest", "stages": aims}
    home = {"kind": "move", "goal": {"joints": HOME}}
    answer = answer_of(plan_sequence, UR, body | {"stages": [each, home]}, TaskAnswer)
    (order,) = answer["orders"]
    items = [stage["item"] for stage in answer["stages"] if stage["kind"] == "grasp"]
    assert items == order["items"]
    assert sorted(items) == names
    # Those of one side come one after another.
    assert {frozenset(items[:2]), frozenset(items[2:])} == {
        frozenset(names[::2]), frozenset(names[1::2])}  # fmt: skip
    given = answer_of(plan_sequence, UR, body | {
        "stages": [each | {"order": "written"}, home]}, TaskAnswer)  # fmt: skip
    assert given["orders"] == []
    assert order["written"] == pytest.approx(given["duration"])
    assert order["saved"] == pytest.approx(given["duration"] - answer["duration"])
    assert order["saved"] > 1.0
    outer = {"for_each": {"object": ["a"]}, "stages": [each]}
    with pytest.raises(InvalidOption, match="shortest"):
        plan_sequence(UR, None, json.dumps(body | {"stages": [outer]}).encode())


def test_the_tip_of_what_is_held_leads_and_sets_of_poses_are_passed() -> None:
    bottom: dict[str, Any] = {
        "object": "part_1",
        "pose": {"position": [0, 0, -0.05], "rpy": [np.pi, 0, 0]},
    }
    there = {"position": [0.4, -0.1, 0.35], "rpy": [np.pi, 0.3, 0.0]}
    end = {"position": [0.5, -0.1, 0.3], "rpy": [np.pi, 0.3, 0.0]}
    far = {"pose": {"position": [2.0, 0, 0.4], "rpy": [np.pi, 0, 0]}}
    near = {"pose": {"position": [0.4, 0.1, 0.45], "rpy": [np.pi, 0, 0]}}
    via = {"goal": {"any_of": [far, near]}}
    pick = TASK["stages"][0]["stages"][:6]
    pick = json.loads(json.dumps(pick).replace("{object}", "part_1"))
    stages = [
        *pick,
        {"kind": "move", "via": [via], "goal": {"pose": there}, "tcp": bottom,
         "name": "over"},
        {"kind": "line", "pose": end, "tool_speed": 0.1},
        {"kind": "wait", "duration": 0.1},
        {"kind": "detach"},
        {"kind": "retreat", "distance": [0.05, 0.08]},
        {"kind": "line", "pose": {"position": [0.5, 0.1, 0.5], "rpy": [np.pi, 0.3, 0]},
         "tool_speed": 0.2},
    ]  # fmt: skip
    body, answer = solved(stages=stages, timing={"sample_period": 0.05})
    answered = answer["stages"]
    kinds = [s["kind"] for s in answer["stages"]]
    assert kinds == [s["kind"] for s in stages[:6]] + ["move", "move", "line", "wait", "detach",
                                                       "retreat", "line"]  # fmt: skip
    assert answered[6]["choice"] == 1
    tips = [s["certificate"]["premises"]["tool"] for s in answer["stages"]]
    assert tips == ["parallel_jaw/tip"] * 6 + ["part_1/tip"] * 4 + ["parallel_jaw/tip"] * 3
    assert [s["tip"] is not None for s in answer["stages"]] == [t == "part_1/tip" for t in tips]
    arm, held = PinocchioArm("ur5e"), answered[8]["after"]["attached"][0]
    T_flange_jaw = aw.mount(aw.load_robot("ur5e"), aw.built_in_tool("parallel_jaw", "j")).chain
    T_flange_tip = T_flange_jaw.tip.T_joint_link
    for k, wanted in ((7, there), (8, end), (9, end)):
        last = answered[k]["trajectory"]["samples"]["position"][-1]
        flange = np.asarray(arm.pose(np.array(last), "tool0"))
        T = flange @ inverse(T_flange_jaw.link("tool0").T_joint_link) @ T_flange_tip
        T = T @ transform_of(held["pose"]) @ transform_of(bottom["pose"])
        assert transform_of(wanted) == pytest.approx(T, abs=2e-4)
    last = answered[12]["trajectory"]["samples"]["position"][-1]
    T = np.asarray(arm.pose(np.array(last), "tool0"))
    T = T @ inverse(T_flange_jaw.link("tool0").T_joint_link) @ T_flange_tip
    assert T[:3, 3] == pytest.approx([0.5, 0.1, 0.5], abs=2e-4)
    made = program("POST /v1/tasks", body, answer, format="urscript_movej")
    assert made["proved"], [p for p in made["parts"] if p["certificate"]["violation"]]
    assert "take_p" not in made["content"]
    kept = {"operation": "POST /v1/tasks", "request": body, "answer": answer, "proved_here": True}
    assert isinstance(view(mounted(body), None, json.dumps(kept).encode()), bytes)


#: A bar between walls, where it is taken from above, and a shelf that it goes into from the side.
TIGHT = [
    solid("bench", "box", [0.55, 0.0, 0.0], size=[0.9, 1.4, 0.04]),
    solid("bar", "box", [0.5, 0.3, 0.08], size=[0.03, 0.03, 0.12]),
    *(solid(f"wall_{k}", "box", [0.5 + x, 0.3 + y, 0.07], size=size)
      for k, (x, y, size) in enumerate([
          (0.08, 0, [0.02, 0.18, 0.1]), (-0.08, 0, [0.02, 0.18, 0.1]),
          (0, 0.1, [0.14, 0.02, 0.1]), (0, -0.1, [0.14, 0.02, 0.1])])),
    solid("lid", "box", [0.55, -0.35, 0.25], size=[0.3, 0.3, 0.02]),
]  # fmt: skip


def carried(*between: dict[str, Any], **changes: Any) -> dict[str, Any]:
    grasps = [
        {"position": [0, 0, 0.04], "rpy": [np.pi, 0, 0]},
        *({"position": [0, 0, 0.03], "rpy": [np.pi / 2, 0, a]} for a in np.arange(8) * np.pi / 4),
    ]
    stages = [
        {"kind": "move"}, {"kind": "approach", "distance": [0.04, 0.08], "name": "down"},
        {"kind": "grasp", "object": "bar", "grasps": grasps, "touch_links": ["parallel_jaw"],
         "support": "bench"},
        {"kind": "close", "until": "contact"}, {"kind": "attach", "object": "bar", "mass": 0.1},
        {"kind": "lift", "distance": [0.12, 0.15]}, *between, {"kind": "move"},
        {"kind": "approach", "distance": [0.01, 0.03], "direction": [0, 0, -1], "frame": "root"},
        {"kind": "place", "support": "bench",
         "poses": [{"position": [0.55, -0.3, 0.08], "rpy": [0, 0, k * np.pi / 4]}
                   for k in range(8)]},
        {"kind": "open"}, {"kind": "detach"}, {"kind": "retreat", "distance": [0.05, 0.08]},
    ]  # fmt: skip
    return {"robot": "ur5e", "tool": "parallel_jaw", "start": {"joints": HOME}, "timeout": 60,
            "scene": {"obstacles": TIGHT}, "stages": stages} | changes  # fmt: skip


def test_what_no_single_grasp_carries_is_put_down_and_grasped_again() -> None:
    alone = problem_of(plan_sequence, mounted(carried()), carried())
    assert alone.code == "PLANNING_FAILED"
    again = {"regrasp": {"supports": ["bench"]}}
    body = carried(again, timing={"sample_period": 0.05})
    answer = answer_of(plan_sequence, mounted(body), body, TaskAnswer)
    grasps = [s["choice"] for s in answer["stages"] if s["kind"] == "grasp"]
    assert grasps[0] == 0
    assert grasps[1] > 0
    items = [s["item"] for s in answer["stages"]]
    assert items == [None] * 6 + ["alternative 1"] * 12 + [None] * 6
    put = next(s for s in answer["stages"] if s["kind"] == "detach")["after"]["objects"][0]["pose"]
    T, corners = transform_of(put), np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1)
                                              for z in (-1, 1)]) * [0.015, 0.015, 0.06]  # fmt: skip
    heights = np.sort((corners @ T[:3, :3].T + T[:3, 3])[:, 2])
    assert heights[:4] == pytest.approx([0.02] * 4, abs=1e-6)
    assert answer["stages"][-1]["after"]["objects"][0]["pose"]["position"] == pytest.approx(
        [0.55, -0.3, 0.08], abs=1e-4
    )
    made = program("POST /v1/tasks", body, answer, format="urscript_movej")
    assert made["proved"]
    # Where one grasp does, nothing is put down.
    free = body | {"scene": {"obstacles": [o for o in TIGHT if o["id"] != "lid"]}}
    answer = answer_of(plan_sequence, mounted(free), free, TaskAnswer)
    assert [s["kind"] for s in answer["stages"]].count("grasp") == 1


@pytest.mark.parametrize(
    ("again", "told"),
    [
        ({"supports": ["bar"]}, "on itself"),
        ({"supports": ["nothing"]}, "no obstacle 'nothing'"),
        ({"supports": ["lid"], "most": 2, "distance": [0.3, 0.31]}, "no combination"),
    ],
)
def test_what_can_not_be_put_down_says_why(again: dict[str, Any], told: str) -> None:
    body = carried({"kind": "regrasp", **again})
    try:
        message = problem_of(plan_sequence, mounted(body), body).message
    except ArmwrightError as error:
        message = error.message
    assert told in message
    early = body | {"stages": [{"kind": "regrasp", **again}, *body["stages"][:2]]}
    with pytest.raises(InvalidOption, match="nothing is grasped and attached before it"):
        plan_sequence(mounted(early), None, json.dumps(early).encode())


def test_an_object_is_handed_over_at_one_of_several_positions_and_taken_otherwise() -> None:
    page = (Path(__file__).parents[3] / "docs" / "task_choices.md").read_text("utf-8")
    told = re.search(r"## Handing over.*?```yaml\n(.*?)```", page, re.DOTALL)
    assert told is not None
    first = {"kind": "grasp", "object": "crate", "touch_links": ["panda_hand"], "support": "table",
             "grasps": [{"position": [0, 0, 0.02], "rpy": [np.pi, 0, 0]}]}  # fmt: skip
    stages = [
        {"kind": "move"}, {"kind": "approach", "distance": [0.03, 0.08]}, first,
        {"kind": "attach", "object": "crate"}, {"kind": "lift", "distance": [0.05, 0.1]},
        *yaml.safe_load(told[1]),
    ]  # fmt: skip
    stages[-1]["touch_links"] = ["panda_hand"]
    obstacles = [
        solid("table", "box", [0.6, 0, 0.08], size=[0.6, 1.0, 0.04]),
        solid("crate", "box", [0.5, -0.25, 0.15], size=[0.05, 0.05, 0.1]),
    ]
    home = {"joints": [0, -0.785, 0, -2.356, 0, 1.571, 0.785]}
    body = {"robot": "panda", "start": home, "scene": {"obstacles": obstacles}, "stages": stages,
            "timeout": 60}  # fmt: skip
    answer = answer_of(plan_sequence, PANDA, body, TaskAnswer)
    assert all(stage["certificate"]["verified"] for stage in answer["stages"])
    choices = {k: stage["choice"] for k, stage in enumerate(answer["stages"])}
    assert (choices[2], choices[7]) == (0, 1)
    let_go = answer["stages"][10]["after"]["objects"][0]["pose"]["position"]
    assert let_go == pytest.approx([0.5, 0.2, 0.4], abs=1e-9)
    assert choices[14] in (0, 1)


@pytest.mark.parametrize("frame", ["tool", "root", "object", "support", "normal"])
@pytest.mark.parametrize("along", [[0.2, 0.1, -1.0], [-0.15, 0.25, -0.9]])
def test_straight_ways_go_along_their_frames(frame: str, along: list[float]) -> None:
    """Crate and slab are turned each in its own way; tips by pinocchio."""
    slab, crate = ([0.5, 0.1, 0.1], [0.2, 0.1, 0.7]), ([0.5, 0.1, 0.2], [-0.15, 0.2, -0.4])
    obstacles = [
        solid("slab", "box", slab[0], size=[0.2, 0.2, 0.02]),
        solid("crate", "box", crate[0], size=[0.08, 0.08, 0.06]),
    ]
    for one, (_, rpy) in zip(obstacles, (slab, crate), strict=True):
        one["pose"]["rpy"] = rpy
    R = {name: transform_of({"position": at, "rpy": rpy})[:3, :3]
         for name, (at, rpy) in (("support", slab), ("object", crate))}  # fmt: skip
    grasp = {"position": [0, 0, 0.08], "rpy": [np.pi, 0, 0.3]}
    R |= {"root": np.eye(3), "tool": R["object"] @ transform_of(grasp)[:3, :3]}
    if frame == "tool":
        along = [along[0], along[1], -along[2]]
    way: dict[str, Any] = {"direction": along, "frame": frame}
    back = way | {"direction": (-np.array(along)).tolist()}
    there = np.array(R.get(frame, R["object"]) @ along)
    if frame == "normal":
        way, back = ({"direction": "normal"},) * 2
        there = np.array(R["object"] @ [0.0, 0.0, -1.0])
    stages = [
        {"kind": "move"}, {"kind": "approach", "distance": [0.04, 0.05], **way},
        {"kind": "grasp", "object": "crate", "grasps": [grasp], "support": "slab"},
        {"kind": "retreat", "distance": [0.04, 0.05], **back},
    ]  # fmt: skip
    body = {"robot": "ur5e", "start": {"joints": HOME}, "scene": {"obstacles": obstacles},
            "stages": stages, "timing": {"sample_period": 0.02}, "timeout": 20}  # fmt: skip
    answer, arm = answer_of(plan_sequence, UR, body, TaskAnswer), PinocchioArm("ur5e")
    for k, wanted in ((1, there), (3, -there)):
        samples = answer["stages"][k]["trajectory"]["samples"]["position"]
        tips = np.array([np.asarray(arm.pose(np.array(q), "tool0"))[:3, 3] for q in samples])
        went = tips[-1] - tips[0]
        assert np.linalg.norm(went) >= 0.04 - 1e-6
        assert went / np.linalg.norm(went) == pytest.approx(
            wanted / np.linalg.norm(wanted), abs=5e-3
        )
        off = np.cross(tips - tips[0], wanted / np.linalg.norm(wanted))
        assert np.linalg.norm(off, axis=1).max() < 3e-4


def test_a_move_goes_through_one_of_each_set() -> None:
    first, second = ({"joints": [x, -1.2, 1.3, -1.6, -1.57, 0.0]} for x in (0.6, 1.4))
    below = {"joints": [0.6, 0.6, 1.3, -1.6, -1.57, 0.0]}
    move = {"kind": "move", "name": "way", "goal": {"joints": [2.0, *HOME[1:]]},
            "via": [{"goal": {"any_of": [below, first]}, "blend": 0.2},
                    {"goal": second, "blend": 0.2}]}  # fmt: skip
    answer = solved(stages=[move, {"kind": "move", "end_of": "way"}])[1]
    assert [s["choice"] for s in answer["stages"]] == [1, 0, 0, 0]
    assert [s["passes"] for s in answer["stages"]] == [True, True, False, False]
    assert [s["name"] for s in answer["stages"]] == [None, None, "way", None]


def test_what_can_not_be_gripped_makes_way_for_another_alternative() -> None:
    grasp = {"kind": "grasp", "object": "block", "touch_links": ["parallel_jaw"]}
    wide: dict[str, Any] = grasp | {"grasps": {"top": {}}}
    part = wide | {"object": "part_1"}
    stages = [{"kind": "move"}, {"kind": "approach", "distance": [0.04, 0.08]}]
    body = TASK | {"stages": [{"fallback": [[*stages, wide], [*stages, part]]}]}
    answer = answer_of(plan_sequence, mounted(body), body, TaskAnswer)
    assert {stage["item"] for stage in answer["stages"]} == {"alternative 1"}
    body = TASK | {"stages": [{"fallback": [[*stages, wide], [*stages, wide]]}]}
    with pytest.raises(ArmwrightError, match="no top grasp of 'block' was found"):
        plan_sequence(mounted(body), None, json.dumps(body).encode())
    far = {"kind": "move", "goal": {"pose": {"position": [3.0, 0.0, 0.3]}}}
    short = {"kind": "move", "goal": {"joints": HOME}}
    body = TASK | {"stages": [{"fallback": [[short, short, far], [far]]}]}
    failed = problem_of(plan_sequence, mounted(body), body)
    assert failed.details["index"] == 2
    assert failed.details["stage"] == "stage 2 (move)"


@pytest.mark.parametrize(
    ("stages", "told"),
    [
        ([{"kind": "wait", "duration": 1.0, "tcp": "tip"}], "the robot has none by then"),
        ([{"kind": "attach", "object": "part_1"},
          {"kind": "wait", "duration": 1.0, "tool": "spindle"}], "while something is held"),
        ([{"kind": "line", "pose": {"position": [9.0, 0.0, 0.3]}}], "can be led along"),
        ([{"kind": "insert", "distance": 0.02, "into": "chuck_1"}], "nothing is held by then"),
        ([{"kind": "wait", "duration": 1.0, "tcp": {"object": "part_1"}}],
         "leads a point of 'part_1', which is not held by then"),
        ([{"kind": "attach", "object": "part_1"},
          {"kind": "attach", "object": "part_2", "tcp": {"object": "part_1"}}],
         "attaches to the tip of 'part_1'"),
    ],
)  # fmt: skip
def test_work_that_can_not_be_done_says_why(stages: list[dict[str, Any]], told: str) -> None:
    body = TASK | {"stages": stages}
    body.pop("tool")
    message = ""
    try:
        message = problem_of(plan_sequence, mounted(body), body).message
    except ArmwrightError as error:
        message = error.message
    assert told in message


def test_margins_of_links_hold_for_each_stage_and_for_its_program() -> None:
    margins = {"links": {"wrist_2_link": 0.02}, "objects": {"block": 0.03}}
    moves = [TASK["stages"][1], {"kind": "move", "tool": "spindle",
                                 "goal": {"joints": [0.6, *HOME[1:]]}}]  # fmt: skip
    body, answer = solved(stages=moves, margins=margins)
    plain = solved(stages=moves)[1]
    told, before = (a["stages"][1]["certificate"]["premises"] for a in (answer, plain))
    assert told["robot_hash"] != before["robot_hash"]
    assert told["scene_hash"] != before["scene_hash"]
    assert program("POST /v1/tasks", body, answer, format="csv")["proved"]


def test_two_tools_of_one_name_are_refused_and_a_tool_may_come_back() -> None:
    mill = {"name": "mill", "form": {"type": "spindle"}}
    stages = [{"kind": "wait", "duration": 0.1, "tool": name} for name in ("spindle", mill)]
    back = [*stages, {"kind": "wait", "duration": 0.1, "tool": "parallel_jaw"}]
    answer = solved(stages=back)[1]
    tips = [stage["certificate"]["premises"]["tool"] for stage in answer["stages"]]
    assert tips == ["spindle/tip", "mill/tip", "parallel_jaw/tip"]
    other = {"name": "mill", "form": {"type": "torch"}}
    with pytest.raises(InvalidOption, match="two different ones are called 'mill'"):
        mounted(TASK | {"stages": [*stages, {"kind": "wait", "duration": 0.1, "tool": other}]})


def test_kept_requests_hold_the_tools_of_their_stages() -> None:
    document = json.dumps({"name": "mill", "form": {"type": "spindle"}}).encode()
    stages = [{"kind": "wait", "duration": 1.0, "tool": "mill"}]
    asked = {"tool": "mill", "stages": [{"fallback": [stages]}, *stages]}
    whole = with_tools(asked, {"mill": document})
    assert whole["tool"]["form"] == {"type": "spindle"}
    assert whole["stages"][0]["fallback"][0][0]["tool"] == whole["stages"][1]["tool"]

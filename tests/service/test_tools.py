"""Tools over HTTP: stored, mounted in requests of every kind, and told in what is answered."""

from typing import Any

import httpx
import numpy as np
import pytest

from tests.service.jobs.requests import ASYNC, batch, ended, submit
from tests.service.poses import matrix
from tests.service.robots import answer, problem, solid

HOME = [0.0, -1.2, 1.2, -1.5, -1.5, 0.0]
TIP = {"position": [0.02, -0.01, 0.18], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}
GRIPPER: dict[str, Any] = {
    "tcp": {"tip": TIP, "side": {"position": [0.1, 0.0, 0.05]}},
    "solids": [
        {
            "shape": {"type": "cylinder", "radius": 0.05, "height": 0.16},
            "pose": {"position": [0.0, 0.0, 0.08]},
        }
    ],
    "mass": 2.0,
    "center_of_mass": [0.0, 0.0, 0.1],
}


@pytest.fixture
def gripper(client: httpx.Client) -> str:
    """A stored tool."""
    assert client.put("/v1/tools/gripper_a", json=GRIPPER).is_success
    return "gripper_a"


def ask(client: httpx.Client, what: str, **body: Any) -> dict[str, Any]:
    return answer(client.post(f"/v1/robots/ur5e/{what}", json=body))


def test_tools_are_stored_listed_and_forgotten(client: httpx.Client) -> None:
    told = answer(
        client.post("/v1/tools", json={"name": "torch_a", "form": {"type": "torch"}}), 201
    )
    assert (told["name"], told["version"], told["built_in"]) == ("torch_a", 1, False)
    problem(client.post("/v1/tools", json=GRIPPER | {"name": "torch_a"}), 409, "CONFLICT")
    assert answer(client.get("/v1/tools/torch_a"))["form"]["type"] == "torch"
    replaced = client.put("/v1/tools/torch_a", json=GRIPPER)
    assert answer(replaced)["version"] == 2
    assert answer(client.get("/v1/tools/torch_a"))["mass"] == 2.0
    names = [tool["name"] for tool in answer(client.get("/v1/tools"))["tools"]]
    assert names == sorted(names)
    assert {"torch_a", "parallel_jaw", "spindle"} <= set(names)
    first = answer(client.get("/v1/tools?limit=1"))
    after = answer(client.get(f"/v1/tools?limit=1&after={first['next']}"))
    assert [first["tools"][0]["name"], after["tools"][0]["name"]] == names[:2]
    assert client.delete("/v1/tools/torch_a").status_code == 204
    problem(client.get("/v1/tools/torch_a"), 404, "NOT_FOUND")
    assert answer(client.get("/v1/tools/torch"))["form"] == {"type": "torch"}
    for asked in (client.put("/v1/tools/torch", json=GRIPPER), client.delete("/v1/tools/torch")):
        problem(asked, 409, "CONFLICT")


def test_kinematics_mean_the_tip_of_the_tool(client: httpx.Client, gripper: str) -> None:
    flange = matrix(ask(client, "fk", joints=HOME)["pose"])
    mounted = {"tool": gripper, "tcp": "tip"}
    there = ask(client, "fk", joints=HOME, **mounted)
    np.testing.assert_allclose(matrix(there["pose"]), flange @ matrix(TIP), atol=1e-12)
    assert {"gripper_a", "gripper_a/tip", "gripper_a/side"} <= there["links"].keys()
    many = ask(client, "fk", joints=[HOME] * 300, **mounted)
    assert many["pose"][0] == there["pose"]
    point = ask(client, "jacobian", joints=HOME, link="tool0", point=TIP["position"])["jacobian"]
    own = ask(client, "jacobian", joints=HOME, **mounted)["jacobian"]
    np.testing.assert_allclose(own, point, atol=1e-12)
    found = ask(client, "ik", pose=there["pose"], seed_joints=HOME, **mounted)["solutions"][0]
    np.testing.assert_allclose(found["joints"], HOME, atol=1e-6)
    reached = ask(client, "reach", poses=[there["pose"]], **mounted)
    assert reached["reached"] == 1


def test_dynamics_carry_the_mass_of_the_tool(client: httpx.Client, gripper: str) -> None:
    load = {"mass": 2.0, "center_of_mass": [0.0, 0.0, 0.1], "link": "tool0"}
    loaded = ask(client, "dynamics", joints=HOME, payload=load)
    mounted = ask(client, "dynamics", joints=HOME, tool=gripper, tcp="tip")
    np.testing.assert_allclose(mounted["gravity"], loaded["gravity"], rtol=1e-12)
    np.testing.assert_allclose(mounted["mass_matrix"], loaded["mass_matrix"], rtol=1e-12)


def test_the_solids_of_the_tool_collide_and_it_is_named(client: httpx.Client, gripper: str) -> None:
    flange = matrix(ask(client, "fk", joints=HOME)["pose"])
    wall = solid("wall", "sphere", (flange @ [0.0, 0.0, 0.15, 1.0])[:3].tolist(), radius=0.02)
    body = {"robot": "ur5e", "joints": HOME, "scene": {"obstacles": [wall]}}
    assert answer(client.post("/v1/check", json=body))["valid"]
    body |= {"tool": gripper, "tcp": "tip"}
    told = answer(client.post("/v1/check", json=body))
    assert [sorted(hit["pair"]) for hit in told["collisions"]] == [["gripper_a", "wall"]]
    allowed = body | {"allowed_collisions": [["gripper_a", "wall"]]}
    assert answer(client.post("/v1/check", json=allowed))["valid"]
    every = body | {"allowed_collisions": [["*", "wall"]]}
    assert answer(client.post("/v1/check", json=every))["valid"]
    part = solid("part", "sphere", [0.0, 0.0, 0.0], radius=0.0205) | {
        "link": "gripper_a/tip",
        "touch_links": ["gripper_a"],
    }
    held = {"robot": "ur5e", "joints": HOME, "tool": gripper, "tcp": "tip", "attached": [part]}
    assert answer(client.post("/v1/check", json=held))["valid"]


def plan_body(gripper: str) -> dict[str, Any]:
    return {
        "robot": "ur5e",
        "tool": gripper,
        "tcp": "tip",
        "start": {"joints": HOME},
        "goal": {"joints": [0.5, -1.0, 1.0, -1.5, -1.5, 0.3]},
        "scene": {"obstacles": []},
    }


def test_a_certificate_names_the_tool(client: httpx.Client, gripper: str) -> None:
    body = plan_body(gripper)
    there = ask(client, "fk", joints=body["goal"]["joints"], tool=gripper, tcp="tip")["pose"]
    plan = answer(client.post("/v1/plan", json=body | {"goal": {"pose": there}}))
    assert plan["certificate"]["verified"]
    assert plan["certificate"]["premises"]["tool"] == "gripper_a/tip"
    last = plan["path"]["joints"][-1]
    reached = ask(client, "fk", joints=last, tool=gripper, tcp="tip")["pose"]
    np.testing.assert_allclose(matrix(reached), matrix(there), atol=1e-5)
    proof = {name: body[name] for name in ("robot", "tool", "tcp", "scene")}
    proved = answer(client.post("/v1/validate", json=proof | {"trajectory": plan["trajectory"]}))
    assert proved["verified"]
    assert proved["premises"]["tool"] == "gripper_a/tip"
    assert proved["premises"]["robot_hash"] == plan["certificate"]["premises"]["robot_hash"]
    told = answer(client.post("/v1/validate", json=proof | {
        "trajectory": plan["trajectory"], "tool": "spindle", "tcp": None,
    }))  # fmt: skip
    assert told["premises"]["tool"] == "spindle/tip"


def test_a_kept_plan_holds_the_tool_as_it_was(client: httpx.Client) -> None:
    answer(client.put("/v1/tools/kept_tool", json=GRIPPER), 201)
    plan = answer(client.post("/v1/plan", json=plan_body("kept_tool") | {"keep": True}))
    plan_id = plan["plan_id"]
    assert client.delete("/v1/tools/kept_tool").status_code == 204
    kept = answer(client.get(f"/v1/plans/{plan_id}"))
    assert kept["request"]["tool"]["mass"] == 2.0
    assert answer(client.post(f"/v1/plans/{plan_id}/replay", json={}))["same"]
    page = client.get(f"/v1/plans/{plan_id}/view")
    assert page.status_code == 200
    assert "kept_tool" in page.text


def test_a_batch_mounts_a_tool_for_all_or_each(client: httpx.Client, gripper: str) -> None:
    body = plan_body(gripper)
    goal = body.pop("goal")
    body["problems"] = [{"goal": goal}, {"goal": goal, "tool": "spindle"}]
    results = batch(client, body)["result"]["results"]
    tools = [result["certificate"]["premises"]["tool"] for result in results]
    assert tools == ["gripper_a/tip", "spindle/tip"]


def test_the_tip_can_be_that_of_a_held_object(client: httpx.Client) -> None:
    peg = solid("peg", "box", [0.0, 0.0, 0.04], size=[0.01, 0.01, 0.1]) | {
        "link": "parallel_jaw/tip",
        "touch_links": ["parallel_jaw"],
    }
    body = {
        "tool": "parallel_jaw",
        "tcp": {"object": "peg", "pose": {"position": [0.0, 0.0, 0.05]}},
    }
    target = {"position": [0.4, 0.1, 0.4], "rpy": [3.14159, 0.0, 0.0]}
    found = ask(client, "ik", pose=target, attached=[peg], seed_joints=HOME, **body)["solutions"][0]
    tip = ask(client, "fk", joints=found["joints"], tool="parallel_jaw")["pose"]
    end = matrix(tip) @ np.array([0.0, 0.0, 0.09, 1.0])
    np.testing.assert_allclose(end[:3], target["position"], atol=1e-6)


def test_tours_exports_and_simulations_work_with_the_tool(
    client: httpx.Client, gripper: str
) -> None:
    mounted = {"robot": "ur5e", "tool": gripper, "tcp": "tip"}
    ends = [HOME, [0.5, -1.0, 1.0, -1.5, -1.5, 0.3]]
    poses = [ask(client, "fk", joints=q, tool=gripper, tcp="tip")["pose"] for q in ends]
    tour = answer(client.post("/v1/tours", json=mounted | {"goals": [{"pose": p} for p in poses]}))
    reached = ask(client, "fk", joints=tour["visits"][0]["joints"], tool=gripper, tcp="tip")["pose"]
    wanted = poses[int(tour["visits"][0]["id"])]
    np.testing.assert_allclose(matrix(reached), matrix(wanted), atol=1e-5)
    leg = tour["legs"][-1]
    assert leg["certificate"]["premises"]["tool"] == "gripper_a/tip"
    body = {"trajectory": leg["trajectory"], "format": "csv"}
    told = answer(client.post("/v1/export", json=mounted | body))
    assert told["certificate"]["premises"]["tool"] == "gripper_a/tip"
    premises = {"premises": leg["certificate"]["premises"], "tool": "spindle", "tcp": None}
    assert client.post("/v1/export", json=mounted | body | premises).status_code == 422
    follow = {
        "reference": {"type": "hold", "joints": HOME, "duration": 0.2},
        "controller": {"type": "pd_gravity", "Kp": 100.0, "Kd": 20.0},
    }
    torques = [
        answer(client.post("/v1/simulate", json=follow | robot))["torque"][0]
        for robot in (mounted, {"robot": "ur5e"})
    ]
    gravity = [
        ask(client, "dynamics", joints=HOME, **tool)["gravity"]
        for tool in ({"tool": gripper, "tcp": "tip"}, {})
    ]
    np.testing.assert_allclose(torques, gravity, atol=1e-6)


def test_a_task_picks_with_a_built_in_jaw(client: httpx.Client) -> None:
    crate: dict[str, Any] = solid("crate", "box", [-0.5, 0.1, 0.04], size=[0.03, 0.06, 0.08])
    table = solid("table", "box", [-0.6, 0.0, -0.02], size=[0.8, 1.2, 0.04])
    stages: list[dict[str, Any]] = [
        {"kind": "move"},
        {"kind": "approach", "distance": [0.04, 0.08]},
        {"kind": "grasp", "object": "crate", "grasps": {"top": {}},
         "touch_links": ["parallel_jaw"],
         "support": "table"},
        {"kind": "close", "until": "contact"},
        {"kind": "attach", "object": "crate"},
        {"kind": "lift", "distance": [0.05, 0.1]},
        {"kind": "open", "state": "parallel_jaw/open"},
    ]  # fmt: skip
    body = {
        "robot": "ur5e", "tool": "parallel_jaw", "start": {"joints": HOME},
        "scene": {"obstacles": [crate, table]}, "stages": stages, "keep": True,
    }  # fmt: skip
    plan = answer(client.post("/v1/tasks", json=body))
    assert plan["status"] == "success"
    assert all(stage["certificate"]["verified"] for stage in plan["stages"])
    openings = [stage["after"]["fingers"]["parallel_jaw/opening"] for stage in plan["stages"]]
    assert min(abs(openings[3] - width) for width in (0.03, 0.06)) < 1e-5
    assert (openings[0], openings[-1]) == (0.085, 0.085)
    wide = [
        stage | {"grasps": {"side": {}}} if stage["kind"] == "grasp" else stage for stage in stages
    ]
    crate["shape"]["size"] = [0.2, 0.2, 0.2]
    refused = problem(
        client.post("/v1/tasks", json=body | {"stages": wide}), 422, "VALIDATION_ERROR"
    )
    told = "it measures [0.2, 0.2, 0.2] m and the fingers open 0.085 m"
    assert f"no side grasp of 'crate' was found: {told}" in refused["detail"]
    page = client.get(f"/v1/plans/{plan['plan_id']}/view")
    assert page.status_code == 200
    swept = client.get(f"/v1/plans/{plan['plan_id']}/swept?tolerance=0.2")
    assert swept.status_code == 200


def test_a_tool_of_a_large_request_is_mounted_whole(client: httpx.Client) -> None:
    """Such a body is validated by a worker, and the server has an outline of it."""
    corners = np.random.default_rng(1).normal(size=(1_500, 3))
    corners *= 0.04 / np.linalg.norm(corners, axis=1)[:, None]
    ball = {"type": "convex", "vertices": corners.tolist()}
    tool = GRIPPER | {
        "name": "ball_a",
        "solids": [
            {"shape": ball, "pose": {"position": [0.0, 0.0, z]}} for z in (0.05, 0.15)
        ],
    }  # fmt: skip
    peg = {
        "id": "peg", "link": "ball_a", "shape": ball, "touch_links": ["ball_a"],
        "pose": {"position": [0.0, 0.0, 0.2]}, "touch_depth": None,
    }  # fmt: skip
    other = peg | {"id": "other", "link": "tool0", "pose": {"position": [0.0, 0.0, -0.5]}}
    flange = matrix(ask(client, "fk", joints=HOME)["pose"])
    far = (flange @ [0.0, 0.0, 0.15, 1.0])[:3].tolist()
    dot = solid("dot", "sphere", far, radius=0.001)
    told = answer(client.post("/v1/check", json={
        "robot": "ur5e", "joints": HOME, "tool": tool, "tcp": "tip",
        "scene": {"obstacles": [dot]},
    }))  # fmt: skip
    assert ["ball_a", "dot"] in [sorted(hit["pair"]) for hit in told["collisions"]]
    target = {"position": [0.4, 0.1, 0.4], "rpy": [3.14159, 0.0, 0.0]}
    held = {"tool": tool, "tcp": {"object": "peg"}, "attached": [other, peg]}
    found = ask(client, "ik", pose=target, seed_joints=HOME, all_solutions=True, **held)
    tip = ask(client, "fk", joints=found["solutions"][0]["joints"])["pose"]
    end = matrix(tip) @ np.array([0.0, 0.0, 0.2, 1.0])
    np.testing.assert_allclose(end[:3], target["position"], atol=1e-6)


def test_a_job_works_with_its_tool(client: httpx.Client, gripper: str) -> None:
    body = plan_body(gripper)
    result = ended(client, submit(client, body))["result"]
    assert result["certificate"]["premises"]["tool"] == "gripper_a/tip"
    refused = body | {"tool": "nothing_such"}
    problem(client.post("/v1/plan", json=refused, headers=ASYNC), 404, "NOT_FOUND")


def test_a_robot_is_stored_with_its_tools(client: httpx.Client, gripper: str) -> None:
    """Its own tools come before those of the same name that are stored alone."""
    urdf = client.get("/v1/robots/ur5e/urdf").text
    own = GRIPPER | {"name": gripper, "tcp": {"tip": {"position": [0.0, 0.0, 0.3]}}}
    jaw = {"name": "my_jaw", "form": {"type": "parallel_jaw", "opening": 0.06}}
    body = {"name": "cell", "urdf": urdf, "tip_link": "tool0", "tools": [own, jaw],
            "default_limits": {"acceleration": "10 x velocity"}}  # fmt: skip
    assert answer(client.post("/v1/robots", json=body), 201)["tools"] == [gripper, "my_jaw"]
    assert answer(client.get("/v1/robots/cell"))["tools"] == [gripper, "my_jaw"]
    tips = {
        robot: matrix(answer(client.post(f"/v1/robots/{robot}/fk",
                                         json={"joints": HOME, "tool": gripper} | more))["pose"])
        for robot, more in (("cell", {}), ("ur5e", {"tcp": "tip"}))
    }  # fmt: skip
    flange = matrix(ask(client, "fk", joints=HOME, link="tool0")["pose"])
    assert tips["cell"][:3, 3] == pytest.approx(flange[:3, :3] @ [0, 0, 0.3] + flange[:3, 3])
    assert np.linalg.norm(tips["cell"] - tips["ur5e"]) > 0.1
    stages = [{"kind": "close", "joints": {"my_jaw/opening": 0.02}, "tool": "my_jaw"}]
    task = {"robot": "cell", "start": {"joints": HOME}, "stages": stages, "keep": True}
    found = answer(client.post("/v1/tasks", json=task))
    assert found["stages"][0]["after"]["fingers"] == {"my_jaw/opening": 0.02}
    kept = answer(client.get(f"/v1/plans/{found['plan_id']}"))
    assert kept["request"]["stages"][0]["tool"]["form"]["opening"] == 0.06
    problem(client.post("/v1/robots/ur5e/fk", json={"joints": HOME, "tool": "my_jaw"}), 404,
            "NOT_FOUND")  # fmt: skip
    for tools, told in (
        ([jaw, jaw], "another tool"), ([jaw | {"name": "torch"}], "a built-in tool"),
        ([jaw | {"link": "nowhere"}], "nowhere"), ([own | {"tcp": {}}], "tcp"),
    ):  # fmt: skip
        refused = client.post("/v1/robots", json=body | {"name": "other", "tools": tools})
        assert refused.status_code == 422
        assert told in refused.text
    assert client.delete("/v1/robots/cell").status_code == 204


@pytest.mark.parametrize("name", ["gripper_a", "gripper_a/side", "peg"])
def test_names_of_tools_and_held_objects_stand_wherever_a_link_does(
    client: httpx.Client, gripper: str, name: str
) -> None:
    peg = {"id": "peg", "shape": {"type": "box", "size": [0.02, 0.02, 0.1]}, "link": gripper,
           "pose": {"position": [0.0, 0.0, 0.25]}, "touch_links": [gripper]}  # fmt: skip
    plate = solid("plate", "box", [0.6, 0.0, 0.3], size=[0.1, 0.1, 0.02])
    common = {"robot": "ur5e", "tool": gripper, "tcp": "tip", "attached": [peg]}
    scene = {"obstacles": [plate]}
    check = common | {"scene": scene, "joints": HOME}
    assert answer(client.post("/v1/check", json=check | {
        "allowed_collisions": [[name, "plate"]]}))["valid"]  # fmt: skip
    held = {"id": "cap", "shape": {"type": "sphere", "radius": 0.01}, "link": gripper,
            "pose": {"position": [0.0, 0.0, 0.32]}, "touch_links": [name]}  # fmt: skip
    answer(client.post("/v1/check", json=check | {"attached": [peg, held]}))
    stay = {"kind": "wait", "duration": 0.1, "allowed_collisions": [[name, "plate"]]}
    answer(client.post("/v1/tasks", json=common | {
        "start": {"joints": HOME}, "scene": scene, "stages": [stay]}))  # fmt: skip
    if name != "peg":
        told = answer(client.post("/v1/robots/ur5e/fk", json={
            "joints": HOME, "tool": gripper, "tcp": "tip", "link": name}))  # fmt: skip
        assert name in told["links"]
        for what in ("jacobian", "velocity"):
            more = {"joint_velocities": [0.0] * 6} if what == "velocity" else {}
            ask(client, what, joints=HOME, tool=gripper, tcp="tip", link=name, **more)
        ask(client, "ik", pose=told["pose"], tool=gripper, tcp="tip", link=name)
        region = {"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 3.0}
        keep = {"type": "position", "link": name, "region": region}
        goal = {"joints": [0.1, *HOME[1:]]}
        plan = client.post("/v1/plan", json=common | {
            "start": {"joints": HOME}, "goal": goal, "constraints": [keep]})  # fmt: skip
        assert plan.is_success, plan.text

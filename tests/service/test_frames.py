"""Frames of scenes, poses, goals and constraints: a UR5e on a mount, beside pinocchio."""

from typing import Any

import httpx
import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.pose import from_rpy, transform
from kinematics.robots import builtin_srdf, builtin_urdf
from tests.service.conftest import Served
from tests.service.poses import as_pose, matrix
from tests.service.robots import answer, problem

#: As the stand of a public UR5 has it.
MOUNT = transform(from_rpy([0.0, 0.0, 1.57]), [0.0, 0.0, 0.9144])
URDF = builtin_urdf("ur5e").replace(
    "</robot>",
    '<link name="stand"/><joint name="mount" type="fixed"><parent link="stand"/>'
    '<child link="base"/><origin xyz="0 0 0.9144" rpy="0 0 1.57"/></joint></robot>',
)
SRDF = builtin_srdf("ur5e")
Q = [0.3, -1.2, 1.4, -1.0, -1.5, 0.4]
BALL = {"type": "sphere", "radius": 0.05}


def at(position: list[float], **more: Any) -> dict[str, Any]:
    obstacle = {"id": "ball", "shape": BALL, "pose": {"position": position, **more}}
    return {"obstacles": [obstacle]}


@pytest.fixture(scope="module", autouse=True)
def mounted(served: Served) -> dict[str, Any]:
    body = {"name": "mounted", "urdf": URDF, "srdf": SRDF, "joint_limits": {"*": {"jerk": 100.0}}}
    return answer(served.client.post("/v1/robots", json=body), 201)


@pytest.fixture(scope="module")
def tool(mounted: dict[str, Any]) -> Array:
    """T_root_tool at Q, by pinocchio."""
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array(Q))
    return np.array(data.oMf[model.getFrameId(mounted["tip_link"])].homogeneous)


def ask(client: httpx.Client, path: str, **body: Any) -> dict[str, Any]:
    return answer(client.post(path, json={"robot": "mounted", **body}))


def of_robot(client: httpx.Client, action: str, **body: Any) -> dict[str, Any]:
    return answer(client.post(f"/v1/robots/mounted/{action}", json=body))


def test_the_model_tells_its_frame(mounted: dict[str, Any]) -> None:
    assert (mounted["frame"], mounted["base_link"]) == ("stand", "base")
    assert any("0.9144 m" in line and "1.57 rad" in line for line in mounted["lint"])


def test_forward_kinematics(client: httpx.Client, tool: Array) -> None:
    told = of_robot(client, "fk", joints=Q)
    assert told["frame"] == "stand"
    assert "0.9144" in told["frame_note"]
    np.testing.assert_allclose(matrix(told["pose"]), tool, atol=1e-12)
    seen = of_robot(client, "fk", joints=[Q, Q], frame="base")
    for pose in seen["pose"]:
        np.testing.assert_allclose(MOUNT @ matrix(pose), tool, atol=1e-12)
    itself = of_robot(client, "fk", joints=Q, frame="tool")
    np.testing.assert_allclose(matrix(itself["pose"]), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(tool @ matrix(itself["links"]["stand"]), np.eye(4), atol=1e-12)


def test_jacobian_and_velocity(client: httpx.Client, tool: Array) -> None:
    root = np.array(of_robot(client, "jacobian", joints=Q)["jacobian"])
    for name, T in (("base", MOUNT), ("tool", tool)):
        seen = of_robot(client, "jacobian", joints=Q, frame=name)
        turn = np.kron(np.eye(2), T[:3, :3].T)
        np.testing.assert_allclose(seen["jacobian"], turn @ root, atol=1e-12)
        twist = [0.1, -0.2, 0.05, 0.1, 0.0, 0.3]
        rates = of_robot(client, "velocity", joints=Q, twist=twist, frame=name)
        np.testing.assert_allclose(turn @ root @ rates["joint_velocities"], twist, atol=1e-9)
        np.testing.assert_allclose(rates["twist"], twist, atol=1e-9)


def test_inverse_kinematics(client: httpx.Client, tool: Array) -> None:
    offset = transform(from_rpy([0.1, -0.1, 0.2]), [0.02, 0.03, -0.04])
    for pose in (as_pose(tool @ offset), as_pose(offset, frame="tool"),
                 as_pose(np.linalg.inv(MOUNT) @ tool @ offset, frame="base")):  # fmt: skip
        found = of_robot(client, "ik", pose=pose, seed_joints=Q)
        reached = of_robot(client, "fk", joints=found["solutions"][0]["joints"])
        np.testing.assert_allclose(matrix(reached["pose"]), tool @ offset, atol=1e-6)
    without = {"pose": as_pose(offset, frame="tool")}
    refusal = problem(client.post("/v1/robots/mounted/ik", json=without), 422, "INVALID_LINK_NAME")
    assert "seed_joints" in refusal["hint"]


def test_scenes_mean_the_root_unless_they_say_otherwise(client: httpx.Client, tool: Array) -> None:
    here = (tool @ [0.0, 0.0, 0.03, 1.0])[:3]
    there = (np.linalg.inv(MOUNT) @ [*here, 1.0])[:3].tolist()
    root = ask(client, "/v1/check", joints=Q, scene=at(here.tolist()))
    assert root["frame"] == "stand"
    assert root["clearance"] < -0.01
    assert "ball" in root["clearance_pair"]
    ways: list[dict[str, Any]] = [
        {"scene": at(there, frame="base")},
        {"scene": {**at(there), "frame": "base"}},
        {"scene": at(there), "frame": "base"},
        {"scene": at([0.0, 0.0, 0.03], frame="tool")},
        {"scene": {**at([0.0, 0.0, 0.03]), "frame": "tool"}, "frame": "base"},
    ]
    for way in ways:
        seen = ask(client, "/v1/check", joints=Q, **way)
        assert seen["clearance"] == pytest.approx(root["clearance"], abs=1e-9), way
    # The mistake that the frame is there to prevent: the same numbers, meant elsewhere.
    wrong = ask(client, "/v1/check", joints=Q, scene=at(there))
    assert wrong["valid"]


def test_point_clouds_and_taken_objects_are_in_their_frames(
    client: httpx.Client, tool: Array
) -> None:
    cloud = {"type": "point_cloud", "points": [[0.0, 0.0, 0.03], [0.0, 0.0, 0.04]], "radius": 0.05}
    obstacle = {"id": "ball", "shape": cloud, "pose": {"position": [0, 0, 0], "frame": "tool"}}
    seen = ask(client, "/v1/check", joints=Q, scene={"obstacles": [obstacle]})
    root = {**obstacle, "pose": as_pose(tool)}
    expected = ask(client, "/v1/check", joints=Q, scene={"obstacles": [root]})
    assert seen["clearance"] == pytest.approx(expected["clearance"], abs=1e-9)
    taken = {"id": "ball", "link": "tool0", "grasp_joints": Q, "touch_links": ["wrist_3_link"]}
    there = (np.linalg.inv(MOUNT) @ tool @ [0.0, 0.0, 0.1, 1.0])[:3].tolist()
    turned = [*Q[:5], Q[5] + 1.0]
    ways: list[dict[str, Any]] = [
        {"scene": at(there), "frame": "base"},
        {"scene": at((MOUNT @ [*there, 1])[:3].tolist())},
    ]
    held = [ask(client, "/v1/check", joints=turned, attached=[taken], **way) for way in ways]
    assert held[0]["clearance"] == pytest.approx(held[1]["clearance"], abs=1e-9)


def test_stored_scenes_keep_their_frame(client: httpx.Client, tool: Array) -> None:
    there = (np.linalg.inv(MOUNT) @ tool @ [0.0, 0.0, 0.2, 1.0])[:3].tolist()
    stored = {"name": "in_base", "frame": "base", **at(there)}
    answer(client.post("/v1/scenes", json=stored), 201)
    seen = ask(client, "/v1/check", joints=Q, scene="in_base", frame="stand")
    inline = ask(client, "/v1/check", joints=Q, scene=at(there, frame="base"))
    assert seen["clearance"] == inline["clearance"]
    found = answer(client.post("/v1/scenes/in_base/project", json={"points": [there]}))
    assert found["frame"] == "base"
    assert found["projections"][0][0]["distance"] == pytest.approx(-0.05)
    problem(
        client.post("/v1/check", json={"robot": "panda", "joints": [0.0] * 7, "scene": "in_base"}),
        422,
        "INVALID_LINK_NAME",
    )


@pytest.mark.parametrize("frame", ["shelf", "tool0", "forearm_link"])
def test_frames_that_move_or_are_missing_are_refused_by_name(
    client: httpx.Client, mounted: dict[str, Any], frame: str
) -> None:
    assert frame == "shelf" or frame in mounted["links"]
    text = (
        f'world: {{collision_objects: [{{id: b, header: {{frame_id: "{frame}"}}, primitives: '
        "[{type: sphere, dimensions: [0.1]}], primitive_poses: [{}]}]}"
    )
    for scene in (at([1.0, 0.0, 0.0], frame=frame), {"moveit": text}):
        body = {"robot": "mounted", "joints": Q, "scene": scene}
        refusal = problem(client.post("/v1/check", json=body), 422, "INVALID_LINK_NAME")
        assert repr(frame) in refusal["detail"]
        assert "stand" in refusal["hint"]


@pytest.mark.parametrize("frame", ["shelf", "forearm_link"])
@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/v1/check", {"joints": Q}),
        ("/v1/plan", {"start": {"joints": Q}, "goal": {"joints": [0.0, *Q[1:]]}}),
        ("/v1/validate", {"trajectory": {"segments": [{
            "t0": 0.0, "t1": 1.0, "coefficients": [[q] for q in Q]}]}}),
        ("/v1/tours", {"start": {"joints": Q}, "goals": [
            {"joints": [0.0, *Q[1:]]}, {"joints": [0.1, *Q[1:]]}]}),
    ],
)  # fmt: skip
def test_a_frame_in_which_nothing_is_meant_is_refused_all_the_same(
    client: httpx.Client, path: str, body: dict[str, Any], frame: str
) -> None:
    request = {"robot": "mounted", "frame": frame, **body}
    refusal = problem(client.post(path, json=request), 422, "INVALID_LINK_NAME")
    assert repr(frame) in refusal["detail"]


def test_plans_constraints_and_proofs(client: httpx.Client, tool: Array) -> None:
    goal = tool @ transform(position=[0.0, 0.05, -0.05])
    region = {"type": "box", "size": [0.4, 0.4, 0.4]}
    frames = {"stand": np.eye(4), "base": MOUNT, "tool": tool}
    durations = []
    for name, T in frames.items():
        back = np.linalg.inv(T)
        constraint = {"type": "position", "region": {**region, "pose": as_pose(back @ tool)}}
        scene = at((back @ [0.5, 0.5, 2.0, 1.0])[:3].tolist())
        body = {"scene": scene, "constraints": [constraint], "frame": name}
        plan = ask(
            client, "/v1/plan", start={"joints": Q}, goal={"pose": as_pose(back @ goal)}, **body
        )
        assert plan["frame"] == "stand"
        end = of_robot(client, "fk", joints=plan["path"]["joints"][-1])
        np.testing.assert_allclose(matrix(end["pose"]), goal, atol=2e-3)
        durations.append(plan["trajectory"]["duration"])
        proof = ask(client, "/v1/validate", trajectory=plan["trajectory"], **body)
        assert proof["verified"]
        assert proof["frame"] == "stand"
        residual = proof["path_constraint_residual"]
        assert residual == pytest.approx(plan["certificate"]["path_constraint_residual"], abs=1e-6)
    goals = {"pose": as_pose(np.linalg.inv(MOUNT) @ goal), "frame": "base"}
    assert ask(client, "/v1/plan", start={"joints": Q}, goal=goals)["status"] == "success"


def test_tool_motions(client: httpx.Client, tool: Array) -> None:
    motion = {"type": "lin", "pose": {"position": [0.0, 0.0, -0.05], "frame": "tool"}}
    plan = ask(client, "/v1/plan", start={"joints": Q}, goal={"pose": motion["pose"]},
               planner="cartesian", planner_options={"motions": [motion]})  # fmt: skip
    end = of_robot(client, "fk", joints=plan["path"]["joints"][-1])
    np.testing.assert_allclose(
        matrix(end["pose"]), tool @ transform(position=[0.0, 0.0, -0.05]), atol=1e-4
    )
    held = {"motions": [motion]}
    proof = ask(client, "/v1/validate", trajectory=plan["trajectory"], tool_motions=held)
    assert proof["verified"]


def test_named_states(client: httpx.Client, mounted: dict[str, Any]) -> None:
    home = mounted["states"]["home"]
    plan = ask(client, "/v1/plan", start={"state": "home"}, goal={"any_of": [{"joints": Q}]})
    assert plan["path"]["joints"][0] == pytest.approx(home)
    back = ask(client, "/v1/plan", start={"joints": Q}, goal={"state": "home"})
    assert back["path"]["joints"][-1] == pytest.approx(home)
    either = ask(client, "/v1/plan", start={"joints": Q}, goal={"any_of": [{"state": "home"}]})
    assert either["path"]["joints"][-1] == pytest.approx(home)
    body = {"robot": "mounted", "start": {"state": "away"}, "goal": {"joints": Q}}
    refusal = problem(client.post("/v1/plan", json=body), 422, "INVALID_ROBOT_STATE")
    assert "home" in refusal["hint"]


def test_one_configuration_says_where_the_tool_is(client: httpx.Client) -> None:
    body = {"robot": "mounted", "joints": [Q, Q], "scene": at([0.0, 0.0, 0.2], frame="tool")}
    problem(client.post("/v1/check", json=body), 422, "INVALID_LINK_NAME")


def test_a_frame_and_a_reference_link_exclude_each_other(client: httpx.Client) -> None:
    constraint = {"type": "look_at", "axis": [0, 0, 1], "target": [1, 0, 0], "angle": 3.0,
                  "frame": "base", "reference_link": "forearm_link"}  # fmt: skip
    body = {"robot": "mounted", "start": {"joints": Q}, "goal": {"joints": Q}}
    refusal = problem(
        client.post("/v1/plan", json={**body, "constraints": [constraint]}),
        422, "INVALID_GOAL_CONSTRAINTS",
    )  # fmt: skip
    assert "constraints[0]" in refusal["detail"]

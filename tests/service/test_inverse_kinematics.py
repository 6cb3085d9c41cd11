"""Inverse kinematics over HTTP against the domain called directly."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.pose import Pose
from armwright_wire.robots.kinematics import IkAnswer
from armwright_wire.scenes.scene import Scene
from kinematics.forward import forward, joint_frames
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.pose import (
    to_quaternion,
)
from kinematics.robots import builtin_chain
from obstacles.collision.fcl_distance import FclWorld
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.translate import poses
from tests.service.poses import as_pose, draws
from tests.service.robots import HOME, answer, problem, scene, solid

UR, SEVEN, FAR = [0.3, -1.0, 1.4, -0.7, -1.3, 0.2], [0.2, 0.2, 0.2, -1.0, 0.2, 1.0, 0.2], 300


@pytest.mark.parametrize(
    ("name", "q", "more", "options"),
    [
        ("panda", SEVEN, {"seed_joints": HOME}, IkOptions()),
        ("panda", HOME, {"link": "panda_link8"}, IkOptions()),
        ("panda", SEVEN, {"choice": "limits"}, IkOptions(ranking="limits")),
        ("iiwa14", SEVEN, {"parameters": [0.2, 0.5], "max_solutions": 16},
         IkOptions(most=16, parameters=[0.2, 0.5])),
        ("ur5e", UR, {"all_solutions": True, "max_solutions": 8},
         IkOptions(most=8, outside_limits=True)),
        ("ur5e", UR, {"method": "analytic", "all_turns": True, "max_solutions": FAR},
         IkOptions(method="analytic", most=FAR, all_turns=True)),
        ("ur5e", UR, {"method": "numeric", "seed": 1}, IkOptions(method="numeric", seed=1)),
        ("puma560", [2.7, -3.8, 3.8, 2.9, 1.7, -4.6],
         {"all_solutions": True, "max_solutions": 8}, IkOptions(most=8, outside_limits=True)),
        ("scara", [0.3, 0.5, 0.1, 0.2], {"axes": ["x", "y", "z"]}, IkOptions(axes=["x", "y", "z"])),
    ],
)  # fmt: skip
def test_solutions_are_those_of_the_library(
    client: httpx.Client, name: str, q: list[float], more: dict[str, Any], options: IkOptions
) -> None:
    chain, link = builtin_chain(name), more.get("link")
    pose = as_pose(forward(chain, q, link))
    given = answer(client.post(f"/v1/robots/{name}/ik", json=more | {"pose": pose}))
    IkAnswer.model_validate(given)
    target = poses.transform(Pose.model_validate(pose))
    near = more.get("seed_joints")
    found = inverse_kinematics(chain, target, options, link=link, seed_joints=near).solutions
    assert found
    for item, solution in zip(given["solutions"], found, strict=True):
        assert item["joints"] == solution.joints.tolist()
        assert (item["branch"], item["within_limits"]) == (solution.branch, solution.within_limits)
        assert item["position_error"] == solution.position_error
        assert (item["rejected_because"] is None) == solution.within_limits
        assert solution.within_limits or "outside [" in item["rejected_because"]
        assert item["collision_free"] is None


def test_ik_with_a_scene_tells_collisions_by_name(client: httpx.Client) -> None:
    T = forward(builtin_chain("panda"), HOME)
    pose = {"position": T[:3, 3].tolist(), "quaternion_xyzw": to_quaternion(T[:3, :3]).tolist()}
    box = solid("elbow_room", "box", [0.1, 0.2, 0.6], size=[0.1, 0.1, 0.3])
    place = scene(box)
    body: dict[str, Any] = {"pose": pose, "scene": place, "all_solutions": True}
    found = answer(client.post("/v1/robots/panda/ik", json=body))["solutions"]
    verdicts = [item["collision_free"] for item in found]
    assert True in verdicts
    assert False in verdicts
    usable = [item["rejected_because"] is None for item in found]
    assert usable == sorted(usable, reverse=True), "best first"
    geometry = worker_cache.robot(builtin_reference("panda")).geometry
    world = FclWorld(geometry, poses.scene(Scene.model_validate(place)))
    for item in found:
        usable_one = item["collision_free"] and item["within_limits"]
        assert (item["rejected_because"] is None) == usable_one
    for item in found[:: max(1, len(found) // 25)]:
        assert item["collision_free"] == (not world.collisions(item["joints"]))
    single = answer(client.post("/v1/robots/panda/ik", json={"pose": pose, "scene": place}))
    assert [item["collision_free"] for item in single["solutions"]] == [True]


def test_ik_where_everything_collides(client: httpx.Client) -> None:
    T = forward(builtin_chain("panda"), HOME)
    position = T[:3, 3].tolist()
    ball = solid("ball", "sphere", position, radius=0.1)
    body: dict[str, Any] = {"pose": {"position": position, "rpy": [3.1, 0, 0]}}
    body["scene"] = scene(ball)
    document = problem(client.post("/v1/robots/panda/ik", json=body), 422, "NO_IK_SOLUTION")
    assert document["stage"] == "collision"
    assert "'ball'" in document["detail"]
    assert len(document["details"]["rejected"]) > 1


@pytest.mark.parametrize(
    ("pose", "hint"),
    [
        ({"position": [3.0, 0.0, 0.0]}, "beyond the longest the arm can reach"),
        ({"position": [0.85, 0.0, 0.33], "rpy": [0.0, -1.5, 0.0]}, "orientation"),
    ],
)
def test_ik_out_of_reach_says_how_far_and_why(
    client: httpx.Client, pose: dict[str, Any], hint: str
) -> None:
    document = problem(
        client.post("/v1/robots/panda/ik", json={"pose": pose}), 422, "NO_IK_SOLUTION"
    )
    assert document["stage"] == "ik"
    assert hint in document["hint"]
    details = document["details"]
    assert details["position_error"] > 1e-3 or details["orientation_error"] > 1e-3
    reached = forward(builtin_chain("panda"), details["nearest_joints"])
    off = float(np.linalg.norm(reached[:3, 3] - pose["position"]))
    np.testing.assert_allclose(off, details["position_error"], atol=1e-9)


def test_out_of_reach_is_told_at_once_and_by_how_much(client: httpx.Client) -> None:
    chain = builtin_chain("elbow_wrist")
    frames = joint_frames(chain, np.zeros(6))[:, :3, 3]
    T = forward(chain, np.zeros(6))
    reach = np.linalg.norm(frames[2] - frames[1]) + np.linalg.norm(frames[4] - frames[2])
    T[:3, 3] += frames[1] + [reach + 0.2, 0.0, 0.0] - frames[4]
    response = client.post("/v1/robots/elbow_wrist/ik", json={"pose": as_pose(T)})
    document = problem(response, 422, "NO_IK_SOLUTION")
    assert "out of reach by 0.2 m" in document["detail"]
    assert "|D| > 1" in document["hint"]
    assert document["details"]["out_of_reach_by"] == pytest.approx(0.2, abs=1e-9)
    assert document["details"]["starts"] <= 20


def test_ik_of_many_poses(client: httpx.Client) -> None:
    chain = builtin_chain("ur5e")
    poses = [as_pose(forward(chain, q)) for q in draws("ur5e", 5, seed=4)]
    far = {"position": [3.0, 0.0, 0.0]}
    body: dict[str, Any] = {"poses": [*poses[:3], far, *poses[3:]], "all_solutions": True}
    found = answer(client.post("/v1/robots/ur5e/ik", json=body))
    IkAnswer.model_validate(found)
    assert [len(item) > 0 for item in found["solutions"]] == [True] * 3 + [False] + [True] * 2
    (missing,) = found["unsolved"]
    assert missing["index"] == 3
    assert missing["code"] == "NO_IK_SOLUTION"
    for pose, each in zip(body["poses"], found["solutions"], strict=True):
        if each:
            alone = answer(
                client.post("/v1/robots/ur5e/ik", json={"pose": pose, "all_solutions": True})
            )
            assert alone["solutions"] == each

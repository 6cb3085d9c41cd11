"""Inverse kinematics over HTTP against the domain called directly."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.robots.kinematics import IkAnswer
from armwright_wire.scenes.scene import Scene
from kinematics.forward import forward, joint_frames
from kinematics.pose import (
    rotation_error,
    to_quaternion,
)
from kinematics.robots import builtin_chain
from obstacles.collision.fcl_distance import FclWorld
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.translate import poses
from tests.service.poses import as_pose, draws
from tests.service.robots import HOME, answer, problem, scene


@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford"])
def test_ik_reaches_the_pose(client: httpx.Client, name: str) -> None:
    chain = builtin_chain(name)
    for q in draws(name, 5, seed=2):
        T = forward(chain, q)
        pose = {
            "position": T[:3, 3].tolist(),
            "quaternion_xyzw": to_quaternion(T[:3, :3]).tolist(),
        }
        found = answer(client.post(f"/v1/robots/{name}/ik", json={"pose": pose}))
        IkAnswer.model_validate(found)
        (best,) = found["solutions"]
        reached = forward(chain, best["joints"])
        np.testing.assert_allclose(reached[:3, 3], T[:3, 3], atol=2e-6)
        assert np.linalg.norm(rotation_error(reached[:3, :3], T[:3, :3])) < 2e-6
        assert best["within_limits"]
        assert best["collision_free"] is None
        assert best["position_error"] <= 1e-6


def test_ik_of_all_branches_and_of_a_link_before_the_tip(client: httpx.Client) -> None:
    pose = {"position": [0.4, 0.2, 0.4], "rpy": [3.0, 0.1, 0.2]}
    body: dict[str, Any] = {"pose": pose, "all_solutions": True, "max_solutions": 8}
    found = answer(client.post("/v1/robots/ur5e/ik", json=body))["solutions"]
    assert len(found) == 8
    assert len({tuple(np.round(item["joints"], 3)) for item in found}) == 8
    seed = found[5]["joints"]
    nearest = answer(client.post("/v1/robots/ur5e/ik", json={"pose": pose, "seed_joints": seed}))
    np.testing.assert_allclose(nearest["solutions"][0]["joints"], seed, atol=1e-5)
    chain = builtin_chain("panda")
    T = forward(chain, HOME, "panda_link8")
    pose = {"position": T[:3, 3].tolist(), "rotation_matrix": T[:3, :3].tolist()}
    body = {"pose": pose, "link": "panda_link8"}
    (best,) = answer(client.post("/v1/robots/panda/ik", json=body))["solutions"]
    np.testing.assert_allclose(forward(chain, best["joints"], "panda_link8"), T, atol=5e-6)


def test_ik_with_a_scene_tells_collisions_by_name(client: httpx.Client) -> None:
    T = forward(builtin_chain("panda"), HOME)
    pose = {"position": T[:3, 3].tolist(), "quaternion_xyzw": to_quaternion(T[:3, :3]).tolist()}
    box = {
        "id": "elbow_room",
        "shape": {"type": "box", "size": [0.1, 0.1, 0.3]},
        "pose": {"position": [0.1, 0.2, 0.6]},
    }
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
    ball = {
        "id": "ball",
        "shape": {"type": "sphere", "radius": 0.1},
        "pose": {"position": position},
    }
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


def test_closed_forms_name_their_branches(client: httpx.Client) -> None:
    q = np.array([0.3, -1.0, 1.4, -0.7, -1.3, 0.2])
    body: dict[str, Any] = {"pose": as_pose(forward(builtin_chain("ur5e"), q))}
    body |= {"method": "analytic", "all_solutions": True}
    found = answer(client.post("/v1/robots/ur5e/ik", json=body))
    IkAnswer.model_validate(found)
    assert len({item["branch"] for item in found["solutions"]}) == 8
    turned = answer(client.post("/v1/robots/ur5e/ik", json=body | {"all_turns": True}))
    assert len(turned["solutions"]) == 8 * 2**5
    few = answer(client.post("/v1/robots/ur5e/ik", json=body | {"max_solutions": 3}))
    assert len(few["solutions"]) == 3
    document = problem(
        client.post(
            "/v1/robots/scara/ik", json={"pose": {"position": [0.4, 0, 0]}, "method": "analytic"}
        ),
        422,
        "VALIDATION_ERROR",
    )
    assert "numeric" in document["hint"]


@pytest.mark.parametrize(
    ("name", "more"),
    [("ur5e", {}), ("scara", {}), ("panda", {"method": "numeric"}), ("iiwa14", {"axes": ["x"]})],
)
def test_parameters_that_would_do_nothing_are_refused(
    client: httpx.Client, name: str, more: dict[str, Any]
) -> None:
    body = {"pose": {"position": [0.4, 0, 0.3]}, "parameters": [0.5]} | more
    response = client.post(f"/v1/robots/{name}/ik", json=body)
    assert "parameter" in problem(response, 422, "VALIDATION_ERROR")["detail"]


def test_rows_of_different_lengths_are_named_as_such(client: httpx.Client) -> None:
    response = client.post("/v1/robots/panda/fk", json={"joints": [HOME, HOME[:6]]})
    document = problem(response, 422, "INVALID_ROBOT_STATE")
    assert "rows of equal length" in document["detail"]
    assert "7 numbers" in document["hint"]


def test_solutions_outside_limits_say_which(client: httpx.Client) -> None:
    q = [2.7, -3.8, 3.8, 2.9, 1.7, -4.6]
    body = {"pose": as_pose(forward(builtin_chain("puma560"), q)), "all_solutions": True}
    found = answer(client.post("/v1/robots/puma560/ik", json=body))["solutions"]
    flags = [item["within_limits"] for item in found]
    assert len(found) == 8
    assert flags == sorted(flags, reverse=True)
    for item in found:
        assert (item["rejected_because"] is None) == item["within_limits"]
        if not item["within_limits"]:
            assert "outside [" in item["rejected_because"]


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_redundant_arms_take_parameters(client: httpx.Client, name: str) -> None:
    chain = builtin_chain(name)
    q = 0.2 * np.array([1, 1, 1, -5, 1, 5, 1])
    body: dict[str, Any] = {"pose": as_pose(forward(chain, q)), "all_solutions": True}
    at_two = answer(client.post(f"/v1/robots/{name}/ik", json=body | {"parameters": [0.2, 0.5]}))
    assert 8 <= len(at_two["solutions"]) <= 16
    seeded = answer(client.post(f"/v1/robots/{name}/ik", json={
        "pose": body["pose"], "seed_joints": q.tolist()}))  # fmt: skip
    np.testing.assert_allclose(seeded["solutions"][0]["joints"], q, atol=1e-6)
    limits = answer(client.post(f"/v1/robots/{name}/ik", json={
        "pose": body["pose"], "choice": "limits"}))  # fmt: skip
    assert limits["solutions"][0]["within_limits"]


@pytest.mark.parametrize("rule", ["pseudo_inverse", "transpose"])
def test_gradients_are_traced(client: httpx.Client, rule: str) -> None:
    chain = builtin_chain("panda")
    q = np.array(HOME)
    pose = as_pose(forward(chain, q + 0.1))
    body: dict[str, Any] = {"pose": pose, "method": "gradient", "seed_joints": q.tolist()}
    body["gradient"] = {"rule": rule, "trace": True, "trace_points": 500}
    found = answer(client.post("/v1/robots/panda/ik", json=body))
    IkAnswer.model_validate(found)
    trace = found["trace"]
    assert len(trace["time"]) == len(trace["joints"]) == len(trace["position_error"])
    np.testing.assert_array_equal(trace["joints"][0], q)
    assert len(trace["time"]) <= 500
    for e, position, turn in zip(
        trace["error"], trace["position_error"], trace["orientation_error"], strict=True
    ):
        assert np.linalg.norm(e[:3]) == pytest.approx(position, abs=1e-15)
        assert np.linalg.norm(e[3:]) == pytest.approx(turn, abs=1e-15)
    assert trace["position_error"][-1] <= 1e-6
    assert trace["joints"][-1] == found["solutions"][0]["joints"]
    body["gradient"]["steps"] = 2
    document = problem(client.post("/v1/robots/panda/ik", json=body), 422, "NO_IK_SOLUTION")
    assert len(document["details"]["trace"]["time"]) == 3
    body |= {"method": "auto"}
    problem(client.post("/v1/robots/panda/ik", json=body), 422, "VALIDATION_ERROR")


def test_sides_of_every_branch_are_told(client: httpx.Client) -> None:
    """The notes' arm: eight branches, each of its own sides; the elbow's height says up or down."""
    chain = builtin_chain("elbow_wrist")
    T = forward(chain, np.array([0.3, 0.4, -0.6, 0.2, 0.5, 0.1]))
    body = {"pose": as_pose(T), "all_solutions": True}
    found = answer(client.post("/v1/robots/elbow_wrist/ik", json=body))["solutions"]
    assert len({tuple(item["sides"].values()) for item in found}) == len(found) == 8
    for item in found:
        points = joint_frames(chain, item["joints"])[:, :3, 3]
        share = (points[2] - points[1])[:2] @ (points[4] - points[1])[:2]
        share /= float(np.sum((points[4] - points[1])[:2] ** 2))
        line = points[1, 2] + share * (points[4, 2] - points[1, 2])
        assert item["sides"]["elbow"] == ("up" if points[2, 2] > line else "down")
        assert item["singular"] == []


def test_singular_wrists_and_shoulders_are_told(client: httpx.Client) -> None:
    chain = builtin_chain("elbow_wrist")
    straight = np.array([0.3, 0.4, -0.6, 0.2, 0.0, 0.1])
    body: dict[str, Any] = {"pose": as_pose(forward(chain, straight)), "seed_joints": [0.0] * 6}
    (found,) = answer(client.post("/v1/robots/elbow_wrist/ik", json=body))["solutions"]
    assert found["singular"] == ["wrist"]
    assert found["sides"]["wrist"] is None
    # The wrist centre on axis 1.
    rest = joint_frames(chain, np.zeros(6))[:, :3, 3]
    tool = forward(chain, np.zeros(6))[:3, 3] - rest[4]
    above = {"position": [float(x) for x in rest[1] * [0, 0, 1] + [0, 0, 0.6] + tool]}
    above["quaternion_xyzw"] = as_pose(forward(chain, np.zeros(6)))["quaternion_xyzw"]
    body = {"pose": above, "all_solutions": True}
    for item in answer(client.post("/v1/robots/elbow_wrist/ik", json=body))["solutions"]:
        assert "shoulder" in item["singular"]
        assert item["sides"]["shoulder"] is None


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


def notes_rrr(client: httpx.Client) -> str:
    """The articulated arm of lecture 15: d1 = 0.4, a2 = 0.5, a3 = 0.35."""
    name, base = "notes_rrr", {"type": "revolute", "lower": -3.2, "upper": 3.2}
    rows = [{"d": 0.4, "alpha": np.pi / 2}, {"a": 0.5}, {"a": 0.35}]
    zero = {"a": 0.0, "alpha": 0.0, "d": 0.0, "theta": 0.0}
    dh = {"convention": "standard", "rows": [base | zero | row for row in rows]}
    response = client.post("/v1/robots", json={"name": name, "dh": dh})
    assert response.status_code in (201, 409), response.text
    return name


@pytest.mark.parametrize(
    "gradient",
    [
        {"rule": "transpose"},
        {"rule": "transpose", "gain": 0.5},
        {"rule": "transpose", "form": "flow", "gain": 2.0},
        {"rule": "transpose", "form": "flow", "gain": np.diag([1.0, 2.0, 3.0]).tolist()},
        {"rule": "pseudo_inverse"},
        {"rule": "pseudo_inverse", "form": "step", "gain": 0.5},
    ],
)
def test_the_gradient_on_positions_of_the_notes(
    client: httpx.Client, gradient: dict[str, Any]
) -> None:
    body = {
        "pose": {"position": [0.3, 0.4, 0.7]}, "axes": ["x", "y", "z"], "method": "gradient",
        "seed_joints": [0.2, 0.4, 0.3], "gradient": gradient | {"trace": True},
    }  # fmt: skip
    found = answer(client.post(f"/v1/robots/{notes_rrr(client)}/ik", json=body))
    IkAnswer.model_validate(found)
    # The triangle of r = 0.5 and 0.7 - 0.4, elbow up.
    elbow = np.arccos((0.5**2 + 0.3**2 - 0.5**2 - 0.35**2) / (2 * 0.5 * 0.35))
    lift = np.arctan2(0.3, 0.5) - np.arctan2(0.35 * np.sin(elbow), 0.5 + 0.35 * np.cos(elbow))
    expected = [np.arctan2(0.4, 0.3), lift, elbow]
    assert found["solutions"][0]["joints"] == pytest.approx(expected, abs=1e-4)
    # By hand, until the error was about a millimetre.
    assert expected == pytest.approx([0.9273, -0.0985, 1.6597], abs=5e-3)
    trace = found["trace"]
    assert trace["axes"] == ["x", "y", "z"]
    assert trace["joints"][0] == [0.2, 0.4, 0.3]
    first = np.array([0.3, 0.4, 0.7]) - trace["error"][0]
    c, s, r = np.cos(0.2), np.sin(0.2), 0.5 * np.cos(0.4) + 0.35 * np.cos(0.7)
    height = 0.4 + 0.5 * np.sin(0.4) + 0.35 * np.sin(0.7)
    assert first == pytest.approx([r * c, r * s, height])
    assert trace["orientation_error"] == [0.0] * len(trace["time"])


@pytest.mark.parametrize(
    ("gradient", "words"),
    [
        ({"gain": [[1.0, 0.0], [0.0, 1.0]]}, "3 x 3 matrix"),
        ({"gain": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]}, "positive real parts"),
        ({"rule": "transpose", "gain": [[1, 1, 0], [0, 1, 0], [0, 0, 1]]}, "symmetric"),
        ({"gain": 0.0}, "gain"),
        ({"form": "jump"}, "form"),
        ({"trace_points": 5}, "trace"),
    ],
)
def test_a_gain_that_does_not_fit_is_refused(
    client: httpx.Client, gradient: dict[str, Any], words: str
) -> None:
    body = {
        "pose": {"position": [0.3, 0.4, 0.7]}, "axes": ["x", "y", "z"], "method": "gradient",
        "gradient": gradient,
    }  # fmt: skip
    response = client.post(f"/v1/robots/{notes_rrr(client)}/ik", json=body)
    assert words in problem(response, 422, "VALIDATION_ERROR")["detail"]


def test_some_axes_of_a_pose(client: httpx.Client) -> None:
    chain = builtin_chain("scara")
    T = forward(chain, [0.3, 0.5, 0.1, 0.2])
    body: dict[str, Any] = {"pose": {"position": T[:3, 3].tolist(), "rpy": [1.0, 0.0, 0.0]}}
    problem(client.post("/v1/robots/scara/ik", json=body), 422, "NO_IK_SOLUTION")
    body["axes"] = ["x", "y", "z"]
    (best,) = answer(client.post("/v1/robots/scara/ik", json=body))["solutions"]
    np.testing.assert_allclose(forward(chain, best["joints"])[:3, 3], T[:3, 3], atol=2e-6)


@pytest.mark.parametrize("several", [False, True])
def test_a_search_chooses_the_best_of_what_it_finds(client: httpx.Client, several: bool) -> None:
    chain = builtin_chain("ur5e")
    lower, span = chain.limits.lower, chain.limits.upper - chain.limits.lower
    goals = [as_pose(forward(chain, q)) for q in draws("ur5e", 8, seed=5)]

    def margins(choice: str) -> list[float]:
        asked: dict[str, Any] = {"method": "numeric", "choice": choice, "seed": 1}
        bodies = [{"poses": goals}] if several else [{"pose": goal} for goal in goals]
        answers = [
            answer(client.post("/v1/robots/ur5e/ik", json=asked | body))["solutions"]
            for body in bodies
        ]
        found = answers[0] if several else answers
        assert [len(one) for one in found] == [1] * len(goals)
        shares = [(np.array(one[0]["joints"]) - lower) / span for one in found]
        return [float(np.minimum(share, 1.0 - share).min()) for share in shares]

    first, best = np.array(margins("nearest")), np.array(margins("limits"))
    assert (best >= first - 1e-6).all()
    assert (best > first + 0.01).any()


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
    problem(client.post("/v1/robots/ur5e/ik", json={"poses": []}), 422, "VALIDATION_ERROR")
    both = {"pose": far, "poses": poses}
    problem(client.post("/v1/robots/ur5e/ik", json=both), 422, "VALIDATION_ERROR")
    traced = {"poses": poses, "method": "gradient", "gradient": {"trace": True}}
    problem(client.post("/v1/robots/ur5e/ik", json=traced), 422, "VALIDATION_ERROR")

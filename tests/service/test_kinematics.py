"""Kinematics over HTTP, forward and inverse, against the domain called directly."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx
import numpy as np
import pinocchio
import pytest

from armwright_wire.pose import Pose
from armwright_wire.robots.kinematics import FkAnswer, IkAnswer, JacobianAnswer, VelocityAnswer
from armwright_wire.scenes.scene import Scene
from kinematics.forward import forward, link_poses
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.jacobian import geometric
from kinematics.pose import (
    to_quaternion,
)
from kinematics.robots import builtin_chain
from obstacles.collision.fcl_distance import FclWorld
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.translate import poses
from tests.mimic_joints import mimic_positions, mimic_robot, urdf
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.sequence import fingers
from tests.service.poses import as_pose, draws, matrix
from tests.service.robots import ASIDE, HOME, answer, problem, scene, solid

ROBOTS = ("panda", "ur5e", "stanford", "scara", "planar_rr")


@pytest.mark.parametrize("name", ROBOTS)
def test_fk_of_one_and_of_many(client: httpx.Client, name: str) -> None:
    chain = builtin_chain(name)
    q = draws(name, 60)
    many = answer(client.post(f"/v1/robots/{name}/fk", json={"joints": q.tolist()}))
    FkAnswer.model_validate(many)
    expected = link_poses(chain, q)
    for i, link in enumerate(chain.links):
        told = np.array([matrix(pose) for pose in many["links"][link.name]])
        np.testing.assert_allclose(told, expected[:, i], atol=1e-12)
    one = answer(client.post(f"/v1/robots/{name}/fk", json={"joints": q[0].tolist()}))
    FkAnswer.model_validate(one)
    assert one["pose"] == many["pose"][0] == one["links"][chain.tip_link]
    single = to_quaternion(expected[0, -1, :3, :3])
    np.testing.assert_allclose(one["links"][chain.links[-1].name]["quaternion_xyzw"], single)
    middle = chain.links[len(chain.links) // 2].name
    request = {"joints": q[0].tolist(), "link": middle}
    at_link = answer(client.post(f"/v1/robots/{name}/fk", json=request))
    assert at_link["pose"] == one["links"][middle]


def test_a_batch_of_one_stays_a_batch(client: httpx.Client) -> None:
    found = answer(client.post("/v1/robots/panda/fk", json={"joints": [HOME]}))
    assert len(found["pose"]) == 1
    found = answer(client.post("/v1/robots/panda/jacobian", json={"joints": [HOME]}))
    assert np.shape(found["jacobian"]) == (1, 6, 7)
    assert found["rank"] == [6]


@pytest.mark.parametrize("name", ROBOTS)
def test_jacobians(client: httpx.Client, name: str) -> None:
    chain = builtin_chain(name)
    q = draws(name, 40, seed=1)
    path = f"/v1/robots/{name}/jacobian"
    link, point = chain.links[-2].name, [0.1, -0.2, 0.3]
    request = {"joints": q.tolist(), "link": link, "point": point}
    many = answer(client.post(path, json=request))
    JacobianAnswer.model_validate(many)
    expected = geometric(chain, q, link, point)
    np.testing.assert_allclose(many["jacobian"], expected, atol=1e-12)
    for J, rank, values, product in zip(
        expected, many["rank"], many["singular_values"], many["manipulability"], strict=True
    ):
        assert rank == np.linalg.matrix_rank(J)
        np.testing.assert_allclose(values, np.linalg.svd(J)[1], atol=1e-12)
        np.testing.assert_allclose(product, np.prod(values))
    one = answer(client.post(path, json={"joints": q[0].tolist()}))
    JacobianAnswer.model_validate(one)
    np.testing.assert_allclose(one["jacobian"], geometric(chain, q[0]), atol=1e-12)


def test_velocity_both_ways(client: httpx.Client) -> None:
    chain = builtin_chain("panda")
    q, rates = np.array(HOME), np.linspace(-0.3, 0.3, 7)
    request: dict[str, Any] = {"joints": HOME, "joint_velocities": rates.tolist()}
    told = answer(client.post("/v1/robots/panda/velocity", json=request))
    VelocityAnswer.model_validate(told)
    np.testing.assert_allclose(told["twist"], geometric(chain, q) @ rates, atol=1e-12)
    assert told["rank"] == 6
    back = {"joints": HOME, "twist": told["twist"], "nullspace": rates.tolist()}
    found = answer(client.post("/v1/robots/panda/velocity", json=back))
    VelocityAnswer.model_validate(found)
    # The least-norm part and the null-space part of the same rates are the rates.
    np.testing.assert_allclose(found["joint_velocities"], rates, atol=1e-9)
    np.testing.assert_allclose(found["residual"], 0.0, atol=1e-9)
    assert found["damped"] == []
    many = {"joints": [HOME] * 20, "twist": told["twist"]}
    batch = answer(client.post("/v1/robots/panda/velocity", json=many))
    VelocityAnswer.model_validate(batch)
    assert np.shape(batch["joint_velocities"]) == (20, 7)
    assert batch["damped"] == [[]] * 20


def test_a_large_batch_goes_to_a_worker(client: httpx.Client) -> None:
    q = draws("panda", 3000)
    found = answer(client.post("/v1/robots/panda/fk", json={"joints": q.tolist()}))
    assert len(found["pose"]) == 3000
    np.testing.assert_allclose(
        matrix(found["pose"][-1]), forward(builtin_chain("panda"), q[-1]), atol=1e-12
    )


@pytest.mark.parametrize("field", ["joints", "joint_velocities", "nullspace"])
def test_rows_of_different_lengths_are_refused_by_name(client: httpx.Client, field: str) -> None:
    rows: dict[str, Any] = {"joints": [HOME, HOME], "twist": [0.0] * 6}
    if field == "joint_velocities":
        del rows["twist"]
    document = problem(
        client.post("/v1/robots/panda/velocity", json=rows | {field: [HOME, HOME[:3]]}),
        422,
        "INVALID_ROBOT_STATE",
    )
    assert document["detail"] == f"{field} is not an array of numbers with rows of equal length"


def test_poses_with_fingers_elsewhere(client: httpx.Client) -> None:
    robot = {"name": "fk_claws", "urdf": fingers.urdf(), "srdf": fingers.srdf()}
    model = answer(client.post("/v1/robots", json=robot), 201)
    assert model["fingers"] == {"claw_left": {"position": 0.0, "lower": 0.0, "upper": 0.06}}
    where = "/v1/robots/fk_claws/fk"
    rows = [HOME, ASIDE, HOME]
    openings = [0.0, 0.02, 0.05]
    body = {"joints": rows, "fingers": {"claw_left": openings}}
    links = answer(client.post(where, json=body))["links"]
    # The URDF by pinocchio, the mimic joint at its own joint as the mimic says.
    with TemporaryDirectory() as folder:
        file = Path(folder, "claws.urdf")
        file.write_text(fingers.urdf())
        pin = pinocchio.buildModelFromUrdf(str(file))
    data = pin.createData()
    for k, (joints, at) in enumerate(zip(rows, openings, strict=True)):
        q = pinocchio.neutral(pin)
        values = dict(zip(model["joint_names"], joints, strict=True))
        for name, value in {**values, "claw_left": at, "claw_right": at}.items():
            q[pin.joints[pin.getJointId(name)].idx_q] = value
        pinocchio.framesForwardKinematics(pin, data, q)
        for name in ("claw_left_plate", "claw_right_plate", "panda_hand"):
            T = data.oMf[pin.getFrameId(name)]
            np.testing.assert_allclose(links[name][k]["position"], T.translation, atol=1e-9)
    one = answer(client.post(where, json={"joints": ASIDE, "fingers": {"claw_left": 0.02}}))
    assert one["links"]["claw_right_plate"] == links["claw_right_plate"][1]
    for wrong in ({"claw_left": 0.1}, {"claw_right": 0.01}, {"claw_left": [0.01]}):
        refused = client.post(where, json={"joints": HOME, "fingers": wrong})
        assert "claw" in problem(refused, 422, "VALIDATION_ERROR")["detail"]


START, GOAL = [-0.9, 0.2, -0.5, 0.4, 0.5, 0.0], [0.9, 0.2, -0.5, -1.2, 0.5, 0.0]


@pytest.fixture
def palletiser(client: httpx.Client) -> Iterator[dict[str, Any]]:
    body = {"name": "palletiser", "urdf": urdf(), "tip_link": "flange"}
    yield answer(client.post("/v1/robots", json=body), 201)
    client.delete("/v1/robots/palletiser")


def test_what_follows_is_told(palletiser: dict[str, Any]) -> None:
    assert palletiser["joint_names"] == ["j1", "j2", "j3", "j4", "j5", "j6"]
    assert {"rod", "flap", "drum"} <= set(palletiser["links"])
    lint = "\n".join(palletiser["lint"])
    assert "'rod_joint' moves with 'j2', which it mimics: -1 x" in lint
    assert "forces and torques are not known" in lint


def test_a_plan_passes_what_only_the_drum_would_hit(
    client: httpx.Client, palletiser: dict[str, Any]
) -> None:
    """A post that the arm itself never comes near, in the way of what turns behind the base."""
    oracle = PinocchioArm(urdf=urdf(), chain=mimic_robot().chain, others=mimic_positions)
    tip = oracle.pose(np.array([0.0, *START[1:]]), "drum")
    post = tip[:3, 3] + 0.22 * tip[:3, 0]
    shape = {"type": "sphere", "radius": 0.04}
    scene = {"obstacles": [{"id": "post", "shape": shape, "pose": {"position": post.tolist()}}]}
    body = {"robot": "palletiser", "scene": scene, "joints": [[0.0, *START[1:]]]}
    checked = answer(client.post("/v1/check", json=body))
    assert "drum" in str(checked)
    problem_body = {
        "robot": "palletiser", "scene": scene, "start": {"joints": START},
        "goal": {"joints": GOAL}, "timeout": 20.0,
    }  # fmt: skip
    # All ways turn the drum, which follows the first joint, past the post.
    refused = client.post("/v1/plan", json=problem_body | {"timeout": 2.0})
    blocked = refused.json()["details"]["blocked_by"]
    assert ["drum", "post"] in [item["pair"] for item in blocked], refused.text
    free = {"obstacles": [scene["obstacles"][0] | {"pose": {"position": [0.6, 1.4, 0.4]}}]}
    plan = answer(client.post("/v1/plan", json=problem_body | {"scene": free}))
    assert plan["certificate"]["verified"]


def test_dynamics_are_refused_by_name(client: httpx.Client, palletiser: dict[str, Any]) -> None:
    refused = client.post("/v1/robots/palletiser/dynamics", json={"joints": START})
    assert refused.status_code == 422
    assert "rod_joint" in refused.text
    assert "mimic" in refused.text


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

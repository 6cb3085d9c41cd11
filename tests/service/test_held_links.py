"""Held objects as links: wherever a request names a link, the id of an attached object works."""

from typing import Any

import httpx
import numpy as np
import pinocchio as pin
import pytest

from armwright_wire.motions.trajectory import TrajectoryBody
from kinematics.pose import from_rpy, transform
from kinematics.robots import builtin_chain
from service.translate.trajectories import trajectory
from tests.kinematics import builtin
from tests.service.poses import as_pose, draws, matrix
from tests.service.robots import HOME, answer, problem

MODEL = builtin.model("panda")
T_HAND_ROD = transform(from_rpy([0.4, -0.7, 1.1]), [0.03, -0.02, 0.25])
ROD: dict[str, Any] = {
    "id": "rod",
    "shape": {"type": "sphere", "radius": 0.01},
    "link": "panda_hand",
    "pose": as_pose(T_HAND_ROD),
}
NEAR = [0.25, *HOME[1:6], HOME[6] + 0.2]


def ask(client: httpx.Client, what: str, **body: Any) -> dict[str, Any]:
    body.setdefault("attached", [ROD])
    return answer(client.post(f"/v1/robots/panda/{what}", json=body))


def by_pinocchio(q: Any) -> tuple[Any, Any]:
    """Pose of the rod, and its Jacobian in the axes of the root."""
    model = MODEL.copy()
    hand = model.frames[model.getFrameId("panda_hand")]
    place = hand.placement * pin.SE3(T_HAND_ROD[:3, :3], T_HAND_ROD[:3, 3])
    rod = model.addFrame(pin.Frame("rod", hand.parentJoint, 0, place, pin.FrameType.OP_FRAME))
    data, full = model.createData(), np.zeros(model.nq)
    full[:7] = q
    J = pin.computeFrameJacobian(model, data, full, rod, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    return pin.updateFramePlacement(model, data, rod).homogeneous, J[:, :7]


def test_kinematics_of_a_held_object_is_pinocchios(client: httpx.Client) -> None:
    F = np.array([3.0, -5.0, 8.0, 0.4, 0.2, -0.6])
    many = draws("panda", 5, 3)
    batch = ask(client, "fk", joints=many.tolist(), link="rod")
    for i, q in enumerate(many):
        T, J = by_pinocchio(q)
        joints = q.tolist()
        told = ask(client, "fk", joints=joints, link="rod")
        np.testing.assert_allclose(matrix(told["pose"]), T, atol=1e-9)
        assert told["links"]["rod"] == told["pose"]
        np.testing.assert_allclose(matrix(batch["pose"][i]), T, atol=1e-9)
        found = ask(client, "jacobian", joints=joints, link="rod")["jacobian"]
        np.testing.assert_allclose(found, J, atol=1e-9)
        rates = np.linspace(-0.5, 0.5, 7)
        twist = ask(client, "velocity", joints=joints, link="rod", joint_velocities=rates.tolist())
        np.testing.assert_allclose(twist["twist"], J @ rates, atol=1e-9)
        torques = ask(client, "wrench", joints=joints, link="rod", wrench=F.tolist())["torques"]
        np.testing.assert_allclose(torques, J.T @ F, atol=1e-9)


def test_what_a_finger_holds_moves_with_it(client: httpx.Client) -> None:
    on_finger = ROD | {"link": "parallel_jaw/left"}
    for opening in (0.0, 0.05):
        told = ask(client, "fk", joints=HOME, attached=[on_finger], link="rod", tool="parallel_jaw",
                   fingers={"parallel_jaw/opening": opening})  # fmt: skip
        finger = matrix(told["links"]["parallel_jaw/left"])
        np.testing.assert_allclose(matrix(told["pose"]), finger @ T_HAND_ROD, atol=1e-12)


@pytest.mark.parametrize("method", ["auto", "numeric", "gradient", "constrained"])
def test_ik_and_reach_bring_a_held_object_to_poses(client: httpx.Client, method: str) -> None:
    target = by_pinocchio(NEAR)[0]
    body = {"pose": as_pose(target), "link": "rod", "seed_joints": HOME, "method": method}
    found = ask(client, "ik", **body)["solutions"][0]
    np.testing.assert_allclose(by_pinocchio(found["joints"])[0], target, atol=1e-5)
    reached = answer(client.post("/v1/robots/panda/reach", json={
        "attached": [ROD], "link": "rod", "poses": [as_pose(target)],
        "joints": True}))  # fmt: skip
    joints = reached["joints"][0]
    np.testing.assert_allclose(by_pinocchio(joints)[0][:3, 3], target[:3, 3], atol=2e-3)


def constraint(kind: str) -> dict[str, Any]:
    T = by_pinocchio(HOME)[0]
    kinds: dict[str, dict[str, Any]] = {
        "position": {"region": {"type": "sphere", "center": T[:3, 3].tolist(), "radius": 0.5}},
        "orientation": {
            "quaternion_xyzw": as_pose(T)["quaternion_xyzw"], "axis_tolerances": [0.6, 0.5, 0.7],
        },
        "relative_pose": {
            "pose": as_pose(T),
            "position_tolerance": [0.4, 0.5, 0.3], "orientation_tolerance": [0.6, 0.5, 0.7],
        },
    }  # fmt: skip
    return {"type": kind, "link": "rod", **kinds[kind]}


@pytest.mark.parametrize("kind", ["position", "orientation", "relative_pose"])
def test_constraints_hold_for_the_held_object(client: httpx.Client, kind: str) -> None:
    common = {"robot": "panda", "attached": [ROD], "constraints": [constraint(kind)]}
    ends = {"start": {"joints": HOME}, "goal": {"joints": NEAR}}
    plan = answer(client.post("/v1/plan", json=common | ends))
    assert plan["certificate"]["path_constraints"]
    # Held objects are told by what proofs are about, as without the constraint.
    bare = answer(client.post("/v1/plan", json=ends | {"robot": "panda", "attached": [ROD]}))
    premises = [one["certificate"]["premises"] for one in (plan, bare)]
    assert premises[0] == premises[1]
    assert premises[0]["attached"] == ["rod"]
    moved = {"robot": "panda", "attached": [ROD], "trajectory": plan["trajectory"]}
    assert answer(client.post("/v1/validate", json=moved | common))["verified"]
    # A region about where the hand is, which the rod is a quarter of a metre from.
    hand = by_pinocchio(HOME)[0] @ np.linalg.inv(T_HAND_ROD)
    about = {"type": "sphere", "center": hand[:3, 3].tolist(), "radius": 0.2}
    for link, fits in (("rod", False), ("panda_hand", True)):
        tight = {"type": "position", "link": link, "region": about}
        told = answer(client.post("/v1/validate", json=moved | {"constraints": [tight]}))
        assert told["verified"] is fits
    tour = answer(client.post("/v1/tours", json=common | {
        "start": {"joints": HOME}, "goals": [{"joints": NEAR}, {"joints": HOME}]}))  # fmt: skip
    assert tour["legs"][0]["certificate"]["path_constraints"]


def test_twists_of_the_guard_turn_about_the_held_object(client: httpx.Client) -> None:
    proposal = {"twist": [0.0, 0.0, 0.0, 0.0, 0.3, 0.0], "duration": 0.4, "link": "rod"}
    body = {"robot": "panda", "attached": [ROD], "state": {"positions": HOME}}
    told = answer(client.post("/v1/guard", json=body | {"proposal": proposal}))
    chain = builtin_chain("panda")
    motion = trajectory(TrajectoryBody.model_validate(told["trajectory"]), chain)[0]
    ends = motion.sample([0.0, motion.duration])
    (first, _), (last, _) = (by_pinocchio(q) for q in ends)
    hand = [T @ np.linalg.inv(T_HAND_ROD) for T in (first, last)]
    gone = [np.linalg.norm(b[:3, 3] - a[:3, 3]) for a, b in ((first, last), hand)]
    assert gone[1] > 0.01
    # Joints gain speed at limits of their own, so the rod drifts a little at first.
    assert gone[0] < 0.1 * gone[1]


def test_stages_of_tasks_hold_constraints_of_what_is_held(client: httpx.Client) -> None:
    body = {"robot": "panda", "start": {"joints": HOME}, "attached": [ROD]}
    move = {"kind": "move", "goal": {"joints": NEAR}, "constraints": [constraint("orientation")]}
    done = answer(client.post("/v1/tasks", json=body | {"stages": [move]}))
    assert done["stages"][0]["certificate"]["path_constraints"]
    let_go = [{"kind": "detach", "object": "rod"}, move]
    refused = client.post("/v1/tasks", json=body | {"stages": let_go})
    assert "rod" in problem(refused, 422, "INVALID_LINK_NAME")["detail"]


def test_what_a_held_object_cannot_be_is_told(client: httpx.Client) -> None:
    body = {"robot": "panda", "joints": HOME, "attached": [ROD]}
    kept = client.post("/v1/check", json=body | {"margins": {"links": {"rod": 0.02}}})
    told = problem(kept, 422, "INVALID_LINK_NAME")
    assert "attached to 'panda_hand'" in told["detail"]
    taken = {"id": "rod", "link": "panda_hand", "grasp_joints": HOME}
    wrong = {"VALIDATION_ERROR": taken, "INVALID_LINK_NAME": ROD | {"id": "panda_hand"}}
    for what in ("fk", "jacobian"):
        for code, item in wrong.items():
            asked = {"joints": HOME, "link": "rod", "attached": [item]}
            problem(client.post(f"/v1/robots/panda/{what}", json=asked), 422, code)

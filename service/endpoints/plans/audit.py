"""Second look at a certified answer that is to be kept, in a worker."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armwright_wire.plans.plan import ValidateRequest
from kinematics.model.chain import Chain
from kinematics.robots import builtin_srdf, builtin_urdf
from service.audit.bodies import Array, Part, Robot, Unread, pose, read_robot, shape_parts
from service.audit.look import Cell, Motion, look
from service.endpoints.attached_objects import RobotInScene
from service.endpoints.plan.task import proof_question, question
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.storage.caches.recent import Recent
from service.workers.task import GRACE, task

#: Robots as they were sent, by the hash of their document.
_ROBOTS = Recent(16)
#: Reasons of pairs that a request lets touch, and not the robot itself.
_ASKED = ("request", "scene", "touch_links", "support", "attached")
#: Objects that are taken or put down stay where they are [m]; poses of a task are of a search.
_STAYS = 1e-4


@task(grace=GRACE)
def audit(
    robot: Reference, scene: Reference | None, content: bytes, documents: tuple[bytes | None, ...]
) -> list[dict[str, Any]] | str:
    """Look once more at a certified answer, by other code.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: Request and answer, JSON.
        documents: Documents of the robot and the scene as they are stored; None for a built-in
            robot, and where the request brings the scene or has none.

    Returns:
        Disagreements, none where all is well; a sentence where the form is one that is not read.

    Raises:
        NotPrepared: The robot or the scene has to be prepared first.
    """
    whole = json.loads(content)
    request, answer = whole["request"], whole["answer"]
    try:
        _check_form(request)
        sent = _ROBOTS.get(robot.hash, lambda: _sent_robot(robot, documents[0]))
        obstacles = _obstacles(request, documents[1])
        if "stages" in answer and "trajectory" not in answer:
            return _task_faults(robot, sent, obstacles, request, answer)
        if "trajectory" in answer:
            _, around, problem = question(robot, scene, json.dumps(request).encode())
            motion, certificate = answer["trajectory"], answer["certificate"]
            margin = problem.margin
        else:
            body = ValidateRequest.model_validate(request)
            _, _, around = proof_question(robot, scene, body)
            motion, certificate, margin = request["trajectory"], answer, body.margin
        moves = _motion(motion)
        cell = _cell(request, sent, obstacles, around, certificate, moves, margin)
    except Unread as reason:
        return str(reason)
    return look(cell, moves, int(certificate.get("cells") or 0))


def _task_faults(
    robot: Reference,
    sent: Robot,
    scene: Mapping[str, Any],
    request: Mapping[str, Any],
    answer: Mapping[str, Any],
) -> list[dict[str, Any]]:
    """Disagreements on the stages of a task, each of which is a proof of a motion by itself.

    Stages in which fingers move are left out; what is taken or put down must stay where it is.
    """
    geometry = worker_cache.robot(robot).geometry
    fingers = dict(request.get("fingers") or {})
    chain = geometry.chain

    def frames(joints: Sequence[str], q: Array) -> dict[str, Array]:
        return _frames(sent, chain, {**geometry.fingers.positions, **fingers}, joints, q)

    first = _motion(answer["stages"][0]["trajectory"])
    start = frames(first.joints, first.at(0.0))
    items = {item["id"]: dict(item) for item in scene["obstacles"]}
    for item in items.values():
        frame = item["pose"].get("frame") or scene["frame"]
        T = (start[frame] if frame else np.eye(4)) @ pose(item["pose"])
        item["pose"] = {"transform": T.tolist()}
    for moved in request.get("objects") or ():
        items[moved["id"]]["pose"] = moved["pose"]
    held = {item["id"]: dict(item) for item in request.get("attached") or ()}
    for item in held.values():
        item.setdefault("shape", items.get(item["id"], {}).get("shape"))
    faults: list[dict[str, Any]] = []
    looked: dict[str, float] | None = None  # fingers that the links were looked at with
    for stage in answer["stages"]:
        motion, certificate, after = (stage[k] for k in ("trajectory", "certificate", "after"))
        moves = _motion(motion)
        begin = frames(moves.joints, moves.at(0.0))
        before = _places(items, held, begin)
        shapes = {name: item["shape"] for name, item in (items | held).items()}
        held = {item["id"]: {**item, "shape": shapes[item["id"]]} for item in after["attached"]}
        for placed in after["objects"]:
            items[placed["id"]]["pose"] = placed["pose"]
        for name, T in _places(items, held, begin).items():
            off = float(np.linalg.norm((T - before[name])[:3]))
            if off > _STAYS:
                faults.append({"kind": "object", "body": name, "stage": stage["index"], "by": off})
        if stage["fingers"] is None and certificate["proved"]["collisions"]:
            asked = {
                "robot": request["robot"],
                "scene": {"obstacles": list(items.values())},
                "trajectory": {name: motion[name] for name in ("joint_names", "segments")},
                "attached": list(held.values()),
                "allowed_collisions": [
                    item["pair"]
                    for item in certificate["allowed_collisions"]
                    if item["reason"] in _ASKED
                ],
                "fingers": fingers or None,
                "margin": certificate["premises"]["margin"],
            }
            body = ValidateRequest.model_validate(asked)
            _, _, around = proof_question(robot, None, body)
            own = {"frame": None, "obstacles": asked["scene"]["obstacles"]}
            cell = _cell(asked, sent, own, around, certificate, moves, asked["margin"])
            found = look(cell, moves, stage["index"], are_links_known=looked == fingers)
            looked = dict(fingers)
            faults += [{**fault, "stage": stage["index"]} for fault in found]
        fingers |= after["fingers"]
    return faults


def _places(
    items: Mapping[str, Any], held: Mapping[str, Any], frames: Mapping[str, Array]
) -> dict[str, Array]:
    """Poses of all objects in the root frame, those that are held by the links' frames."""
    places = {name: pose(item["pose"]) for name, item in items.items()}
    for name, item in held.items():
        if item.get("pose") is not None:
            places[name] = frames[item["link"]] @ pose(item["pose"])
    return places


def _frames(
    sent: Robot, chain: Chain, fingers: Mapping[str, float], joints: Sequence[str], q: Array
) -> dict[str, Array]:
    """Frames of links in the root frame, by the names that a request gives them."""
    positions = {**fingers, **dict(zip(joints, q.tolist(), strict=True))}
    frames = sent.frames(positions, chain.root_link)
    return {**frames, "tool": frames[chain.tip_link]}


def _check_form(request: Mapping[str, Any]) -> None:
    if _names_a_tool(request):
        raise Unread("a mounted tool")
    if request.get("collisions") == "ignore":
        raise Unread("collisions are not looked at")


def _names_a_tool(node: Any) -> bool:
    """Whether a request, or a stage anywhere in it, mounts a tool."""
    if isinstance(node, Mapping):
        mounts = any(node.get(name) is not None for name in ("tool", "tcp"))
        return mounts or any(map(_names_a_tool, node.values()))
    return isinstance(node, list) and any(map(_names_a_tool, node))


def _sent_robot(reference: Reference, document: bytes | None) -> Robot:
    if document is not None:
        return read_robot(json.loads(document))
    name = reference.name
    return read_robot({"urdf": builtin_urdf(name), "srdf": builtin_srdf(name)})


def _obstacles(request: Mapping[str, Any], document: bytes | None) -> dict[str, Any]:
    """The scene of a request with the frame of its obstacles."""
    inline = request.get("scene")
    scene = json.loads(document) if document is not None else inline or {}
    if scene.get("moveit") is not None:
        raise Unread("the text of a MoveIt scene")
    default = request.get("frame") if document is None else None
    return {"frame": scene.get("frame") or default, "obstacles": scene.get("obstacles") or []}


def _motion(trajectory: Mapping[str, Any]) -> Motion:
    segments = trajectory.get("segments")
    if not segments:
        raise Unread("a motion by samples")
    if not trajectory.get("joint_names"):
        raise Unread("a motion without names of joints")
    last = segments[-1]
    return Motion(
        tuple(trajectory["joint_names"]),
        np.array([segment["t0"] for segment in segments]) - segments[0]["t0"],
        last["t1"] - segments[0]["t0"],
        tuple(
            tuple(np.array(row, dtype=np.float64) for row in segment["coefficients"])
            for segment in segments
        ),
    )


def _cell(
    request: Mapping[str, Any],
    sent: Robot,
    scene: Mapping[str, Any],
    around: RobotInScene,
    certificate: Mapping[str, Any],
    motion: Motion,
    margin: float,
) -> Cell:
    """What was proved beside what was sent."""
    chain = around.robot.chain
    fingers = dict(around.robot.fingers.positions)
    base = chain.root_link

    def frames(q: Array) -> dict[str, Array]:
        return _frames(sent, chain, fingers, motion.joints, q)

    start = frames(motion.at(0.0))
    placed: dict[str, Array] = {}
    shapes: dict[str, Any] = {}
    margins: dict[str, float] = {}
    for item in scene["obstacles"]:
        frame = item["pose"].get("frame") or scene["frame"]
        placed[item["id"]] = (start[frame] if frame else np.eye(4)) @ pose(item["pose"])
        shapes[item["id"]] = item["shape"]
        margins[item["id"]] = margin + (item.get("margin") or 0.0)
    held: dict[str, tuple[str, list[Part]]] = {}
    for item in request.get("attached") or ():
        name, link = item["id"], item["link"]
        if item.get("grasp_joints") is not None:
            T = np.linalg.inv(frames(np.array(item["grasp_joints"]))[link]) @ placed[name]
        else:
            T = pose(item["pose"])
        held[name] = link, shape_parts(item.get("shape") or shapes[name], T)
    obstacles = {
        name: shape_parts(shapes[name], T) for name, T in placed.items() if name not in held
    }
    allowed = frozenset(
        (min(item["pair"]), max(item["pair"])) for item in certificate["allowed_collisions"]
    )
    return Cell(
        around.robot, around.scene, sent, base, fingers, obstacles, held, allowed, margin, margins
    )

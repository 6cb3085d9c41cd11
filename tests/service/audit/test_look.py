"""Second looks agree where all is well, and see each fault that is planted in shared code."""

import base64
import dataclasses
import importlib.metadata
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest

from armwright_wire.plans.task import TaskRequest
from armwright_wire.robots.robot import RobotBody
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from obstacles.convex.piece import Piece, PieceKind
from obstacles.robots.robot_geometry import RobotGeometry
from planning.values.deadline import Deadline
from service.audit.bodies import Unread, read_robot, shape_parts
from service.endpoints.plan.task import plan
from service.endpoints.plans.audit import audit
from service.endpoints.robots.task import prepare_robot
from service.endpoints.tasks.task import plan_sequence
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference, builtin_reference
from service.storage.caches.disk_cache import PreparedRobot
from service.storage.caches.prepared_files import document_hash
from service.workers import current
from service.workers.result import PlanOutcome

READY = {
    "panda": [0.6, -0.6, 0.0, -2.2, 0.0, 1.8, 0.8],
    "ur5": [0.6, -1.3, 1.4, -1.6, -1.5, 0.3],
    "table_arm": [0.5, 0.4, 0.3],
}
#: Type, a, alpha, d, beta, range and solid of each row.
ROWS: list[tuple[Any, ...]] = [
    ("revolute", 0.3, 1.2, 0.4, 0.0, 3.0, {"type": "capsule", "radius": 0.03, "height": 0.1}),
    ("revolute", 0.35, 0.3, 0.1, 0.2, 3.0, {"type": "cylinder", "radius": 0.03, "height": 0.1}),
    ("prismatic", 0.1, 0.0, 0.2, 0.0, 0.5, {"type": "sphere", "radius": 0.04}),
]


def table_row(
    kind: str, a: float, alpha: float, d: float, beta: float, most: float, shape: dict[str, Any]
) -> dict[str, Any]:
    frame = {"type": kind, "a": a, "alpha": alpha, "d": d, "theta": 0.2, "beta": beta}
    limits = {"lower": -most, "upper": most, "velocity": 2.0, "acceleration": 10.0}
    pose = {"position": [-0.5 * a, 0.0, 0.0], "rpy": [0.0, 1.57, 0.0]}
    return {**frame, **limits, "geometry": [{"shape": shape, "pose": pose}]}


TABLE = {"convention": "standard", "rows": [table_row(*row) for row in ROWS]}


def data(end: str) -> Path:
    """A file of example-robot-data."""
    files = importlib.metadata.files("example-robot-data") or []
    return Path(str(next(file.locate() for file in files if file.as_posix().endswith(end))))


def ur5_document() -> dict[str, Any]:
    """The UR5 of example-robot-data with its collision meshes."""

    def read(end: str) -> bytes:
        return data(end).read_bytes()

    text = read("ur_description/urdf/ur5_robot.urdf").decode()
    start = "package://example-robot-data/robots/"
    uris = {part.split('"')[0] for part in text.split('filename="')[1:]}
    meshes = {
        uri: base64.b64encode(read(uri.removeprefix(start))).decode()
        for uri in uris
        if "/collision/" in uri
    }
    limits = {"*": {"acceleration": 8.0}}
    return {"name": "ur5", "urdf": text, "meshes": meshes, "joint_limits": limits}


def stored(folder: Path, document: dict[str, Any]) -> tuple[Reference, bytes]:
    content = RobotBody.model_validate(document).model_dump_json(exclude_none=True).encode()
    prepare_robot(content, str(folder))
    return Reference("robot", document["name"], document_hash(content), str(folder)), content


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Reference, bytes | None]]:
    folder = tmp_path_factory.mktemp("prepared")
    table = {"name": "table_arm", "dh": TABLE}
    return {
        "panda": (builtin_reference("panda", str(folder)), None),
        "ur5": stored(folder, ur5_document()),
        "table_arm": stored(folder, table),
    }


@pytest.fixture(autouse=True)
def _in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(current._Current, "deadline", Deadline.after(120.0))


def request(name: str, seed: int, **more: Any) -> dict[str, Any]:
    """A plan among obstacles of every kind that are not in the way of the start."""
    rng = np.random.default_rng(seed)
    start = np.array(READY[name])
    shapes = [
        {"type": "box", "size": [0.1, 0.2, 0.3]},
        {"type": "sphere", "radius": 0.08},
        {"type": "cylinder", "radius": 0.06, "height": 0.4},
        {"type": "capsule", "radius": 0.05, "height": 0.2},
        {"type": "cone", "radius": 0.1, "height": 0.3},
        {"type": "convex", "vertices": rng.uniform(-0.1, 0.1, (12, 3)).tolist()},
        {"type": "point_cloud", "points": rng.uniform(-0.1, 0.1, (9, 3)).tolist(), "radius": 0.02},
    ]
    obstacles = []
    for k, shape in enumerate(shapes):
        angle, far = rng.uniform(-3.1, 3.1), rng.uniform(0.6, 1.0)
        spot = [far * np.cos(angle), far * np.sin(angle), rng.uniform(0.1, 0.9)]
        turn = rng.normal(size=4)
        quaternion = (turn / np.linalg.norm(turn)).tolist()
        pose = {"position": spot, "quaternion_xyzw": quaternion}
        obstacles.append({"id": f"o{k}", "shape": shape, "pose": pose, "margin": 0.001 * k})
    floor = {"type": "halfspace", "normal": [0.0, 0.1, 1.0], "offset": -0.6}
    obstacles.append({"id": "floor", "shape": floor, "pose": {"position": [0.0, 0.0, 0.0]}})
    goal = start + rng.uniform(-0.7, 0.7, start.size) * (np.arange(start.size) < 3)
    return {
        "robot": name,
        "scene": {"obstacles": obstacles},
        "start": {"joints": start.tolist()},
        "goal": {"joints": goal.tolist()},
        "seed": seed,
        **more,
    }


def look(arm: tuple[Reference, bytes | None], asked: dict[str, Any]) -> Any:
    """The disagreements on the plan of a request; None where there is none."""
    planned = plan(arm[0], None, json.dumps(asked).encode())
    if not isinstance(planned, PlanOutcome):
        return None
    content = json.dumps({"request": asked, "answer": json.loads(planned.content)}).encode()
    return audit(arm[0], None, content, (arm[1], None))


HELD = {
    "id": "part",
    "shape": {"type": "box", "size": [0.06, 0.08, 0.1]},
    "pose": {"position": [0.0, 0.0, 0.2], "rpy": [0.1, 0.2, 0.3]},
}
LAST = {"panda": "panda_hand", "ur5": "tool0", "table_arm": "link_3"}


@pytest.mark.parametrize("name", ["panda", "ur5", "table_arm"])
def test_other_code_agrees_with_what_was_proved(
    arms: dict[str, tuple[Reference, bytes | None]], name: str
) -> None:
    looked = 0
    for seed in range(12):
        held = [HELD | {"link": LAST[name]}] if seed % 3 == 0 else []
        found = look(arms[name], request(name, seed, attached=held, margin=0.005 * (seed % 2)))
        if found is not None:
            assert found == [], (name, seed, found)
            looked += 1
    assert looked >= 4


def moved_joint(geometry: RobotGeometry) -> RobotGeometry:
    """The frame of the fourth joint a millimetre off."""
    chain: Chain = geometry.chain
    offsets = chain.offsets.copy()
    offsets[3, 0, 3] += 1e-3
    return dataclasses.replace(geometry, chain=dataclasses.replace(chain, offsets=offsets))


def without_a_piece(geometry: RobotGeometry) -> RobotGeometry:
    """A piece of the forearm is lost."""
    lost = max(
        k for k, link in enumerate(geometry.links) if link in ("panda_link5", "forearm_link")
    )
    keep = [k for k in range(len(geometry.links)) if k != lost]
    return dataclasses.replace(
        geometry,
        pieces=tuple(geometry.pieces[k] for k in keep),
        links=tuple(geometry.links[k] for k in keep),
        joints=geometry.joints[keep],
        solids=geometry.solids[keep],
    )


def without_an_octant(geometry: RobotGeometry) -> RobotGeometry:
    """Supports of polytopes are those of the others' corners in one octant, 3 mm at least."""

    def cut(piece: Piece) -> Piece:
        corners = piece.vertices
        if piece.kind != PieceKind.POLYTOPE or len(corners) < 8:
            return piece
        middle = corners.mean(axis=0)
        inside = (corners > middle).all(axis=1)
        cut = np.where(inside[:, None], middle + 0.9 * (corners - middle), corners)
        return dataclasses.replace(piece, vertices=cut, surface=None)

    return dataclasses.replace(geometry, pieces=tuple(cut(piece) for piece in geometry.pieces))


@pytest.mark.parametrize(
    ("name", "fault", "kind"),
    [
        ("panda", moved_joint, "frame"),
        ("ur5", moved_joint, "frame"),
        ("panda", without_a_piece, "solid"),
        ("ur5", without_a_piece, "solid"),
        ("ur5", without_an_octant, "solid"),
    ],
)
def test_faults_in_shared_code_are_seen(
    arms: dict[str, tuple[Reference, bytes | None]],
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    fault: Callable[[RobotGeometry], RobotGeometry],
    kind: str,
) -> None:
    honest = worker_cache.robot(arms[name][0])
    wrong = PreparedRobot.of(fault(honest.geometry), honest.answer)
    monkeypatch.setattr(worker_cache, "robot", lambda reference: wrong)
    found = [f for seed in range(6) for f in look(arms[name], request(name, seed)) or []]
    assert kind in {fault["kind"] for fault in found}


def test_an_object_that_is_held_elsewhere_is_seen(
    arms: dict[str, tuple[Reference, bytes | None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    attach = RobotGeometry.attach

    def off(self: RobotGeometry, attached: Any, *args: Any, **more: Any) -> RobotGeometry:
        pose = attached.T_world_obstacle.copy()
        pose[0, 3] += 5e-3
        return attach(self, dataclasses.replace(attached, T_world_obstacle=pose), *args, **more)

    monkeypatch.setattr(RobotGeometry, "attach", off)
    held = [HELD | {"link": "panda_hand"}]
    found = [
        f
        for seed in range(3)
        for f in look(arms["panda"], request("panda", seed, attached=held)) or []
    ]
    assert ("solid", "part") in {(fault["kind"], fault.get("body")) for fault in found}


def test_a_distance_that_is_too_large_is_seen(
    arms: dict[str, tuple[Reference, bytes | None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    clearance = Checker.clearance

    def more(self: Checker, q: Array) -> tuple[float, tuple[str, str] | None]:
        distance, pair = clearance(self, q)
        return distance + 2e-3, pair

    monkeypatch.setattr(Checker, "clearance", more)
    found = [f for seed in range(4) for f in look(arms["ur5"], request("ur5", seed)) or []]
    assert {fault["kind"] for fault in found} == {"distance"}
    assert all(fault["distance"] < fault["proved"] for fault in found)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"tcp": {"object": "part", "pose": {"position": [0, 0, 0]}}}, "tool"),
        ({"scene": {"moveit": "name: x"}}, "MoveIt"),
        ({"collisions": "ignore"}, "collisions"),
        ({"stages": [{"kind": "for_each", "stages": [{"kind": "move", "tool": "t"}]}]}, "tool"),
    ],
)
def test_forms_that_are_not_read_are_told(
    arms: dict[str, tuple[Reference, bytes | None]], changes: dict[str, Any], reason: str
) -> None:
    asked = request("panda", 0) | changes
    content = json.dumps({"request": asked, "answer": {"verified": True}}).encode()
    assert reason in audit(arms["panda"][0], None, content, (None, None))


@pytest.fixture(scope="module")
def task_answer(arms: dict[str, tuple[Reference, bytes | None]]) -> tuple[Any, Any]:
    """The task of the API's example, and its answer."""
    asked: Any = TaskRequest.model_json_schema()["examples"][0] | {"improve": 0.0}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(current._Current, "deadline", Deadline.after(120.0))
        planned = plan_sequence(arms["panda"][0], None, json.dumps(asked).encode())
    assert isinstance(planned, bytes)
    return asked, json.loads(planned)


def look_at_task(arms: dict[str, tuple[Reference, bytes | None]], asked: Any, told: Any) -> Any:
    content = json.dumps({"request": asked, "answer": told}).encode()
    return audit(arms["panda"][0], None, content, (None, None))


def test_other_code_agrees_with_the_stages_of_a_task(
    arms: dict[str, tuple[Reference, bytes | None]], task_answer: tuple[Any, Any]
) -> None:
    assert any(stage["after"]["attached"] for stage in task_answer[1]["stages"])
    assert look_at_task(arms, *task_answer) == []


def test_an_object_that_is_taken_up_elsewhere_is_seen(
    arms: dict[str, tuple[Reference, bytes | None]], task_answer: tuple[Any, Any]
) -> None:
    asked, told = task_answer
    wrong = json.loads(json.dumps(told))
    for stage in wrong["stages"]:
        for item in stage["after"]["attached"]:
            item["pose"]["position"][0] += 5e-3
    found = look_at_task(arms, asked, wrong)
    assert "object" in {fault["kind"] for fault in found}


def test_links_are_looked_at_once_while_fingers_stay(
    arms: dict[str, tuple[Reference, bytes | None]],
    task_answer: tuple[Any, Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A lost piece is seen as often as fingers change, not in each stage."""
    honest = worker_cache.robot(arms["panda"][0])
    wrong = PreparedRobot.of(without_a_piece(honest.geometry), honest.answer)
    monkeypatch.setattr(worker_cache, "robot", lambda reference: wrong)
    found = look_at_task(arms, *task_answer)
    lost = [fault["stage"] for fault in found if fault["kind"] == "solid"]
    assert 1 <= len(lost) <= 3
    assert lost[0] == 0


@pytest.mark.parametrize("file", ["forearm.dae", "wrist1.dae"])
def test_collada_meshes_are_read_in_their_unit(file: str) -> None:
    """As assimp reads them."""
    path = data(f"ur_description/meshes/ur5/visual/{file}")
    text = f"""<robot name="r"><link name="a"><collision><geometry><mesh filename="package://m/{file}"/>
</geometry></collision></link></robot>"""
    meshes = {f"m/{file}": base64.b64encode(path.read_bytes()).decode()}
    read = read_robot({"urdf": text, "meshes": meshes})
    own = read.parts["a"][0].vertices
    theirs = np.array(coal.MeshLoader().load(str(path), np.ones(3)).vertices())
    np.testing.assert_allclose(own.min(axis=0), theirs.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(own.max(axis=0), theirs.max(axis=0), atol=1e-6)


def test_a_cloud_without_what_is_near_an_object_is_not_read() -> None:
    cloud = {"type": "point_cloud", "points": [[0.5, 0.0, 0.2]], "radius": 0.01}
    assert len(shape_parts(cloud, np.eye(4))) == 1
    with pytest.raises(Unread, match="near an object"):
        shape_parts(cloud | {"except": [{"object": "part", "margin": 0.01}]}, np.eye(4))

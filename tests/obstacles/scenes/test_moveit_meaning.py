"""Planning scenes drawn at random mean what MoveIt takes them for.

The judge is written from MoveIt's own source (repository moveit/moveit, folder moveit_core):
``Transforms::setTransform`` (transforms/src/transforms.cpp), ``PlanningScene::getFrameTransform``,
``poseMsgToEigen``, ``shapesAndPosesFromCollisionObjectMessage`` and ``processCollisionObjectAdd``
(planning_scene/src/planning_scene.cpp), ``AllowedCollisionMatrix``
(collision_detection/src/collision_matrix.cpp); names and defaults of fields are those of
moveit/moveit_msgs, msg/*.msg.
"""

import copy
import json
import re
from itertools import combinations
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import ArmwrightError
from kinematics.robots import builtin_chain
from obstacles.scenes import moveit
from obstacles.scenes.moveit import scene_from_moveit
from obstacles.scenes.placement import place
from obstacles.scenes.scene import Scene

CHAIN = builtin_chain("panda")
ROOT = "panda_link0"
LINKS = tuple(CHAIN.index)
DIMENSIONS = {1: 3, 2: 1, 3: 2, 4: 2}
NAMES = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}


class RefusedByMoveItError(Exception):
    """MoveIt would leave an object out."""


# ---------------------------------------------------------------------------------- the judge


def matrix(pose: dict[str, Any]) -> Array:
    """``poseMsgToEigen``: an empty quaternion is no rotation, another one is normalised."""
    T = np.eye(4)
    p, q = pose.get("position", {}), pose.get("orientation", {})
    T[:3, 3] = [p.get(axis, 0.0) for axis in "xyz"]
    xyzw = np.array([q.get(axis, 0.0) for axis in "xyzw"])
    if xyzw.any():
        T[:3, :3] = Rotation.from_quat(xyzw / np.linalg.norm(xyzw)).as_matrix()
    return T


def judge(message: dict[str, Any]) -> dict[str, list[tuple[int, tuple[float, ...], Array]]]:
    """Solids of each object in the planning frame: type, dimensions, pose."""
    fixed = {}
    for entry in message.get("fixed_frame_transforms", ()):
        frame = entry["header"]["frame_id"]
        if entry["child_frame_id"] == ROOT and frame:
            pose = entry["transform"]
            fixed[frame] = matrix(
                {"position": pose["translation"], "orientation": pose["rotation"]}
            )
    objects: dict[str, Array] = {}
    subframes: dict[str, Array] = {}
    world: dict[str, list[tuple[int, tuple[float, ...], Array]]] = {}
    items = message["world"]["collision_objects"]
    removed = {item["id"] for item in items if item.get("operation") == 1}  # at the end, if any
    for item in items:
        name, frame = item["id"], item["header"]["frame_id"].removeprefix("/")
        if name in removed:
            continue
        known = [{ROOT: np.eye(4)}, objects, subframes, fixed]
        T_frame = next((frames[frame] for frames in known if frame in frames), None)
        if T_frame is None:
            raise RefusedByMoveItError(frame)
        T = T_frame @ matrix(item.get("pose", {}))
        objects[name] = T
        given = item["primitive_poses"]
        poses = [matrix(given[k] if k < len(given) else {}) for k in range(len(item["primitives"]))]
        # Where an object of one solid has no pose, the object has that of the solid.
        is_empty = not any(np.any(list(part.values())) for part in item.get("pose", {}).values())
        if is_empty and len(poses) == 1:
            objects[name] = T @ poses[0]
        world[name] = [
            (solid["type"], tuple(solid["dimensions"]), T @ pose)
            for solid, pose in zip(item["primitives"], poses, strict=True)
        ]
        subframe_poses = zip(
            item.get("subframe_names", ()), item.get("subframe_poses", ()), strict=True
        )
        subframes |= {f"{name}/{s}": objects[name] @ matrix(pose) for s, pose in subframe_poses}
    return world


def may_touch(message: dict[str, Any], a: str, b: str) -> bool:
    """``getAllowedCollision`` of the matrix that the message makes."""
    acm = message.get("allowed_collision_matrix", {})
    names, rows = acm.get("entry_names", []), acm.get("entry_values", [])
    defaults = dict(
        zip(acm.get("default_entry_names", []), acm.get("default_entry_values", []), strict=True)
    )
    if a in names and b in names:
        i, j = sorted((names.index(a), names.index(b)))
        return bool(rows[i]["enabled"][j])
    given = [defaults[name] for name in (a, b) if name in defaults]
    return bool(given) and all(given)


# ------------------------------------------------------------------------------ the messages


def drawn_pose(random: Random, *, empty: float = 0.1) -> dict[str, Any]:
    """A pose as messages have it, with parts left out, and orientations of any length."""
    if random.random() < empty:
        return {}
    position = {axis: round(random.uniform(-1, 1), 3) for axis in "xyz" if random.random() < 0.9}
    kind = random.random()
    if kind < 0.15:
        return {"position": position}
    if kind < 0.3:
        return {"position": position, "orientation": dict.fromkeys("xyzw", 0.0)}
    xyzw = np.array([random.gauss(0, 1) for _ in range(4)])
    xyzw *= random.choice([1.0, 1.0, 0.9, 2.0]) / np.linalg.norm(xyzw)
    orientation = dict(zip("xyzw", xyzw.round(random.choice([3, 9, 15])).tolist(), strict=True))
    return {"position": position, "orientation": orientation}


def drawn_message(random: Random) -> dict[str, Any]:
    """A planning scene."""
    frames = random.sample(["world", "tray", "camera_link", "zed_left"], random.randrange(4))
    transforms = []
    for frame in [ROOT, *frames]:
        pose = drawn_pose(random, empty=0.0) if frame != ROOT else {}
        turn = pose.get("orientation", {})
        if not any(turn.values()):
            turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
        header, child = (frame, ROOT) if random.random() < 0.93 else (ROOT, frame)
        transforms.append(
            {
                "header": {"seq": 0, "stamp": {"secs": 0, "nsecs": 0}, "frame_id": header},
                "child_frame_id": child,
                "transform": {"translation": pose.get("position", {}), "rotation": turn},
            }
        )
    random.shuffle(transforms)
    names = [f"thing_{i}" for i in range(random.randrange(1, 6))]
    objects = [drawn_object(random, names[:i], names[i], frames) for i in range(len(names))]
    if random.random() < 0.2:
        gone = {"header": {"frame_id": ROOT}, "id": names[-1], "operation": 1}
        objects.append(gone)
    return {
        "name": "cell",
        "robot_state": {"joint_state": {"name": ["panda_joint1"], "position": [0.3]}},
        "robot_model_name": "panda",
        "fixed_frame_transforms": transforms,
        "allowed_collision_matrix": drawn_matrix(random, names),
        "link_padding": [{"link_name": "panda_hand", "padding": 0.0}],
        "link_scale": [{"link_name": "panda_hand", "scale": 1.0}],
        "object_colors": [],
        "world": {"collision_objects": objects, "octomap": {"octomap": {"data": []}}},
        "is_diff": False,
    }


def drawn_object(
    random: Random, earlier: list[str], name: str, frames: list[str]
) -> dict[str, Any]:
    """A collision object in the planning frame, in a fixed one or in an earlier object's."""
    frame = random.choice([ROOT, ROOT, f"/{ROOT}", *frames, *earlier])
    if earlier and random.random() < 0.1:
        frame = f"{random.choice(earlier)}/handle"
    kinds = [random.choice(list(DIMENSIONS)) for _ in range(random.choice([1, 1, 2, 3]))]
    item: dict[str, Any] = {
        "header": {"frame_id": frame},
        "id": name,
        "primitives": [
            {
                "type": kind,
                "dimensions": [
                    round(random.uniform(0.02, 0.3), 3) for _ in range(DIMENSIONS[kind])
                ],
            }
            for kind in kinds
        ],
        "primitive_poses": [drawn_pose(random) for _ in kinds],
        "subframe_names": ["handle"],
        "subframe_poses": [drawn_pose(random)],
        "operation": random.choice([0, 0, 0, 2]),
    }
    if random.random() < 0.7:
        item["pose"] = drawn_pose(random, empty=0.3)
    if random.random() < 0.2:
        item["primitive_poses"].pop()
    return item


def drawn_matrix(random: Random, names: list[str]) -> dict[str, Any]:
    """A symmetric matrix of some names, and defaults of some."""
    pool = [*names, *LINKS[:6], "gone"]
    chosen = random.sample(pool, random.randrange(len(pool)))
    size = len(chosen)
    rows = np.array([[random.random() < 0.4 for _ in range(size)] for _ in range(size)], dtype=bool)
    rows = rows | rows.T
    defaults = random.sample(pool, random.randrange(3))
    return {
        "entry_names": chosen,
        "entry_values": [{"enabled": row.tolist()} for row in rows.reshape(size, size)],
        "default_entry_names": defaults,
        "default_entry_values": [random.random() < 0.6 for _ in defaults],
    }


def listed(node: Any) -> Any:
    """A message whose vectors and quaternions are lists, where they have all their numbers."""
    if isinstance(node, list):
        return [listed(item) for item in node]
    if not isinstance(node, dict):
        return node
    if set(node) in ({*"xyz"}, {*"xyzw"}):
        return [node[axis] for axis in "xyzw"[: len(node)]]
    return {key: listed(value) for key, value in node.items()}


def written(message: dict[str, Any], random: Random) -> str:
    """The text of a message as one of the tools writes it."""
    form = copy.deepcopy(message)
    if random.random() < 0.3:
        form = listed(form)
    if random.random() < 0.3:
        for item in form["world"]["collision_objects"]:
            for solid in item.get("primitives", ()):
                solid["type"] = NAMES[solid["type"]]
    if random.random() < 0.3:  # a byte, as ROS 2 writes it
        for item in form["world"]["collision_objects"]:
            item["operation"] = chr(item.get("operation", 0))
    if random.random() < 0.3:
        for key in ("link_padding", "link_scale", "object_colors", "robot_state", "is_diff"):
            del form[key]
    if random.random() < 0.3:  # equal parts are written once, and repeated by aliases
        shared: dict[str, Any] = {}
        for item in form["world"]["collision_objects"]:
            header = item["header"]
            item["header"] = shared.setdefault(header["frame_id"], header)
    if random.random() < 0.2:
        form = {"scene": form}
    if random.random() < 0.15:
        return json.dumps(form)
    text = yaml.safe_dump(
        form, sort_keys=random.random() < 0.5, default_flow_style=random.choice([None, False])
    )
    return text + random.choice(["", "---\n", "---\n---\n"])


# ------------------------------------------------------------------------------- comparison


def solids_of(scene: Scene) -> dict[str, list[tuple[str, tuple[float, ...], Array]]]:
    """Solids of each obstacle: type, sizes in the order of the message, pose."""
    found: dict[str, list[tuple[str, tuple[float, ...], Array]]] = {}
    for obstacle in scene.obstacles:
        for solid in obstacle.solids():
            kind = type(solid.shape).__name__.lower()
            x, y, z = solid.shape.measures()
            sizes = {"box": (x, y, z), "sphere": (x,)}.get(kind, (y, x))
            part = kind, sizes, solid.T_world_obstacle
            found.setdefault(obstacle.id, []).append(part)
    return found


def compare(message: dict[str, Any], text: str) -> None:
    """See that a text has the objects and the pairs of a message."""
    try:
        expected = judge(message)
    except RefusedByMoveItError:
        with pytest.raises(ArmwrightError):
            place(scene_from_moveit(text), CHAIN)
        return
    scene = place(scene_from_moveit(text), CHAIN)
    found = solids_of(scene)
    assert set(found) == set(expected)
    for name, solids in expected.items():
        for (kind, sizes, T), (own_kind, own_sizes, own_T) in zip(solids, found[name], strict=True):
            assert (NAMES[kind], sizes) == (own_kind, own_sizes)
            np.testing.assert_allclose(own_T, T, atol=1e-12)
    for a, b in combinations([*LINKS, *found], 2):
        assert scene.allows(a, b) == may_touch(message, a, b), (a, b)


@pytest.mark.parametrize("seed", range(60))
def test_a_scene_is_where_moveit_puts_it(seed: int) -> None:
    random = Random(seed)
    message = drawn_message(random)
    compare(message, written(message, random))


def test_each_field_that_is_known_is_in_the_table_of_the_documentation() -> None:
    page = (Path(__file__).parents[3] / "docs" / "moveit_files.md").read_text("utf-8")
    fields = {*moveit._SCENE_FIELDS, *moveit._STATE_FIELDS, *moveit._WORLD_FIELDS}
    fields |= {*moveit._OBJECT_FIELDS}
    for name in fields - {"header"}:
        assert re.search(rf"\b{name}\b", page), name

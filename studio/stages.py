"""Stages of tasks as the editor makes them: new ones, picks and places, and the goal's frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright_client import Obstacle, Pose
from studio.pose import rotation
from studio.state import Entries, StudioState

#: Least and most way of an approach, a retreat and a lift [m].
_WAY = [0.03, 0.1]
#: Fields that a new stage needs, by its kind.
_NEW: dict[str, dict[str, Any]] = {
    "approach": {"distance": _WAY},
    "retreat": {"distance": _WAY},
    "lift": {"distance": _WAY},
    "wait": {"duration": 1.0},
}
_WHOLE_TURN = [0.0, 6.283185307179586]


def new_stage(kind: str, state: StudioState) -> dict[str, Any]:
    """A stage of a kind with the fields that it needs.

    Args:
        kind: Kind of the stage.
        state: State of the studio; its last obstacle is the object of a grasp.
    """
    stage = {"kind": kind, **_NEW.get(kind, {})}
    if kind in ("grasp", "attach") and state.obstacles:
        stage["object"] = state.obstacles[-1].id
    return stage


def pick_stages(
    obstacle: Obstacle, touch_links: Sequence[str], grasps: str | None = None
) -> Entries:
    """The stages that pick an object from above, the tool turned about the vertical as it fits.

    Args:
        obstacle: The object.
        touch_links: Links that may touch it.
        grasps: Kind of grasps that follow from the object's shape, "top" or "suction", with a tool;
            None for the robot's own gripper.
    """
    if grasps is not None:
        closes = {"kind": "close"} | ({"until": "contact"} if grasps == "top" else {})
        by_shape = {"grasps": {grasps: {}}, "touch_links": [*touch_links]}
        return (
            {"kind": "move"},
            {"kind": "approach", "distance": _WAY},
            {"kind": "grasp", "object": obstacle.id, **by_shape},
            closes,
            {"kind": "attach", "object": obstacle.id},
            {"kind": "lift", "distance": _WAY},
        )
    down = {"position": [0.0, 0.0, 0.0], "rpy": [np.pi, 0.0, 0.0]}
    grasp = {
        "kind": "grasp",
        "object": obstacle.id,
        "region": {"pose": down, "angles": _WHOLE_TURN},
        "touch_links": [*touch_links],
    }
    return (
        {"kind": "open"},
        {"kind": "move"},
        {"kind": "approach", "distance": _WAY},
        grasp,
        {"kind": "close"},
        {"kind": "attach", "object": obstacle.id},
        {"kind": "lift", "distance": _WAY},
    )


def place_stages(obstacle: Obstacle, tip: Pose) -> Entries:
    """The stages that put an object where the goal's frame is, as upright as it now stands.

    Args:
        obstacle: The object.
        tip: The goal, in the root frame.
    """
    region = {"pose": _pose(tip.position, rotation(obstacle.pose)), "angles": _WHOLE_TURN}
    return (
        {"kind": "move"},
        {"kind": "approach", "distance": _WAY, "direction": [0, 0, -1], "frame": "root"},
        {"kind": "place", "object": obstacle.id, "region": region},
        {"kind": "open"},
        {"kind": "detach", "object": obstacle.id},
        {"kind": "retreat", "distance": _WAY},
    )


def goal_entry(state: StudioState, tip: Pose) -> dict[str, Any]:
    """The goal of the studio as a goal of a tour.

    Args:
        state: State of the studio.
        tip: The goal, in the root frame.
    """
    return {"joints": [*state.goal_joints]} if state.goal_pose is None else pose_entry(tip)


def pose_entry(tip: Pose) -> dict[str, Any]:
    """The goal of the studio as a waypoint of a tool path.

    Args:
        tip: The goal, in the root frame.
    """
    return {"pose": _wire(tip)}


def aimed(stage: dict[str, Any], state: StudioState, tip: Pose) -> dict[str, Any]:
    """A stage at the goal: of a move, a grasp among others, or a place of the held object.

    Args:
        stage: The stage.
        state: State of the studio.
        tip: The goal, in the root frame.

    Raises:
        ValueError: The stage takes no pose, or names no obstacle.
    """
    if stage["kind"] == "move":
        joints = {"joints": [*state.goal_joints]}
        return stage | {"goal": joints if state.goal_pose is None else {"pose": _wire(tip)}}
    if stage["kind"] not in ("grasp", "place"):
        raise ValueError(f"a stage of kind {stage['kind']} goes to no pose: move, grasp, place do")
    if stage["kind"] == "place":
        named = (item for item in state.obstacles if item.id == stage.get("object"))
        standing = next(named, None)
        turn = rotation(tip if standing is None else standing.pose)
        rest = {name: item for name, item in stage.items() if name != "region"}
        return rest | {"poses": [*stage.get("poses", ()), _pose(tip.position, turn)]}
    found = [item for item in state.obstacles if item.id == stage.get("object")]
    if not found:
        raise ValueError("name the object of the grasp first: the id of an obstacle")
    inverse = rotation(found[0].pose).inv()
    offset = inverse.apply(np.array(tip.position) - np.array(found[0].pose.position))
    rest = {name: item for name, item in stage.items() if name != "region"}
    before = stage.get("grasps", ())  # found ones give way to those that are set
    listed = [*before] if isinstance(before, list | tuple) else []
    return rest | {"grasps": [*listed, _pose(offset, inverse * rotation(tip))]}


def _wire(pose: Pose) -> dict[str, Any]:
    return _pose(pose.position, rotation(pose))


def _pose(position: Any, turn: Any) -> dict[str, Any]:
    """A pose as requests have it."""
    return {
        "position": [round(float(value), 9) for value in position],
        "quaternion_xyzw": turn.as_quat().tolist(),
    }

"""The robot, its motion, single configurations and the tree of a planner, as a page draws them.

Bodies of a page: links, held objects and obstacles as triangles.
"""

import base64
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.forward import forward
from kinematics.model.chain import Chain, JointType, MimicJoint
from kinematics.trajectory.trajectory import Trajectory
from obstacles.convex.triangles import Triangles, join, piece_triangles
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.robots.visual_geometry import VisualBody, VisualGeometry, built_in_looks
from obstacles.scenes.scene import Obstacle, Scene
from planning.values.search_trees import WHOLE, Edge, Explored
from service.fields import picked
from service.viewer.curves import clearance_curve, nearest, tool_speed_curve, torque_curve

#: All triangles of a page together: with their text they stay below 8 of its 10 MB [byte].
_BUDGET = 5_500_000
#: Clouds of more points are drawn with every k-th point.
_MAX_BALLS = 4000


class Body(NamedTuple):
    """A body to be drawn.

    Args:
        name: Name of the link or obstacle.
        kind: "link", "visual" for what a link looks like, "held", "obstacle", or "moved" for what
            is carried by turns.
        joint: Index of the joint that carries it, -1 for what stands still.
        surface: Surface in the frame of that joint, or the root frame.
        simplified: Whether hulls stand for the triangles of its mesh, or it is thinned out.
        color: Red, green, blue, 0 to 1; None for the page's own.
    """

    name: str
    kind: str
    joint: int
    surface: Triangles
    simplified: bool = False
    color: tuple[float, float, float] | None = None


def bodies(robot: RobotGeometry, scene: Scene, moved: Sequence[Obstacle] = ()) -> list[Body]:
    """Links with what they hold, and obstacles; fine meshes by their hulls where too much.

    Args:
        robot: The robot with what it holds.
        scene: The obstacles.
        moved: Objects that are carried from one place to another, each in its own frame.
    """
    own = [replace(item, T_world_obstacle=np.eye(4)) for item in moved]
    drawn = [*_links(robot, covers=False), *(_obstacle(item) for item in scene.obstacles)]
    drawn += [_obstacle(item)._replace(kind="moved") for item in own]
    if sum(_size(body) for body in drawn) <= _BUDGET:
        return drawn
    return [
        *_links(robot, covers=True),
        *(_obstacle(item, covers=True) for item in scene.obstacles),
        *(_obstacle(item, covers=True)._replace(kind="moved") for item in own),
    ]


def visual_bodies(
    chain: Chain, looks: VisualGeometry, drawn: Sequence[Body]
) -> tuple[list[Body], bool]:
    """The visual geometry of links, if there is room for it beside what is drawn already.

    Args:
        chain: The robot.
        looks: Visual surfaces of the links, in their frames.
        drawn: All other bodies.

    Returns:
        The bodies, and whether they had to be left out.
    """
    made = [_visual(chain, body) for body in looks.bodies]
    fits = sum(_size(body) for body in (*drawn, *made)) <= _BUDGET
    return (made, False) if fits else ([], True)


def _visual(chain: Chain, body: VisualBody) -> Body:
    link = chain.link(body.link)
    T = link.T_joint_link
    vertices = body.surface.vertices @ T[:3, :3].T + T[:3, 3]
    surface = Triangles(vertices, body.surface.faces)
    color = None if body.color is None else body.color[:3]
    return Body(body.link, "visual", link.joint, surface, body.simplified, color)


def body_document(body: Body) -> dict[str, Any]:
    """A body as JSON: single-precision vertices and numbers of corners, little-endian, base64."""
    vertices, faces = body.surface
    kind = np.uint16 if len(vertices) < 2**16 else np.uint32
    return {
        **picked(body, "name", "kind", "joint", "simplified", "color"),
        "vertices": packed(vertices.astype("<f4")),
        "faces": packed(faces.astype(np.dtype(kind).newbyteorder("<"))),
        "wide": kind is np.uint32,
    }


def _links(robot: RobotGeometry, *, covers: bool) -> list[Body]:
    """One body for each link and joint, since side branches may move with several."""
    links = robot.chain.index
    parts: dict[tuple[str, int], list[int]] = {}
    for i, (name, joint) in enumerate(zip(robot.links, robot.joints, strict=True)):
        parts.setdefault((name, int(joint)), []).append(i)
    drawn = []
    for (name, joint), numbers in parts.items():
        pieces = [robot.pieces[i] for i in numbers]
        surface = join(piece_triangles(piece, covers=covers) for piece in pieces)
        simplified = covers and any(piece.surface is not None for piece in pieces)
        drawn.append(Body(name, "link" if name in links else "held", joint, surface, simplified))
    return drawn


def _obstacle(obstacle: Obstacle, *, covers: bool = False) -> Body:
    count = obstacle.count
    step = -(-count // _MAX_BALLS) if obstacle.is_cloud else 1
    pieces = [obstacle.piece(k) for k in range(0, count, step)]
    surface = join(
        piece_triangles(piece, covers=covers, coarse=obstacle.is_cloud) for piece in pieces
    )
    simplified = step > 1 or (covers and obstacle.is_mesh)
    return Body(obstacle.id, "obstacle", -1, surface, simplified)


def _size(body: Body) -> int:
    vertices, faces = body.surface
    return 12 * len(vertices) + (6 if len(vertices) < 2**16 else 12) * len(faces)


def packed(values: Array | Indices) -> str:
    """The numbers of an array, in Base64."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()


#: Two bodies in a sentence: 'hand' and 'table' overlap.
_PAIR = re.compile(r"'([^']+)' and '([^']+)'")


class Configuration(NamedTuple):
    """A configuration that a page shows by itself.

    Args:
        label: Label: "start", "IK solution 3".
        joints: Shape (n,) [rad or m].
        verdict: "valid", "rejected" or "asked".
        reason: Why it was rejected, or what else is to be said.
        pair: The two bodies that collide or come closest there, if that is known.
        cause: Cause of a rejection, which gives the colour: "collision", "limits" or "other".
    """

    label: str
    joints: Sequence[float]
    verdict: str
    reason: str = ""
    pair: Sequence[str] | None = None
    cause: str | None = None


class Carrier(NamedTuple):
    """A link that carries a moved object from a time on, or the ground.

    Args:
        begins: The time [s].
        joint: Index of the joint that carries it, -1 where it stands.
        T_joint_object: Pose of the object in the frame of the joint, shape (4, 4).
    """

    begins: float
    joint: int
    T_joint_object: Array


def carrier_document(carrier: Carrier) -> dict[str, Any]:
    """A carrier as JSON.

    Args:
        carrier: Carrier of an object.
    """
    return {
        "begins": carrier.begins,
        "joint": int(carrier.joint),
        "frame": _flat(carrier.T_joint_object),
    }


def rejected(label: str, joints: Sequence[float], reason: str) -> Configuration:
    """A configuration that was rejected, with the pair and the cause that its reason names.

    Args:
        label: Label of the body.
        joints: Shape (n,) [rad or m].
        reason: Reason in words, as the API answers it: bodies stand between quotes.
    """
    pair = _PAIR.search(reason)
    cause = "limits" if "outside" in reason else "collision" if pair else "other"
    names = None if pair is None else pair.groups()
    return Configuration(label, joints, "rejected", reason, names, cause)


def configuration_documents(
    robot: RobotGeometry, scene: Scene, items: Sequence[Configuration]
) -> list[dict[str, Any]]:
    """Configurations as JSON, each with its closest pair; what was asked for may collide.

    Args:
        robot: The robot with what it holds.
        scene: The obstacles.
        items: The configurations.
    """
    found = nearest(robot, scene, [item.joints for item in items])
    return [_with_pair(item, near) for item, near in zip(items, found, strict=True)]


def _with_pair(item: Configuration, near: dict[str, Any] | None) -> dict[str, Any]:
    if near is None or near["pair"] is None or near["distance"] is None:
        return item._asdict() | {"near": None}
    first, second = near["pair"]
    if item.verdict == "asked" and near["distance"] < 0.0:
        item = rejected(item.label, item.joints, f"'{first}' and '{second}' collide")
    return item._asdict() | {"pair": item.pair or near["pair"], "near": near}


def robot_document(
    robot: RobotGeometry,
    scene: Scene,
    moved: Sequence[Obstacle] = (),
    looks: VisualGeometry | None = None,
) -> dict[str, Any]:
    """Kinematics and bodies of a robot among obstacles.

    Args:
        robot: The robot with what it holds.
        scene: The obstacles.
        moved: Objects that are carried from one place to another.
        looks: Visual geometry of the links, drawn in place of their collision geometry; None for
            the looks of a built-in arm.
    """
    chain = robot.chain
    tip = chain.links[chain.index[chain.tip_link]]
    solid = bodies(robot, scene, moved)
    seen, left_out = visual_bodies(chain, looks or built_in_looks(chain), solid)
    drawn = [*solid, *seen]
    return {
        "robot": chain.name,
        "joints": _joints(chain),
        "offsets": [_flat(A) for A in chain.offsets],
        "followers": [_mimic_joint(mimic) for mimic in chain.mimic_joints],
        "tip": {"name": tip.name, "joint": tip.joint, "frame": _flat(tip.T_joint_link)},
        "bodies": [body_document(body) for body in drawn],
        "simplified": [body.name for body in solid if body.simplified],
        "visuals_left_out": left_out,
    }


def motion_document(
    motion: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    tool_speed: float | None,
    curves: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """A motion: its polynomials, and curves that are sampled here.

    Args:
        motion: The motion.
        robot: The robot with what it holds.
        scene: The obstacles.
        tool_speed: The limit of the tip's speed, if there is one [m/s].
        curves: Curves in place of those of this robot in this scene.
    """
    sampled = curves or {
        "torque": torque_curve(robot.chain, motion),
        "tool_speed": tool_speed_curve(robot.chain, motion) | {"limit": tool_speed},
        "clearance": clearance_curve(robot, scene, motion),
    }
    return {
        "breaks": motion.breaks.tolist(),
        "coefficients": motion.coefficients.tolist(),
        **sampled,
    }


def _mimic_joint(mimic: MimicJoint) -> dict[str, Any]:
    """A joint off the chain that mimics one of it, and the body before it."""
    return {
        **picked(mimic, "parent", "leader", "multiplier", "offset"),
        "slides": mimic.joint_type == JointType.PRISMATIC,
        "frame": _flat(mimic.T_parent_joint),
    }


def _joints(chain: Chain) -> list[dict[str, Any]]:
    limits = picked(chain.limits, "lower", "upper", "velocity", "acceleration", "jerk", "effort")
    return [
        {
            "name": name,
            "slides": bool(chain.joint_types[i] == JointType.PRISMATIC),
            **{quantity: _finite(values[i]) for quantity, values in limits.items()},
        }
        for i, name in enumerate(chain.joint_names)
    ]


def _flat(T: Array) -> list[float]:
    """A transform by columns, as WebGL has it."""
    return np.asarray(T).T.reshape(-1).tolist()


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


#: Straight pieces of a line: the tool moves on a curve while the joints move straight.
_PIECES = 3


def tree_document(chain: Chain, explored: Explored) -> dict[str, Any]:
    """The edges that a planner explored, as JSON.

    Args:
        chain: The robot.
        explored: Edges of the tree or roadmap.
    """
    parts = sorted({edge.part for edge in explored.edges}, reverse=True)
    return {
        **picked(explored, "planner", "runs"),
        "edges": len(explored.edges),
        "left_out": explored.left_out,
        "parts": [
            {"name": part, "points": _points(chain, [e for e in explored.edges if e.part == part])}
            for part in parts
        ],
    }


def tree_sentence(explored: Explored) -> str:
    """A sentence about the tree that is drawn.

    Args:
        explored: Tree or roadmap that was explored when the request was planned once more.
    """
    if explored.planner is None:
        return "No planner with a tree or a roadmap had its turn when this was planned once more."
    kind = "edges" if any(e.part == WHOLE for e in explored.edges) else "edges of two trees"
    run = "" if explored.runs == 1 else f", in run {explored.runs}"
    words = f"{explored.planner} explored {len(explored.edges) + explored.left_out} {kind}{run}"
    drawn = f"; the first {len(explored.edges)} are drawn" if explored.left_out else ""
    return f"Planned once more, {words}{drawn}."


def _points(chain: Chain, edges: list[Edge]) -> str:
    """Positions of the tip along edges, shape (k, pieces + 1, 3), float32 in base64."""
    begins, ends = (np.array([edge[k] for edge in edges], dtype=float) for k in (0, 1))
    shares = np.linspace(0.0, 1.0, _PIECES + 1)[:, None]
    rows: Array = begins[:, None] + shares * (ends - begins)[:, None]
    at = forward(chain, rows)[..., :3, 3]
    return base64.b64encode(np.ascontiguousarray(at, dtype="<f4").tobytes()).decode()

"""Bodies of a page: links, held objects and obstacles as triangles."""

import base64
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain
from obstacles.convex.triangles import Triangles, join, piece_triangles
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.robots.visual_geometry import VisualBody, VisualGeometry
from obstacles.scenes.scene import Obstacle, Scene
from service.fields import picked

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

"""Second look at a certified motion: frames, solids and distances, by other code.

Where they agree, the frames of all links at drawn instants are those of the description, every
corner of a solid as it was sent lies within the pieces that were proved free of collision, and no
distance that FCL finds between the triangles is below what the proof has for it.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from kinematics.forward import link_poses
from obstacles.collision.checker import Checker
from obstacles.convex.piece import Piece, PieceKind
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from service.audit.bodies import Array, Part, Robot, distance

#: Rounding that no verdict hangs on: of frames, and of meshes in single precision [m].
_FRAME, _SOLID = 1e-7, 2e-5
#: Frames compared by points this far from their origins [m].
_ARM = 1.0
#: States among which the tightest is looked at, and how many more are drawn.
_SCANNED, _DRAWN = 64, 4
#: Corners of a solid that are looked at.
_CORNERS = 500


class Motion(NamedTuple):
    """A motion as an answer or a request gives it.

    Args:
        joints: Names of the joints, n.
        begins: Begin of each segment, shape (s,) [s].
        duration: End of the last one [s].
        coefficients: Of each segment, each joint's from the constant on [rad or m].
    """

    joints: tuple[str, ...]
    begins: Array
    duration: float
    coefficients: tuple[tuple[Array, ...], ...]

    def at(self, time: float) -> Array:
        """The configuration at a time [s], shape (n,) [rad or m]."""
        k = max(int(np.searchsorted(self.begins, time, side="right")) - 1, 0)
        since = time - self.begins[k]
        return np.array([np.polyval(row[::-1], since) for row in self.coefficients[k]])


class Cell(NamedTuple):
    """What was proved, and the same as it was sent.

    Args:
        robot: The robot with what it holds, as it was proved.
        scene: The scene, as it was proved.
        sent: The robot as its document describes it.
        tree: Link whose frame is the root frame.
        fingers: Positions of joints off the chain [rad or m].
        obstacles: Obstacles as they were sent, in the root frame.
        held: Links that hold objects, with the object's parts in their frame, by name.
        allowed: Pairs that were not kept apart.
        margin: Distance to be kept from obstacles beyond their own margins [m].
        margins: Distance to be kept from each obstacle, both together [m].
    """

    robot: RobotGeometry
    scene: Scene
    sent: Robot
    tree: str
    fingers: Mapping[str, float]
    obstacles: Mapping[str, list[Part]]
    held: Mapping[str, tuple[str, list[Part]]]
    allowed: frozenset[tuple[str, str]]
    margin: float
    margins: Mapping[str, float]


class _Placed(NamedTuple):
    name: str
    part: Part
    T: Array


def look(
    cell: Cell, motion: Motion, seed: int, *, are_links_known: bool = False
) -> list[dict[str, Any]]:
    """Disagreements on a certified motion, none where all is well.

    Args:
        cell: The robot and its surroundings.
        motion: The motion.
        seed: Seed of the instants that are drawn.
        are_links_known: Whether the solids of the robot's links were looked at before.
    """
    checker = Checker.of(cell.robot, cell.scene, cell.margin)
    times = np.linspace(0.0, motion.duration, _SCANNED)
    states = np.array([motion.at(time) for time in times])
    _, tightest, _ = checker.closest(states, np.inf)
    drawn = np.random.default_rng(seed).uniform(0.0, motion.duration, _DRAWN)
    faults = _solids(cell, () if are_links_known else cell.sent.parts)
    for time in (times[max(tightest, 0)], *drawn):
        faults += _at(cell, checker, motion.joints, motion.at(float(time)), float(time))
    return faults


def _at(
    cell: Cell, checker: Checker, joints: tuple[str, ...], q: Array, time: float
) -> list[dict[str, Any]]:
    """Disagreements at an instant."""
    positions = {**cell.fingers, **dict(zip(joints, q.tolist(), strict=True))}
    frames = cell.sent.frames(positions, cell.tree)
    chain = cell.robot.chain
    faults: list[dict[str, Any]] = []
    for link, T in zip(chain.links, link_poses(chain, q), strict=True):
        if link.name in frames:
            moved = T - frames[link.name]
            off = np.linalg.norm(moved[:3, 3]) + _ARM * np.linalg.norm(moved[:3, :3])
            if off > _FRAME:
                faults.append({"kind": "frame", "link": link.name, "time": time, "by": float(off)})
    proved, pair = checker.clearance(q)
    reach = max(proved, 0.0) if np.isfinite(proved) else 0.0
    for names, apart, needed in _distances(cell, frames, reach):
        if apart < needed - _SOLID:
            faults.append({
                "kind": "distance", "pair": list(names), "time": time, "distance": apart,
                "proved": float(proved), "proved_pair": None if pair is None else list(pair),
            })  # fmt: skip
    return faults


def _distances(
    cell: Cell, frames: Mapping[str, Array], reach: float
) -> list[tuple[tuple[str, str], float, float]]:
    """Distances of pairs that may be nearer than a reach, margins taken off, and needed ones [m].

    What stands still only has to be apart: no margin is kept from obstacles there, and the proof's
    distances are those of what moves.
    """
    links = cell.robot.chain.links
    fixed = {link.name for link in links if link.joint < 0} | set(cell.obstacles)
    robot = [
        _Placed(name, part, frames[name])
        for name, parts in cell.sent.parts.items()
        for part in parts
    ]
    robot += [
        _Placed(name, part, frames[link])
        for name, (link, parts) in cell.held.items()
        for part in parts
    ]
    eye = np.eye(4)
    others = [_Placed(name, part, eye) for name, parts in cell.obstacles.items() for part in parts]
    everything = robot + others
    centers = np.array([item.T[:3, :3] @ item.part.center + item.T[:3, 3] for item in everything])
    radii = np.array([item.part.radius for item in everything])
    margins = np.array([cell.margins.get(item.name, 0.0) for item in everything])
    found = []
    for i, one in enumerate(robot):
        gaps = np.linalg.norm(centers[i + 1 :] - centers[i], axis=1) - radii[i + 1 :] - radii[i]
        for k in np.flatnonzero(gaps - margins[i + 1 :] < reach + _SOLID) + i + 1:
            two = everything[k]
            names = (min(one.name, two.name), max(one.name, two.name))
            if one.name != two.name and names not in cell.allowed:
                apart, is_still = distance(one.part, one.T, two.part, two.T), set(names) <= fixed
                needed, margin = (0.0, 0.0) if is_still else (reach, float(margins[k]))
                found.append((names, apart - margin, needed))
    return found


def _solids(cell: Cell, links: Iterable[str]) -> list[dict[str, Any]]:
    """Bodies, of the robot's links these, whose corners lie outside of their pieces."""
    chain = cell.robot.chain
    proved: dict[str, list[Piece]] = {}
    for name, piece in zip(cell.robot.links, cell.robot.pieces, strict=True):
        proved.setdefault(name, []).append(piece)
    faults = []
    for name in links:
        if name not in chain.index or (name not in proved and name in cell.robot.unseen):
            continue
        T = chain.link(name).T_joint_link
        faults += _outside(name, cell.sent.parts[name], T, proved.get(name, []))
    for name, (link, parts) in cell.held.items():
        faults += _outside(name, parts, chain.link(link).T_joint_link, proved.get(name, []))
    for obstacle in cell.scene.obstacles:
        if obstacle.id in cell.obstacles:
            faults += _outside(
                obstacle.id, cell.obstacles[obstacle.id], np.eye(4), obstacle.pieces()
            )
    return faults


def _outside(name: str, parts: list[Part], T: Array, pieces: Any) -> list[dict[str, Any]]:
    """The body's farthest corner outside of all its pieces, if there is one."""
    corners = np.concatenate([part.vertices for part in parts])
    if len(corners) > _CORNERS:
        corners = corners[np.random.default_rng(0).choice(len(corners), _CORNERS, replace=False)]
    corners = corners @ T[:3, :3].T + T[:3, 3]
    out = np.full(len(corners), np.inf)
    for piece in pieces:
        out = np.minimum(out, _beyond(piece, corners))
    worst = int(out.argmax())
    if out[worst] <= _SOLID:
        return []
    return [
        {"kind": "solid", "body": name, "point": corners[worst].tolist(), "by": float(out[worst])}
    ]


def _beyond(piece: Piece, points: Array) -> Array:
    """How far points (m, 3) are outside of a piece at least, 0 or less for those inside [m]."""
    T = piece.T_owner_piece
    local = (points - T[:3, 3]) @ T[:3, :3]
    if piece.kind == PieceKind.HALFSPACE:
        return local[:, 2] - piece.offset_radius
    if piece.kind == PieceKind.POLYTOPE:
        return _beyond_polytope(piece.vertices, local) - piece.offset_radius
    radius = np.full(len(local), piece.radius)
    if piece.kind == PieceKind.CONE:
        radius *= np.clip(0.5 - 0.5 * local[:, 2] / piece.half_height, 0.0, 1.0)
    aside = np.hypot(local[:, 0], local[:, 1]) - radius
    out: Array = np.maximum(aside, np.abs(local[:, 2]) - piece.half_height) - piece.offset_radius
    return out


def _beyond_polytope(vertices: Array, points: Array) -> Array:
    try:
        planes = ConvexHull(vertices).equations if len(vertices) > 3 else None
    except QhullError:
        planes = None
    if planes is not None:
        out: Array = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        return out
    a, b = vertices[0], vertices[-1]  # a point or a segment, that a ball is added to
    along = b - a
    share = np.clip((points - a) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - share[:, None] * along, axis=1))

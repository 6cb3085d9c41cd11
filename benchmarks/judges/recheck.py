"""An independent look at trajectories: dense samples, FCL on the meshes, nothing of Armwright.

Robot kinematics by pinocchio, meshes by trimesh, the scene straight from its YAML text.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fcl
import numpy as np
import pinocchio
import trimesh
import yaml
from numpy.typing import NDArray

#: Largest joint change between two samples [rad].
STEP = 1e-3

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scenery:
    """The obstacles with their names, and FCL's tree of their boxes."""

    objects: list[tuple[str, Any]]
    manager: Any


@dataclass(frozen=True)
class Finding:
    """What a dense look at a motion found."""

    colliding: tuple[str, str] | None
    limit_ratio: float
    samples: int

    @property
    def clean(self) -> bool:
        """Whether nothing collides and no limit is exceeded."""
        return self.colliding is None and self.limit_ratio <= 1.0 + 1e-9


class Recheck:
    """A URDF robot with its SRDF in MoveIt scenes.

    Args:
        folder: Folder of the robot.
        acceleration: Limits of the joints, shape (n,) [rad/s^2].
    """

    def __init__(self, folder: Path, acceleration: Sequence[float]) -> None:
        self._acceleration = np.array(acceleration)
        urdf = (folder / "panda.urdf").read_text()
        self.model = pinocchio.buildModelFromXML(urdf)
        self.data = self.model.createData()
        self.bodies: list[tuple[str, int, Array, Any]] = []
        self._load(urdf, folder)
        disabled = _disabled_pairs(folder / "panda.srdf")
        names = [body[0] for body in self.bodies]
        self.pairs = [
            (i, j)
            for i in range(len(names))
            for j in range(i)
            if frozenset((names[i], names[j])) not in disabled
        ]

    def _load(self, urdf: str, folder: Path) -> None:
        for link in ElementTree.fromstring(urdf).findall("link"):
            for collision in link.findall("collision"):
                mesh = collision.find("geometry/mesh")
                if mesh is None:
                    continue
                path = folder / mesh.attrib["filename"].removeprefix("package://")
                hull = trimesh.load(path, force="mesh").convex_hull
                faces = np.column_stack([np.full(len(hull.faces), 3), hull.faces]).ravel()
                convex = fcl.Convex(np.array(hull.vertices), len(hull.faces), faces)
                origin = collision.find("origin")
                T = np.eye(4)
                if origin is not None:
                    rpy = [float(x) for x in origin.attrib.get("rpy", "0 0 0").split()]
                    T[:3, :3] = pinocchio.rpy.rpyToMatrix(*rpy)
                    T[:3, 3] = [float(x) for x in origin.attrib.get("xyz", "0 0 0").split()]
                frame = self.model.getFrameId(link.attrib["name"])
                self.bodies.append((link.attrib["name"], frame, T, fcl.CollisionObject(convex)))

    def scene(self, text: str) -> Scenery:
        """Collision objects of a MoveIt planning scene."""
        objects = []
        for entry in yaml.safe_load(text)["world"]["collision_objects"]:
            for shape, pose in zip(entry["primitives"], entry["primitive_poses"], strict=True):
                d = shape["dimensions"]
                solid = fcl.Box(*d) if shape["type"] == "box" else fcl.Cylinder(d[1], d[0])
                x, y, z, w = pose["orientation"]
                rotation = pinocchio.Quaternion(w, x, y, z).normalized().matrix()
                placed = fcl.Transform(rotation, np.array(pose["position"], dtype=float))
                objects.append((entry["id"], fcl.CollisionObject(solid, placed)))
        manager = fcl.DynamicAABBTreeCollisionManager()
        manager.registerObjects([thing for _, thing in objects])
        manager.setup()
        return Scenery(objects, manager)

    def collision(self, q: Array, scene: Scenery) -> tuple[str, str] | None:
        """The first colliding pair at q, or None."""
        pinocchio.framesForwardKinematics(self.model, self.data, q)
        for _, frame, T, body in self.bodies:
            M = self.data.oMf[frame].homogeneous @ T
            body.setTransform(fcl.Transform(M[:3, :3], M[:3, 3]))
        for name, _, _, body in self.bodies:
            if name != "panda_link0":
                hit = fcl.CollisionData()
                scene.manager.collide(body, hit, fcl.defaultCollisionCallback)
                if hit.result.is_collision:
                    return name, self._first_hit(body, scene)
        request = fcl.CollisionRequest()
        for i, j in self.pairs:
            (name, _, _, body), (other, _, _, second) = self.bodies[i], self.bodies[j]
            if fcl.collide(body, second, request, fcl.CollisionResult()):
                return name, other
        return None

    @staticmethod
    def _first_hit(body: Any, scene: "Scenery") -> str:
        request = fcl.CollisionRequest()
        hits = (
            name
            for name, thing in scene.objects
            if fcl.collide(body, thing, request, fcl.CollisionResult())
        )
        return next(hits, "the scene")

    def motion(self, breaks: Array, coefficients: Array, scene: Scenery) -> Finding:
        """Look at a piecewise polynomial motion every milliradian."""
        worst, colliding, samples = 0.0, None, 0
        lower, upper = self.model.lowerPositionLimit, self.model.upperPositionLimit
        velocity = self.model.velocityLimit
        last = None
        for k in range(len(breaks) - 1):
            length = breaks[k + 1] - breaks[k]
            if length <= 0.0:
                continue
            c = coefficients[k].T  # power, joint
            powers = np.arange(len(c))
            first, second = c[1:] * powers[1:, None], c[2:] * (powers[2:] * powers[1:-1])[:, None]
            speed = (np.abs(first) * (length ** powers[:-1])[:, None]).sum(axis=0).max()
            count = max(2, int(np.ceil(speed * length / STEP)) + 1)
            t = np.linspace(0.0, length, count)
            q = t[:, None] ** powers @ c
            v = t[:, None] ** powers[:-1] @ first
            a = t[:, None] ** powers[:-2] @ second
            ratios = [np.abs(v).max(0) / velocity, np.abs(a).max(0) / self._acceleration]
            worst = max(worst, *(float(ratio.max()) for ratio in ratios))
            outside = float(np.maximum(q.max(0) - upper, lower - q.min(0)).max())
            worst = max(worst, 1.0 + outside if outside > 0.0 else 0.0)
            for row in q:
                if last is not None and np.abs(row - last).max() < 0.5 * STEP:
                    continue
                last = row
                samples += 1
                colliding = colliding or self.collision(row, scene)
        return Finding(colliding, worst, samples)


def _disabled_pairs(path: Path) -> set[frozenset[str]]:
    pairs = ElementTree.parse(path).getroot().findall("disable_collisions")
    return {frozenset((pair.attrib["link1"], pair.attrib["link2"])) for pair in pairs}

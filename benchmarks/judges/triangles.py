"""FCL on the very triangles of a robot and a scene: the judge of what Armwright says of meshes.

Nothing of Armwright decides here: the URDF is read anew, its joints are moved by pinocchio, its
meshes are read by trimesh, and what lies inside a closed mesh is found by its winding number.
"""

import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from xml.etree import ElementTree

import fcl
import numpy as np
import pinocchio
import trimesh
from numpy.typing import NDArray

from benchmarks.problems.example_arms import ExampleArm, mesh_bytes
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from obstacles.shapes.shape import Box, Cylinder, Mesh, Sphere

Array = NDArray[np.float64]

#: Units of a metre in FCL, whose tolerances are fixed numbers.
UNITS = 1e3


@dataclass(eq=False)
class Body:
    """Triangles in FCL.

    Args:
        name: Of the link or obstacle.
        solid: Their mesh [m].
        T: Its frame in that of its link, or in the world, shape (4, 4).
        frame: Of its link in pinocchio, -1 for an obstacle.
        object: In FCL.
        pose: Where it is now, shape (4, 4).
    """

    name: str
    solid: trimesh.Trimesh
    T: Array
    frame: int
    object: Any
    pose: Array

    @classmethod
    def of(cls, name: str, solid: trimesh.Trimesh, T: Array, frame: int = -1) -> "Body":
        """Hand the triangles to FCL and put them where they are."""
        bvh = fcl.BVHModel()
        bvh.beginModel(len(solid.vertices), len(solid.faces))
        bvh.addSubModel(UNITS * np.array(solid.vertices), np.array(solid.faces))
        bvh.endModel()
        body = cls(name, solid, T, frame, fcl.CollisionObject(bvh), T)
        body.place(np.eye(4))
        return body

    def place(self, T_world_frame: Array) -> None:
        """Move it with its frame."""
        self.pose = M = T_world_frame @ self.T
        self.object.setTransform(fcl.Transform(M[:3, :3], UNITS * M[:3, 3]))

    @cached_property
    def ball(self) -> tuple[Array, float]:
        """Middle and radius of a ball that holds it, in its own frame."""
        corners = np.array(self.solid.vertices)
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        return middle, float(np.linalg.norm(corners - middle, axis=1).max())

    @property
    def placed_ball(self) -> tuple[Array, float]:
        """The same where it is now."""
        middle, radius = self.ball
        return self.pose[:3, :3] @ middle + self.pose[:3, 3], radius

    @cached_property
    def parts(self) -> Array:
        """A corner of every connected part, shape (k, 3)."""
        merged = self.solid.copy()
        merged.merge_vertices()
        return np.array([merged.vertices[own[0]] for own in _components(merged)])

    @cached_property
    def closed(self) -> bool:
        """Whether it bounds a solid."""
        merged = self.solid.copy()
        merged.merge_vertices()
        return bool(merged.is_watertight)


def _components(mesh: trimesh.Trimesh) -> Iterable[NDArray[np.int64]]:
    every = np.arange(len(mesh.faces))
    parts = trimesh.graph.connected_components(mesh.face_adjacency, nodes=every)
    return [np.array(mesh.faces[own]).ravel() for own in parts]


def _gap(a: Body, b: Body) -> float:
    """What balls prove of the distance of two bodies [m]."""
    (p, r), (q, s) = a.placed_ball, b.placed_ball
    return float(np.linalg.norm(p - q)) - r - s


def _balls(bodies: list[Body]) -> Array:
    """Middles and radii of the balls of bodies, shape (k, 4)."""
    return np.array([[*body.placed_ball[0], body.placed_ball[1]] for body in bodies]).reshape(-1, 4)


def touch(a: Body, b: Body) -> bool:
    """Whether triangles meet, or one body lies inside the other."""
    if fcl.collide(a.object, b.object, fcl.CollisionRequest(), fcl.CollisionResult()):
        return True
    return _holds(a, b) or _holds(b, a)


def _holds(outer: Body, inner: Body) -> bool:
    """Whether a part of ``inner`` is inside the solid ``outer``, when no triangles meet."""
    if not outer.closed:
        return False
    T = np.linalg.inv(outer.pose) @ inner.pose
    points = inner.parts @ T[:3, :3].T + T[:3, 3]
    low, high = outer.solid.bounds
    points = points[((points > low) & (points < high)).all(axis=1)]
    return bool(len(points)) and bool((np.abs(winding_numbers(outer.solid, points)) > 0.5).any())


def winding_numbers(solid: trimesh.Trimesh, points: Array) -> Array:
    """Winding numbers of points (m, 3), by the solid angles of the triangles, (m,)."""
    numbers = np.empty(len(points))
    for k, point in enumerate(points):
        a, b, c = (np.array(solid.triangles[:, i]) - point for i in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        below = la * lb * lc + np.einsum("ij,ij->i", a, b) * lc
        below += np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
        above = np.einsum("ij,ij->i", a, np.cross(b, c))
        numbers[k] = np.arctan2(above, below).sum() / (2.0 * np.pi)
    return numbers


class Triangles:
    """An arm as triangles.

    Args:
        arm: Which one.
        robot: The same as Armwright has it: the order of its joints, and who may touch whom.
    """

    def __init__(self, arm: ExampleArm, robot: RobotGeometry) -> None:
        self.model = pinocchio.buildModelFromXML(arm.text)
        self._data = self.model.createData()
        self._rest = pinocchio.neutral(self.model)
        self._joints = [
            self.model.joints[self.model.getJointId(n)] for n in robot.chain.joint_names
        ]
        moving = {link.name for link in robot.chain.links if link.joint >= 0}
        self.bodies = [
            Body.of(name, solid, T, self.model.getFrameId(name, pinocchio.FrameType.BODY))
            for name, solid, T in _solids(ElementTree.fromstring(arm.text))
        ]
        self._moving = [body for body in self.bodies if body.name in moving]
        body_of = {link.name: link.joint for link in robot.chain.links}
        allowed = {frozenset(pair) for pair in robot.allowed}
        self.pairs = [
            (a, b)
            for i, a in enumerate(self.bodies)
            for b in self.bodies[:i]
            if frozenset((a.name, b.name)) not in allowed and body_of[a.name] != body_of[b.name]
        ]

    def hold(self, positions: Mapping[str, float]) -> None:
        """Hold joints off the chain at positions [rad or m]."""
        for name, value in positions.items():
            joint = self.model.joints[self.model.getJointId(name)]
            turned = value if joint.nq == 1 else (np.cos(value), np.sin(value))
            self._rest[joint.idx_q : joint.idx_q + joint.nq] = turned

    def place(self, q: Array) -> None:
        """Put the arm into a configuration (n,)."""
        full = self._rest.copy()
        for joint, value in zip(self._joints, q, strict=True):
            at = joint.idx_q
            full[at : at + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        pinocchio.framesForwardKinematics(self.model, self._data, full)
        for body in self.bodies:
            body.place(self._data.oMf[body.frame].homogeneous)

    def clearance(self, q: Array, scenery: list[Body], most: float = np.inf) -> float:
        """Least distance to the scene and of the arm to itself [m], 0 where something touches.

        Args:
            q: Shape (n,).
            scenery: What stands around.
            most: Larger distances are told as this one [m].
        """
        self.place(q)
        near = sorted(
            ((_gap(a, b), k, a, b) for k, (a, b) in enumerate(self._all(scenery))),
            key=lambda entry: entry[:2],
        )
        least = most
        for gap, _, a, b in near:
            if gap >= least:
                break
            if touch(a, b):
                return 0.0
            found = fcl.distance(a.object, b.object, fcl.DistanceRequest(), fcl.DistanceResult())
            least = min(least, max(float(found) / UNITS, 0.0))
        return least

    def collision(self, q: Array, scenery: list[Body]) -> tuple[str, str] | None:
        """Who touches whom in a configuration, the first that are found."""
        self.place(q)
        around = _balls(scenery)
        for a in self._moving:
            (middle, radius) = a.placed_ball
            near = np.linalg.norm(around[:, :3] - middle, axis=1) <= around[:, 3] + radius
            for k in np.flatnonzero(near):
                if touch(a, scenery[k]):
                    return a.name, scenery[k].name
        for a, b in self.pairs:
            if _gap(a, b) <= 0.0 and touch(a, b):
                return a.name, b.name
        return None

    def _all(self, scenery: list[Body]) -> Iterable[tuple[Body, Body]]:
        yield from ((a, b) for a in self._moving for b in scenery)
        yield from self.pairs


def _solids(tree: ElementTree.Element) -> Iterable[tuple[str, trimesh.Trimesh, Array]]:
    for link in tree.findall("link"):
        for collision in link.findall("collision"):
            yield link.attrib["name"], _solid(collision), _origin(collision.find("origin"))


def _origin(origin: ElementTree.Element | None) -> Array:
    T = np.eye(4)
    if origin is not None:
        rpy, xyz = (
            [float(x) for x in origin.attrib.get(key, "0 0 0").split()] for key in ("rpy", "xyz")
        )
        T[:3, :3], T[:3, 3] = pinocchio.rpy.rpyToMatrix(*rpy), xyz
    return T


def _solid(collision: ElementTree.Element) -> trimesh.Trimesh:
    (shape,) = collision.findall("geometry/*")
    given = {
        key: [float(x) for x in text.split()]
        for key, text in shape.attrib.items()
        if key != "filename"
    }
    if shape.tag == "box":
        return trimesh.creation.box(given["size"])
    if shape.tag == "sphere":
        return trimesh.creation.icosphere(5, given["radius"][0])
    if shape.tag == "cylinder":
        return _cylinder(given["radius"][0], given["length"][0])
    uri = shape.attrib["filename"]
    mesh = trimesh.load(
        io.BytesIO(mesh_bytes(uri)), file_type=uri.rpartition(".")[2].lower(), force="mesh"
    )
    assert isinstance(mesh, trimesh.Trimesh)
    if "scale" in given:
        mesh.apply_scale(given["scale"])
    return mesh


def _cylinder(radius: float, height: float) -> trimesh.Trimesh:
    return trimesh.creation.cylinder(radius, height, sections=2048)


def scenery(scene: Scene) -> list[Body]:
    """A scene's obstacles as triangles; what is round has many."""
    bodies = []
    for obstacle in scene.obstacles:
        shape = obstacle.shape
        if isinstance(shape, Box):
            solid = trimesh.creation.box(np.array(shape.size))
        elif isinstance(shape, Cylinder):
            solid = _cylinder(shape.radius, shape.height)
        elif isinstance(shape, Sphere):
            solid = trimesh.creation.icosphere(5, shape.radius)
        elif isinstance(shape, Mesh):
            solid = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
        else:
            raise TypeError(f"no triangles for {type(shape).__name__}")
        bodies.append(Body.of(obstacle.id, solid, np.array(obstacle.T_world_obstacle)))
    return bodies

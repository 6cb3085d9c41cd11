"""An independent dense look at tasks: pinocchio's kinematics and Coal's collisions, every step.

The robot comes from its URDF and meshes, the scene from its text; of Armwright only the answer is
used: trajectories, which object is held how, and which pairs may touch.
"""

from pathlib import Path
from typing import Any, Protocol

import coal
import numpy as np
import pinocchio
import yaml

from kinematics.arrays import Array
from kinematics.trajectory import Trajectory
from planning.sequence.stage import Pair
from planning.sequence.world import World

#: Largest joint change between two samples [rad].
STEP = 5e-3


class Stage(Protocol):
    """What is looked at of a stage."""

    @property
    def after(self) -> World:
        """The world after it."""
        ...

    @property
    def allowed(self) -> tuple[Pair, ...]:
        """Pairs that may touch."""
        ...

    @property
    def trajectory(self) -> Trajectory:
        """Its motion."""
        ...


class DenseCheck:
    """A robot of a URDF with its meshes, among boxes and cylinders.

    Args:
        urdf: The file.
        folder: Where packages of its meshes lie.
        srdf: Its SRDF, which lists pairs that may touch.
        hand: A mesh on a link beside those of the URDF, the link and the angle about its z; None
            for none.
    """

    def __init__(
        self, urdf: Path, folder: Path, srdf: Path, hand: tuple[Path, str, float] | None = None
    ) -> None:
        self.model = pinocchio.buildModelFromUrdf(str(urdf))
        self._bare = pinocchio.buildGeomFromUrdf(
            self.model, str(urdf), pinocchio.GeometryType.COLLISION, package_dirs=[str(folder)]
        )
        if hand is not None:
            path, link, angle = hand
            frame = self.model.frames[self.model.getFrameId(link)]
            turn = pinocchio.SE3(pinocchio.utils.rotate("z", angle), np.zeros(3))
            mesh = coal.MeshLoader().load(str(path), np.ones(3))
            self._bare.addGeometryObject(
                pinocchio.GeometryObject(
                    "hand_0", frame.parentJoint, frame.parentFrame, frame.placement * turn, mesh
                )
            )
        self._bare.addAllCollisionPairs()
        pinocchio.removeCollisionPairs(self.model, self._bare, str(srdf))

    def first_collision(self, text: str, stage: Stage, names: tuple[str, ...]) -> Any:
        """The first pair that collides in a stage, with its time; None where none does.

        Args:
            text: Of the scene.
            stage: The stage with its motion.
            names: The joints of the trajectory.
        """
        geometry = self._bare.copy()
        links = len(geometry.geometryObjects)
        moved = {o.id: o.T_world_obstacle for o in stage.after.scene.obstacles}
        held = {item.name: item.attachment for item in stage.after.held}
        for name, shape, T in _solids(text):
            if name in held:
                frame = self.model.frames[self.model.getFrameId(held[name].link)]
                placement = frame.placement * _se3(held[name].held.T_world_obstacle)
                joint = frame.parentJoint
            else:
                placement, joint = _se3(moved.get(name, T)), 0
            geometry.addGeometryObject(pinocchio.GeometryObject(name, joint, 0, placement, shape))
        self._add_pairs(geometry, links, stage)
        data, found = self.model.createData(), geometry.createData()
        index = [self.model.joints[self.model.getJointId(name)].idx_q for name in names]
        rest = pinocchio.neutral(self.model)
        for time, q in _samples(stage):
            rest[index] = q
            if pinocchio.computeCollisions(self.model, data, geometry, found, rest, True):
                for k, pair in enumerate(geometry.collisionPairs):
                    if found.collisionResults[k].isCollision():
                        objects = geometry.geometryObjects
                        return objects[pair.first].name, objects[pair.second].name, time
        return None

    def _add_pairs(self, geometry: Any, links: int, stage: Stage) -> None:
        """Pairs of links and held objects with objects, but those that may touch."""
        allowed = {frozenset(pair) for pair in stage.allowed}
        touches = {
            frozenset((item.name, link)) for item in stage.after.held
            for link in (*item.attachment.touches, item.attachment.link)
        }  # fmt: skip
        objects = geometry.geometryObjects
        for i in range(len(objects)):
            for j in range(max(i + 1, links), len(objects)):
                one, other = objects[i], objects[j]
                a = one.name.rpartition("_")[0] if i < links else one.name
                pair = frozenset((a, other.name))
                fixed = one.parentJoint == 0 and other.parentJoint == 0
                same = one.parentJoint == other.parentJoint
                if not (fixed or same or pair in allowed or pair in touches):
                    geometry.addCollisionPair(pinocchio.CollisionPair(i, j))


def _solids(text: str) -> list[tuple[str, Any, Array]]:
    """Name, shape and pose of the objects of a MoveIt scene."""
    solids = []
    for entry in yaml.safe_load(text)["world"]["collision_objects"]:
        for shape, pose in zip(entry["primitives"], entry["primitive_poses"], strict=True):
            d = shape["dimensions"]
            solid = coal.Box(*d) if shape["type"] == "box" else coal.Cylinder(d[1], d[0])
            x, y, z, w = pose["orientation"]
            T = np.eye(4)
            T[:3, :3] = pinocchio.Quaternion(w, x, y, z).normalized().matrix()
            T[:3, 3] = pose["position"]
            solids.append((entry["id"], solid, T))
    return solids


def _se3(T: Array) -> Any:
    return pinocchio.SE3(np.array(T[:3, :3]), np.array(T[:3, 3]))


def _samples(stage: Stage) -> list[tuple[float, Array]]:
    """Times and configurations, each within a step of the one before."""
    motion = stage.trajectory
    speed = float(np.abs(motion.extrema(1).maximum).max())
    speed = max(speed, float(np.abs(motion.extrema(1).minimum).max()))
    count = max(2, int(np.ceil(speed * motion.duration / STEP)) + 1)
    times = np.linspace(0.0, motion.duration, count)
    return list(zip(times.tolist(), motion.sample(times), strict=True))

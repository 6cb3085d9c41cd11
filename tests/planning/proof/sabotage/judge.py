"""A judge of motions without a line of the planner's code: pinocchio, FCL and numpy's roots.

Solids are read from the robot's description by ElementTree, moved by pinocchio and given to FCL as
they are. Limits are judged by the roots of the polynomials, everything else by dense samples. A
fault is told only where it is larger than what rounding could make of a good motion.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import fcl
import numpy as np
import pinocchio as pin

from benchmarks.judges.ratios import worst_ratio
from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.scenes.scene import Scene
from obstacles.shapes.shape import Box, Cylinder, Shape
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.proof.sabotage.box_gaps import box_gaps

#: Instants at which a motion is looked at.
SAMPLES = 400
_REQUEST = fcl.CollisionRequest(num_max_contacts=1, enable_contact=True)
#: A distance is wrong that falls short of its margin by this [m]: FCL is good to a tenth of it.
DISTANCE_TOLERANCE = 1e-5
#: An overlap this deep is one [m].
OVERLAP_TOLERANCE = 1e-5
#: A ratio to a limit is wrong that exceeds 1 by this.
RATIO_TOLERANCE = 1e-6
#: A residual or deviation is wrong that exceeds what is allowed by this [m or rad].
RESIDUAL_TOLERANCE = 2e-6
#: The end of a motion is wrong that misses its goal by this [rad or m].
END_TOLERANCE = 1e-6

#: From the pose of the tool, (4, 4), to how far it is off what is asked for; at most 0 where it
#: holds [m or rad].
Residual = Callable[[Array], float]


@dataclass(frozen=True)
class Truth:
    """What a motion is held to, apart from the planner's own values.

    Args:
        scene: The obstacles.
        margin: To be kept from them [m].
        limits: Limits (n,) by the order of the derivative, 1 velocity, 2 acceleration, 3 jerk.
        effort: Torque limits, shape (n,) [N m or N]; None where torques are free.
        tool_speed: Largest speed of the tool's origin [m/s]; None where it is free.
        residual: Of a constraint on the tool; None where there is none.
        deviation: How far the tool is off its line beyond what is allowed; None where there is no
            line.
        start: Shape (n,).
    """

    scene: Scene
    start: Array
    limits: Mapping[int, Array]
    margin: float = 0.0
    effort: Array | None = None
    tool_speed: float | None = None
    residual: Residual | None = None
    deviation: Residual | None = None


@dataclass(frozen=True)
class Body:
    """A solid on a link.

    Args:
        link: Name of the link.
        T_link_solid: Its pose in the link, shape (4, 4).
        solid: FCL's geometry.
        lower: Least coordinates of its points in its own frame, shape (3,) [m].
        upper: Largest ones, shape (3,) [m].
    """

    link: str
    T_link_solid: Array
    solid: Any
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Arm:
    """A robot as pinocchio and FCL see it.

    Args:
        urdf: Its description.
        joints: Names of the joints of a motion, in their order.
        tip: Link that is the tool.
        allowed: Pairs of links that may touch, sorted.
        meshes: Corners (k, 3) and faces (f, 3) by file name.
    """

    urdf: str
    joints: tuple[str, ...]
    tip: str
    allowed: frozenset[tuple[str, str]]
    meshes: Mapping[str, tuple[Array, Any]] = field(default_factory=dict)

    @cached_property
    def moving(self) -> PinocchioArm:
        """The arm as pinocchio moves it, seen from the root of its tree."""
        elements = list(ElementTree.fromstring(self.urdf))
        children = {e.attrib["link"] for joint in elements for e in joint.iter("child")}
        links = [e.attrib["name"] for e in elements if e.tag == "link"]
        (root,) = set(links) - children
        named: Any = SimpleNamespace(
            n=len(self.joints), joint_names=self.joints, tip_link=self.tip, root_link=root
        )
        return PinocchioArm(urdf=self.urdf, chain=named)

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """The solids of all links."""
        bodies = []
        for link in ElementTree.fromstring(self.urdf).iter("link"):
            for element in link.findall("collision"):
                geometry = element.find("geometry")
                assert geometry is not None
                T = _origin(element.find("origin"))
                bodies.append(Body(link.attrib["name"], T, *self._solid(geometry[0])))
        return tuple(bodies)

    @cached_property
    def self_pairs(self) -> tuple[tuple[int, int], ...]:
        """Numbers of the bodies that must stay apart from each other."""
        model = self.moving.model
        carriers = [model.frames[model.getFrameId(b.link)].parentJoint for b in self.bodies]
        return tuple(
            (i, j)
            for i, j in itertools.combinations(range(len(self.bodies)), 2)
            if carriers[i] != carriers[j]
            and tuple(sorted((self.bodies[i].link, self.bodies[j].link))) not in self.allowed
        )

    def _solid(self, element: ElementTree.Element) -> tuple[Any, Array, Array]:
        size = element.attrib
        if element.tag == "box":
            return _box([float(value) for value in size["size"].split()])
        if element.tag == "sphere":
            radius = float(size["radius"])
            return fcl.Sphere(radius), np.full(3, -radius), np.full(3, radius)
        if element.tag == "cylinder":
            return _cylinder(float(size["radius"]), float(size["length"]))
        assert element.tag == "mesh", element.tag
        return _surface(*self.meshes[size["filename"]])


class Look:
    """Solids of an arm and a scene in FCL's hands."""

    def __init__(self, arm: Arm, scene: Scene) -> None:
        self._arm = arm
        model = arm.moving.model
        frames = [model.getFrameId(body.link) for body in arm.bodies]
        self._frames, self._carriers = np.unique(frames, return_inverse=True)
        solids = [(body.solid, body.lower, body.upper) for body in arm.bodies]
        solids += [_shape(obstacle.shape) for obstacle in scene.obstacles]
        self._names = [body.link for body in arm.bodies] + list(scene.ids)
        self._things = [fcl.CollisionObject(solid) for solid, _, _ in solids]
        self._own_poses = np.array([body.T_link_solid for body in arm.bodies])
        self._still_poses = np.array(
            [obstacle.T_world_obstacle for obstacle in scene.obstacles]
        ).reshape(-1, 4, 4)
        for k, T in enumerate(self._still_poses, len(arm.bodies)):
            self._things[k].setTransform(fcl.Transform(T[:3, :3], T[:3, 3]))
        # What stands still with the base can't be moved away from obstacles.
        still = [model.frames[frame].parentJoint == 0 for frame in frames]
        around = [
            (i, k)
            for i in range(len(arm.bodies))
            for k in range(len(arm.bodies), len(solids))
            if not still[i] and not scene.allows(self._names[i], self._names[k])
        ]
        self._pairs = np.array([*around, *arm.self_pairs]).reshape(-1, 2)
        self._own = np.arange(len(self._pairs)) >= len(around)
        lower, upper = (np.array([solid[k] for solid in solids]) for k in (1, 2))
        self._middles, self._halves = 0.5 * (lower + upper), 0.5 * (upper - lower)

    def first_fault(self, configurations: Array, margin: float) -> str | None:
        """What is wrong with the first configuration (m, n) that is wrong; None where none is."""
        poses = self._poses(configurations)
        rows, near = self._near(poses, margin)
        placed = -1
        for row, k in zip(rows.tolist(), near.tolist(), strict=True):
            if row != placed:
                self._place(poses[row], self._pairs[near[rows == row]])
                placed = row
            i, j = self._pairs[k].tolist()
            names = f"{self._names[i]} and {self._names[j]}"
            if _overlap(self._things[i], self._things[j]) > OVERLAP_TOLERANCE:
                return f"{names} overlap"
            if margin > 0.0 and not self._own[k]:
                distance = float(fcl.distance(self._things[i], self._things[j]))
                if distance < margin - DISTANCE_TOLERANCE:
                    return f"{names} are {distance:.4g} m apart"
        return None

    def _poses(self, configurations: Array) -> Array:
        """Poses of all solids, shape (m, k, 4, 4)."""
        arm, links = self._arm.moving, []
        for q in configurations:
            pin.framesForwardKinematics(arm.model, arm.data, arm.configuration(q))
            links.append([arm.data.oMf[int(frame)].homogeneous for frame in self._frames])
        own = np.array(links)[:, self._carriers] @ self._own_poses
        still = np.broadcast_to(self._still_poses, (len(own), *self._still_poses.shape))
        return np.concatenate([own, still], axis=1)

    def _near(self, poses: Array, margin: float) -> tuple[Any, Any]:
        """Which pairs no plane proves farther apart than the margin: rows, and numbers of pairs."""
        middles = (poses[..., :3, :3] @ self._middles[:, :, None])[..., 0] + poses[..., :3, 3]
        radii = np.linalg.norm(self._halves, axis=1)
        i, j = self._pairs.T
        apart = np.linalg.norm(middles[:, i] - middles[:, j], axis=2)
        rows, near = np.nonzero(apart <= radii[i] + radii[j] + margin)
        i, j = self._pairs[near].T
        gaps = box_gaps(
            (poses[rows, i, :3, :3], self._halves[i]),
            (poses[rows, j, :3, :3], self._halves[j]),
            middles[rows, i] - middles[rows, j],
        )
        left = gaps <= margin
        return rows[left], near[left]

    def _place(self, poses: Array, pairs: Any) -> None:
        for k in np.unique(pairs):
            if k < len(self._own_poses):
                self._things[k].setTransform(fcl.Transform(poses[k, :3, :3], poses[k, :3, 3]))


def faults(arm: Arm, motion: Trajectory, truth: Truth) -> dict[str, str]:
    """Everything that is wrong with a motion, by kind, in words.

    Args:
        arm: The robot.
        motion: Of its joints.
        truth: What it is held to.
    """
    assert motion.joint_names == arm.joints
    times = np.unique([*np.linspace(0.0, motion.duration, SAMPLES), *motion.breaks])
    q, velocity, acceleration = (sample(motion, times, order) for order in range(3))
    found: dict[str, str] = {}

    def note(kind: str, text: str | None) -> None:
        if text is not None:
            found[kind] = text

    note("collision", Look(arm, truth.scene).first_fault(q, truth.margin))
    for order, limit in truth.limits.items():
        kind = ("velocity", "acceleration", "jerk")[order - 1]
        note(kind, _ratio(worst_ratio(motion, limit, order)))
    note("position", _outside(arm, q))
    if truth.effort is not None:
        rows = zip(q, velocity, acceleration, strict=True)
        worst = max(float((np.abs(arm.moving.torque(*row)) / truth.effort).max()) for row in rows)
        note("torque", _ratio(worst))
    if truth.tool_speed is not None:
        fastest = arm.moving.tip_speeds_at(q, velocity).max()
        note("tool_speed", _ratio(float(fastest) / truth.tool_speed))
    for kind, residual in (("constraint", truth.residual), ("deviation", truth.deviation)):
        if residual is not None:
            worst = max(residual(arm.moving.pose(row)) for row in q)
            note(kind, f"off by {worst:.3g}" if worst > RESIDUAL_TOLERANCE else None)
    note("start", _off_start(q[0], truth.start))
    note("jump", _jump(motion))
    return found


def sample(motion: Trajectory, times: Array, order: int) -> Array:
    """A derivative of a motion at times, shape (len(times), n), by Horner's rule in numpy."""
    piece = np.clip(np.searchsorted(motion.breaks, times, side="right") - 1, 0, motion.pieces - 1)
    rows = np.array(motion.coefficients[piece])
    for _ in range(order):
        powers = np.arange(1.0, rows.shape[2])
        rows = rows[:, :, 1:] * powers if rows.shape[2] > 1 else 0.0 * rows
    value, since = np.zeros(rows.shape[:2]), (times - motion.breaks[piece])[:, None]
    for k in range(rows.shape[2] - 1, -1, -1):
        value = value * since + rows[:, :, k]
    return value


def _ratio(worst: float) -> str | None:
    return f"{worst:.6g} of its limit" if worst > 1.0 + RATIO_TOLERANCE else None


def _outside(arm: Arm, q: Array) -> str | None:
    model = arm.moving.model
    places = [model.joints[model.getJointId(name)].idx_q for name in arm.joints]
    lower, upper = model.lowerPositionLimit[places], model.upperPositionLimit[places]
    worst = float(np.maximum(lower - q, q - upper).max())
    return f"{worst:.3g} beyond" if worst > END_TOLERANCE else None


def _off_start(q: Array, start: Array) -> str | None:
    off = float(np.abs(q - start).max())
    return f"misses the start by {off:.3g}" if off > END_TOLERANCE else None


def _jump(motion: Trajectory) -> str | None:
    lengths, worst = np.diff(motion.breaks)[:-1, None], 0.0
    for order in (0, 1):
        rows = np.array(motion.coefficients)
        if order:
            rows = rows[:, :, 1:] * np.arange(1.0, rows.shape[2])
        powers = lengths[..., None] ** np.arange(rows.shape[2])
        ends = (rows[:-1] * powers).sum(axis=2)
        worst = max(worst, float(np.abs(ends - rows[1:, :, :1].sum(axis=2)).max(initial=0.0)))
    return f"jumps by {worst:.3g}" if worst > END_TOLERANCE else None


def _overlap(a: Any, b: Any) -> float:
    """Depth of the overlap of two solids [m], 0 where they are apart."""
    result = fcl.CollisionResult()
    if not fcl.collide(a, b, _REQUEST, result):
        return 0.0
    return max((abs(float(c.penetration_depth)) for c in result.contacts), default=np.inf)


def _origin(element: ElementTree.Element | None) -> Array:
    if element is None:
        return np.eye(4)
    xyz, rpy = (
        [float(value) for value in element.attrib.get(name, "0 0 0").split()]
        for name in ("xyz", "rpy")
    )
    return np.array(pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz)).homogeneous)


def _shape(shape: Shape) -> tuple[Any, Array, Array]:
    if isinstance(shape, Box):
        return _box([float(value) for value in shape.size])
    assert isinstance(shape, Cylinder), shape
    return _cylinder(shape.radius, shape.height)


def _box(size: list[float]) -> tuple[Any, Array, Array]:
    half = 0.5 * np.array(size)
    return fcl.Box(*size), -half, half


def _cylinder(radius: float, length: float) -> tuple[Any, Array, Array]:
    half = np.array([radius, radius, 0.5 * length])
    return fcl.Cylinder(radius, length), -half, half


def _surface(corners: Array, faces: Any) -> tuple[Any, Array, Array]:
    model = fcl.BVHModel()
    model.beginModel(len(corners), len(faces))
    model.addSubModel(np.asarray(corners), np.asarray(faces))
    model.endModel()
    return model, corners.min(axis=0), corners.max(axis=0)

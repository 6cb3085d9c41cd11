"""A judge of stops without a line of the proof's code: ruckig, pinocchio and coal.

Ruckig brakes the joints, pinocchio reads and moves the robot's description, coal looks for overlap
at many instants of many stops.
"""

from collections.abc import Callable, Mapping

import coal
import numpy as np
import pinocchio as pin
from ruckig import ControlInterface, InputParameter, Ruckig, Synchronization
from ruckig import Trajectory as Phases

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from obstacles.shapes.shape import Box, Cylinder, Shape, Sphere
from planning.stops.braking import BrakingLimits
from tests.planning.pinocchio_arm import PinocchioArm

#: Jerk that stands for none: an acceleration builds up in a microsecond.
_NO_LIMIT = 1e7


class Brakes:
    """Joints that brake by ruckig.

    Args:
        limits: Limits that they brake at.
    """

    def __init__(self, limits: BrakingLimits) -> None:
        self._limits = limits
        self._n = len(limits.acceleration)
        self._otg = Ruckig(self._n)

    def states(self, q: Array, v: Array, a: Array, count: int) -> tuple[Array, float]:
        """States (count, n) at even times until all joints are at rest, and when that is [s]."""
        asked = InputParameter(self._n)
        asked.control_interface = ControlInterface.Velocity
        asked.synchronization = Synchronization.No
        limit = self._limits.acceleration
        jerk = np.where(np.isinf(self._limits.jerk), _NO_LIMIT, self._limits.jerk)
        asked.current_position, asked.current_velocity = q.tolist(), v.tolist()
        asked.current_acceleration = np.clip(a, -limit, limit).tolist()
        if np.isinf(self._limits.jerk).all():
            # Such joints are at any acceleration at once.
            asked.current_acceleration = (-np.sign(v) * limit).tolist()
        asked.target_velocity = asked.target_acceleration = [0.0] * self._n
        asked.max_acceleration, asked.max_jerk = limit.tolist(), jerk.tolist()
        phases = Phases(self._n)
        self._otg.calculate(asked, phases)
        times = np.linspace(0.0, phases.duration, count)
        return np.array([phases.at_time(t)[0] for t in times.tolist()]), float(phases.duration)

    def stops(self, trajectory: Trajectory, starts: Array, count: int) -> tuple[Array, Array]:
        """States (len(starts), count, n) of stops, and how long each takes (len(starts),) [s]."""
        rows = [trajectory.sample(starts, order) for order in range(3)]
        found = [self.states(q, v, a, count) for q, v, a in zip(*rows, strict=True)]
        return np.array([one for one, _ in found]), np.array([time for _, time in found])


class CoalArm:
    """A robot among obstacles as pinocchio and coal see it.

    Args:
        urdf: Its description, meshes by absolute path.
        robot: The robot, of which only the pairs that may touch and the joints of links count.
        scene: The obstacles.
        mimic: Positions of the mimic joints by name, of configurations.
    """

    def __init__(
        self,
        urdf: str,
        robot: RobotGeometry,
        scene: Scene,
        mimic: Callable[[Array], Mapping[str, Array | float]] = lambda _: {},
    ) -> None:
        self._arm = PinocchioArm(urdf=urdf, chain=robot.chain, others=mimic)
        model = self._arm.model
        self.solids = pin.buildGeomFromUrdfString(model, urdf, pin.GeometryType.COLLISION)
        joints = dict(zip(robot.links, robot.joints.tolist(), strict=True))
        own = [
            (k, model.frames[solid.parentFrame].name)
            for k, solid in enumerate(self.solids.geometryObjects)
        ]
        own = [(k, name) for k, name in own if name in joints]
        pairs = [
            (k, i)
            for at, (i, a) in enumerate(own)
            for k, b in own[:at]
            if tuple(sorted((a, b))) not in robot.allowed and joints[a] != joints[b]
        ]
        for obstacle in scene.obstacles:
            place = pin.SE3(obstacle.T_world_obstacle)
            solid = pin.GeometryObject(obstacle.id, 0, place, _solid(obstacle.shape))
            k = self.solids.addGeometryObject(solid)
            pairs += [(i, k) for i, name in own if joints[name] >= 0]
        for pair in pairs:
            self.solids.addCollisionPair(pin.CollisionPair(*pair))
        self._pool = pin.BroadPhaseManagerPool_DynamicAABBTreeCollisionManager(
            model, self.solids, 1
        )

    def overlaps(self, states: Array) -> Array:
        """Whether anything overlaps, of configurations (k, n)."""
        whole = self._arm.configurations(states)
        return np.asarray(pin.computeCollisionsInParallel(1, self._pool, whole, True))


def _solid(shape: Shape) -> coal.CollisionGeometry:
    if isinstance(shape, Box):
        return coal.Box(np.asarray(shape.size))
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius)
    assert isinstance(shape, Cylinder), shape
    return coal.Cylinder(shape.radius, shape.height)

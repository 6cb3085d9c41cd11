"""Pieces and bytes of motions, speeds of a tool and torques by pinocchio, random problems."""

import json
from collections.abc import Iterator

import numpy as np
import pinocchio

from benchmarks.problems.mesh_scenes import own_scenes
from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from planning.options import Options
from planning.problem import JointGoal, Problem
from planning.timing.options import Payload, TimingOptions

#: Length of a motion that pieces and bytes are told for, unless it is shorter [s].
LENGTH = 1.6
#: Pieces of such a motion at most; a span more where its length is rounded up [-].
MOST = 20.5
#: Bytes of such a motion at most [-].
BYTES = 8000.0
#: Random motions: speed of the tool [m/s], largest angle of a joint, least clearance of ends [m],
#: instants that are judged, and by how much a limit may be exceeded where it is reached.
TOOL_SPEED, TURN, CLEAR, INSTANTS, ABOVE = 0.5, 2.6, 2e-3, 500, 1e-9


def size(motion: Trajectory) -> int:
    """Bytes of a motion's segments in an answer."""
    segments = [
        {"t0": a, "t1": b, "coefficients": c.tolist()}
        for a, b, c in zip(motion.breaks, motion.breaks[1:], motion.coefficients, strict=False)
    ]
    return len(json.dumps(segments, separators=(",", ":")))


class Judge:
    """Speeds of a tool and torques by pinocchio.

    Args:
        urdf: The arm.
        robot: The same.
        load: Mass of a point at the tip [kg].
    """

    def __init__(self, urdf: str, robot: RobotGeometry, load: float) -> None:
        chain = robot.chain
        self._model = pinocchio.buildModelFromXML(urdf)
        self._tip = self._model.getFrameId(chain.tip_link, pinocchio.FrameType.BODY)
        if load:
            frame = self._model.frames[self._tip]
            inertia = pinocchio.Inertia(load, frame.placement.translation, np.zeros((3, 3)))
            self._model.appendBodyToJoint(frame.parentJoint, inertia, pinocchio.SE3.Identity())
        self._data = self._model.createData()
        joints = self._model.joints
        self._columns = [joints[self._model.getJointId(name)].idx_q for name in chain.joint_names]

    def uses(self, motion: Trajectory, effort: Array) -> tuple[float, float]:
        """Largest speed of the tool [m/s], and largest part of a torque limit that is used."""
        times = np.linspace(0.0, motion.duration, INSTANTS)
        q, v, a = (motion.sample(times, order) for order in range(3))
        fastest, strongest = 0.0, 0.0
        whole = np.zeros((3, self._model.nq))
        for k in range(INSTANTS):
            for row, values in enumerate((q[k], v[k], a[k])):
                whole[row, self._columns] = values
            pinocchio.forwardKinematics(self._model, self._data, whole[0], whole[1])
            twist = pinocchio.getFrameVelocity(
                self._model, self._data, self._tip, pinocchio.LOCAL_WORLD_ALIGNED
            )
            fastest = max(fastest, float(np.linalg.norm(twist.linear)))
            torque = pinocchio.rnea(self._model, self._data, *whole)[self._columns]
            strongest = max(strongest, float(np.abs(torque / effort).max()))
        return fastest, strongest


def random_problems(
    robot: RobotGeometry, count: int, load: float
) -> Iterator[tuple[Problem, Options]]:
    """Random motions among boxes, the tool no faster than ``TOOL_SPEED`` or with a load."""
    random, (low, high) = np.random.default_rng(0), robot.chain.sampling_bounds()
    timing = TimingOptions(tool_speed=TOOL_SPEED)
    if load:
        timing = TimingOptions(torque_limits=True, payload=Payload(load))
    scenes, made = list(own_scenes(30, 0.9, 0)), 0
    while made < count:
        scene = scenes[made % len(scenes)]
        start, end = np.clip(random.uniform(low, high, (2, robot.chain.n)), -TURN, TURN)
        if min(Checker.of(robot, scene).clearance(q)[0] for q in (start, end)) < CLEAR:
            continue
        made += 1
        options = Options(timing=timing, timeout=20.0)
        yield Problem(robot, scene, start, (JointGoal(end),)), options

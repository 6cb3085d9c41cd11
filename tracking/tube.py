"""The tube around a reference that a tracked motion stays in, and what clearance it leaves."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.chain import JointType
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry


@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """Displacement bound of a robot whose joints are off by an error.

    Args:
        joint_error: Largest |q^r - q| of each joint, shape (n,) [rad or m].
        reach: How far any point of the robot moves for a unit of each joint, at most, shape (n,)
            [m/rad, or 1].
        displacement: Largest displacement of any point of the robot, sum_j reach_j error_j [m]:
            joints turned back one by one, each moves a point along an arc of at most that length.
    """

    joint_error: Array
    reach: Array
    displacement: float

    def remaining_clearance(self, clearance: float) -> float:
        """Lower bound of the tracked motion's clearance, from that of the reference [m].

        To an obstacle a robot loses as much as a point of it is displaced. Two links of it lose no
        more: seen from the first, the second is displaced by the joints between them alone.
        """
        return clearance - self.displacement


def tube(robot: RobotGeometry, trajectory: Trajectory, joint_error: Array) -> Tube:
    """The tube of a tracked motion.

    Args:
        robot: The robot with what it holds.
        trajectory: The reference, whose positions say how far prismatic joints are out.
        joint_error: Largest |q^r - q| of each joint, shape (n,) [rad or m].
    """
    span = trajectory.extrema()
    out = np.maximum(np.abs(span.minimum), np.abs(span.maximum)) + joint_error
    reach = reaches(robot, out)
    return Tube(frozen(joint_error), frozen(reach), float(reach @ joint_error))


def reaches(robot: RobotGeometry, extension: Array) -> Array:
    """Largest distance of any point beyond each joint from its axis, in any configuration, (n,).

    Links are as if stretched out: origins of the frames between are counted at their distances,
    prismatic joints at ``extension`` (n,) [m]. For a prismatic joint it is 1.
    """
    chain, arrays = robot.chain, robot.arrays
    radius = np.zeros(chain.n)
    for piece, joint in enumerate(robot.joints):
        if joint >= 0:
            farthest = float(np.linalg.norm(arrays.centers[piece]) + arrays.radii[piece])
            radius[joint] = max(radius[joint], farthest)
    reach, beyond = np.empty(chain.n), 0.0
    for j in range(chain.n - 1, -1, -1):
        beyond = max(radius[j], beyond)
        slides = chain.joint_types[j] == JointType.PRISMATIC
        reach[j] = 1.0 if slides else beyond
        beyond += float(np.linalg.norm(chain.offsets[j][:3, 3])) + (extension[j] if slides else 0.0)
    return reach

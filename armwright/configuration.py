"""Configurations: checked against a scene, and found for a pose by inverse kinematics."""

import math
from typing import Any

from numpy.typing import ArrayLike

from armwright.model import Robot, chain_of
from kinematics.arrays import typed
from kinematics.errors import InvalidOption
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.ik.solution import IkResult
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.placement import place
from obstacles.scenes.scene import Scene
from planning.configuration_check import ConfigurationReport, configuration_checker


@typed
def check(
    robot: RobotGeometry, scene: Scene, joints: ArrayLike, *, margin: float = 0.0
) -> ConfigurationReport:
    """Check one configuration for collisions and position limits.

    Args:
        robot: The robot with its geometry.
        scene: The obstacles.
        joints: Shape (n,) [rad or m].
        margin: Distance to keep from obstacles beyond their own margins [m].

    Raises:
        InvalidRobotState: ``joints`` has the wrong length or is not finite.
    """
    q = robot.chain.state(joints)
    if not 0.0 <= margin < math.inf:
        raise InvalidOption(f"margin is {margin}", hint="Give 0 or more [m].")
    return configuration_checker(robot, place(scene, robot.chain, q), margin).check(q)


@typed
def ik(
    robot: Robot,
    T_base_link: ArrayLike,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    **options: Any,
) -> IkResult:
    """Configurations that bring a link to a pose, best first.

    Args:
        robot: The robot or its chain.
        T_base_link: Pose of the link, shape (4, 4).
        link: The link to bring there; the tip where none is named.
        seed_joints: Configuration to search from and to measure "nearest" from, shape (n,) [rad or
            m]; the middle of the limits where not given.
        options: Fields of ``kinematics.ik.inverse.IkOptions``: ``method``, ``most``, ``ranking``,
            ...

    Raises:
        InvalidPose: The pose is not a finite rigid transform.
        InvalidOption: An option has an invalid value.
    """
    how = IkOptions(**options) if options else None
    return inverse_kinematics(chain_of(robot), T_base_link, how, link=link, seed_joints=seed_joints)

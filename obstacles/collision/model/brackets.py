"""A robot's sphere brackets: outer ones that are clear are free, inner ones that meet collide.

Each convex piece has a ``SphereSet``; between the two radii the exact test decides (`verdict`).
"""

from dataclasses import dataclass, field

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.caches.preparation_limit import check_preparation_time
from obstacles.convex.sphere_set import MOST, SphereSet, sphere_set
from obstacles.robots.robot_geometry import RobotGeometry

#: What stands in which columns of a sphere: its centre in the frame of the joint that carries it,
#: the radii, and the sphere after all below it.
OUTER, INNER, AFTER = 3, 4, 5
#: Finest spheres of a robot's pieces together, a second's work, and of each of very many pieces.
_TOGETHER, _LEAST = 2400, 8


@dataclass(frozen=True, slots=True, eq=False)
class Brackets:
    """The sphere sets of a robot's pieces.

    Args:
        robot: The robot.
        sets: Sphere sets of the pieces, in their order, each in the frame of the joint that carries
            it.
        spheres: Spheres of all pieces for the kernels, columns as named above, shape (s, 6).
        starts: The spheres of piece i are ``spheres[starts[i]:starts[i + 1]]``, shape (p + 1,).
    """

    robot: RobotGeometry
    sets: tuple[SphereSet, ...]
    spheres: Array = field(init=False, repr=False)
    starts: Indices = field(init=False, repr=False)

    def __post_init__(self) -> None:
        starts = np.cumsum([0, *(len(own.outer) for own in self.sets)])
        blocks = [np.zeros((0, 6))]
        for own, start in zip(self.sets, starts, strict=False):
            blocks.append(np.column_stack([own.centers, own.outer, own.inner, own.skips + start]))
        spheres = np.vstack(blocks)
        for name, values in (("spheres", spheres), ("starts", starts.astype(np.int64))):
            values.setflags(write=False)
            object.__setattr__(self, name, values)


@bounded_cache(maxsize=64)
def brackets(robot: RobotGeometry) -> Brackets:
    """The brackets of a robot, made once for each piece and kept by the robot's content."""
    return Brackets(robot, sphere_sets(robot))


def sphere_sets(robot: RobotGeometry) -> tuple[SphereSet, ...]:
    """The spheres of each of a robot's pieces."""
    most = max(min(MOST, _TOGETHER // max(len(robot.pieces), 1)), _LEAST)
    sets = []
    for piece in robot.pieces:
        check_preparation_time()
        sets.append(sphere_set(piece, most))
    return tuple(sets)

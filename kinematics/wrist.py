"""Which closed form of inverse kinematics the axes of a chain allow.

In the frame of a revolute joint its axis is the line (0, 0, t), and where the axes of its
neighbours lie relative to it depends on no other joint: the class is a property of the fixed
offsets alone.
"""

from typing import Literal

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain, JointType
from kinematics.pose import inverse

Wrist = Literal["spherical", "three_parallel", "none"]

#: Published tables round angles to a millionth of a radian and lengths to a hundredth of a
#: millimetre; a closed form that takes such axes for exact is polished by the numeric one.
PARALLEL_TOLERANCE = 1e-6
MEETING_TOLERANCE = 1e-5


def classify_wrist(chain: Chain) -> Wrist:
    """Classify a chain by the axes that make its inverse kinematics solvable in closed form.

    Returns:
        "spherical" when the last three axes meet in one point; else "three_parallel" when any
        three consecutive axes are parallel; else "none". Only revolute joints count. Source: the
        sufficient conditions of "The kinematics of manipulators under computer control", 1968.
    """
    if chain.n >= 3 and _revolute(chain, chain.n - 3) and _spherical(chain):
        return "spherical"
    parallel = (
        _revolute(chain, i) and _parallel(chain.offsets[i + 1]) and _parallel(chain.offsets[i + 2])
        for i in range(chain.n - 2)
    )
    return "three_parallel" if any(parallel) else "none"


def _revolute(chain: Chain, first: int) -> bool:
    """Whether three joints from ``first`` on are revolute."""
    return bool((chain.joint_types[first : first + 3] == JointType.REVOLUTE).all())


def _spherical(chain: Chain) -> bool:
    before = _meeting(inverse(chain.offsets[-2]))
    after = _meeting(chain.offsets[-1])
    return before is not None and after is not None and abs(before - after) <= MEETING_TOLERANCE


def _parallel(A: Array) -> bool:
    return float(np.hypot(A[0, 2], A[1, 2])) <= PARALLEL_TOLERANCE


def _meeting(A: Array) -> float | None:
    """Where on z the z axis of frame ``A`` (4, 4) meets it [m]; None where it doesn't."""
    if _parallel(A):
        return None
    direction, point = A[:3, 2], A[:3, 3]
    across = direction[:2]
    along = -float(point[:2] @ across) / float(across @ across)
    nearest = point + along * direction
    return float(nearest[2]) if float(np.hypot(*nearest[:2])) <= MEETING_TOLERANCE else None

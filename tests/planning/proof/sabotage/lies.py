"""The lies: each verdict that planners use, and how it is made to be wrong.

A lie is told at the place where planners ask, by every module that knows the verdict by name: where
the certificate asked the same function, it would be lied to as well. Kernels that call kernels are
beyond names; they are lied to by what they are given: a robot or scene packed wrongly, rows that
are too wide, limits that are too high.
"""

from tests.planning.proof.sabotage.collision_lies import COLLISION_LIES
from tests.planning.proof.sabotage.motion_lies import MOTION_LIES

LIES = (*COLLISION_LIES, *MOTION_LIES)

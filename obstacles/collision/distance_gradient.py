"""How the distance of a pair changes with the joints.

With n the unit direction from piece i to piece j along which their signed distance d is measured,
p the point of j that is nearest (or deepest), and z_k, o_k axis and origin of joint k,

    dd/dq_k = n . (z_k x (p - o_k))   (revolute),   n . z_k   (prismatic)

for the joints between the two, 0 for all others.
"""

from compiled.kernel import kernel
from compiled.vec3 import Vector
from kinematics.arrays import Array
from obstacles.collision.model.kernel_work import meeting_body


@kernel(allocates=False)
def distance_gradient(
    chain: Array, frames: Array, still: int, joint: int, n: Vector, p: Vector, gradient: Array
) -> None:
    """Write dd/dq (n,) of a pair.

    Args:
        chain: ``Chain.model``.
        frames: Frames of the joints, shape (n, 4, 4).
        still: The joint that carries the first piece, -1 for the base.
        joint: The joint that carries the second piece, beyond ``still``, or its body.
        n: Unit direction from the second piece to the first.
        p: The point of the second piece.
        gradient: Filled, shape (n,).
    """
    gradient[:] = 0.0
    if joint < gradient.shape[0]:
        for k in range(still + 1, joint + 1):
            gradient[k] = -_rate_along(chain, 1 + k, frames[k], n, p)
        return
    # From both bodies to the one that both hang on; what joints before that do moves neither.
    meeting = meeting_body(chain, still, joint)
    for side in range(2):
        body, sign = (joint, -1.0) if side == 0 else (still, 1.0)
        while body != meeting:
            leader, parent, row = body, body - 1, 1 + body
            share = sign
            if body >= gradient.shape[0]:
                row = int(chain[0, 3]) + 2 * (body - gradient.shape[0])
                parent, leader = int(chain[row, 13]), int(chain[row + 1, 0])
                share *= chain[row + 1, 1]
            gradient[leader] += share * _rate_along(chain, row, frames[body], n, p)
            body = parent


@kernel(allocates=False)
def _rate_along(chain: Array, row: int, F: Array, n: Vector, p: Vector) -> float:
    """Rate along n of a point p that a joint with this row and frame carries."""
    zx, zy, zz = F[0, 2], F[1, 2], F[2, 2]
    if chain[row, 0] == 0.0:
        x, y, z = p[0] - F[0, 3], p[1] - F[1, 3], p[2] - F[2, 3]
        zx, zy, zz = zy * z - zz * y, zz * x - zx * z, zx * y - zy * x
    return float(n[0] * zx + n[1] * zy + n[2] * zz)

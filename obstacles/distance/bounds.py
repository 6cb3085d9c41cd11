"""Cheap lower bounds of the distance of two pieces, from the balls and boxes that hold them."""

import math

from compiled.kernel import kernel
from compiled.vec3 import Vector
from kinematics.arrays import Array
from obstacles.distance.piece_set import CENTER, HALF, KIND, MIDDLE, POSE, RADIUS, CoreKind

_HALFSPACE = int(CoreKind.HALFSPACE)


@kernel(allocates=False)
def quick_bound(a: Array, i: int, b: Array, j: int, enough: float) -> tuple[float, Vector]:
    """A cheap lower bound [m] of the distance of two pieces, and the plane that proves it.

    From their balls, and where that is not ``enough``, from the box of each and the ball of the
    other. The normal points from j to i.
    """
    if a[i, KIND] == _HALFSPACE:
        n = (-a[i, POSE + 2], -a[i, POSE + 6], -a[i, POSE + 10])
        height = (a[i, POSE + 3] - b[j, CENTER]) * n[0] + (a[i, POSE + 7] - b[j, CENTER + 1]) * n[1]
        height += (a[i, POSE + 11] - b[j, CENTER + 2]) * n[2]
        return height - b[j, RADIUS], n
    x, y = a[i, CENTER] - b[j, CENTER], a[i, CENTER + 1] - b[j, CENTER + 1]
    z = a[i, CENTER + 2] - b[j, CENTER + 2]
    length = math.sqrt(x * x + y * y + z * z)
    bound = length - a[i, RADIUS] - b[j, RADIUS]
    scale = 1.0 / length if length > 0.0 else 0.0
    n = (x * scale, y * scale, z * scale)
    if bound > enough:
        return bound, n
    for side in range(2):
        out = _out_of_box(b, j, a, i) if side == 0 else _out_of_box(a, i, b, j)
        radius, sign = (b[j, RADIUS], -1.0) if side == 0 else (a[i, RADIUS], 1.0)
        length = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
        if length - radius > bound:
            bound = length - radius
            scale = sign / length if length > 0.0 else 0.0
            n = (out[0] * scale, out[1] * scale, out[2] * scale)
            if bound > enough:
                return bound, n
    return bound, n


@kernel(allocates=False)
def balls_apart(placed: Array, a: int, b: int) -> float:
    """Distance of the balls of two rows [m]."""
    x, y = placed[a, CENTER] - placed[b, CENTER], placed[a, CENTER + 1] - placed[b, CENTER + 1]
    z = placed[a, CENTER + 2] - placed[b, CENTER + 2]
    return float(math.sqrt(x * x + y * y + z * z) - placed[a, RADIUS] - placed[b, RADIUS])


@kernel(allocates=False)
def _out_of_box(a: Array, i: int, b: Array, j: int) -> Vector:
    """From the nearest point of the box of piece j to the centre of piece i."""
    x, y = a[i, CENTER] - b[j, POSE + 3], a[i, CENTER + 1] - b[j, POSE + 7]
    z = a[i, CENTER + 2] - b[j, POSE + 11]
    fx, fy, fz = 0.0, 0.0, 0.0
    for k in range(3):
        ex, ey, ez = b[j, POSE + k], b[j, POSE + 4 + k], b[j, POSE + 8 + k]
        local = x * ex + y * ey + z * ez - b[j, MIDDLE + k]
        out = abs(local) - b[j, HALF + k]
        if out > 0.0:
            out = out if local > 0.0 else -out
            fx += out * ex
            fy += out * ey
            fz += out * ez
    return fx, fy, fz

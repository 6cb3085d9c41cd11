"""Distances of all near pairs and how they change with the joints.

With n the unit direction from piece i to piece j along which their signed distance d is measured,
p the point of j that is nearest (or deepest), and z_k, o_k axis and origin of joint k,

    dd/dq_k = n . (z_k x (p - o_k))   (revolute),   n . z_k   (prismatic)

for the joints between the two, 0 for all others.
"""

import numpy as np

from kinematics.chain import Array, Indices
from kinematics.forward import forward_kernel
from kinematics.kernel import kernel
from obstacles.collision_model import ModelArrays
from obstacles.contact import Pieces, contact
from obstacles.gjk import Vector
from obstacles.motion import ball_bound, look_along_centers, place_piece, quick_bound


@kernel
def distance_gradient(
    model: ModelArrays, frames: Array, i: int, j: int, n: Vector, p: Vector, gradient: Array
) -> None:
    """Write dd/dq (n,) of a pair; ``n`` points from piece j to piece i, ``p`` is a point of j."""
    gradient[:] = 0.0
    for k in range(model.joints[i] + 1, model.joints[j] + 1):
        zx, zy, zz = frames[k, 0, 2], frames[k, 1, 2], frames[k, 2, 2]
        if model.joint_types[k] == 0:
            x, y, z = p[0] - frames[k, 0, 3], p[1] - frames[k, 1, 3], p[2] - frames[k, 2, 3]
            zx, zy, zz = zy * z - zz * y, zz * x - zx * z, zx * y - zy * x
        gradient[k] = -(n[0] * zx + n[1] * zy + n[2] * zz)


@kernel
def near_pairs(
    model: ModelArrays, q: Array, within: float, found: Indices, distances: Array, gradients: Array
) -> int:
    """Find the pairs whose distance, margins taken off, is at most ``within`` [m].

    Args:
        model: The packed robot and scene.
        q: Shape (n,).
        within: [m].
        found: Filled with the pairs, shape (k,).
        distances: Filled with their signed distances, margins taken off, shape (k,) [m].
        gradients: Filled with dd/dq, shape (k, n).

    Returns:
        How many were found.
    """
    n, p = q.shape[0], model.joints.shape[0]
    frames, poses, centers = np.empty((n, 4, 4)), np.empty((p, 4, 4)), np.empty((p, 3))
    axis = np.empty(3)
    pieces = Pieces(model.kinds, model.starts, model.vertices, model.sizes)
    forward_kernel(model.joint_types, model.offsets, q, frames)
    for piece in range(p):
        place_piece(model, frames, piece, poses, centers)
    count = 0
    for pair in range(model.pairs.shape[0]):
        i, j = model.pairs[pair, 0], model.pairs[pair, 1]
        far = within + model.margins[pair]
        if ball_bound(model, i, j, centers) > far or quick_bound(model, i, j, poses, centers) > far:
            continue
        look_along_centers(i, j, centers, axis)
        distance, normal, point = contact(pieces, i, poses[i], j, poses[j], axis)
        if distance > far:
            continue
        found[count], distances[count] = pair, distance - model.margins[pair]
        distance_gradient(model, frames, i, j, normal, point, gradients[count])
        count += 1
    return count

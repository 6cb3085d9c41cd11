"""Arrays of a robot in a scene for the collision kernels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.distance.piece_set import Lists


class ModelArrays(NamedTuple):
    """Arrays for kernels (n joints, p pieces of the robot, m of the scene, k pairs of the robot).

    Args:
        chain: ``Chain.model`` of the robot.
        joints: The joint that carries each row of ``robot``, -1 for the base.
        robot: Rows of the robot's pieces, each in the frame of its joint, and behind them a ball
            for each body that holds all its pieces, and balls that hold some of them, shape (p +
            balls, WIDTH).
        scene: Rows of what stands around, in the base frame, shape (m, WIDTH).
        corners: Corners of all pieces, shape (v, 3).
        tables: Tables of all pieces.
        surfaces: Trees over the triangles of those that are covers, as in ``PieceSet``.
        self_pairs: Pieces (i, j) of the robot that must stay apart, ``joints[i] < joints[j]``, so
            that j is the one that moves seen from i; by groups, shape (k, 2).
        groups: Groups of them, columns as in ``pair_groups``, shape (g, 4).
        grid_axes: Axes of ``PairGrid``, by pair of the robot, as are the next two.
        grid_starts: Starts of ``PairGrid``.
        grid_values: Values of ``PairGrid``.
        nodes: Nodes of a tree over the scene's pieces with their own margins, half-spaces left out.
        items: Items of the tree.
        skipped: Whether a piece may touch an obstacle, shape (p, obstacles).
        spheres: Spheres of ``Brackets``, as are the next.
        sphere_starts: Starts of ``Brackets``.
        bodies: Moving bodies from the outermost in: the row of its ball, and from which to before
            which entry of ``carried`` its pieces go, shape (b, 3).
        carried: Pieces that may meet obstacles, by bodies.
        halfspaces: Half-spaces of the scene.
        roots: Pairs that every search starts at: (i, -1) is piece i against the tree's first node,
            (i, k) against half-space k, (-1 - g, 0) is group g and all that it is parted into, and
            once it is parted (p + s, 0) is pair s of the robot; shape (r, 2).
        margin: Margin from obstacles beyond their own [m].
        own_margin: Margin of self-collision pairs [m].
    """

    chain: Array
    joints: Indices
    robot: Array
    scene: Array
    corners: Array
    tables: Lists
    surfaces: Array
    self_pairs: Indices
    groups: Indices
    grid_axes: Array
    grid_starts: Indices
    grid_values: Array
    nodes: Array
    items: Indices
    skipped: NDArray[np.bool_]
    spheres: Array
    sphere_starts: Indices
    bodies: Indices
    carried: Indices
    halfspaces: Indices
    roots: Indices
    margin: float
    own_margin: float


@kernel(allocates=False, inline="always")
def at_margins(model: ModelArrays, margin: float, own_margin: float) -> ModelArrays:
    """The model with other margins from obstacles and of self-collision pairs [m]."""
    return ModelArrays(
        model.chain, model.joints, model.robot, model.scene, model.corners, model.tables,
        model.surfaces, model.self_pairs, model.groups, model.grid_axes, model.grid_starts,
        model.grid_values, model.nodes, model.items, model.skipped, model.spheres,
        model.sphere_starts, model.bodies, model.carried, model.halfspaces, model.roots, margin,
        own_margin,
    )  # fmt: skip

"""Cells of time for the certificate: how far things can stray in one, and which pairs are far off.

Written apart from the planner's own kernels on purpose: a fault there must not be believed here.
"""

import math
from dataclasses import dataclass

import numpy as np

from kinematics.chain import Array, Chain, Indices
from kinematics.forward import forward_kernel
from kinematics.kernel import kernel
from kinematics.trajectory import Trajectory
from obstacles.world import World


@dataclass(frozen=True, slots=True, eq=False)
class PairTable:
    """The pairs of convex pieces that must stay apart; the robot's pieces come first.

    Args:
        pairs: Shape (k, 2); the second is a robot's piece that moves against the first.
        margins: Distance each pair must keep, shape (k,) [m].
        joints: Joint that carries each piece, -1 for what stands still, shape (p,).
        centers: Of a ball that holds each piece, in the frame of its joint, shape (p, 3).
        radii: Of these balls, shape (p,).
        boxes: Centre and half sizes of a box that holds each piece, in its own frame, (p, 6).
        poses: Frame of each piece in that of its joint, shape (p, 4, 4).
        chain: The arm.
    """

    pairs: Indices
    margins: Array
    joints: Indices
    centers: Array
    radii: Array
    boxes: Array
    poses: Array
    chain: Chain

    @classmethod
    def of(cls, world: World, margin: float) -> "PairTable":
        """The pairs of a world; from obstacles ``margin`` [m] is kept beyond their own."""
        robot = world.robot
        with_obstacle = world.pairs[:, 1] >= len(robot.pieces)
        still = world.scene.pieces()[0]
        joints = np.concatenate([robot.joints, np.full(len(still), -1, dtype=np.int64)])
        pairs = np.where(
            (joints[world.pairs[:, 0]] > joints[world.pairs[:, 1]])[:, None],
            world.pairs[:, ::-1],
            world.pairs,
        )
        return cls(
            pairs=np.ascontiguousarray(pairs),
            margins=world.margins + np.where(with_obstacle, margin, 0.0),
            joints=joints,
            centers=np.vstack([robot.arrays.centers, still.centers]),
            radii=np.concatenate([robot.arrays.radii, still.radii]),
            boxes=np.vstack([robot.arrays.boxes, still.boxes]),
            poses=np.concatenate([robot.arrays.poses, still.poses]),
            chain=robot.chain,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Intervals of time and the pairs still open on each (c cells).

    Args:
        low, high: Ends [s], shape (c,).
        pieces: The polynomial piece each lies in, shape (c,).
        starts: Open pairs of cell i are ``open_pairs[starts[i]:starts[i + 1]]``, shape (c + 1,).
        open_pairs: Flat.
    """

    low: Array
    high: Array
    pieces: Indices
    starts: Indices
    open_pairs: Indices

    def __len__(self) -> int:
        return len(self.low)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """What bounds alone could not settle, with where everything is in the middle of each cell.

    Args:
        times: Middles of the cells, shape (c,) [s].
        frames: T_base_joint there, shape (c, n, 4, 4).
        open_cells, open_pairs: What is left, shape (o,).
        open_bounds: How far each of these pairs can move against each other, shape (o,) [m].
        open_lowers: What their balls and boxes prove of their clearance on the cell, (o,) [m].
        clearance: Least clearance that bounds proved for what they settled [m].
        closest: The pair it belongs to, -1 for none.
    """

    times: Array
    frames: Array
    open_cells: Indices
    open_pairs: Indices
    open_bounds: Array
    open_lowers: Array
    clearance: float
    closest: int


def first_cells(trajectory: Trajectory, pairs: int) -> Cells:
    """One cell for each polynomial piece, every pair open on it."""
    m = trajectory.pieces
    return Cells(
        trajectory.breaks[:-1],
        trajectory.breaks[1:],
        np.arange(m),
        np.arange(m + 1) * pairs,
        np.tile(np.arange(pairs), m),
    )


def halves(cells: Cells, left: list[tuple[int, int]]) -> Cells:
    """Both halves of every cell on which a pair is left, (cell, pair) in order of cells."""
    if not left:
        empty = np.zeros(0, dtype=np.int64)
        return Cells(np.zeros(0), np.zeros(0), empty, np.zeros(1, dtype=np.int64), empty)
    table = np.array(left, dtype=np.int64)
    kept, counts = np.unique(table[:, 0], return_counts=True)
    groups = np.split(table[:, 1], np.cumsum(counts)[:-1])
    low, high = cells.low[kept], cells.high[kept]
    middle = 0.5 * (low + high)
    return Cells(
        np.column_stack([low, middle]).reshape(-1),
        np.column_stack([middle, high]).reshape(-1),
        np.repeat(cells.pieces[kept], 2),
        np.concatenate([[0], np.cumsum(np.repeat(counts, 2))]),
        np.concatenate([group for group in groups for _ in range(2)]),
    )


def settle_by_bounds(
    trajectory: Trajectory, table: PairTable, cells: Cells, enough: float
) -> Placed:
    """Settle the pairs whose balls and boxes keep their margin and ``enough`` [m] on a cell."""
    chain = table.chain
    count = len(cells.open_pairs)
    frames = np.zeros((len(cells), chain.n, 4, 4))
    frames[..., 3, 3] = 1.0
    left, bounds = np.empty((count, 2), dtype=np.int64), np.empty((count, 2))
    clearance, closest, size = settle_kernel(
        chain.joint_types, chain.offsets, trajectory.breaks, trajectory.coefficients,
        table.pairs, table.margins, table.joints, table.centers, table.radii,
        table.boxes, table.poses,
        cells.low, cells.high, cells.pieces, cells.starts, cells.open_pairs,
        enough, frames, left, bounds,
    )  # fmt: skip
    times = 0.5 * (cells.low + cells.high)
    left = left[:size]
    moved, lowers = bounds[:size].T
    return Placed(times, frames, left[:, 0], left[:, 1], moved, lowers, clearance, int(closest))


@kernel
def stray(coefficients: Array, at: float, half: float, q: Array, delta: Array) -> None:
    """Write q(at) (n,) and how far q strays from it within ``half`` of it, delta (n,).

    ``coefficients`` (n, k) are of one piece; about ``at`` they are found by repeated synthetic
    division, and |q(t) - q(at)| <= sum_(i >= 1) |c_i| half^i.
    """
    n, k = coefficients.shape
    c = np.empty(k)
    for j in range(n):
        for i in range(k):
            c[i] = coefficients[j, i]
        for first in range(k - 1):
            for i in range(k - 2, first - 1, -1):
                c[i] += at * c[i + 1]
        q[j] = c[0]
        total, power = 0.0, 1.0
        for i in range(1, k):
            power *= half
            total += abs(c[i]) * power
        delta[j] = total


@kernel
def relative_stray(
    types: Indices, frames: Array, x: float, y: float, z: float, radius: float,
    carrier: int, still: int, delta: Array,
) -> float:  # fmt: skip
    """How far a ball carried by joint ``carrier`` can move, seen from joint ``still``'s body [m].

    The ball's centre is (x, y, z) in the base frame; joints still + 1 .. carrier move.
    """
    moved = 0.0
    for j in range(carrier, still, -1):
        if types[j] == 1:
            moved += delta[j]
            continue
        dx, dy, dz = x - frames[j, 0, 3], y - frames[j, 1, 3], z - frames[j, 2, 3]
        ax, ay, az = frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]
        # Distance of the centre from the axis: |d x a|.
        cx, cy, cz = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
        lever = math.sqrt(cx * cx + cy * cy + cz * cz) + radius + moved
        # A point never strays farther than the circle's diameter.
        moved += min(lever * delta[j], 2.0 * lever)
    return moved


@kernel
def outside_box(point: Array, box: Array, T: Array) -> float:
    """Distance of a point (3,) from a box of frame T, 0 inside [m]."""
    square = 0.0
    for axis in range(3):
        local = -box[axis]
        for row in range(3):
            local += T[row, axis] * (point[row] - T[row, 3])
        out = max(abs(local) - box[3 + axis], 0.0)
        square += out * out
    return math.sqrt(square)


@kernel
def settle_kernel(
    types: Indices, offsets: Array, breaks: Array, coefficients: Array,
    pairs: Indices, margins: Array, joints: Indices, centers: Array, radii: Array,
    boxes: Array, poses: Array,
    low: Array, high: Array, pieces: Indices, starts: Indices, open_pairs: Indices,
    enough: float, frames: Array, left: Indices, bounds: Array,
) -> tuple[float, int, int]:  # fmt: skip
    """Kernel of ``settle_by_bounds``; least clearance settled, its pair, and how many are left."""
    n, p = offsets.shape[0], joints.shape[0]
    q, delta, place, now = np.empty(n), np.empty(n), np.empty((p, 3)), poses.copy()
    clearance, closest, size = np.inf, -1, 0
    for cell in range(low.shape[0]):
        piece = pieces[cell]
        at = 0.5 * (low[cell] + high[cell]) - breaks[piece]
        stray(coefficients[piece], at, 0.5 * (high[cell] - low[cell]), q, delta)
        forward_kernel(types, offsets, q, frames[cell])
        for i in range(p):
            joint = joints[i]
            for row in range(3):
                place[i, row] = centers[i, row]
                if joint >= 0:
                    F = frames[cell, joint]
                    place[i, row] = F[row, 3]
                    for k in range(3):
                        place[i, row] += F[row, k] * centers[i, k]
                    for column in range(4):
                        now[i, row, column] = F[row, 3] if column == 3 else 0.0
                        for k in range(3):
                            now[i, row, column] += F[row, k] * poses[i, k, column]
        for entry in range(starts[cell], starts[cell + 1]):
            pair = open_pairs[entry]
            i, j = pairs[pair, 0], pairs[pair, 1]
            moved = relative_stray(
                types, frames[cell], place[j, 0], place[j, 1], place[j, 2], radii[j],
                joints[j], joints[i], delta,
            )  # fmt: skip
            dx, dy = place[i, 0] - place[j, 0], place[i, 1] - place[j, 1]
            dz = place[i, 2] - place[j, 2]
            apart = math.sqrt(dx * dx + dy * dy + dz * dz) - radii[i] - radii[j]
            if apart - moved < enough:
                apart = max(apart, outside_box(place[j], boxes[i], now[i]) - radii[j])
                apart = max(apart, outside_box(place[i], boxes[j], now[j]) - radii[i])
            apart -= moved
            if apart > margins[pair] and apart >= enough:
                if apart < clearance:
                    clearance, closest = apart, pair
                continue
            left[size, 0], left[size, 1] = cell, pair
            bounds[size, 0], bounds[size, 1] = moved, apart
            size += 1
    return clearance, closest, size

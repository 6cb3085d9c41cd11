"""Stops along a motion's own path: how soon its speed can be brought to zero within its limits.

With s the motion's own time and x the square of the path's speed ds/dt, joint j has acceleration
q_j'' x + q_j' s'', |q_j''| at most its limit A_j where the motion keeps its limits. Of 0 <= x <= 1,

    s'' = -d,   0 <= d <= min_j (A_j - x max(0, -sign(q_j') q_j'')) / |q_j'|,

keeps all limits; d = 0 always does. On a cell of s that holds with the least of the right side,
and x falls by 2 d times the cell's length. A stop from anywhere in a cell follows the motion to the
end of the cell and brakes from there, so the times of as many stops as there are cells bound all.
"""

from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.trajectory.polynomial import composed_pieces
from kinematics.trajectory.trajectory import Trajectory, stay
from planning.stops.braking import BrakingLimits
from planning.stops.stop_family import derivative_interval, taylor

#: Cells of a motion at least, and their length at most [s].
_CELLS = 200
_LONGEST_CELL = 0.02
#: Speeds at the end of a motion that are at rest [rad/s or m/s].
_AT_REST = 1e-9


class PathCells(NamedTuple):
    """Cells of a motion, with what braking on them is limited by (b cells).

    Args:
        piece: Piece of the trajectory that each lies in, shape (b,).
        begin: Begin of each in its piece's own time, shape (b,) [s].
        length: Length of each, shape (b,) [s].
        speed: Largest absolute rate of each joint, shape (b, n) [rad/s or m/s].
        against: Largest acceleration of each joint against its motion, shape (b, n).
    """

    piece: Indices
    begin: Array
    length: Array
    speed: Array
    against: Array

    def deceleration(self, k: int, square: Array, limits: BrakingLimits) -> Array:
        """Deceleration of the path on cell k from squares of its speed, shape of these [1/s]."""
        left = np.maximum(limits.acceleration - square[:, None] * self.against[k], 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            least = np.where(self.speed[k] > 0.0, left / self.speed[k], np.inf)
        return np.asarray(least.min(axis=1))


class PathStops(NamedTuple):
    """Stops along a path.

    Args:
        proved: Whether the motion can be stopped everywhere: not where it ends without rest.
        longest: Bound of the longest time to rest [s].
        time: Where that begins [s].
        message: Sentence on the fault, "" where there is none.
    """

    proved: bool
    longest: float
    time: float
    message: str = ""


def path_cells(trajectory: Trajectory, begins: float = 0.0) -> PathCells:
    """Cells of a motion from an instant on."""
    breaks = trajectory.breaks
    longest = min(_LONGEST_CELL, (trajectory.duration - begins) / _CELLS)
    first = min(int(np.searchsorted(breaks, begins, side="right")) - 1, trajectory.pieces - 1)
    starts = np.maximum(breaks[first:-1], begins)
    lengths = breaks[first + 1 :] - starts
    parts = np.maximum(np.ceil(lengths / max(longest, 1e-9)), 1.0).astype(np.int64)
    own = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(own)) - np.repeat(np.cumsum(parts) - parts, parts)
    length = lengths[own] / parts[own]
    piece = own + first
    begin = starts[own] - breaks[piece] + number * length
    c = taylor(trajectory.coefficients[piece], begin + 0.5 * length)
    h = 0.5 * length[:, None] * (1.0 + 1e-12)
    v, a = (derivative_interval(c, h, order) for order in (1, 2))
    against = np.maximum(np.abs(a).max(axis=0), 0.0)
    # Where a joint keeps its direction only what brakes it already counts.
    against = np.where(v[0] > 0.0, np.maximum(-a[0], 0.0), against)
    against = np.where(v[1] < 0.0, np.maximum(a[1], 0.0), against)
    return PathCells(piece, begin, length, np.abs(v).max(axis=0), against)


def prove_path_stops(trajectory: Trajectory, limits: BrakingLimits) -> PathStops:
    """Bound the longest stop along the path of a motion that keeps its limits."""
    cells, end = path_cells(trajectory), trajectory.sample([trajectory.duration], 1)[0]
    if np.abs(end).max() > _AT_REST:
        j = int(np.abs(end).argmax())
        message = (
            f"the motion ends while {trajectory.joint_names[j]!r} moves at {end[j]:.6g}: its path "
            "does not go on to where the arm could come to rest"
        )
        return PathStops(False, np.inf, trajectory.duration, message)
    count = len(cells.piece)
    # One stop from the begin of each cell, all taken on cell by cell.
    squares, times = np.zeros(count), np.zeros(count)
    for k in range(count):
        squares[k] = 1.0
        moving = np.flatnonzero(squares[: k + 1] > 0.0)
        squares[moving], taken = _brake(cells, k, squares[moving], limits)
        times[moving] += taken
    begins = trajectory.breaks[cells.piece] + cells.begin
    # From within a cell: on to its end, at full speed, and the stop from there.
    longest = cells.length + np.append(times[1:], 0.0)
    longest[0] = max(longest[0], times[0])
    at = int(np.argmax(longest))
    return PathStops(True, float(longest[at]), float(begins[at]))


def _brake(cells: PathCells, k: int, squares: Array, limits: BrakingLimits) -> tuple[Array, Array]:
    """Squares of the path's speed after cell k, 0 once at rest, and the time taken on it [s]."""
    length = float(cells.length[k])
    slower = cells.deceleration(k, squares, limits)
    after = np.maximum(squares - 2.0 * slower * length, 0.0)
    speed = np.sqrt(squares)
    with np.errstate(divide="ignore"):
        taken = np.where(after > 0.0, 2.0 * length / (speed + np.sqrt(after)), speed / slower)
    return after, taken


def path_stop(trajectory: Trajectory, at: float, limits: BrakingLimits) -> Trajectory:
    """Quickest stop along the path that cells allow, as a trajectory from ``at`` on.

    On a cell the motion's time is a quadratic s of the stop's, so q(s) is a polynomial of twice
    the degree.

    Args:
        trajectory: The motion, at rest at its end.
        at: Instant of it at which braking begins [s].
        limits: Limits that the joints brake within.
    """
    cells = path_cells(trajectory, at)
    breaks, phases, square = [0.0], list[tuple[float, float, float]](), np.ones(1)
    for k in range(len(cells.piece)):
        slower = float(cells.deceleration(k, square, limits)[0])
        speed = float(np.sqrt(square[0]))
        square, taken = _brake(cells, k, square, limits)
        if np.isinf(slower) or not taken[0] > 0.0:
            # Nothing moves here: the arm is at rest.
            break
        phases.append((float(cells.begin[k]), speed, -0.5 * slower))
        breaks.append(breaks[-1] + float(taken[0]))
        if not square[0] > 0.0:
            break
    if not phases:
        rest = trajectory.sample([at])[0]
        return stay(trajectory.joint_names, rest)
    owners = cells.piece[: len(phases)]
    pieces = composed_pieces(trajectory.coefficients, owners, np.array(phases), 2)
    return Trajectory(trajectory.joint_names, np.array(breaks), pieces)

"""The numeric method's search for one pose: damped steps, and restarts from a table."""

import math

import numpy as np

from kinematics.chain import Array
from kinematics.forward import IDENTITY, Frame, compose_kernel, finite_kernel, move_kernel
from kinematics.ik.step import (
    State,
    error_kernel,
    frame_kernel,
    step_within_kernel,
    uniform_kernel,
)
from kinematics.jacobian import frame_and_jacobian_kernel
from kinematics.kernel import kernel
from kinematics.turns import turns_kernel

#: Steps from one start; most that converge at all do so in a quarter of it.
STEPS = 60
#: A start is given up after so many steps in a row without this factor of the squared error; one
#: in so many starts is given more, for poses near singularities.
PATIENCE, GAIN = 1, 0.7
LONG, LONG_PATIENCE, LONG_GAIN = 5, 8, 0.9
#: mu at the start and what a good or bad step makes of it.
DAMPING, LESS, MORE = 0.1, 0.7, 6.0
LEAST_MU, LEAST_DAMPING = 1e-7, 1e-13
#: Random draws of which the nearest is the next start.
_DRAWS = 2
#: Configurations whose frames are known beforehand, those among which a start is chosen, and
#: where only some axes count.
ROWS, _LOOK, _MASKED, TABLE_SEED = 4096, 64, 32, 1
#: What a radian weighs against a reach of metres.
WEIGHT = 0.18


@kernel
def weigh_kernel(
    error: tuple[float, float, float, float, float, float], T: Frame, axes: Array, w: float,
    e: Array,
) -> tuple[float, float, float]:  # fmt: skip
    """Write the weighed error (6,); answer its square and the errors [m], [rad] that count."""
    x, y, z, a, b, c = error
    if axes[6] != 0.0:
        x, y, z = (
            T[0] * x + T[4] * y + T[8] * z, T[1] * x + T[5] * y + T[9] * z,
            T[2] * x + T[6] * y + T[10] * z,
        )  # fmt: skip
        a, b, c = (
            T[0] * a + T[4] * b + T[8] * c, T[1] * a + T[5] * b + T[9] * c,
            T[2] * a + T[6] * b + T[10] * c,
        )  # fmt: skip
        x, y, z = axes[0] * x, axes[1] * y, axes[2] * z
        a, b, c = axes[3] * a, axes[4] * b, axes[5] * c
    e[0], e[1], e[2], e[3], e[4], e[5] = x, y, z, w * a, w * b, w * c
    position, rotation = x * x + y * y + z * z, a * a + b * b + c * c
    return position + w * w * rotation, math.sqrt(position), math.sqrt(rotation)


@kernel
def weigh_jacobian_kernel(T: Frame, axes: Array, w: float, J: Array) -> None:
    """The same for the columns of J (6, n), in place."""
    for j in range(J.shape[1]):
        if axes[6] == 0.0:
            J[3, j], J[4, j], J[5, j] = w * J[3, j], w * J[4, j], w * J[5, j]
            continue
        for k in range(2):
            i = 3 * k
            x, y, z = J[i, j], J[i + 1, j], J[i + 2, j]
            scale = w if k == 1 else 1.0
            J[i, j] = scale * axes[i] * (T[0] * x + T[4] * y + T[8] * z)
            J[i + 1, j] = scale * axes[i + 1] * (T[1] * x + T[5] * y + T[9] * z)
            J[i + 2, j] = scale * axes[i + 2] * (T[2] * x + T[6] * y + T[10] * z)


@kernel
def draw_kernel(
    model: Array, link: int, T: Frame, axes: Array, lower: Array, upper: Array, w: float,
    state: State, trial: Array, e: Array, room: Array, q: Array,
) -> None:  # fmt: skip
    """Put the nearest of some random draws into q; joints behind the link stay as they are.

    ``room`` is (6, n), where turns can stand.
    """
    row = 1 + q.shape[0] + link
    last = int(model[row, 0])
    for j in range(q.shape[0]):
        trial[j] = q[j]
    nearest = np.inf
    for _ in range(_DRAWS):
        for j in range(last + 1):
            trial[j] = lower[j] + uniform_kernel(state) * (upper[j] - lower[j])
        turns_kernel(trial, room[0], room[1])
        B = IDENTITY
        for j in range(last + 1):
            B = move_kernel(model, 1 + j, trial[j], room[0, j], room[1, j], B)
        B = compose_kernel(B, model, row)
        square, _, _ = weigh_kernel(error_kernel(B, T), T, axes, w, e)
        if square < nearest:
            nearest = square
            for j in range(last + 1):
                q[j] = trial[j]


@kernel
def pick_kernel(
    table: Array, T: Frame, axes: Array, w: float, state: State, last: int, e: Array, near: Array,
    q: Array,
) -> None:  # fmt: skip
    """Put into q that of some neighbouring rows of the table whose frame is nearest to T.

    Args:
        table: Configurations and their frames by columns, shape (n + 12, k); the rotation's rows
            times w / sqrt(2), so that squares add up as those of small errors do.
        T: The target.
        axes: As ``solve_kernel`` has it.
        w: Weight of a radian [m].
        state: Of the draws.
        last: The last joint that moves the link.
        e: Room (6,).
        near: Room, as many as rows are looked at.
        q: The answer (n,); joints behind ``last`` stay as they are.
    """
    n, k = q.shape[0], near.shape[0]
    begin = int(uniform_kernel(state) * (table.shape[1] - k))
    if axes[6] == 0.0:
        for i in range(k):
            near[i] = 0.0
        for row in range(12):
            wanted = T[row] if row % 4 == 3 else w * math.sqrt(0.5) * T[row]
            column = table[n + row, begin : begin + k]
            for i in range(k):
                near[i] += (column[i] - wanted) * (column[i] - wanted)
    else:
        r = math.sqrt(2.0) / w
        k = min(k, _MASKED)
        for i in range(k):
            c = begin + i
            B = (
                r * table[n, c], r * table[n + 1, c], r * table[n + 2, c], table[n + 3, c],
                r * table[n + 4, c], r * table[n + 5, c], r * table[n + 6, c], table[n + 7, c],
                r * table[n + 8, c], r * table[n + 9, c], r * table[n + 10, c], table[n + 11, c],
            )  # fmt: skip
            near[i], _, _ = weigh_kernel(error_kernel(B, T), T, axes, w, e)
    best = 0
    for i in range(1, k):
        if near[i] < near[best]:
            best = i
    for j in range(last + 1):
        q[j] = table[j, begin + best]


@kernel
def table_kernel(
    model: Array, link: int, lower: Array, upper: Array, w: float, seed: int, table: Array
) -> None:
    """Fill a table for ``pick_kernel`` with random configurations (n + 12, k)."""
    n = lower.shape[0]
    q, room = np.empty(n), np.empty((6, n))
    state = np.empty(1, dtype=np.uint64)
    state[0] = np.uint64(seed)
    scale = w * math.sqrt(0.5)
    for i in range(table.shape[1]):
        for j in range(n):
            q[j] = lower[j] + uniform_kernel(state) * (upper[j] - lower[j])
            table[j, i] = q[j]
        B = frame_and_jacobian_kernel(model, q, link, room)
        for row in range(12):
            table[n + row, i] = B[row] if row % 4 == 3 else scale * B[row]


@kernel
def solve_kernel(
    model: Array, link: int, target: Array, axes: Array, bounds: Array, table: Array,
    scales: tuple[float, float, float], starts: int, spent: int, seed: int, start: Array,
    best: Array,
) -> int:  # fmt: skip
    """Search from ``start`` (n,), then from random draws, until the tolerances are met.

    Fills ``best`` (n + 4,) with the nearest configuration, its position error, orientation error,
    the steps and the starts spent.

    Args:
        model: ``Chain.model``.
        link: The number of the link to bring there, -1 for the tip.
        target: T_base_link, shape (4, 4).
        axes: 1 for each row of the error in the target's frame that counts, and whether some do
            not, shape (7,).
        bounds: Limits, lower and upper, and where random starts are drawn from, shape (4, n).
        table: What most restarts are taken from, see ``pick_kernel``.
        scales: Tolerance of position [m], of orientation [rad], and the weight of a radian [m].
        starts: How many to spend in all.
        spent: Starts that were spent before; above 0 it begins with a draw instead of ``start``.
        seed: Of the draws.
        start: Inside the limits.
        best: The answer.

    Returns:
        1 when the tolerances are met, 0 when not, -1 where ``start`` is not one finite number a
        joint, -2 where the target is not finite.
    """
    n = start.shape[0]
    if n != int(model[0, 0]) or not finite_kernel(start):
        return -1
    for row in range(3):
        for column in range(4):
            if not math.isfinite(target[row, column]):
                return -2
    if link < 0:
        link = int(model[0, 1])
    T = frame_kernel(target)
    state = np.empty(1, dtype=np.uint64)
    state[0] = np.uint64(seed) + np.uint64(0xD1342543DE82EF95) * np.uint64(spent)
    # One piece of memory for all: each costs as much as a joint does.
    look, wide = min(_LOOK, table.shape[1]), max(n, 6)
    room = np.empty(14 * n + n * n + 12 + wide + look)
    q, trial, room = room[:n], room[n : 2 * n], room[2 * n :]
    J, J_trial = room[: 6 * n].reshape((6, n)), room[6 * n : 12 * n].reshape((6, n))
    H, room = room[12 * n : 12 * n + n * n].reshape((n, n)), room[12 * n + n * n :]
    e, e_trial, g, near = room[:6], room[6:12], room[12 : 12 + wide], room[12 + wide :]
    free, last = np.empty(n, dtype=np.int64), int(model[1 + n + link, 0])
    lower, upper, w = bounds[0], bounds[1], scales[2]
    for j in range(n):
        q[j] = min(max(start[j], lower[j]), upper[j])
    least, steps = np.inf, 0
    for attempt in range(spent, starts):
        if attempt > 0 and attempt % LONG != LONG - 1:
            pick_kernel(table, T, axes, w, state, last, e, near, q)
        elif attempt > 0:
            draw_kernel(model, link, T, axes, bounds[2], bounds[3], w, state, trial, e, J, q)
        patience, gain = PATIENCE, GAIN
        if attempt % LONG == LONG - 1:
            patience, gain = LONG_PATIENCE, LONG_GAIN
        B = frame_and_jacobian_kernel(model, q, link, J)
        square, position, rotation = weigh_kernel(error_kernel(B, T), T, axes, w, e)
        weigh_jacobian_kernel(T, axes, w, J)
        mu, stale, mark = DAMPING, 0, square
        for _ in range(STEPS):
            if position <= scales[0] and rotation <= scales[1]:
                break
            damping = mu * square + LEAST_DAMPING
            step_within_kernel(J, e, q, lower, upper, damping, free, H, g, trial)
            steps += 1
            B = frame_and_jacobian_kernel(model, trial, link, J_trial)
            after, position_after, rotation_after = weigh_kernel(
                error_kernel(B, T), T, axes, w, e_trial
            )
            if after < square:
                q, trial = trial, q
                J, J_trial = J_trial, J
                e, e_trial = e_trial, e
                square, position, rotation = after, position_after, rotation_after
                weigh_jacobian_kernel(T, axes, w, J)
                mu = max(LESS * mu, LEAST_MU)
            else:
                mu = MORE * mu
            stale += 1
            if square < gain * mark:
                mark, stale = square, 0
            if stale > patience:
                break
        done = position <= scales[0] and rotation <= scales[1]
        if square < least or done:
            least = square
            for j in range(n):
                best[j] = q[j]
            best[n], best[n + 1] = position, rotation
        if done:
            best[n + 2], best[n + 3] = steps, attempt + 1
            return 1
    best[n + 2], best[n + 3] = steps, starts
    return 0

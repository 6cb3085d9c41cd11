"""The numeric method's search for one pose: damped steps, and restarts from a table."""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.random import State, uniform_kernel
from compiled.simd import LANES, Lanes, choose, fill, load, on_stack, store
from compiled.sincos import TURNS, few_turns_kernel, turn_at_kernel
from kinematics.arrays import Array
from kinematics.forward import finite_kernel
from kinematics.frame import IDENTITY, Frame, compose_kernel, frame_kernel, move_kernel
from kinematics.ik.numeric.dls_step import Error, error_kernel, step_within_kernel
from kinematics.jacobian import frame_and_jacobian_kernel
from kinematics.model.chain import MAX_JOINTS
from kinematics.simd_frames import FRAME, FRAME_SIZE, load_frame_kernel

#: Steps from one start; most that converge at all do so in a quarter of it.
STEPS = 60
#: A start is given up after more than so many steps in a row without progress.
PATIENCE = 1
#: Progress is a squared error below this share of that before.
GAIN = 0.7
#: One start in so many is given more patience, for poses near singularities.
LONG = 5
#: Patience of such a start [steps].
LONG_PATIENCE = 8
#: Progress of such a start.
LONG_GAIN = 0.9
#: Damping factor mu of a start's first step.
DAMPING = 0.1
#: Factor of mu after a step that helps.
LESS = 0.7
#: Factor of mu after a step that does not.
MORE = 6.0
#: The least mu.
LEAST_MU = 1e-7
#: The least damping term.
LEAST_DAMPING = 1e-13
#: Random draws of which the nearest is the next start.
_DRAWS = 2
#: Configurations whose frames are known beforehand.
ROWS = 4096
#: Those among which a start is chosen.
LOOK = 64
#: Those where only some axes count, which costs more for each.
_MASKED = 32
#: Seed of the known configurations.
TABLE_SEED = 1
#: Numbers of a Jacobian.
_JACOBIAN_SIZE = 6 * MAX_JOINTS
#: Numbers of what ``pick_kernel`` works in: two vectors.
NEAR_SIZE = 2 * LANES
#: Weight of a radian against a reach of metres.
WEIGHT = 0.18


class SearchSpace(NamedTuple):
    """A chain up to a link, and where the search for its poses starts.

    Args:
        model: ``Chain.model``.
        link: Number of the link to bring to a pose.
        bounds: Lower and upper limits, and the bounds that random starts are drawn between, shape
            (4, n) [rad or m].
        table: Frames and configurations that most restarts are taken from: eight frames and their
            configurations in a row of vectors, twelve and n, one such row after the other; the
            rotations times weight / sqrt(2), so that squares add up as those of small errors do.
        weight: Weight of a radian [m].
    """

    model: Array
    link: int
    bounds: Array
    table: Array
    weight: float


class SearchSettings(NamedTuple):
    """Settings of a search.

    Args:
        axes: 1 for each row of the error in the target's frame that counts, else 0, and whether
            some do not, shape (7,).
        position_tolerance: Largest distance of a solution from its target [m].
        orientation_tolerance: Largest angle of a solution from its target [rad].
        starts: Starts to spend in all, on each pose.
        seed: Seed of the random draws.
    """

    axes: Array
    position_tolerance: float
    orientation_tolerance: float
    starts: int
    seed: int


@kernel(inline="code")
def weigh_kernel(
    error: Error, T: Frame, axes: Array, w: float
) -> tuple[Error, Lanes, Lanes, Lanes]:
    """The weighed error, its square, and the errors [m], [rad] that count; also of vectors."""
    x, y, z, a, b, c = error
    if axes[6] != 0.0:
        x, y, z, a, b, c = seen_kernel(error, T, axes)
    position, rotation = x * x + y * y + z * z, a * a + b * b + c * c
    weighed = (x, y, z, w * a, w * b, w * c)
    return weighed, position + w * w * rotation, math.sqrt(position), math.sqrt(rotation)


@kernel(inline="code")
def seen_kernel(column: Error, T: Frame, axes: Array) -> Error:
    """Six rows as the target's frame sees them, those that do not count 0."""
    x, y, z, a, b, c = column
    return (
        axes[0] * (T[0] * x + T[4] * y + T[8] * z), axes[1] * (T[1] * x + T[5] * y + T[9] * z),
        axes[2] * (T[2] * x + T[6] * y + T[10] * z), axes[3] * (T[0] * a + T[4] * b + T[8] * c),
        axes[4] * (T[1] * a + T[5] * b + T[9] * c), axes[5] * (T[2] * a + T[6] * b + T[10] * c),
    )  # fmt: skip


@kernel(inline="code")
def weigh_column_kernel(column: Error, T: Frame, axes: Array, w: float) -> Error:
    """The weighed column of a Jacobian, of numbers or of vectors."""
    if axes[6] != 0.0:
        x, y, z, a, b, c = seen_kernel(column, T, axes)
    else:
        x, y, z, a, b, c = column
    return x, y, z, w * a, w * b, w * c


@kernel(allocates=False)
def weigh_jacobian_kernel(T: Frame, axes: Array, w: float, J: Array) -> None:
    """Weigh all columns of J (6, n) in place."""
    for j in range(J.shape[1]):
        column = (J[0, j], J[1, j], J[2, j], J[3, j], J[4, j], J[5, j])
        J[0, j], J[1, j], J[2, j], J[3, j], J[4, j], J[5, j] = weigh_column_kernel(
            column, T, axes, w
        )


@kernel(allocates=False)
def draw_kernel(
    space: SearchSpace, T: Frame, axes: Array, state: State, trial: Array, q: Array
) -> None:
    """Put the nearest of some random draws into q; joints behind the link stay as they are.

    Args:
        space: The chain.
        T: The target.
        axes: ``SearchSettings.axes``.
        state: State of the draws.
        trial: Workspace, shape (n,).
        q: The answer, shape (n,).
    """
    model, lower, upper = space.model, space.bounds[2], space.bounds[3]
    row = 1 + q.shape[0] + space.link
    last = int(model[row, 0])
    for j in range(q.shape[0]):
        trial[j] = q[j]
    nearest, turns = np.inf, on_stack(TURNS)
    for _ in range(_DRAWS):
        for j in range(last + 1):
            trial[j] = lower[j] + uniform_kernel(state) * (upper[j] - lower[j])
        few, B = few_turns_kernel(trial, turns), IDENTITY
        for j in range(last + 1):
            c, s = turn_at_kernel(trial, j, few, turns)
            B = move_kernel(model, 1 + j, trial[j], c, s, B)
        B = compose_kernel(B, model, row)
        _, square, _, _ = weigh_kernel(error_kernel(B, T), T, axes, space.weight)
        if square < nearest:
            nearest = square
            for j in range(last + 1):
                q[j] = trial[j]


@kernel(allocates=False)
def pick_kernel(
    space: SearchSpace, T: Frame, axes: Array, state: State, near: Array, q: Array
) -> None:
    """Put into q that of some neighbouring rows of the table whose frame is nearest to T.

    Args:
        space: The chain and its table.
        T: The target.
        axes: ``SearchSettings.axes``.
        state: State of the draws.
        near: Workspace, shape (NEAR_SIZE,).
        q: The answer, shape (n,); joints behind the link stay as they are.
    """
    table, w = space.table, space.weight
    last = int(space.model[1 + q.shape[0] + space.link, 0])
    wide = LANES * (q.shape[0] + FRAME)
    begin = int(uniform_kernel(state) * (table.shape[0] // wide - LOOK // LANES))
    scale, look = w * math.sqrt(0.5), LOOK // LANES
    least, which = fill(np.inf), fill(0.0)
    if axes[6] == 0.0:
        wanted = (
            scale * T[0], scale * T[1], scale * T[2], T[3], scale * T[4], scale * T[5],
            scale * T[6], T[7], scale * T[8], scale * T[9], scale * T[10], T[11],
        )  # fmt: skip
        for i in range(look):
            at, square = wide * (begin + i), fill(0.0)
            for value in wanted:
                away = load(table, at) - value
                square = square + away * away
                at += LANES
            nearer = square < least
            least, which = choose(nearer, square, least), choose(nearer, 1.0 * i, which)
    else:
        look, r = _MASKED // LANES, math.sqrt(2.0) / w
        for i in range(look):
            f = load_frame_kernel(table, wide * (begin + i))
            B = (
                r * f[0], r * f[1], r * f[2], f[3], r * f[4], r * f[5], r * f[6], f[7],
                r * f[8], r * f[9], r * f[10], f[11],
            )  # fmt: skip
            _, square, _, _ = weigh_kernel(error_kernel(B, T), T, axes, w)
            nearer = square < least
            least, which = choose(nearer, square, least), choose(nearer, 1.0 * i, which)
    store(near, 0, least)
    store(near, LANES, which)
    best = 0
    for lane in range(1, LANES):
        if near[lane] < near[best]:
            best = lane
    at = wide * (begin + int(near[LANES + best])) + FRAME_SIZE + best
    for j in range(last + 1):
        q[j] = table[at + LANES * j]


@kernel
def table_kernel(
    model: Array, link: int, lower: Array, upper: Array, w: float, seed: int, table: Array
) -> None:
    """Fill a table for ``pick_kernel`` with random configurations, (n + 12) numbers for each."""
    n = lower.shape[0]
    q, room = np.empty(n), np.empty((6, n))
    state = np.empty(1, dtype=np.uint64)
    state[0] = np.uint64(seed)
    scale, wide = w * math.sqrt(0.5), LANES * (n + FRAME)
    for i in range(table.shape[0] // (n + FRAME)):
        at = wide * (i // LANES) + i % LANES
        for j in range(n):
            q[j] = lower[j] + uniform_kernel(state) * (upper[j] - lower[j])
            table[at + FRAME_SIZE + LANES * j] = q[j]
        B = frame_and_jacobian_kernel(model, q, link, room)
        for row in range(FRAME):
            table[at + LANES * row] = B[row] if row % 4 == 3 else scale * B[row]


@kernel(allocates=False)
def search_kernel(  # noqa: C901, PLR0912, PLR0915
    space: SearchSpace, settings: SearchSettings, target: Array, spent: int, start: Array,
    best: Array,
) -> tuple[int, float, float, int, int]:  # fmt: skip
    """Search from ``start``, then from random draws, until the tolerances are met.

    Args:
        space: The chain up to the link.
        settings: Settings of the search.
        target: T_base_link, shape (4, 4).
        spent: Starts that were spent before; above 0 it begins with a draw instead of ``start``.
        start: Configuration to begin at, shape (n,).
        best: The nearest configuration, shape (n,).

    Returns:
        1 when the tolerances are met, 0 when not, -1 where ``start`` is not one finite number a
        joint, -2 where the target is not finite; then the errors of ``best``, and the steps and
        starts spent.
    """
    model, link, w, axes = space.model, space.link, space.weight, settings.axes
    position_tolerance = settings.position_tolerance
    orientation_tolerance = settings.orientation_tolerance
    n = start.shape[0]
    if n != int(model[0, 0]) or not finite_kernel(start):
        return -1, 0.0, 0.0, 0, 0
    for row in range(3):
        for column in range(4):
            if not math.isfinite(target[row, column]):
                return -2, 0.0, 0.0, 0, 0
    T = frame_kernel(target)
    state = on_stack(1).view(np.uint64)
    state[0] = np.uint64(settings.seed) + np.uint64(0xD1342543DE82EF95) * np.uint64(spent)
    q, trial = on_stack(MAX_JOINTS)[:n], on_stack(MAX_JOINTS)[:n]
    J = on_stack(_JACOBIAN_SIZE)[: 6 * n].reshape((6, n))
    J_trial = on_stack(_JACOBIAN_SIZE)[: 6 * n].reshape((6, n))
    free, e, near = on_stack(MAX_JOINTS).view(np.int64), on_stack(6), on_stack(NEAR_SIZE)
    lower, upper = space.bounds[0], space.bounds[1]
    for j in range(n):
        q[j] = min(max(start[j], lower[j]), upper[j])
    least, errors, steps = np.inf, (np.inf, np.inf), 0
    for attempt in range(spent, settings.starts):
        if attempt > 0 and attempt % LONG != LONG - 1:
            pick_kernel(space, T, axes, state, near, q)
        elif attempt > 0:
            draw_kernel(space, T, axes, state, trial, q)
        patience, gain = PATIENCE, GAIN
        if attempt % LONG == LONG - 1:
            patience, gain = LONG_PATIENCE, LONG_GAIN
        B = frame_and_jacobian_kernel(model, q, link, J)
        weighed, square, position, rotation = weigh_kernel(error_kernel(B, T), T, axes, w)
        e[0], e[1], e[2], e[3], e[4], e[5] = weighed
        weigh_jacobian_kernel(T, axes, w, J)
        mu, stale, mark = DAMPING, 0, square
        for _ in range(STEPS):
            if position <= position_tolerance and rotation <= orientation_tolerance:
                break
            damping = mu * square + LEAST_DAMPING
            step_within_kernel(J, e, q, lower, upper, damping, free, trial)
            steps += 1
            B = frame_and_jacobian_kernel(model, trial, link, J_trial)
            weighed, after, position_after, rotation_after = weigh_kernel(
                error_kernel(B, T), T, axes, w
            )
            if after < square:
                q, trial = trial, q
                J, J_trial = J_trial, J
                e[0], e[1], e[2], e[3], e[4], e[5] = weighed
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
        done = position <= position_tolerance and rotation <= orientation_tolerance
        if square < least or done:
            least = square
            for j in range(n):
                best[j] = q[j]
            errors = (position, rotation)
        if done:
            return 1, position, rotation, steps, attempt + 1
    return 0, errors[0], errors[1], steps, settings.starts

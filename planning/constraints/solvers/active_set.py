"""Constrained inverse kinematics in one kernel: feasible first, then ever better.

From a start, steps of least length that meet all constraints to first order bring q into the
feasible set (Newton's method on inequalities); where they contradict each other, the damped least
squares of what is violated leads on. From there each step goes down the objective inside the
linearised constraints and is brought back into the set before it counts, so that every iterate
holds. Constraints are the rows, the joint limits, and the signed distances of near pairs.
Sources: "Sequential quadratic programming methods" in "Numerical Optimization", chapter 18;
the steps' quadratic programs are solved by ``least_distance``.
"""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from obstacles.collision.model.model_arrays import ModelArrays
from planning.constraints.solvers.active_set_program import (
    ENDED,
    GAIN,
    LEFT,
    SHARE,
    Goal,
    Work,
    linearise,
    make_work,
    objective_kernel,
    slope_kernel,
)
from planning.constraints.solvers.least_distance import least_distance

#: Residuals that count as none [unit of the row].
FEASIBLE = 1e-9
#: Steps into the feasible set at most, and down the objective in it.
_MAX_STEPS = 40
#: How often a step is shortened.
_SHORTENINGS = 5
#: Columns of a descent's course: its worst violation, its objective, whether it is inside the
#: feasible set (1) or over (2), and its steps there.
WORST, OBJECTIVE, STAGE, TAKEN = range(4)
COURSE = 4
_OUTSIDE, _INSIDE, OVER = 0.0, 1.0, 2.0


@kernel
def damped_step(work: Work, count: int, total: float, dq: Array) -> None:
    """Damped least squares of the violated constraints."""
    n = dq.shape[0]
    H, g = np.zeros((n, n)), np.zeros(n)
    for i in range(count):
        if work.b[i] < 0.0:
            for j in range(n):
                g[j] += work.A[i, j] * work.b[i]
                for k in range(n):
                    H[j, k] += work.A[i, j] * work.A[i, k]
    for j in range(n):
        # Damping by the sum of squared violations, and a little where there are none.
        H[j, j] += 0.1 * total + 1e-9
    dq[:] = np.linalg.solve(H, g)


@kernel(allocates=False)
def _shortened_step(goal: Goal, q: Array, dq: Array, share: float, trial: Array) -> float:
    """Write q + share dq, shortened and inside the limits; the longest step of a joint."""
    longest = 0.0
    for j in range(q.shape[0]):
        longest = max(longest, abs(dq[j]))
    # A joint steps 0.6 rad or m at most.
    scale = share * min(1.0, 0.6 / max(longest, 1e-300))
    for j in range(q.shape[0]):
        trial[j] = min(max(q[j] + scale * dq[j], goal.lower[j]), goal.upper[j])
    return scale * longest


@kernel
def make_feasible(
    model: ModelArrays | None, goal: Goal, q: Array, steps: int, work: Work, trial: Array, dq: Array
) -> float:
    """Bring q (n,) into the feasible set, in place; the worst violation that is left.

    ``work.pace`` tells whether another step would be in vain. Without linearisations left it ends
    in the midst of a step, which is then not taken.
    """
    zero = np.zeros(q.shape[0])
    count, worst, total = linearise(model, goal, q, work)
    work.pace[ENDED] = 0.0
    for _ in range(steps):
        if worst <= FEASIBLE:
            break
        exact = least_distance(work.A, work.b, count, zero, dq)
        if not exact:
            damped_step(work, count, total, dq)
        share, better = 1.0, False
        for _ in range(_SHORTENINGS):
            if work.pace[LEFT] <= 0.0:
                return worst
            _shortened_step(goal, q, dq, share, trial)
            count, new_worst, new_total = linearise(model, goal, trial, work)
            if new_total < total:
                better = True
                break
            share *= 0.3
        if not better:
            work.pace[ENDED] = 1.0
            break
        stalled = new_total > 0.98 * total
        worst, total = new_worst, new_total
        q[:] = trial
        if stalled:
            work.pace[ENDED] = 1.0
            break
    return worst


@kernel
def improve(
    model: ModelArrays | None, goal: Goal, q: Array, steps: int, work: Work, trial: Array, dq: Array
) -> float:
    """Go down the objective inside the feasible set, in place; the worst violation in the end.

    ``work.pace`` is read and written as by ``make_feasible``, whose corrections it calls for.
    """
    n = q.shape[0]
    H, best = np.empty((n, n)), q.copy()
    AL = np.empty_like(work.A)
    value = objective_kernel(goal, q, work)
    share, worst, ended = work.pace[SHARE], 0.0, 0.0
    for _ in range(steps):
        slope_kernel(goal, q, work, H)
        # In y = L^T dq the step is a least-distance problem.
        inverse = np.linalg.inv(np.linalg.cholesky(H)).T
        d = -(np.ascontiguousarray(inverse.T) @ work.slope)
        count, _, _ = linearise(model, goal, q, work)
        for i in range(count):
            for j in range(n):
                total = 0.0
                for k in range(n):
                    total += work.A[i, k] * inverse[k, j]
                AL[i, j] = total
        y = np.empty(n)
        if not least_distance(AL, work.b, count, d, y):
            ended = 1.0
            break
        dq[:] = np.ascontiguousarray(inverse) @ y
        gained, longest = 0.0, 0.0
        for _ in range(_SHORTENINGS):
            longest = _shortened_step(goal, best, dq, share, trial)
            q[:] = trial
            # Four corrections after a step down the objective.
            worst = make_feasible(model, goal, q, 4, work, trial, y)
            if worst <= FEASIBLE:
                gained = value - objective_kernel(goal, q, work)
                if gained > 0.0:
                    break
            gained = 0.0
            if work.pace[LEFT] <= 0.0:
                break
            share *= 0.4
        if gained <= 0.0:
            ended = 1.0 if work.pace[LEFT] > 0.0 else 0.0
            break
        share = min(1.0, 2.0 * share)
        best[:] = q
        value -= gained
        if gained < work.pace[GAIN] * (1.0 + abs(value)) or longest < 1e-9:
            ended = 1.0
            break
    q[:] = best
    work.pace[ENDED], work.pace[SHARE] = ended, share
    return worst


@kernel
def go_on(
    model: ModelArrays | None, goal: Goal, q: Array, steps: int, work: Work, course: Array
) -> None:
    """Take up to ``steps`` more steps of a descent, in place.

    Args:
        model: The robot in its scene; None where nothing can collide.
        goal: Goal as in ``Goal``.
        q: Configuration of the descent, shape (n,).
        steps: Number of steps, at least 1.
        work: Memory of ``make_work``, with linearisations left.
        course: Zeros at first, shape (COURSE,).
    """
    trial, dq = np.empty(q.shape[0]), np.empty(q.shape[0])
    course[TAKEN] += steps
    if course[STAGE] == _OUTSIDE:
        course[WORST] = make_feasible(model, goal, q, steps, work, trial, dq)
        if course[WORST] <= FEASIBLE:
            course[STAGE], course[TAKEN] = _INSIDE, 0.0
            work.pace[SHARE], work.pace[ENDED] = 1.0, 0.0
    else:
        improve(model, goal, q, steps, work, trial, dq)
    if work.pace[ENDED] > 0.0 or course[TAKEN] >= _MAX_STEPS:
        course[STAGE] = OVER
    course[OBJECTIVE] = objective_kernel(goal, q, work)


@kernel
def descend(model: ModelArrays | None, goal: Goal, q: Array, found: Array) -> None:
    """From q (n,), in place, to a configuration that holds everything and is locally best.

    ``found`` (2,) is filled with the worst violation and the objective.
    """
    work, course = make_work(model, goal), np.zeros(COURSE)
    while course[STAGE] != OVER:
        go_on(model, goal, q, _MAX_STEPS, work, course)
    found[0], found[1] = course[WORST], course[OBJECTIVE]

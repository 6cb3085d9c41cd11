"""From a candidate of a closed form to a verified solution of the true chain.

Each candidate is verified by forward kinematics; what misses the tolerance, since the arm misses
the form a little or its limits cut off a rounding error, is polished by damped steps. Angles are
taken by whole turns into the limits, nearest to the seed.

Eight candidates, rows of cosines and sines (see ``spherical``), are verified at once in SIMD lanes.
A lane computes what a single number would, to the last bit, so that a branch does not depend on its
neighbours.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.simd import (
    LANES,
    Conditions,
    Lanes,
    anywhere,
    bits,
    choose,
    fill,
    floor,
    load,
    store,
)
from kinematics.arrays import Array
from kinematics.frame import IDENTITY, Frame, compose_kernel, move_kernel, step_kernel, turn_kernel
from kinematics.ik.closed_form.parallel import parallel_kernel
from kinematics.ik.closed_form.redundant import arm_angle_kernel, redundant_kernel
from kinematics.ik.closed_form.spherical import flange_kernel, spherical_kernel
from kinematics.ik.closed_form.structure import (
    BRANCH,
    FAMILY,
    HEADER,
    HELD,
    INDEX,
    KIND,
    LOCKED,
    LOCKED_TIP,
    PARAMETER,
    REDUNDANT,
    REVERSED,
    SIGN,
    SPHERICAL,
    THREE_PARALLEL,
    Arm,
    CandidateTable,
    Problem,
)
from kinematics.ik.numeric.dls_step import (
    error_kernel,
    quadrant_kernel,
    step_within_kernel,
)
from kinematics.jacobian import frame_and_jacobian_kernel
from kinematics.model.chain import MAX_JOINTS
from kinematics.simd_frames import identity_lanes_kernel

#: An angle this little outside a limit [rad] is rounding of a double root, and put onto it.
_SNAP = 1e-6
#: Rows of vectors behind four for each joint: errors [m], [rad], and whether inside the limits.
_BEHIND = 3
#: Room for what ``verify_kernel`` answers.
VERIFIED = LANES * (4 * MAX_JOINTS + _BEHIND)


@kernel(inline="code")
def near_kernel(
    angle: Lanes, lower: float, upper: float, seed: float
) -> tuple[Lanes, Conditions, Conditions]:
    """The angle by whole turns nearest to the seed, inside the limits if it can be.

    Also whether it is inside, and whether it had to be put onto a limit for that.
    """
    turn = 2.0 * math.pi
    best = angle + turn * floor((seed - angle) / turn + 0.5)
    above, below = best > upper, best < lower
    inside, snapped = (best >= lower) & (best <= upper), above & below
    if anywhere(above | below):
        # So many turns, rounded up, take it to the limit that it is beyond.
        low = best + turn * floor((upper + _SNAP - best) / turn)
        high = best - turn * floor((best + _SNAP - lower) / turn)
        moved = choose(above, low, high)
        clipped = min(max(moved, lower), upper)
        within = (above & (low >= lower - _SNAP)) | (below & (high <= upper + _SNAP))
        snapped = within & ((moved < lower) | (moved > upper))
        best = choose(within, clipped, best)
        inside = inside | within
    return best, inside, snapped


@kernel(inline="code")
def miss_kernel(B: Frame, T: Frame) -> tuple[Lanes, Lanes]:
    """Distance [m] and 2 sin(angle / 2), the angle [rad] where it is small, between two frames.

    The squared distance of their rotations is 8 sin^2(angle / 2).
    """
    x, y, z = T[3] - B[3], T[7] - B[7], T[11] - B[11]
    a, b, c = T[0] - B[0], T[4] - B[4], T[8] - B[8]
    d, e, f = T[1] - B[1], T[5] - B[5], T[9] - B[9]
    g, h, i = T[2] - B[2], T[6] - B[6], T[10] - B[10]
    square = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i
    return math.sqrt(x * x + y * y + z * z), math.sqrt(0.5 * square)


@kernel(allocates=False)
def verify_kernel(problem: Problem, candidates: Array, first: int, count: int, lanes: Array) -> int:
    """Verify up to eight candidates of one parameter.

    Args:
        problem: The pose and the arm.
        candidates: Rows of candidates, shape (r, WIDTH).
        first: The row to begin with.
        count: Number of candidates, 8 at most.
        lanes: The answer, by rows of eight numbers: angles, then the nearest turns of the n joints,
            errors [m], [rad], and 1 where all joints are inside their limits; (VERIFIED,).

    Returns:
        The candidates that some limit had to be put on, as bits.
    """
    arm, seed = problem.arm, problem.seed
    plan, model, lower, upper = arm.plan, arm.model, arm.lower, arm.upper
    n, held = seed.shape[0], int(plan[HEADER, HELD])
    joints = 7 if plan[HEADER, KIND] == REDUNDANT else 6
    row = 1 + n + arm.link
    last = int(model[row, 0])
    rest = LANES * (2 * n + _BEHIND)
    for j in range(joints):
        at, sign = rest + 2 * LANES * int(plan[1 + j, INDEX]), plan[1 + j, SIGN]
        for lane in range(LANES):
            k = first + min(lane, count - 1)
            lanes[at + lane] = candidates[k, 2 * j]
            lanes[at + LANES + lane] = sign * candidates[k, 2 * j + 1]
    B = identity_lanes_kernel()
    inside = fill(0.0) <= 0.0
    snapped = fill(0.0) < 0.0
    for j in range(n):
        if j > last:
            value = fill(seed[j])
        elif j == held:
            parameter = candidates[first, PARAMETER]
            value, cosine, sine = fill(parameter), math.cos(parameter), math.sin(parameter)
            B = move_kernel(model, 1 + j, value, fill(cosine), fill(sine), B)
        else:
            c, s = load(lanes, rest + 2 * LANES * j), load(lanes, rest + 2 * LANES * j + 8)
            B = turn_kernel(model, 1 + j, c, s, B)
            value, _, _ = quadrant_kernel(abs(c), abs(s))
            value = choose(c < 0.0, math.pi - value, value)
            value = choose(s < 0.0, -value, value)
        store(lanes, LANES * j, value)
        if j != held and j <= last:
            value, fits, cut = near_kernel(value, lower[j], upper[j], seed[j])
            inside, snapped = inside & fits, snapped | cut
        else:
            inside = inside & (value >= lower[j]) & (value <= upper[j])
        store(lanes, LANES * (n + j), value)
    position, orientation = miss_kernel(compose_kernel(B, model, row), problem.T)
    store(lanes, 2 * n * LANES, position)
    store(lanes, (2 * n + 1) * LANES, orientation)
    store(lanes, (2 * n + 2) * LANES, choose(inside, 1.0, 0.0))
    return bits(snapped)


# Columns behind the n joints of a row in a table of branches.
#: Distance from the target [m].
POSITION = 0
#: Angle from the target [rad].
ORIENTATION = 1
#: 1 where some whole turn of every joint is inside its limits.
INSIDE = 2
#: Branch of the form, in bits.
CODE = 3
#: Number of the family that the branch stands for, 0 where it is alone.
GROUP = 4
#: Parameter of a redundant arm.
VALUE = 5
#: Number of these columns.
MORE = 6
#: Damped steps that a candidate is polished by at most.
_POLISH_STEPS = 25
#: Solutions nearer than this in every joint [rad or m] are one.
_SAME = 1e-6
#: Errors below this [m], [rad] are not worth a step.
_GOOD = 1e-12
#: Errors below this [m], [rad] are not worth a polish.
CLOSE = 1e-10
#: A candidate is hard where polishing moves an angle by more [rad].
_FAR = 0.02


@kernel(allocates=False)
def tip_kernel(model: Array, q: Array, link: int) -> Frame:
    """The frame of link number ``link`` of ``Chain.model``."""
    row = 1 + q.shape[0] + link
    B = IDENTITY
    for i in range(int(model[row, 0]) + 1):
        B = step_kernel(model, 1 + i, q[i], B)
    return compose_kernel(B, model, row)


@kernel(allocates=False)
def size_kernel(e: tuple[float, float, float, float, float, float]) -> tuple[float, float]:
    """Lengths of the two halves of an error."""
    return (
        math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]),
        math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5]),
    )


@kernel
def refine_kernel(
    model: Array, link: int, T: Frame, lower: Array, upper: Array, held: int, q: Array
) -> tuple[float, float]:
    """Improve q (n,) in place by damped steps inside bounds; the errors [m], [rad] that are left.

    Joint ``held`` stays where it is (-1: none).
    """
    n = q.shape[0]
    J, e, trial = np.empty((6, n)), np.empty(6), np.empty(n)
    free = np.empty(n, dtype=np.int64)
    B = frame_and_jacobian_kernel(model, q, link, J)
    error = error_kernel(B, T)
    position, orientation = size_kernel(error)
    square = position * position + orientation * orientation
    mu = 1e-3
    for _ in range(_POLISH_STEPS):
        if position < _GOOD and orientation < _GOOD:
            break
        if held >= 0:
            J[:, held] = 0.0
        for k in range(6):
            e[k] = error[k]
        step_within_kernel(J, e, q, lower, upper, mu * square + 1e-14, free, trial)
        error_after = error_kernel(tip_kernel(model, trial, link), T)
        a, b = size_kernel(error_after)
        after = a * a + b * b
        if after < square:
            gained = after < 0.25 * square
            q[:] = trial
            position, orientation, square = a, b, after
            if not gained and square < 1e-20:
                break
            mu *= 0.1
            B = frame_and_jacobian_kernel(model, q, link, J)
            error = error_kernel(B, T)
        else:
            if square < 1e-22:
                break
            mu *= 10.0
    return position, orientation


@kernel(allocates=False)
def fold_kernel(plan: Array, T: Frame, value: float) -> Frame:
    """The pose the closed form is asked for: without the locked joint, inverted if it runs back."""
    held = int(plan[HEADER, HELD])
    if held >= 0:
        c, s, slide = math.cos(value), math.sin(value), 0.0
        if plan[LOCKED, 0] != 0.0:
            c, s, slide = 1.0, 0.0, -value
        # M^-1 of the held joint.
        back = c, s, 0.0, 0.0, -s, c, 0.0, 0.0, 0.0, 0.0, 1.0, slide
        if held == 0:
            # (A M)^-1 T with A^-1 in the plan: M^-1 A^-1 T.
            T = product_kernel(back, product_kernel(compose_kernel(IDENTITY, plan, LOCKED), T))
        else:
            T = product_kernel(compose_kernel(T, plan, LOCKED_TIP), back)
            T = compose_kernel(T, plan, LOCKED)
    if plan[HEADER, REVERSED] != 0.0:
        T = (
            T[0], T[4], T[8], -(T[0] * T[3] + T[4] * T[7] + T[8] * T[11]),
            T[1], T[5], T[9], -(T[1] * T[3] + T[5] * T[7] + T[9] * T[11]),
            T[2], T[6], T[10], -(T[2] * T[3] + T[6] * T[7] + T[10] * T[11]),
        )  # fmt: skip
    return T


@kernel(allocates=False)
def product_kernel(A: Frame, B: Frame) -> Frame:
    """A B of two frames."""
    return (
        A[0] * B[0] + A[1] * B[4] + A[2] * B[8], A[0] * B[1] + A[1] * B[5] + A[2] * B[9],
        A[0] * B[2] + A[1] * B[6] + A[2] * B[10],
        A[0] * B[3] + A[1] * B[7] + A[2] * B[11] + A[3],
        A[4] * B[0] + A[5] * B[4] + A[6] * B[8], A[4] * B[1] + A[5] * B[5] + A[6] * B[9],
        A[4] * B[2] + A[5] * B[6] + A[6] * B[10],
        A[4] * B[3] + A[5] * B[7] + A[6] * B[11] + A[7],
        A[8] * B[0] + A[9] * B[4] + A[10] * B[8], A[8] * B[1] + A[9] * B[5] + A[10] * B[9],
        A[8] * B[2] + A[9] * B[6] + A[10] * B[10],
        A[8] * B[3] + A[9] * B[7] + A[10] * B[11] + A[11],
    )  # fmt: skip


@kernel(allocates=False)
def candidates_kernel(
    plan: Array, t: Array, table: CandidateTable, T: Frame, value: float, count: int
) -> int:
    """Add the closed form's candidates for one pose and parameter; the new count.

    Args:
        plan: The arm.
        t: Workspace for the pose that the form sees, shape (COLUMNS,).
        table: The candidates.
        T: The pose of the link.
        value: Parameter of a redundant arm.
        count: Rows that are taken.
    """
    T = fold_kernel(plan, T, value)
    t[1], t[2], t[3], t[4], t[5], t[6] = T[0], T[1], T[2], T[3], T[4], T[5]
    t[7], t[8], t[9], t[10], t[11], t[12] = T[6], T[7], T[8], T[9], T[10], T[11]
    start, flange = count, flange_kernel(plan, t)
    kind = int(plan[HEADER, KIND])
    if kind == SPHERICAL:
        count = spherical_kernel(plan, table, flange, count)
    elif kind == THREE_PARALLEL:
        count = parallel_kernel(plan, flange, table, count)
    else:
        count = redundant_kernel(plan, flange, table, value, count)
    for k in range(start, count):
        table.rows[k, PARAMETER] = value
    return count


@kernel(allocates=False)
def free_kernel(arm: Arm, seed: Array, free: Array) -> None:
    """Fill ``CandidateTable.free``: the seed, both limits, then steps around a turn."""
    plan, lower, upper = arm.plan, arm.lower, arm.upper
    for j in range(free.shape[1]):
        index = int(plan[1 + j, INDEX])
        sign = plan[1 + j, SIGN]
        free[0, j] = sign * seed[index]
        if free.shape[0] == 1:
            continue
        free[1, j] = sign * (lower[index] if math.isfinite(lower[index]) else seed[index] + 1.0)
        free[2, j] = sign * (upper[index] if math.isfinite(upper[index]) else seed[index] - 1.0)
        for k in range(3, free.shape[0]):
            free[k, j] = free[0, j] + (k - 2) * 2.0 * math.pi / (free.shape[0] - 2)


@kernel(allocates=False)
def parameter_kernel(plan: Array, q: Array, angles: Array) -> float:
    """The parameter of a configuration: the held joint's value, or the arm angle.

    Args:
        plan: The closed form.
        q: The configuration, shape (n,).
        angles: Workspace, shape (7,).
    """
    held = int(plan[HEADER, HELD])
    if held >= 0:
        value: float = q[held]
        return value
    if int(plan[HEADER, KIND]) != REDUNDANT:
        return 0.0
    for j in range(7):
        angles[j] = plan[1 + j, SIGN] * q[int(plan[1 + j, INDEX])]
    return arm_angle_kernel(plan, angles)


@kernel
def add_refined_kernel(
    problem: Problem, candidate: Array, lane: int, lanes: Array, q: Array, out: Array, count: int
) -> tuple[int, bool]:
    """Add a candidate that misses the target a little, or that a limit would cut, to ``out``.

    Args:
        problem: The pose and the arm.
        candidate: Row of the candidate, shape (WIDTH,).
        lane: The number of its lane.
        lanes: The answer of ``verify_kernel``.
        q: Workspace, shape (n,).
        out: Table of branches, shape (r, n + MORE).
        count: Rows that are taken.

    Returns:
        The new count, and whether polishing took it far away.
    """
    arm = problem.arm
    n, held = q.shape[0], int(arm.plan[HEADER, HELD])
    position, orientation = lanes[2 * n * LANES + lane], lanes[(2 * n + 1) * LANES + lane]
    for j in range(n):
        q[j] = lanes[j * LANES + lane]
    far = False
    if max(position, orientation) > CLOSE:
        # Without limits first, so that a branch is found where it is, inside or not.
        position, orientation = refine_kernel(
            arm.model, arm.link, problem.T, np.full(n, -np.inf), np.full(n, np.inf), held, q
        )
        far = max(position, orientation) > CLOSE
        for j in range(int(arm.model[1 + n + arm.link, 0]) + 1):
            far = far or abs(q[j] - lanes[j * LANES + lane]) > _FAR
    about = (candidate[BRANCH], candidate[FAMILY], candidate[PARAMETER])
    return admit_kernel(problem, (position, orientation), about, q, out, count), far


@kernel
def admit_kernel(
    problem: Problem, error: tuple[float, float], about: tuple[float, float, float], q: Array,
    out: Array, count: int,
) -> int:  # fmt: skip
    """Add q to a table of branches, unless it is there or misses the target; the new count.

    Args:
        problem: The pose and the arm.
        error: Distance [m] and angle [rad] of q from the target.
        about: Branch, family and parameter.
        q: A configuration, shape (n,); taken by whole turns into the limits.
        out: The table, shape (r, n + MORE).
        count: Rows that are taken.
    """
    position, orientation = error
    code, family, value = about
    arm, T, tolerance = problem.arm, problem.T, problem.tolerance
    if not (position <= tolerance and orientation <= tolerance):
        return count
    model, link, lower, upper, seed = arm.model, arm.link, arm.lower, arm.upper, problem.seed
    n, held = q.shape[0], int(arm.plan[HEADER, HELD])
    inside, moved = True, False
    for j in range(n):
        if model[1 + j, 0] == 0.0 and j != held and j <= int(model[1 + n + link, 0]):
            q[j], fits, snapped = near_kernel(q[j], lower[j], upper[j], seed[j])
            moved = moved or snapped
            inside = inside and fits
        else:
            inside = inside and q[j] >= lower[j] and q[j] <= upper[j]
    if moved:
        position, orientation = miss_kernel(tip_kernel(model, q, link), T)
        if max(position, orientation) > tolerance:
            if inside:
                position, orientation = refine_kernel(model, link, T, lower, upper, held, q)
            if not (position <= tolerance and orientation <= tolerance):
                # It is a hair outside, and no rounding.
                inside, whole = False, np.full(n, np.inf)
                position, orientation = refine_kernel(model, link, T, -whole, whole, held, q)
            if not (position <= tolerance and orientation <= tolerance):
                return count
    known = (position, orientation, 1.0 if inside else 0.0, code, family, value)
    return enter_kernel(known, q, out, count)


@kernel(inline="code", allocates=False)
def enter_kernel(
    about: tuple[float, float, float, float, float, float], q: Array, out: Array, count: int
) -> int:
    """Add q and what is known ``about`` it, as a row has it, unless it is there; the new count."""
    n = q.shape[0]
    _, _, inside, code, family, value = about
    place = first = count
    # Rows of one parameter follow each other.
    while first > 0 and out[first - 1, n + VALUE] == value:
        first -= 1
    for k in range(first, count):
        if family != 0.0 and out[k, n + GROUP] == family and out[k, n + CODE] == code:
            # One member stands for a family: the first that is inside the limits.
            if out[k, n + INSIDE] == 1.0 or inside == 0.0:
                return count
            place = k
            break
        same = True
        for j in range(n):
            if abs(out[k, j] - q[j]) > _SAME:
                same = False
                break
        if same:
            return count
    if place == out.shape[0]:
        return count
    for j in range(n):
        out[place, j] = q[j]
    for k in range(MORE):
        out[place, n + k] = about[k]
    return count + 1 if place == count else count

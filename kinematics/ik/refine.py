"""From the candidates of a closed form to verified solutions of the true chain.

Each candidate is verified by forward kinematics; what misses the tolerance, since the arm misses
the form a little or its limits cut off a rounding error, is polished by damped steps. Angles are
taken by whole turns into the limits, nearest to the seed.
"""

import math

import numpy as np

from kinematics.chain import MAX_JOINTS, Array, Indices
from kinematics.forward import finite_kernel
from kinematics.frame import IDENTITY, Frame, compose_kernel, step_kernel
from kinematics.ik.parallel import parallel_kernel
from kinematics.ik.redundant import arm_angle_kernel, redundant_kernel
from kinematics.ik.spherical import (
    BRANCH,
    FAMILY,
    LOCKED,
    LOCKED_TIP,
    PARAMETER,
    WIDTH,
    spherical_kernel,
)
from kinematics.ik.step import (
    State,
    cholesky_solve_kernel,
    error_kernel,
    frame_kernel,
    step_within_kernel,
    uniform_kernel,
)
from kinematics.ik.verification import VERIFIED, miss_kernel, near_kernel, verify_kernel
from kinematics.jacobian import frame_and_jacobian_kernel
from kinematics.kernel import kernel
from kinematics.vector import LANES, on_stack

#: Columns behind the joints of a solution: errors [m], [rad], inside limits, branch, family,
#: parameter.
POSITION, ORIENTATION, INSIDE, CODE, GROUP, VALUE, MORE = 0, 1, 2, 3, 4, 5, 6
#: Candidates of one pose at most, since families stand for themselves with several members, and
#: the room for them; members of a family that are tried, and the room for those.
_CANDIDATES, _MEMBERS = 400, 11
_RAW, _FREE = _CANDIDATES * WIDTH, _MEMBERS * 7
_POLISH_STEPS = 25
#: Solutions nearer than this in every joint are one.
_SAME = 1e-6
#: Errors below this are not worth a step, below the other no polish.
_GOOD, _CLOSE = 1e-12, 1e-10
#: Arms that miss a form by more [m or rad] than this are searched around where polishing moves an
#: angle by more than ``_FAR`` [rad]: so many starts a candidate, so far around [rad] but for every
#: fourth, and so many candidates at most.
_EXACT, _FAR, _AROUND, _SPREAD, _CENTRES = 1e-10, 0.02, 20, 0.4, 16
#: Branches that some direction moves by less than this [m or rad a radian] may have a twin, which
#: is looked for so far along it [rad].
_FOLD, _STEPS_ASIDE = 0.03, (1e-4, 1e-3, 1e-2, 5e-2, 0.2, 0.6)
#: Poses around a target that are tried where it has no candidate itself.
_NUDGES = 16


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
def polish_kernel(
    model: Array, link: int, T: Frame, lower: Array, upper: Array, held: int, q: Array
) -> tuple[float, float]:
    """Improve q (n,) in place by damped steps inside bounds; the errors [m], [rad] that are left.

    Joint ``held`` stays where it is (-1: none).
    """
    n = q.shape[0]
    J, H, e = np.empty((6, n)), np.empty((n, n)), np.empty(6)
    g, trial, free = np.empty(max(n, 6)), np.empty(n), np.empty(n, dtype=np.int64)
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
        step_within_kernel(J, e, q, lower, upper, mu * square + 1e-14, free, H, g, trial)
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
    lock = int(plan[0, 2])
    if lock == 0:
        # (A M)^-1 T with A^-1 in the plan: M^-1 A^-1 T.
        T = _product(compose_kernel(IDENTITY, plan, LOCKED), T)
        if plan[LOCKED, 0] == 0.0:
            c, s = math.cos(value), math.sin(value)
            T = (
                c * T[0] + s * T[4], c * T[1] + s * T[5], c * T[2] + s * T[6], c * T[3] + s * T[7],
                c * T[4] - s * T[0], c * T[5] - s * T[1], c * T[6] - s * T[2], c * T[7] - s * T[3],
                T[8], T[9], T[10], T[11],
            )  # fmt: skip
        else:
            T = (
                T[0], T[1], T[2], T[3], T[4], T[5], T[6], T[7], T[8], T[9], T[10], T[11] - value,
            )  # fmt: skip
    elif lock > 0:
        T = compose_kernel(T, plan, LOCKED_TIP)
        if plan[LOCKED, 0] == 0.0:
            c, s = math.cos(value), math.sin(value)
            T = (
                T[0] * c - T[1] * s, T[1] * c + T[0] * s, T[2], T[3],
                T[4] * c - T[5] * s, T[5] * c + T[4] * s, T[6], T[7],
                T[8] * c - T[9] * s, T[9] * c + T[8] * s, T[10], T[11],
            )  # fmt: skip
        else:
            T = (
                T[0], T[1], T[2], T[3] - value * T[2], T[4], T[5], T[6], T[7] - value * T[6],
                T[8], T[9], T[10], T[11] - value * T[10],
            )  # fmt: skip
        T = compose_kernel(T, plan, LOCKED)
    if plan[0, 1] != 0.0:
        T = (
            T[0], T[4], T[8], -(T[0] * T[3] + T[4] * T[7] + T[8] * T[11]),
            T[1], T[5], T[9], -(T[1] * T[3] + T[5] * T[7] + T[9] * T[11]),
            T[2], T[6], T[10], -(T[2] * T[3] + T[6] * T[7] + T[10] * T[11]),
        )  # fmt: skip
    return T


@kernel(allocates=False)
def _product(A: Frame, B: Frame) -> Frame:
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
    plan: Array, T: Frame, value: float, free: Array, slack: float, t: Array, raw: Array, count: int
) -> int:
    """Add the closed form's candidates for one pose and parameter; the new count."""
    T = fold_kernel(plan, T, value)
    t[1], t[2], t[3], t[4], t[5], t[6] = T[0], T[1], T[2], T[3], T[4], T[5]
    t[7], t[8], t[9], t[10], t[11], t[12] = T[6], T[7], T[8], T[9], T[10], T[11]
    start = count
    kind = int(plan[0, 0])
    if kind == 0:
        count = spherical_kernel(plan, t, free, slack, raw, count)
    elif kind == 1:
        count = parallel_kernel(plan, t, free, slack, raw, count)
    else:
        count = redundant_kernel(plan, t, value, free, slack, raw, count)
    for k in range(start, count):
        raw[k, PARAMETER] = value
    return count


@kernel(allocates=False)
def free_kernel(plan: Array, lower: Array, upper: Array, seed: Array, free: Array) -> None:
    """Fill ``free`` (k, joints in plan order): the seed, both limits, then steps around a turn."""
    for j in range(free.shape[1]):
        index = int(plan[1 + j, 13])
        sign = plan[1 + j, 0]
        free[0, j] = sign * seed[index]
        if free.shape[0] == 1:
            continue
        free[1, j] = sign * (lower[index] if math.isfinite(lower[index]) else seed[index] + 1.0)
        free[2, j] = sign * (upper[index] if math.isfinite(upper[index]) else seed[index] - 1.0)
        for k in range(3, free.shape[0]):
            free[k, j] = free[0, j] + (k - 2) * 2.0 * math.pi / (free.shape[0] - 2)


@kernel(allocates=False)
def parameter_kernel(plan: Array, q: Array, angles: Array) -> float:
    """The parameter of a configuration: the locked joint's value, or the arm angle."""
    lock = int(plan[0, 2])
    if lock >= 0:
        value: float = q[lock]
        return value
    if int(plan[0, 0]) != 2:
        return 0.0
    for j in range(7):
        angles[j] = plan[1 + j, 0] * q[int(plan[1 + j, 13])]
    return arm_angle_kernel(plan, angles)


@kernel(allocates=False)
def branches_kernel(
    plan: Array, model: Array, link: int, target: Array, lower: Array, upper: Array, seed: Array,
    values: Array, tolerance: float, enough: int, out: Array,
) -> int:  # fmt: skip
    """All branches for a pose, verified, into ``out`` (r, n + 6); how many there are.

    -1 where the seed is not one finite number a joint, -2 where the target is not finite.

    Args:
        plan: The closed form, see ``structure``.
        model: ``Chain.model``.
        link: The number of the link to bring there, -1 for the tip.
        target: T_base_link, shape (4, 4).
        lower: Limits, shape (n,).
        upper: ...
        seed: Where to be near, shape (n,).
        values: Values of the parameter to try in this order, NaN for that of the seed; one where
            there is none.
        tolerance: Largest error of a solution [m], [rad].
        enough: Stop between parameters with so many solutions inside the limits.
        out: Joints, errors, whether inside the limits, branch, family, parameter in a row.
    """
    n = seed.shape[0]
    if n != int(model[0, 0]) or not finite_kernel(seed):
        return -1
    for row in range(3):
        for column in range(4):
            if not math.isfinite(target[row, column]):
                return -2
    if link < 0:
        link = int(model[0, 1])
    raw, lanes = on_stack(_RAW).reshape((_CANDIDATES, WIDTH)), on_stack(VERIFIED)
    joints = 7 if plan[0, 0] == 2.0 else 6
    free = on_stack(_FREE)[: _MEMBERS * joints].reshape((_MEMBERS, joints))
    t, q = on_stack(14), on_stack(MAX_JOINTS)[:n]
    T = frame_kernel(target)
    slack = max(2.0 * tolerance, 10.0 * plan[0, 5])
    # Many values of a parameter are tried for one that will do, one value for all its branches.
    exact, alone = plan[0, 5] <= _EXACT, values.shape[0] == 1
    # Of families the seed's own member first: mostly it is inside the limits, and will do.
    members = 1 if exact else free.shape[0]
    free_kernel(plan, lower, upper, seed, free[:members])
    count, inside = 0, 0
    for v in range(values.shape[0]):
        value = values[v]
        if math.isnan(value):
            value = parameter_kernel(plan, seed, t[:7])
        before = count
        for trial in range(2):
            found = candidates_kernel(plan, T, value, free[:members], slack, t, raw, 0)
            hard = False
            for first in range(0, found, LANES):
                some = min(found - first, LANES)
                bounds = (lower, upper, seed)
                snapped = verify_kernel(plan, model, link, T, raw, first, some, bounds, lanes)
                for lane in range(some):
                    row = first + lane
                    position, orientation = lanes[16 * n + lane], lanes[16 * n + 8 + lane]
                    hard = hard or raw[row, FAMILY] != 0.0
                    if max(position, orientation) > _CLOSE or (snapped >> lane) & 1 != 0:
                        count, moved = _polished(
                            plan, model, link, T, lower, upper, seed, tolerance, raw[row], lane,
                            lanes, q, out, count,
                        )  # fmt: skip
                        hard = hard or moved
                    elif max(position, orientation) <= tolerance:
                        for j in range(n):
                            q[j] = lanes[8 * (n + j) + lane]
                        about = (
                            position, orientation, lanes[16 * n + 16 + lane], raw[row, BRANCH],
                            raw[row, FAMILY], value,
                        )  # fmt: skip
                        count = _enter(about, q, out, count)
            if trial == 1 or members > 1 or _settled(raw, found, out, before, count, n):
                break
            members, count = free.shape[0], before
            free_kernel(plan, lower, upper, seed, free)
        if members > 1 and exact:
            members = 1
        if hard and not exact:
            count = _complete(
                plan, model, link, T, lower, upper, seed, tolerance, raw, found,
                _AROUND if alone else _AROUND // 4, q, out, count,
            )  # fmt: skip
        if alone and not exact:
            count = _twins(
                plan, model, link, T, lower, upper, seed, tolerance, before, q, out, count
            )
        if count == before and not exact:
            count = _nudged(
                plan, model, link, T, value, lower, upper, seed, tolerance, free, slack, t, raw, q,
                out, count,
            )  # fmt: skip
        inside = 0
        for k in range(count):
            inside += int(out[k, n + INSIDE])
        if inside >= enough:
            break
    return count


@kernel(allocates=False)
def _settled(raw: Array, found: int, out: Array, before: int, count: int, n: int) -> bool:
    """Whether every family's first member is inside the limits and speaks for all of them."""
    for k in range(found):
        family = raw[k, FAMILY]
        if family == 0.0:
            continue
        settled = False
        for i in range(before, count):
            if out[i, n + GROUP] == family and out[i, n + CODE] == raw[k, BRANCH]:
                settled = out[i, n + INSIDE] == 1.0
                break
        if family < 0.0 or not settled:
            return False
    return True


@kernel
def _polished(
    plan: Array, model: Array, link: int, T: Frame, lower: Array, upper: Array, seed: Array,
    tolerance: float, row: Array, lane: int, lanes: Array, q: Array, out: Array, count: int,
) -> tuple[int, bool]:  # fmt: skip
    """Add a candidate that misses the target a little, or that a limit would cut, to ``out``.

    Returns:
        The new count, and whether polishing took it far away.
    """
    n, held = q.shape[0], int(plan[0, 2])
    position, orientation = lanes[16 * n + lane], lanes[16 * n + 8 + lane]
    for j in range(n):
        q[j] = lanes[8 * j + lane]
    far = False
    if max(position, orientation) > _CLOSE:
        # Without limits first, so that a branch is found where it is, inside or not.
        position, orientation = polish_kernel(
            model, link, T, np.full(n, -np.inf), np.full(n, np.inf), held, q
        )
        far = max(position, orientation) > _CLOSE
        for j in range(int(model[1 + n + link, 0]) + 1):
            far = far or abs(q[j] - lanes[8 * j + lane]) > _FAR
    count = _admit(
        plan, model, link, T, lower, upper, seed, tolerance, (position, orientation),
        (row[BRANCH], row[FAMILY], row[PARAMETER]), q, out, count,
    )  # fmt: skip
    return count, far


@kernel
def _admit(
    plan: Array, model: Array, link: int, T: Frame, lower: Array, upper: Array, seed: Array,
    tolerance: float, error: tuple[float, float], about: tuple[float, float, float], q: Array,
    out: Array, count: int,
) -> int:  # fmt: skip
    """Add q to ``out``, unless it is there or misses the target; the new count."""
    position, orientation = error
    code, family, value = about
    if not (position <= tolerance and orientation <= tolerance):
        return count
    n, held = q.shape[0], int(plan[0, 2])
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
                position, orientation = polish_kernel(model, link, T, lower, upper, held, q)
            else:
                whole = np.full(n, np.inf)
                position, orientation = polish_kernel(model, link, T, -whole, whole, held, q)
            if not (position <= tolerance and orientation <= tolerance):
                return count
    known = (position, orientation, 1.0 if inside else 0.0, code, family, value)
    return _enter(known, q, out, count)


@kernel(inline="code", allocates=False)
def _enter(
    about: tuple[float, float, float, float, float, float], q: Array, out: Array, count: int
) -> int:
    """Add q and what is known ``about`` it, as a row has it, unless it is there; the new count."""
    n = q.shape[0]
    _, _, inside, code, family, value = about
    place = count
    for k in range(count):
        if out[k, n + VALUE] != value:
            continue
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


@kernel
def _complete(
    plan: Array, model: Array, link: int, T: Frame, lower: Array, upper: Array, seed: Array,
    tolerance: float, raw: Array, found: int, trials: int, q: Array, out: Array, count: int,
) -> int:  # fmt: skip
    """Search around the candidates of a form that the arm misses, near a singularity of the form.

    There branches of the true arm part, meet or vanish elsewhere than the form's: polished starts
    around each candidate, first turned against each other in the joints that a straight wrist
    leaves free, find those that are left.
    """
    n, held = q.shape[0], int(plan[0, 2])
    last = int(model[1 + n + link, 0])
    state = np.array([0x9E3779B97F4A7C15], dtype=np.uint64)
    unlimited = np.full(n, np.inf)
    some = min(found, _CENTRES)
    for i in range(some):
        # Members of families fill many rows in turn.
        k = i * found // some
        for trial in range(trials):
            for j in range(7 if plan[0, 0] == 2.0 else 6):
                index = int(plan[1 + j, 13])
                q[index] = plan[1 + j, 0] * math.atan2(raw[k, 2 * j + 1], raw[k, 2 * j])
            if held >= 0:
                q[held] = raw[k, PARAMETER]
            spread = math.pi if trial % 4 == 3 else _SPREAD
            for j in range(last + 1):
                if j != held:
                    q[j] += spread * (2.0 * uniform_kernel(state) - 1.0)
            turn = math.pi * (2.0 * uniform_kernel(state) - 1.0)
            ends = (0, 2) if plan[0, 1] != 0.0 else (3, 5)
            a, b = int(plan[1 + ends[0], 13]), int(plan[1 + ends[1], 13])
            if uniform_kernel(state) < 0.5:
                q[min(a, b)] += turn
                q[max(a, b)] += turn if uniform_kernel(state) < 0.5 else -turn
            error = polish_kernel(model, link, T, -unlimited, unlimited, held, q)
            about = (raw[k, BRANCH], raw[k, FAMILY], raw[k, PARAMETER])
            count = _admit(
                plan, model, link, T, lower, upper, seed, tolerance, error, about, q, out, count
            )
    return count


@kernel
def _twins(
    plan: Array, model: Array, link: int, T: Frame, lower: Array, upper: Array, seed: Array,
    tolerance: float, before: int, q: Array, out: Array, count: int,
) -> int:  # fmt: skip
    """Look for the twin of each branch that is near a fold, where two of them meet.

    It lies along the direction that moves the link least. The form may have one root there, or
    none, where the true arm has two.
    """
    n, held = q.shape[0], int(plan[0, 2])
    J, v, unlimited = np.empty((6, n)), np.empty(n), np.full(n, np.inf)
    k = before
    while k < count:
        q[:] = out[k, :n]
        frame_and_jacobian_kernel(model, q, link, J)
        if _least_moving(J, held, int(model[1 + n + link, 0]), v) < _FOLD:
            for step in _STEPS_ASIDE:
                for side in (1.0, -1.0):
                    for j in range(n):
                        q[j] = out[k, j] + side * step * v[j]
                    error = polish_kernel(model, link, T, -unlimited, unlimited, held, q)
                    about = (out[k, n + CODE], 0.0, out[k, n + VALUE])
                    count = _admit(
                        plan, model, link, T, lower, upper, seed, tolerance, error, about, q, out,
                        count,
                    )  # fmt: skip
        k += 1
    return count


@kernel
def _least_moving(J: Array, held: int, last: int, v: Array) -> float:
    """Write the direction that J (6, n) stretches least into v, by inverse iteration; how much."""
    n = v.shape[0]
    H = np.empty((n, n))
    if held >= 0:
        J[:, held] = 0.0
    for j in range(n):
        v[j] = 1.0 + 0.1 * j if j <= last and j != held else 0.0
    for _ in range(3):
        for a in range(n):
            for b in range(a + 1):
                H[a, b] = 0.0
                for i in range(6):
                    H[a, b] += J[i, a] * J[i, b]
            H[a, a] += 1e-14 if a <= last and a != held else 1.0
        cholesky_solve_kernel(H, v, n)
        v /= math.sqrt(np.sum(v * v))
    square = 0.0
    for i in range(6):
        along = 0.0
        for j in range(n):
            along += J[i, j] * v[j]
        square += along * along
    return math.sqrt(square)


@kernel
def _nudged(
    plan: Array, model: Array, link: int, T: Frame, value: float, lower: Array, upper: Array,
    seed: Array, tolerance: float, free: Array, slack: float, t: Array, raw: Array, q: Array,
    out: Array, count: int,
) -> int:  # fmt: skip
    """Add what is polished from the candidates of poses near a target that has none itself.

    That is where a singularity of the true arm is none of the form's, or beyond its reach.
    """
    n, held, joints = q.shape[0], int(plan[0, 2]), 7 if plan[0, 0] == 2.0 else 6
    state = np.array([0xD1B54A32D192ED03], dtype=np.uint64)
    unlimited = np.full(n, np.inf)
    for trial in range(_NUDGES):
        size = max(1e-7, 30.0 * plan[0, 5]) * (1.0 + 0.1 * trial * trial)
        x, y, z = _jitter(state, size), _jitter(state, size), _jitter(state, size)
        a, b, c = _jitter(state, size), _jitter(state, size), _jitter(state, size)
        r = 1.0 / math.sqrt(1.0 + a * a + b * b + c * c)
        w, a, b, c = r, a * r, b * r, c * r
        near = _product(
            (
                1.0 - 2.0 * (b * b + c * c), 2.0 * (a * b - c * w), 2.0 * (a * c + b * w), 0.0,
                2.0 * (a * b + c * w), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c - a * w), 0.0,
                2.0 * (a * c - b * w), 2.0 * (b * c + a * w), 1.0 - 2.0 * (a * a + b * b), 0.0,
            ),
            (
                T[0], T[1], T[2], 0.0, T[4], T[5], T[6], 0.0, T[8], T[9], T[10], 0.0,
            ),
        )  # fmt: skip
        near = (
            near[0], near[1], near[2], T[3] + x, near[4], near[5], near[6], T[7] + y,
            near[8], near[9], near[10], T[11] + z,
        )  # fmt: skip
        found = candidates_kernel(plan, near, value, free, slack, t, raw, 0)
        for k in range(min(found, 16)):
            q[:] = seed
            for j in range(joints):
                q[int(plan[1 + j, 13])] = plan[1 + j, 0] * math.atan2(
                    raw[k, 2 * j + 1], raw[k, 2 * j]
                )
            if held >= 0:
                q[held] = raw[k, PARAMETER]
            error = polish_kernel(model, link, T, -unlimited, unlimited, held, q)
            about = (raw[k, BRANCH], 0.0, raw[k, PARAMETER])
            count = _admit(
                plan, model, link, T, lower, upper, seed, tolerance, error, about, q, out, count
            )
    return count


@kernel
def _jitter(state: State, size: float) -> float:
    return size * (2.0 * uniform_kernel(state) - 1.0)


@kernel(allocates=False)
def branches_alone_kernel(
    plan: Array, model: Array, link: int, target: Array, lower: Array, upper: Array, seed: Array,
    values: Array, tolerance: float, enough: int, out: Array,
) -> int:  # fmt: skip
    """``branches_kernel`` for calls from Python: arrays are taken over without counting them."""
    return branches_kernel(
        plan, model, link, target, lower, upper, seed, values, tolerance, enough, out
    )


@kernel
def branches_batch_kernel(
    plan: Array, model: Array, link: int, targets: Array, lower: Array, upper: Array, seeds: Array,
    values: Array, tolerance: float, enough: int, out: Array, counts: Indices,
) -> None:  # fmt: skip
    """``branches_kernel`` for a batch: targets (m, 4, 4), seeds (m, n), values (m, v)."""
    for k in range(targets.shape[0]):
        counts[k] = branches_kernel(
            plan, model, link, targets[k], lower, upper, seeds[k], values[k], tolerance, enough,
            out[k],
        )  # fmt: skip

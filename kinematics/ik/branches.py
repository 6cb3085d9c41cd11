"""All branches of a closed form for a pose, verified on the true chain."""

import math

from kinematics.arrays import Array, Indices
from kinematics.chain import MAX_JOINTS
from kinematics.compiled.kernel import kernel
from kinematics.compiled.simd import LANES, on_stack
from kinematics.forward import finite_kernel
from kinematics.frame import Frame
from kinematics.ik.calibrated import (
    add_curve_branches_kernel,
    add_nearby_branches_kernel,
    add_perturbed_branches_kernel,
    is_balanced_kernel,
)
from kinematics.ik.dls_step import frame_kernel
from kinematics.ik.refine import (
    CLOSE,
    CODE,
    GROUP,
    INSIDE,
    add_refined_kernel,
    candidates_kernel,
    enter_kernel,
    free_kernel,
    parameter_kernel,
)
from kinematics.ik.spherical import BRANCH, FAMILY, PARAMETER, WIDTH
from kinematics.ik.subproblem import EXACT
from kinematics.ik.verification import VERIFIED, verify_kernel

#: Candidates of one pose at most, since families stand for themselves with several members, and
#: the room for them; members of a family that are tried, and the room for those.
_CANDIDATES, _MEMBERS = 400, 11
_RAW, _FREE = _CANDIDATES * WIDTH, _MEMBERS * 7
#: Starts around a hard candidate, and poses around a target that has no candidate itself.
_AROUND, _NUDGES = 20, 16
#: How often a branch is looked for that must be there.
_TRIALS = 6


@kernel(allocates=False)
def branches_kernel(  # noqa: C901, PLR0912
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
        lower: Lower limits, shape (n,) [rad or m].
        upper: Upper limits, shape (n,) [rad or m].
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
    kind = int(plan[0, 0])
    joints = 7 if kind == 2 else 6
    free = on_stack(_FREE)[: _MEMBERS * joints].reshape((_MEMBERS, joints))
    t, q = on_stack(14), on_stack(MAX_JOINTS)[:n]
    T = frame_kernel(target)
    slack = max(2.0 * tolerance, 10.0 * plan[0, 5])
    # Many values of a parameter are tried for one that will do, one value for all its branches.
    exact, alone = plan[0, 5] <= EXACT, values.shape[0] == 1
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
            count, hard = _add_verified(
                plan, model, link, T, (lower, upper, seed), tolerance, raw, found, lanes, q, out,
                count,
            )  # fmt: skip
            if trial == 1 or members > 1 or _settled(raw, found, out, before, count, n):
                break
            members, count = free.shape[0], before
            free_kernel(plan, lower, upper, seed, free)
        if members > 1 and exact:
            members = 1
        if not exact:
            if hard and (kind == 2 or not alone):
                count = add_nearby_branches_kernel(
                    plan, model, link, T, lower, upper, seed, tolerance, raw, found,
                    _AROUND if alone else _AROUND // 4, 0, q, out, count,
                )  # fmt: skip
            nudges = _NUDGES if count == before else (_NUDGES // 4 if alone and hard else 0)
            found, count = add_perturbed_branches_kernel(
                plan, model, link, T, value, lower, upper, seed, tolerance, free, slack, t, raw,
                found, nudges, q, out, count,
            )  # fmt: skip
            if alone:
                count = add_curve_branches_kernel(
                    plan, model, link, T, lower, upper, seed, tolerance, raw,
                    found if nudges > 0 else 0, before, 0.0, q, out, count,
                )  # fmt: skip
                for trial in range(1, _TRIALS):
                    full = count == out.shape[0]
                    if full or is_balanced_kernel(plan, model, link, before, q, out, count):
                        break
                    count = add_nearby_branches_kernel(
                        plan, model, link, T, lower, upper, seed, tolerance, raw, found, _AROUND,
                        trial, q, out, count,
                    )  # fmt: skip
                    count = add_curve_branches_kernel(
                        plan, model, link, T, lower, upper, seed, tolerance, raw, 0, before,
                        trial / _TRIALS, q, out, count,
                    )  # fmt: skip
        inside = 0
        for k in range(count):
            inside += int(out[k, n + INSIDE])
        if inside >= enough:
            break
    return count


@kernel(allocates=False)
def _add_verified(
    plan: Array, model: Array, link: int, T: Frame, bounds: tuple[Array, Array, Array],
    tolerance: float, raw: Array, found: int, lanes: Array, q: Array, out: Array, count: int,
) -> tuple[int, bool]:  # fmt: skip
    """Add the ``found`` candidates that forward kinematics confirms, with damped steps if need be.

    Returns:
        The new count, and whether some candidate is of a family or far from its branch.
    """
    lower, upper, seed = bounds
    n, hard = q.shape[0], False
    errors = 2 * n * LANES
    for first in range(0, found, LANES):
        some = min(found - first, LANES)
        snapped = verify_kernel(plan, model, link, T, raw, first, some, bounds, lanes)
        for lane in range(some):
            candidate = raw[first + lane]
            position, orientation = lanes[errors + lane], lanes[errors + LANES + lane]
            hard = hard or candidate[FAMILY] != 0.0
            if max(position, orientation) > CLOSE or (snapped >> lane) & 1 != 0:
                count, moved = add_refined_kernel(
                    plan, model, link, T, lower, upper, seed, tolerance, candidate, lane, lanes, q,
                    out, count,
                )  # fmt: skip
                hard = hard or moved
            elif max(position, orientation) <= tolerance:
                for j in range(n):
                    q[j] = lanes[(n + j) * LANES + lane]
                about = (
                    position, orientation, lanes[errors + 2 * LANES + lane], candidate[BRANCH],
                    candidate[FAMILY], candidate[PARAMETER],
                )  # fmt: skip
                count = enter_kernel(about, q, out, count)
    return count, hard


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

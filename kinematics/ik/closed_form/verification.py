"""Candidates of a closed form, in eight SIMD lanes: their angles, frames, errors and nearest turns.

A candidate is a row of cosines and sines, see ``spherical``. A lane computes what a single
number would, to the last bit, so a branch does not depend on its neighbours.
"""

import math

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
from kinematics.frame import Frame, compose_kernel, move_kernel, turn_kernel
from kinematics.ik.closed_form.plan import (
    HEADER,
    HELD,
    INDEX,
    KIND,
    PARAMETER,
    REDUNDANT,
    SIGN,
    Problem,
)
from kinematics.ik.numeric.dls_step import quadrant_kernel
from kinematics.model.chain import MAX_JOINTS
from kinematics.simd_frames import identity_lanes_kernel

#: An angle this little outside a limit [rad] is rounding of a double root, and put onto it.
_SNAP = 1e-6
#: Rows of vectors behind four for each joint: errors [m], [rad], and whether inside the limits.
_BEHIND = 3
#: Room for what ``verify_kernel`` answers.
VERIFIED = LANES * (4 * MAX_JOINTS + _BEHIND)


@kernel(inline="code")
def angle_kernel(c: Lanes, s: Lanes) -> Lanes:
    """The angle of a unit vector (c, s) in (-pi, pi]."""
    angle, _, _ = quadrant_kernel(abs(c), abs(s))
    angle = choose(c < 0.0, math.pi - angle, angle)
    return choose(s < 0.0, -angle, angle)


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
        count: How many there are, 8 at most.
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
            value = angle_kernel(c, s)
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

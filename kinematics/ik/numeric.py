"""Inverse kinematics of any chain by damped least squares inside the joint limits, with restarts.

Each step solves (J^T J + lambda I) dq = J^T e over the joints that are free to move, with
e = [p_target - p; log(R_target R^T)] and lambda = mu |e|^2, which vanishes with the error. A joint
at a limit that e pushes outwards is left out of the step; what is left over is clipped.
Sources: "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE
Transactions on Robotics, 2011 (the damping); restarts with seeded draws are our own.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.chain import Array, Chain, Indices
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.forward import forward_kernel
from kinematics.ik.solution import IkResult, IkSolution
from kinematics.jacobian import jacobian_kernel
from kinematics.kernel import kernel

State = NDArray[np.uint64]

POSITION_TOLERANCE = 1e-6
ORIENTATION_TOLERANCE = 1e-6
#: Steps from one start; most that converge at all do so in half of it.
_STEPS = 60
#: Steps without a tenth less error before a start is given up.
_PATIENCE = 8
_DAMPING = 1e-2
_LEAST_DAMPING = 1e-12
#: Solutions nearer than this in every joint [rad or m] are one.
_SAME = 1e-3


@kernel
def rotation_vector(R: Array, target: Array, out: Array) -> None:
    """Write log(target R^T) of two rotations (rows 0..2 of 4x4 frames), shape (3,)."""
    m = np.empty((3, 3))
    for row in range(3):
        for column in range(3):
            m[row, column] = (
                target[row, 0] * R[column, 0]
                + target[row, 1] * R[column, 1]
                + target[row, 2] * R[column, 2]
            )
    x, y, z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    sine = 0.5 * math.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (m[0, 0] + m[1, 1] + m[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-7:
        scale = 0.5 * angle / sine
        out[0], out[1], out[2] = scale * x, scale * y, scale * z
    elif cosine > 0.0:
        out[0], out[1], out[2] = 0.5 * x, 0.5 * y, 0.5 * z
    else:
        # Half a turn: the axis is the largest column of (R + I) / 2.
        k = 0
        for i in range(1, 3):
            if m[i, i] > m[k, k]:
                k = i
        norm = 0.0
        for row in range(3):
            out[row] = m[row, k] + (1.0 if row == k else 0.0)
            norm += out[row] * out[row]
        for row in range(3):
            out[row] *= angle / math.sqrt(norm)


@kernel
def _tip_error(
    types: Indices, offsets: Array, T_tip: Array, target: Array, turn: float, q: Array,
    frames: Array, tip: Array, e: Array,
) -> tuple[float, float]:  # fmt: skip
    """Fill the tip's pose (4, 4) and the error (6,); answer the errors [m], [rad]."""
    forward_kernel(types, offsets, q, frames)
    F = frames[q.shape[0] - 1]
    for row in range(3):
        for column in range(4):
            tip[row, column] = (
                F[row, 0] * T_tip[0, column] + F[row, 1] * T_tip[1, column]
                + F[row, 2] * T_tip[2, column]
            )  # fmt: skip
        tip[row, 3] += F[row, 3]
        e[row] = target[row, 3] - tip[row, 3]
    if turn > 0.0:
        rotation_vector(tip, target, e[3:])
    else:
        e[3:] = 0.0
    position = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    return position, math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5])


@kernel
def _cholesky_solve(H: Array, g: Array, n: int) -> None:
    """Solve H x = g in place for the leading n rows of a positive definite H."""
    for i in range(n):
        for j in range(i + 1):
            total = H[i, j]
            for k in range(j):
                total -= H[i, k] * H[j, k]
            H[i, j] = math.sqrt(max(total, 1e-300)) if i == j else total / H[j, j]
    for i in range(n):
        for k in range(i):
            g[i] -= H[i, k] * g[k]
        g[i] /= H[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            g[i] -= H[k, i] * g[k]
        g[i] /= H[i, i]


@kernel
def _step(
    J: Array, e: Array, q: Array, lower: Array, upper: Array, damping: float,
    free: Indices, H: Array, g: Array, out: Array,
) -> None:  # fmt: skip
    """Write the damped, limited step from q into ``out`` (n,)."""
    n, count = q.shape[0], 0
    for j in range(n):
        out[j] = q[j]
        pull = 0.0
        for row in range(6):
            pull += J[row, j] * e[row]
        if (q[j] <= lower[j] and pull < 0.0) or (q[j] >= upper[j] and pull > 0.0):
            continue
        free[count], g[count] = j, pull
        count += 1
    for a in range(count):
        for b in range(a + 1):
            total = 0.0
            for row in range(6):
                total += J[row, free[a]] * J[row, free[b]]
            H[a, b] = total
        H[a, a] += damping
    _cholesky_solve(H, g, count)
    for a in range(count):
        j = free[a]
        out[j] = min(max(q[j] + g[a], lower[j]), upper[j])


@kernel
def _uniform(state: State) -> float:
    """Next number in [0, 1) of a splitmix64 sequence, whose state is one uint64."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    x = state[0]
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x = x ^ (x >> np.uint64(31))
    return float(x >> np.uint64(11)) * 2.0**-53


@kernel
def solve_kernel(
    types: Indices, offsets: Array, T_tip: Array, target: Array, turn: float,
    lower: Array, upper: Array, draw_lower: Array, draw_upper: Array,
    tolerances: Array, starts: int, state: State, start: Array, best: Array, told: Array,
) -> bool:  # fmt: skip
    """Search from ``start`` (n,), then from random draws, until the tolerances are met.

    Fills ``best`` (n,) with the nearest configuration, ``told`` (4,) with its position error,
    orientation error, the iterations and the starts spent.
    """
    n = start.shape[0]
    q, trial = start.copy(), np.empty(n)
    frames, tip = np.empty((n, 4, 4)), np.empty((4, 4))
    J, e, e_trial = np.empty((6, n)), np.empty(6), np.empty(6)
    H, g, free = np.empty((n, n)), np.empty(n), np.empty(n, dtype=np.int64)
    least, iterations = np.inf, 0
    for attempt in range(starts):
        if attempt > 0:
            for j in range(n):
                q[j] = draw_lower[j] + _uniform(state) * (draw_upper[j] - draw_lower[j])
        mu, stale = _DAMPING, 0
        position, rotation = _tip_error(types, offsets, T_tip, target, turn, q, frames, tip, e)
        square = position * position + rotation * rotation
        mark = square
        for _ in range(_STEPS):
            if square < least:
                least = square
                best[:] = q
                told[0], told[1] = position, rotation
            if position <= tolerances[0] and rotation <= tolerances[1]:
                told[2], told[3] = iterations, attempt + 1
                return True
            jacobian_kernel(types, frames, tip[:3, 3], n - 1, J)
            if turn == 0.0:
                J[3:] = 0.0
            _step(J, e, q, lower, upper, mu * square + _LEAST_DAMPING, free, H, g, trial)
            iterations += 1
            position, rotation = _tip_error(
                types, offsets, T_tip, target, turn, trial, frames, tip, e_trial
            )
            after = position * position + rotation * rotation
            if after < square:
                square = after
                q[:] = trial
                e[:] = e_trial
                mu = max(0.2 * mu, 1e-6)
            else:
                # Frames and error of where we stand are needed again.
                position, rotation = _tip_error(
                    types, offsets, T_tip, target, turn, q, frames, tip, e
                )
                mu = 8.0 * mu
            stale += 1
            if square < 0.8 * mark:
                mark, stale = square, 0
            if stale > _PATIENCE:
                break
    told[2], told[3] = iterations, starts
    return False


def solve(
    chain: Chain,
    target: ArrayLike,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    seed: int = 0,
    solutions: int = 1,
    starts: int = 200,
    position_tolerance: float = POSITION_TOLERANCE,
    orientation_tolerance: float = ORIENTATION_TOLERANCE,
    position_only: bool = False,
) -> IkResult:
    """Find up to ``solutions`` distinct configurations that bring a link to a pose.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4).
        link: The link to bring there; the tip where none is named.
        seed_joints: Where to start from, shape (n,); the middle of the limits where not given.
        seed: Of the restarts; the same seed gives the same answer.
        solutions: How many distinct ones to look for.
        starts: Start configurations to spend in all.
        position_tolerance: [m].
        orientation_tolerance: [rad].
        position_only: Leave the orientation free.

    Returns:
        The solutions, nearest to ``seed_joints`` first, or the nearest attempt and advice.

    Raises:
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link, or none that a joint moves.
        InvalidPose: ``target`` is no finite 4x4 matrix.
    """
    T = np.array(target, dtype=np.float64, order="C")
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise InvalidPose("the target must be a finite 4x4 transform")
    if position_tolerance <= 0.0 or orientation_tolerance <= 0.0:
        raise InvalidOption("tolerances must be positive")
    carrier = chain.link(link or chain.tip_link)
    m = carrier.joint + 1
    low, high = chain.sampling_bounds()
    home = np.clip(np.zeros(chain.n), low, high)
    middle = 0.5 * (low + high) if seed_joints is None else chain.configuration(seed_joints)
    middle = np.clip(middle, chain.limits.lower, chain.limits.upper)
    state = np.array([seed], dtype=np.int64).view(np.uint64)
    found: list[IkSolution] = []
    nearest: IkSolution | None = None
    spent = 0
    while spent < starts and len(found) < solutions:
        start = middle
        if spent:
            start = np.array([_uniform(state) for _ in range(chain.n)]) * (high - low) + low
        q, told = home.copy(), np.zeros(4)
        best = q[:m].copy()
        done = solve_kernel(
            chain.joint_types[:m], chain.offsets[:m], carrier.T_joint_link, T,
            0.0 if position_only else 1.0,
            chain.limits.lower[:m], chain.limits.upper[:m], low[:m], high[:m],
            np.array([position_tolerance, orientation_tolerance]),
            starts - spent, state, start[:m].copy(), best, told,
        )  # fmt: skip
        spent += int(told[3])
        q[:m] = best
        q[m:] = middle[m:]
        solution = IkSolution(q, float(told[0]), float(told[1]), int(told[2]))
        if nearest is None or _error(solution) < _error(nearest):
            nearest = solution
        if done and all(np.abs(q - other.joints).max() > _SAME for other in found):
            found.append(solution)
        if m == 0:
            break
    assert nearest is not None
    found.sort(key=lambda solution: float(np.linalg.norm(solution.joints - middle)))
    advice = "" if found else _advice(chain, carrier.name, T, nearest, position_only)
    return IkResult(tuple(found), nearest, spent, advice)


def reach(chain: Chain, link: str | None = None) -> tuple[Array, float]:
    """A ball that no configuration takes the link's origin out of: centre (3,) [m], radius [m].

    Centred on the first joint; its radius is the sum of the fixed offsets and the longest slides.
    """
    carrier = chain.link(link or chain.tip_link)
    if carrier.joint < 0:
        return carrier.T_joint_link[:3, 3], 0.0
    radius = float(np.linalg.norm(carrier.T_joint_link[:3, 3]))
    for i in range(carrier.joint + 1):
        if i > 0:
            radius += float(np.linalg.norm(chain.offsets[i, :3, 3]))
        if chain.joint_types[i] == 1:
            radius += float(max(abs(chain.limits.lower[i]), abs(chain.limits.upper[i])))
    return chain.offsets[0, :3, 3], radius


def _error(solution: IkSolution) -> float:
    return math.hypot(solution.position_error, solution.orientation_error)


def _advice(chain: Chain, link: str, T: Array, nearest: IkSolution, position_only: bool) -> str:
    center, radius = reach(chain, link)
    away = float(np.linalg.norm(T[:3, 3] - center))
    if away > radius:
        return (
            f"The target is {away:.3f} m from the first joint, {away - radius:.3f} m beyond the "
            f"longest the arm can reach ({radius:.3f} m). Bring it nearer."
        )
    if not position_only:
        alone = solve(chain, T, link=link, starts=40, position_only=True)
        if alone.solutions:
            return (
                "The position can be reached, but not in this orientation: the nearest attempt "
                f"is off by {nearest.orientation_error:.4f} rad and "
                f"{nearest.position_error:.4f} m. Turn the pose or move it."
            )
        return (
            "The position can't be reached inside the joint limits in any orientation: the "
            f"nearest attempt stays {alone.nearest.position_error:.4f} m away."
        )
    return f"The nearest attempt inside the joint limits stays {nearest.position_error:.4f} m away."

"""Kernels of seams: the search in layers of configurations, and the projection onto tolerances."""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.jacobian import frame_and_jacobian_kernel

#: Damping of a step, as part of the trace of J J^T: arms of five joints have a singular one.
_DAMPING = 1e-9
#: Errors below this are none [m], [rad].
_NO_ERROR = 1e-10
#: Rounds in which angles are scaled down to a tilt.
_TILT_ROUNDS = 6
#: Weight of the squared joint motion beside the time, so that of equal times the calmest is taken.
_CALM = 0.2


class Layers(NamedTuple):
    """Layers of configurations.

    Args:
        joints: All configurations, layer by layer, shape (m, n).
        firsts: Index of the first of each layer, and m, shape (l + 1,).
        costs: Of each configuration, infinite where it is not to be used, shape (m,).
        times: Least time from each layer to the next, shape (l - 1,) [s].
    """

    joints: Array
    firsts: Indices
    costs: Array
    times: Array


class Steps(NamedTuple):
    """Motions that are allowed from layer to layer.

    Args:
        weights: Least time of a joint for a unit of motion, shape (n,) [s/rad or s/m].
        turns: 1 for joints whose whole turns do not count, shape (n,).
        jump: Largest motion of a joint between neighbouring layers [rad or m].
        blocked: Pairs of configurations that have no way between them, shape (b, 2).
    """

    weights: Array
    turns: Indices
    jump: float
    blocked: Indices


class Ways(NamedTuple):
    """Cheapest ways to configurations.

    Args:
        best: Cost of the best way to each configuration, shape (m,).
        before: The configuration before on that way, -1 where it begins, shape (m,).
        origin: The layer where it begins, shape (m,).
    """

    best: Array
    before: Indices
    origin: Indices


@kernel
def layer_kernel(layers: Layers, steps: Steps, ways: Ways) -> None:
    """Cheapest ways through layers of configurations, by dynamic programming.

    A way costs, between neighbouring layers, the longest time that a joint or the tool takes and a
    share of the squared motion; where a layer can't be reached ways begin anew.

    Args:
        layers: The configurations.
        steps: What is allowed between them.
        ways: Written.
    """
    joints, firsts, costs, times = layers
    weights, turns, jump, blocked = steps
    best, before, origin = ways
    n = joints.shape[1]
    two_pi = 2.0 * math.pi
    for layer in range(firsts.shape[0] - 1):
        for j in range(firsts[layer], firsts[layer + 1]):
            best[j], before[j], origin[j] = costs[j], -1, layer
            if layer == 0 or not costs[j] < np.inf:
                continue
            cheapest, start = np.inf, layer
            for i in range(firsts[layer - 1], firsts[layer]):
                if not best[i] < np.inf or origin[i] > start:
                    continue
                longest, square, fits = times[layer - 1], 0.0, True
                for k in range(n):
                    step = joints[j, k] - joints[i, k]
                    if turns[k] == 1:
                        step -= two_pi * math.floor(step / two_pi + 0.5)
                    if abs(step) > jump:
                        fits = False
                        break
                    time = abs(step) * weights[k]
                    longest = max(longest, time)
                    square += time * time
                if not fits:
                    continue
                cost = best[i] + longest + _CALM * square / max(times[layer - 1], 1e-3)
                # A way that begins earlier is better, whatever it costs.
                if origin[i] == start and cost >= cheapest:
                    continue
                for b in range(blocked.shape[0]):
                    if blocked[b, 0] == i and blocked[b, 1] == j:
                        fits = False
                if fits:
                    cheapest, start = cost, origin[i]
                    before[j], origin[j] = i, origin[i]
            if before[j] >= 0:
                best[j] = costs[j] + cheapest


@kernel
def project_kernel(
    model: Array, nominal: Array, boxes: Array, limits: Array, rounds: int, joints: Array,
    errors: Array,
) -> None:  # fmt: skip
    """Move configurations by the least motion that brings the tool into its tolerances.

    Args:
        model: ``Chain.model``; the tip is the tool.
        nominal: Poses asked for, shape (k, 4, 4).
        boxes: Lower and upper deviations, tilt, whether the axes stand still, and these, shape
            (k, 23).
        limits: Lower and upper joint limits, shape (2, n).
        rounds: Newton steps at most.
        joints: Configurations, moved, shape (k, n).
        errors: What is left, position [m] and orientation [rad], written, shape (k, 2).
    """
    n = joints.shape[1]
    J, e, A, D = np.empty((6, n)), np.empty(6), np.empty((3, 3)), np.empty((3, 3))
    d, S, H = np.empty(6), np.empty((3, 3)), np.empty((6, 6))
    for k in range(nominal.shape[0]):
        q, box = joints[k], boxes[k]
        for i in range(3):
            for c in range(3):
                A[i, c] = box[14 + 3 * i + c] if box[13] != 0.0 else nominal[k, i, c]
        for step in range(rounds + 1):
            B = frame_and_jacobian_kernel(model, q, -1, J)
            T = ((B[0], B[1], B[2]), (B[4], B[5], B[6]), (B[8], B[9], B[10]))
            _deviation(nominal[k], A, T, (B[3], B[7], B[11]), S, D, d)
            _error(nominal[k], A, T, box, d, S, e)
            errors[k, 0] = math.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
            errors[k, 1] = math.sqrt(e[3] ** 2 + e[4] ** 2 + e[5] ** 2)
            if step == rounds or max(errors[k, 0], errors[k, 1]) < _NO_ERROR:
                break
            _least_motion(J, e, H)
            for j in range(n):
                change = 0.0
                for i in range(6):
                    change += J[i, j] * e[i]
                q[j] = min(max(q[j] + change, limits[0, j]), limits[1, j])


@kernel(allocates=False)
def _deviation(
    N: Array, A: Array, T: tuple[tuple[float, float, float], ...],
    p: tuple[float, float, float], S: Array, D: Array, d: Array,
) -> None:  # fmt: skip
    """Write the deviation (6,) of a pose from N; S and D are memory (3, 3)."""
    for i in range(3):
        d[i] = 0.0
        for k in range(3):
            d[i] += A[k, i] * (p[k] - N[k, 3])
            # S = R_T R_N^T
            S[i, k] = T[i][0] * N[k, 0] + T[i][1] * N[k, 1] + T[i][2] * N[k, 2]
    for i in range(3):
        for k in range(3):
            D[i, k] = 0.0
            for a in range(3):
                for b in range(3):
                    D[i, k] += A[a, i] * S[a, b] * A[b, k]
    d[3] = math.atan2(-D[1, 2], D[2, 2])
    d[4] = math.asin(min(1.0, max(-1.0, D[0, 2])))
    d[5] = math.atan2(-D[0, 1], D[0, 0])


@kernel
def _error(
    N: Array, A: Array, T: tuple[tuple[float, float, float], ...], box: Array, d: Array,
    S: Array, e: Array,
) -> None:  # fmt: skip
    """Write the twist (6,) from a pose to the nearest one within the box; S is memory (3, 3)."""
    c = np.empty(6)
    for k in range(6):
        value = d[k]
        if k >= 3 and math.isfinite(box[k]):
            middle = 0.5 * (box[k] + box[6 + k])
            value -= 2.0 * math.pi * math.floor((value - middle) / (2.0 * math.pi) + 0.5)
        c[k] = min(max(value, box[k]), box[6 + k])
    for _ in range(_TILT_ROUNDS):
        tilt = math.acos(min(1.0, max(-1.0, math.cos(c[3]) * math.cos(c[4]))))
        if tilt <= box[12]:
            break
        c[3] *= box[12] / tilt
        c[4] *= box[12] / tilt
    for i in range(3):
        e[i], e[3 + i] = 0.0, 0.0
        for k in range(3):
            e[i] += A[i, k] * (c[k] - d[k])
    if c[3] == d[3] and c[4] == d[4] and c[5] == d[5]:
        return
    ca, sa, cb, sb = math.cos(c[3]), math.sin(c[3]), math.cos(c[4]), math.sin(c[4])
    cc, sc = math.cos(c[5]), math.sin(c[5])
    D = (
        (cb * cc, -cb * sc, sb),
        (ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb),
        (sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb),
    )
    # S = A D A^T, the rotation from the pose asked for to the target; then the target itself.
    for i in range(3):
        for k in range(3):
            S[i, k] = 0.0
            for a in range(3):
                for b in range(3):
                    S[i, k] += A[i, a] * D[a][b] * A[k, b]
    sine = np.zeros(3)
    cosine = -1.0
    for k in range(3):
        x = S[0, 0] * N[0, k] + S[0, 1] * N[1, k] + S[0, 2] * N[2, k]
        y = S[1, 0] * N[0, k] + S[1, 1] * N[1, k] + S[1, 2] * N[2, k]
        z = S[2, 0] * N[0, k] + S[2, 1] * N[1, k] + S[2, 2] * N[2, k]
        sine[0] += 0.5 * (T[1][k] * z - T[2][k] * y)
        sine[1] += 0.5 * (T[2][k] * x - T[0][k] * z)
        sine[2] += 0.5 * (T[0][k] * y - T[1][k] * x)
        cosine += T[0][k] * x + T[1][k] * y + T[2][k] * z
    size = math.sqrt(sine[0] ** 2 + sine[1] ** 2 + sine[2] ** 2)
    scale = math.atan2(size, 0.5 * cosine) / size if size > 1e-15 else 1.0
    for i in range(3):
        e[3 + i] = scale * sine[i]


@kernel(allocates=False)
def _least_motion(J: Array, e: Array, H: Array) -> None:
    """Replace the twist e by (J J^T + damping)^-1 e, by Cholesky's factors in H (6, 6)."""
    n, trace = J.shape[1], 0.0
    for i in range(6):
        for k in range(i + 1):
            H[i, k] = 0.0
            for j in range(n):
                H[i, k] += J[i, j] * J[k, j]
        trace += H[i, i]
    for i in range(6):
        H[i, i] += _DAMPING * trace
        for k in range(i + 1):
            total = H[i, k]
            for j in range(k):
                total -= H[i, j] * H[k, j]
            H[i, k] = math.sqrt(max(total, 1e-300)) if i == k else total / H[k, k]
    for i in range(6):
        for j in range(i):
            e[i] -= H[i, j] * e[j]
        e[i] /= H[i, i]
    for i in range(5, -1, -1):
        for j in range(i + 1, 6):
            e[i] -= H[j, i] * e[j]
        e[i] /= H[i, i]

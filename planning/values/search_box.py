"""Boxes in joint space that random configurations are drawn from."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from compiled.kernel import direct, kernel
from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain, JointType

_REVOLUTE = int(JointType.REVOLUTE)
_TURN = 2.0 * np.pi


def search_box(chain: Chain, known: Sequence[Array] | Array) -> tuple[Array, Array]:
    """Bounds (n,) to draw from: the limits, or a turn beyond what is known where there are none.

    Args:
        chain: The robot.
        known: Configurations that the box must hold, each (n,) [rad or m].
    """
    return _box(chain, known, nearby=False)


def nearby_box(chain: Chain, known: Sequence[Array] | Array) -> tuple[Array, Array]:
    """The part (n,) of ``search_box`` that is within half a turn of what is known.

    Of joints that can turn further. It has the arm in every place that the whole box has it in,
    by fewer turns: of six joints with 720 degrees each it is a sixty-fourth of the whole.

    Args:
        chain: The robot.
        known: Configurations that the box must hold, each (n,) [rad or m].
    """
    return _box(chain, known, nearby=True)


def _box(chain: Chain, known: Sequence[Array] | Array, *, nearby: bool) -> tuple[Array, Array]:
    points, limits = np.array(known, dtype=np.float64), chain.limits
    low, high = np.empty(chain.n), np.empty(chain.n)
    _write_box()(chain.joint_types, limits.lower, limits.upper, points, nearby, low, high)
    return low, high


@cache
def _write_box() -> Callable[[Indices, Array, Array, Array, bool, Array, Array], None]:
    """``box_kernel`` without the look at its arguments' types, which would cost more than it."""
    example = np.zeros(1)
    return direct(
        box_kernel, np.zeros(1, np.int64), example, example, example[None], True, example, example
    )


@kernel(allocates=False, unlocks=False)
def box_kernel(
    types: Indices, lower: Array, upper: Array, known: Array, nearby: bool, low: Array, high: Array
) -> None:
    """Write the bounds of ``search_box``, or of ``nearby_box``, into ``low`` and ``high`` (n,).

    Args:
        types: Types of the joints, shape (n,).
        lower: Lower limits of the joints, shape (n,).
        upper: Upper limits of the joints, shape (n,).
        known: Shape (k, n).
        nearby: Whether to stay within half a turn of what is known.
        low: Filled.
        high: Filled.
    """
    for j in range(types.shape[0]):
        least, most = known[0, j], known[0, j]
        for k in range(1, known.shape[0]):
            least, most = min(least, known[k, j]), max(most, known[k, j])
        low[j] = lower[j] if np.isfinite(lower[j]) else least - _TURN
        high[j] = upper[j] if np.isfinite(upper[j]) else most + _TURN
        if nearby and types[j] == _REVOLUTE and high[j] - low[j] > _TURN:
            low[j], high[j] = max(low[j], least - np.pi), min(high[j], most + np.pi)

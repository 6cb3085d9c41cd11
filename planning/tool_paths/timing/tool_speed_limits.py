"""Joint limits that keep the tool below the speed that it is asked to keep."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from planning.result import SpeedLimit
from planning.timing.jerk.steady_speed import speed_caps
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_run import RunPart

_QUANTITIES: tuple[Literal["velocity", "acceleration", "jerk"], ...] = (
    "velocity", "acceleration", "jerk",
)  # fmt: skip
#: A limit that allows this part of the speed asked for is none.
_KEPT = 0.99
#: Places of a path that differ by less are the same.
_SAME_PLACE = 1e-9


def speed_limits(
    joint_names: Sequence[str],
    path: JointPath,
    parts: Sequence[RunPart],
    length: float,
    speed: float,
    parametrization: TimeParametrization,
) -> list[SpeedLimit | None]:
    """The limit of each part of a run that is farthest below the speed asked for.

    Args:
        joint_names: n names.
        path: The joint path of the run, by its place.
        parts: Of the run, as far as the path goes.
        length: Of the whole run [m].
        speed: What is asked for [m/s].
        parametrization: The limits.

    Returns:
        One for each part; None where the joints allow the speed all along it.
    """
    jerk = parametrization.jerk
    limits = np.stack(
        [
            parametrization.velocity,
            parametrization.acceleration,
            np.full(path.n, np.inf) if jerk is None else jerk,
        ]
    )
    caps = length * (speed_caps(path, limits, 1.0) if jerk is None else speed_caps(path, limits))
    breaks, found = path.breaks, list[SpeedLimit | None]()
    for part in parts:
        inside = (breaks[1:] > part.begin + _SAME_PLACE) & (breaks[:-1] < part.end - _SAME_PLACE)
        own = caps[inside]
        if not len(own) or not own.min() < _KEPT * speed:
            found.append(None)
            continue
        _, quantity, joint = np.unravel_index(int(np.argmin(own)), own.shape)
        name = _QUANTITIES[int(quantity)]
        found.append(SpeedLimit(float(own.min()), joint_names[int(joint)], name))
    return found

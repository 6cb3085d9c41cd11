"""Events of a closed loop: breaks of the reference, control periods, disturbances."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import MAX_SAMPLES
from tracking.simulation.disturbance import Disturbance, EncoderNoise
from tracking.simulation.options import SimulationOptions
from tracking.simulation.references import ReferenceSignal

# A period that would begin this part of one before the end is the end itself, to rounding.
_SAME_PERIOD = 1e-6
# Events closer than this part of the duration are one.
_SAME_EVENT = 1e-12


class Events(NamedTuple):
    """Instants at which the loop is not smooth or the controller is called (s segments between).

    Args:
        times: Shape (s + 1,) [s].
        pieces: Piece of the reference on each segment, shape (s,).
        called: Whether a held controller is called at the start, shape (s,).
        noises: Row of the encoders' errors, shape (s,).
        disturbed: Whether the disturbance acts, shape (s,).
        noise: The encoders' errors, shape (., 2, n).
    """

    times: Array
    pieces: NDArray[np.int64]
    called: NDArray[np.bool_]
    noises: NDArray[np.int64]
    disturbed: NDArray[np.bool_]
    noise: Array


def schedule(
    signal: ReferenceSignal,
    duration: float,
    options: SimulationOptions,
    disturbance: Disturbance | None,
    noise: EncoderNoise | None,
) -> Events:
    """All events of a run of ``duration`` seconds.

    Raises:
        InvalidOption: A period is too short for the duration.
    """
    called: list[float] = []
    if options.control_period is not None:
        called = list(periods(duration, options.control_period, "control_period"))
    elif noise is not None:
        called = list(periods(duration, noise.period, "encoder period"))
    others = signal.breaks(duration)
    if disturbance is not None:
        others += disturbance.cuts(duration)
    marks = [*((t, True) for t in called), *((t, False) for t in [0.0, *others])]
    marks.sort(key=lambda mark: (mark[0], not mark[1]))
    starts, flags = [marks[0][0]], [marks[0][1]]
    for t, is_call in marks[1:]:
        if t - starts[-1] > _SAME_EVENT * duration:
            starts.append(t)
            flags.append(is_call)
        else:
            flags[-1] = flags[-1] or is_call
    rows = np.cumsum(flags) - 1 if called else np.zeros(len(starts), dtype=np.int64)
    acts = [disturbance is not None and disturbance.start <= t < disturbance.end for t in starts]
    n = signal.trajectory.n
    return Events(
        np.array([*starts, duration]),
        np.array([signal.piece(t + _SAME_EVENT * duration) for t in starts], dtype=np.int64),
        np.array(flags) & (options.control_period is not None),
        np.asarray(rows, dtype=np.int64),
        np.array(acts),
        np.zeros((max(len(called), 1), 2, n)) if noise is None else noise.draw(len(called), n),
    )


def periods(duration: float, period: float, name: str) -> Iterator[float]:
    """Times 0, period, 2 period, ... before ``duration``.

    Raises:
        InvalidOption: There are too many of them.
    """
    if duration / period > MAX_SAMPLES:
        raise InvalidOption(
            f"a {name} of {period} s over {duration} s gives more than {MAX_SAMPLES} of them",
            hint=f"Give at least {duration / MAX_SAMPLES:.3g} s.",
        )
    count = max(1, math.ceil(duration / period - _SAME_PERIOD))
    return (i * period for i in range(count))

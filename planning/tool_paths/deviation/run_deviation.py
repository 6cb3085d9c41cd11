"""Deviation of the tool from a run of motions, for planners: piece by piece, motion by motion."""

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from planning.tool_motions.tool_run import ToolRun
from planning.tool_paths.deviation.tool_deviation import piece_deviations

#: Places of pieces and motions that differ by less are the same.
_SAME_PLACE = 1e-12


def pieces_within(
    chain: Chain,
    run: ToolRun,
    places: Array,
    breaks: Array,
    coefficients: Array,
    tolerances: tuple[float, float],
) -> NDArray[np.bool_]:
    """Whether the tool is proved to keep to a run on each piece of a piecewise polynomial.

    Args:
        chain: The robot; its tip is the tool.
        run: The motions.
        places: Of the run at the ends of the pieces, those where its motions meet among them,
            shape (m + 1,).
        breaks: Ends of the pieces in their own parameter, shape (m + 1,).
        coefficients: Shape (m, n, k), ascending.
        tolerances: Deviations allowed [m], [rad]; infinite where it is free.

    Returns:
        Shape (m,).
    """
    within = np.zeros(len(breaks) - 1, dtype=np.bool_)
    for part in run.parts:
        first = int(np.searchsorted(places, part.begin - _SAME_PLACE))
        last = int(np.searchsorted(places[:-1], part.end - _SAME_PLACE))
        if first < last:
            _, within[first:last], _ = piece_deviations(
                chain,
                breaks[first : last + 1],
                coefficients[first:last],
                part.motion,
                tolerances,
            )
    return within

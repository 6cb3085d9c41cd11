"""Splines of few pieces near motions that lead the tool."""

import math

import numpy as np

from kinematics.model.chain import Chain
from planning.timing.parametrization import WORTH, TimeParametrization
from planning.timing.spline.quintic_fit import fit_quintic
from planning.timing.time_scaling import ScaledTime
from planning.tool_motions.tool_path import Tolerances
from planning.tool_motions.tool_run import ToolRun
from planning.tool_paths.deviation.tool_deviation import piece_deviations

#: Spans for each second that are tried in turn [1/s], and spans at least.
_SPANS = ((12.0, 10), (16.0, 13), (24.0, 17))
#: A spline that takes longer than the motion by this factor is only taken if no other is faster.
_FAST = 1.05
#: Of the deviation allowed, what a spline may use: the rest is for the proof's bounds.
_SHARE = 0.5


def spline_near(
    chain: Chain,
    run: ToolRun,
    timed: ScaledTime,
    tolerances: Tolerances,
    parametrization: TimeParametrization,
) -> ScaledTime:
    """The spline of fewest pieces near a motion along a run; the motion itself where none will do.

    Whether the tool keeps near enough is seen here for a run of one motion, and by the proof for
    all; whether the spline is free of collisions by the proof alone.

    Args:
        chain: The robot; its tip is the tool.
        run: What the tool follows.
        timed: The motion, from rest to rest.
        tolerances: Deviations allowed.
        parametrization: The limits.
    """
    motion = timed.trajectory
    if parametrization.loads is not None or run.tolerances or run.tool_speeds:
        return timed
    allowed = (_SHARE * tolerances.pair[0], _SHARE * tolerances.pair[1])
    best = timed
    for rate, least in _SPANS:
        count = max(least, math.ceil(rate * motion.duration))
        if count >= len(motion.breaks) - 1:
            break
        spline = fit_quintic(
            motion, motion.joint_names, parametrization.jerk_bounds, count, count / motion.duration
        )
        found = spline.trajectory
        longer = found.duration / motion.duration
        if longer > WORTH or (best is not timed and longer > _FAST):
            continue
        if len(run.motions) == 1:
            _, within, _ = piece_deviations(
                chain, found.breaks, found.coefficients, run.motions[0], allowed
            )
            if not np.all(within):
                continue
        if best is timed or found.duration < best.trajectory.duration:
            best = spline
        if longer <= _FAST:
            break
    return best

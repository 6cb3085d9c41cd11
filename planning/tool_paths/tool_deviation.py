"""Deviation of the tool from its motion, sampled, for planners.

The tool is off by its distance from the nearest place of the motion, and by its turn from the
orientation there. Planners sample it, and leave a part of the tolerance to what lies between; all
of a motion is bounded by the proof alone (``planning.proof.tool.tool_deviation``).
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.forward import forward
from kinematics.model.chain import Chain
from planning.tool_motions.tool_corner import ToolCorner, ToolCurve
from planning.tool_motions.tool_path import ToolRun
from planning.tool_paths.projection import box_errors, pack_tolerance

#: Samples of a piece, in the middles of as many parts of it.
_SAMPLES = 8


def pieces_within(
    chain: Chain,
    run: ToolRun,
    places: Array,
    breaks: Array,
    coefficients: Array,
    tolerances: tuple[float, float],
) -> NDArray[np.bool_]:
    """Whether samples of the tool keep to a run on each piece of a piecewise polynomial.

    Deviations are measured from the places that the tool is at, as the proof does.

    Args:
        chain: The robot; its tip is the tool.
        run: The motions.
        places: Places of the run at the ends of the pieces, those where its motions meet among
            them, shape (m + 1,).
        breaks: Ends of the pieces in their own parameter, shape (m + 1,).
        coefficients: Shape (m, n, k), ascending.
        tolerances: Deviations allowed, of boxes those beyond them [m], [rad]; infinite where it
            is free.

    Returns:
        Shape (m,).
    """
    m, n, size = coefficients.shape
    since = np.outer(np.diff(breaks), (np.arange(_SAMPLES) + 0.5) / _SAMPLES)
    joints = np.einsum("mnk,msk->msn", coefficients, since[..., None] ** np.arange(size))
    joints = joints.reshape(-1, n)
    T = forward(chain, joints)
    if run.tolerances:
        owners = _own_motions(run, T)
    else:
        # Places of pieces and motions that differ by less are the same.
        same_place = 1e-12
        at = np.searchsorted(run.breaks[1:-1] - same_place, places[:-1], side="right")
        owners = np.repeat(at, _SAMPLES)
    errors = run_errors(chain, run, owners, T, joints)
    return np.asarray((errors <= tolerances).reshape(m, -1).all(axis=1))


def run_errors(chain: Chain, run: ToolRun, owners: Indices, T: Array, joints: Array) -> Array:
    """Deviations of the tool from its motions, or how far it is out of their boxes.

    Args:
        chain: The robot; its tip is the tool.
        run: The motions.
        owners: Index of the motion that each pose is measured from, shape (k,).
        T: Poses of the tool, shape (k, 4, 4).
        joints: Its configurations, shape (k, n).

    Returns:
        Shape (k, 2) [m], [rad].
    """
    nominal = np.empty((len(T), 4, 4))
    for k in np.unique(owners):
        motion, mine = run.motions[k], owners == k
        nominal[mine] = motion.poses(places_at(motion, T[mine]))
    boxes = np.array([pack_tolerance(part.tolerance) for part in run.parts])[owners]
    return box_errors(chain, nominal, boxes, joints)


def _own_motions(run: ToolRun, T: Array) -> Indices:
    """Index of the motion that the tool is on with its poses T (k, 4, 4), in order, shape (k,).

    Each point belongs to the motion up to the plane across the path at its end.
    """
    ends = [motion.T_end[:3, 3] for motion in run.motions[:-1]]
    across = [one.direction(1.0) + other.direction(0.0) for one, other in pairwise(run.motions)]
    owners, k = np.zeros(len(T), dtype=np.int64), 0
    for i, point in enumerate(T[:, :3, 3]):
        while k < len(ends) and (point - ends[k]) @ across[k] >= 0.0:
            k += 1
        owners[i] = k
    return owners


def places_at(motion: ToolCurve, T: Array) -> Array:
    """Places from 0 to 1 on a motion that the tool is at with its poses T (k, 4, 4), shape (k,)."""
    # A motion that is shorter is a turn on the spot [m].
    if isinstance(motion, ToolCorner) or motion.length >= 1e-9:
        return motion.places(T[:, :3, 3])
    if motion.angle == 0.0:
        return np.zeros(len(T))
    # The angle about the turn's axis that D = R R_0^T contains.
    axis = motion.turn / motion.angle
    D = T[:, :3, :3] @ motion.T_start[:3, :3].T
    skew = [D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]]
    turned = np.arctan2(axis @ skew, np.trace(D, axis1=1, axis2=2) - 1.0)
    turned -= 2.0 * np.pi * np.round((turned - 0.5 * motion.angle) / (2.0 * np.pi))
    return np.asarray(np.clip(turned / motion.angle, 0.0, 1.0))

"""Exact verdicts about joint motions that also have to hold constraints."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from obstacles.checker import Checker, Motion
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import holds
from planning.constraints.row import LOWER, UPPER

#: Kept back of each row's width, so that corners can be rounded without leaving it.
_KEPT_BACK = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class ConstrainedChecker(Checker):
    """A checker to which a motion is free where it also holds all rows for every instant.

    Args:
        constraints: The hard ones, on the model's chain.
        spare: What of its rows start and goal have to spare, shape (m,); half of it may be kept
            back.
    """

    constraints: ConstraintSet = field(kw_only=True)
    spare: Array = field(kw_only=True)

    @property
    def rows(self) -> Array:
        """The packed rows, somewhat narrower than asked for, (m, WIDTH)."""
        return narrowed(self.constraints, _KEPT_BACK, 0.5 * self.spare)

    def curve(self, b0: Array, b1: Array, b2: Array, b3: Array | None = None) -> Motion:
        """Prove the joint motion b0 + b1 s + b2 s^2 + b3 s^3 over 0 <= s <= 1, each (n,)."""
        powers = [b0, b1, b2] if b3 is None else [b0, b1, b2, b3]
        coefficients = np.column_stack(powers)
        if not holds(self.model.chain, self.rows, coefficients):
            places = coefficients @ np.linspace(0.0, 1.0, 9) ** np.arange(len(powers))[:, None]
            residuals = self.constraints.residuals(places.T)
            worst = np.unravel_index(int(np.argmax(residuals)), residuals.shape)
            label = self.constraints.label(int(worst[1]))
            pair = (self.model.chain.tip_link, label)
            return Motion(False, False, float(worst[0]) / 8.0, pair, -np.inf, 1)
        return Checker.curve(self, b0, b1, b2, b3)

    def free(self, start: Array, end: Array) -> bool:
        """Whether the straight joint motion is proved free and holds all rows."""
        line = np.column_stack([start, end - start])
        return holds(self.model.chain, self.rows, line) and Checker.free(self, start, end)

    def polyline(self, waypoints: Array) -> tuple[Motion, int]:
        """Prove every leg of a polyline (k, n); what was found and the leg it is about."""
        for leg, (a, b) in enumerate(pairwise(waypoints)):
            motion = self.segment(a, b)
            if not motion.free:
                return motion, leg
        return motion, len(waypoints) - 1


def narrowed(constraints: ConstraintSet, share: float, most: Array | float = np.inf) -> Array:
    """The packed rows with their bounds moved inwards by a share of half their width, at ``most``.

    Args:
        constraints: m rows.
        share: 0 leaves them, 1 leaves their middle.
        most: In each row's unit, number or shape (m,).
    """
    rows = np.array(constraints.packed)
    two_sided = np.isfinite(rows[:, LOWER])
    half = np.where(
        two_sided, 0.5 * (rows[:, UPPER] - np.nan_to_num(rows[:, LOWER])), rows[:, UPPER]
    )
    inwards = np.maximum(np.minimum(share * half, most), 0.0)
    rows[:, UPPER] -= inwards
    rows[:, LOWER] += inwards
    return rows

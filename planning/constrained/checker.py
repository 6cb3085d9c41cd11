"""A checker of joint motions that also have to hold constraints."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker, Motion
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import edge_holds
from planning.constraints.row import Column


@dataclass(frozen=True, slots=True, eq=False)
class ConstrainedChecker(Checker):
    """A checker that calls a motion free where it also holds all rows for every instant.

    Args:
        constraints: Hard constraints with m rows, on the model's chain.
        spare: How far start and goal are inside each row, shape (m,) [m or rad]; rows are narrowed
            by half of it at most, and by 2 mm or 2 mrad.
    """

    constraints: ConstraintSet = field(kw_only=True)
    spare: Array = field(kw_only=True)

    @property
    def rows(self) -> Array:
        """The packed rows, somewhat narrower than asked for, (m, WIDTH)."""
        # What a row is narrowed by at most [m or rad]: a way with more to spare is found.
        limit = np.minimum(0.5 * self.spare, 2e-3)
        # Share of half a row's width by which it is narrowed, so that corners can be rounded inside
        # it.
        return narrow_rows(self.constraints, 0.05, limit)

    def holds(self, states: Array) -> bool:
        """Whether configurations (k, n) hold all constraints as they were asked for."""
        return not (self.constraints.residuals(states) > 0.0).any()

    def curve(self, b0: Array, b1: Array, b2: Array, b3: Array | None = None) -> Motion:
        """Prove the joint motion b0 + b1 s + b2 s^2 + b3 s^3 over 0 <= s <= 1, each (n,)."""
        powers = [b0, b1, b2] if b3 is None else [b0, b1, b2, b3]
        coefficients = np.column_stack(powers)
        if not edge_holds(self.model.robot.chain, self.rows, coefficients):
            # Samples of a motion that violates a row, to find where it does most.
            s = np.linspace(0.0, 1.0, 9)
            samples = coefficients @ s ** np.arange(len(powers))[:, None]
            residuals = self.constraints.residuals(samples.T)
            worst, row = np.unravel_index(int(np.argmax(residuals)), residuals.shape)
            pair = (self.model.robot.chain.tip_link, self.constraints.label(int(row)))
            return Motion(False, False, float(s[worst]), pair, -np.inf, 1)
        return Checker.curve(self, b0, b1, b2, b3)

    def round_corners(
        self, waypoints: Array, reaches: Array, halvings: int, *, keep: bool, smooth: bool
    ) -> Iterator[int]:
        """``Checker.round_corners``, one ``curve`` after the other."""
        return round_one_by_one(self, waypoints, reaches, halvings, keep=keep, smooth=smooth)

    def straight(self, start: Array, end: Array) -> Motion:
        """``Checker.straight``; what it finds free has to hold all rows as well."""
        motion = Checker.straight(self, start, end)
        return self.segment(start, end) if motion.free else motion

    def free(self, start: Array, end: Array) -> bool:
        """Whether the straight joint motion is proved free and holds all rows."""
        chain, line = self.model.robot.chain, np.column_stack([start, end - start])
        return edge_holds(chain, self.rows, line) and Checker.free(self, start, end)

    def polyline(self, waypoints: Array) -> tuple[Motion, int]:
        """Prove every leg of a polyline (k, n).

        Returns:
            The first leg that is not free, or the last leg, and its number.
        """
        for leg, (a, b) in enumerate(pairwise(waypoints)):
            motion = self.segment(a, b)
            if not motion.free:
                return motion, leg
        return motion, len(waypoints) - 1


def round_one_by_one(
    checker: Checker, waypoints: Array, reaches: Array, halvings: int, *, keep: bool, smooth: bool
) -> Iterator[int]:
    """``Checker.round_corners`` by what the checker says of each ``curve``."""
    for i, widest in enumerate(reaches.tolist()):
        corner, legs = waypoints[i + 1], np.diff(waypoints[i : i + 3], axis=0)
        u = legs / np.linalg.norm(legs, axis=1, keepdims=True)
        if widest > 0.0:
            reaches[i] = -1.0
            tried = 0 if keep and not checker.valid(corner) else halvings
            for reach in widest * 0.5 ** np.arange(tried):
                if _is_corner_free(checker, corner, u, reach, smooth):
                    reaches[i] = reach
                    break
        yield i + 1


def _is_corner_free(checker: Checker, corner: Array, u: Array, reach: float, smooth: bool) -> bool:
    turn = reach * (u[1] - u[0])
    if not smooth:
        return checker.curve(corner - reach * u[0], 2.0 * reach * u[0], turn).free
    none = np.zeros_like(corner)
    # The second one is looked at backwards.
    return all(
        checker.curve(corner - reach * away, reach * away, none, turn / 6.0).free
        for away in (u[0], -u[1])
    )


def narrow_rows(constraints: ConstraintSet, share: float, limit: Array | float = np.inf) -> Array:
    """The packed rows with their bounds moved inwards by a share of half their width.

    Args:
        constraints: Constraints with m rows.
        share: 0 leaves them as they are, 1 leaves their middle.
        limit: Largest move, a number or shape (m,) [m or rad].
    """
    rows = np.array(constraints.packed)
    two_sided = np.isfinite(rows[:, Column.LOWER])
    lower, upper = np.nan_to_num(rows[:, Column.LOWER]), rows[:, Column.UPPER]
    half = np.where(two_sided, 0.5 * (upper - lower), upper)
    inwards = np.maximum(np.minimum(share * half, limit), 0.0)
    rows[:, Column.UPPER] -= inwards
    rows[:, Column.LOWER] += inwards
    return rows

"""Braking of single joints: the quickest way of each to rest at its limits.

A joint with velocity v and acceleration a brakes with jerk -J down to acceleration -p, holds that
where -p is its limit, and comes to rest with jerk J (its mirror image where v + a |a| / 2J < 0).
Without a limit of jerk it brakes at its limit of acceleration at once.

Two states in order, v <= v' and a <= a', stay in order of velocity while both brake: at a crossing
v = v' of the velocities the later state would have the lesser acceleration, and v + a |a| / 2J of
the two the signs in the wrong order. So the position reached after any time grows with v and with
a, and so does the time to rest where the joint moves forwards: ends of intervals bound all of them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Limits
from planning.values.limits import MotionLimits


class BrakingLimits(NamedTuple):
    """Limits that joints brake at, each of shape (n,).

    Args:
        acceleration: Largest acceleration [rad/s^2 or m/s^2].
        jerk: Largest jerk, infinite where none is known [rad/s^3 or m/s^3].
    """

    acceleration: Array
    jerk: Array

    @classmethod
    def of(
        cls, limits: Limits, joint_names: Sequence[str], wanted: MotionLimits
    ) -> "BrakingLimits":
        """Limits of joints, or those wanted in their place.

        Raises:
            MissingLimit: The acceleration of a joint has no limit, so that nothing says how it
                brakes.
        """
        given = wanted.bounds
        acceleration = np.asarray(given.get("acceleration", limits.acceleration), np.float64)
        known = np.where(np.isfinite(acceleration), acceleration, np.nan)
        jerk = np.asarray(given.get("jerk", limits.jerk), np.float64)
        return cls(
            replace(limits, acceleration=known).require("acceleration", joint_names),
            np.where(np.isnan(jerk), np.inf, jerk),
        )


class Braking(NamedTuple):
    """Braking of joints, arrays of one shape; times count from its begin.

    Args:
        sign: 1 where the joint brakes from a forward motion, -1 for the mirror image.
        velocity: Velocity at the begin, mirrored [rad/s or m/s].
        acceleration: Acceleration just after the begin, mirrored [rad/s^2 or m/s^2].
        jerk: Size of the jerk, 0 where the acceleration jumps [rad/s^3 or m/s^3].
        spans: Lengths of the three phases, shape (3, ...) [s].
    """

    sign: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    spans: Array

    @classmethod
    def of(cls, velocity: Array, acceleration: Array, limits: BrakingLimits) -> "Braking":
        """Quickest braking from states whose last axis is that of the joints."""
        A, jerk = np.broadcast_arrays(*limits, velocity)[:2]
        jumps = np.isinf(jerk)
        J = np.where(jumps, 1.0, jerk)
        a = np.where(jumps, 0.0, acceleration)
        sign = np.where(velocity + a * np.abs(a) / (2.0 * J) >= 0.0, 1.0, -1.0)
        v, a = sign * velocity, sign * a
        # More than the limit is not built up, but where it is there it is held.
        most = np.maximum(A, -a)
        peak = np.minimum(np.sqrt(np.maximum(J * v + 0.5 * a * a, 0.0)), most)
        # The first phase ends at the peak, which a joint that brakes harder already is beyond.
        peak = np.maximum(peak, np.maximum(-a, 0.0))
        left = v + (0.5 * a * a - peak * peak) / J
        held = np.where(peak > 0.0, left / np.where(peak > 0.0, peak, 1.0), 0.0)
        spans = np.stack([(a + peak) / J, np.where(peak >= most, held, 0.0), peak / J])
        spans[:, jumps] = 0.0
        spans[1] = np.where(jumps, v / A, spans[1])
        return cls(
            sign,
            v,
            np.where(jumps, -A, a),
            np.where(jumps, 0.0, J),
            np.maximum(spans, 0.0),
        )

    @property
    def duration(self) -> Array:
        """Time to rest [s]."""
        return np.asarray(self.spans.sum(axis=0))

    @property
    def turn(self) -> Array:
        """Time at which a joint that brakes too much turns round, 0 for none [s]."""
        v, a, J = self.velocity, self.acceleration, np.where(self.jerk > 0.0, self.jerk, 1.0)
        root = np.sqrt(np.maximum(a * a + 2.0 * J * v, 0.0))
        return np.where((v < 0.0) & (self.jerk > 0.0), (a - root) / J, 0.0)

    def moved(self, time: Array) -> Array:
        """Distance from the begin after a time of the arrays' shape [rad or m]."""
        v, a, total = self.velocity, self.acceleration, np.zeros_like(self.velocity)
        for phase, jerk in enumerate((-self.jerk, np.zeros_like(self.jerk), self.jerk)):
            x = np.clip(time, 0.0, self.spans[phase])
            total = total + x * (v + x * (0.5 * a + x * jerk / 6.0))
            v, a = v + x * (a + 0.5 * x * jerk), a + x * jerk
            time = time - self.spans[phase]
        return np.asarray(self.sign * total)

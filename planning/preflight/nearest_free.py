"""A free configuration near one that is not free."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from obstacles.collision.checker import Checker

#: Clearance that a configuration found to be free has at least, margins taken off [m].
_CLEARANCE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class NearestFree:
    """A free configuration near one that is not free.

    Args:
        joints: Shape (n,).
        distance: Euclidean, in joint space.
        tip_distance: How far the tip's origin is moved [m].
        clearance: Margins taken off [m].
    """

    joints: Array
    distance: float
    tip_distance: float
    clearance: float

    @property
    def details(self) -> dict[str, Any]:
        """The configuration as values a program can use."""
        return {
            "joints": self.joints.tolist(),
            "distance": self.distance,
            "tip_distance": self.tip_distance,
            "clearance": self.clearance,
        }


def nearest_free(checker: Checker, q: Array, seed: int = 0) -> NearestFree | None:
    """Find a free configuration near ``q``, inside the limits; None if none is found.

    It takes the least step that brings all near pairs apart, to first order, again and again. Where
    that fails, it tries random configurations farther and farther off. From the first that is free
    it goes back towards ``q`` as far as that stays free. It is near, not proved to be nearest.

    Args:
        checker: The robot in its scene, margins included.
        q: Configuration, shape (n,) [rad or m].
        seed: Of the draws; the same seed gives the same answer.
    """
    chain = checker.model.chain
    spacious = Checker(checker.model, checker.slack + _CLEARANCE)
    inside = np.clip(q, chain.limits.lower, chain.limits.upper)
    free = _descend(spacious, inside)
    if free is None:
        free = _draw(spacious, inside, np.random.default_rng(seed))
    if free is None:
        return None
    free = _go_back(spacious, free, inside)
    tip_motion = forward(chain, free)[:3, 3] - forward(chain, q)[:3, 3]
    clearance, _ = checker.clearance(free)
    distance, tip_distance = np.linalg.norm(free - q), np.linalg.norm(tip_motion)
    return NearestFree(free, float(distance), float(tip_distance), clearance)


def _descend(spacious: Checker, q: Array) -> Array | None:
    """Step away from contacts until there are none; None where that does not succeed."""
    limits = spacious.model.chain.limits
    # Steps of the descent away from contacts.
    for _ in range(40):
        if spacious.valid(q):
            return q
        # Distance up to which pairs are taken into account in it [m].
        near = spacious.gradient(q, 0.02)
        touching = near.distances <= _CLEARANCE
        if not touching.any():
            return None
        # What is near but apart may come nearer, though not into touch.
        change = np.where(touching, 2.0 * _CLEARANCE - near.distances, 0.0)
        approach = near.gradients @ _least_step(near.gradients[touching], change[touching]) < 0
        active = touching | approach
        step = _least_step(near.gradients[active], change[active])
        longest = float(np.abs(step).max())
        if not longest > 0.0:
            return None
        # Longest step of any joint in it [rad or m].
        step *= min(1.0, 0.2 / longest)
        q = np.clip(q + step, limits.lower, limits.upper)
    return None


def _least_step(gradients: Array, change: Array) -> Array:
    """The least step (n,) that changes the distances (k,) as asked, to first order."""
    # Singular values below this part of the largest count as zero in a step.
    return np.asarray(np.linalg.lstsq(gradients, change, rcond=1e-3)[0])


def _draw(spacious: Checker, q: Array, random: np.random.Generator) -> Array | None:
    """The nearest of the random configurations that are free, if one is."""
    chain = spacious.model.chain
    low, high = chain.sampling_bounds()
    best: Array | None = None
    # Random configurations about the one that is not free, if the descent fails.
    draws = 240
    for k in range(draws):
        # Half-width of the first draw's box, as part of the joints' ranges; the last has all of
        # them.
        share = 0.02 ** (1.0 - k / draws)
        drawn = q + share * (high - low) * random.uniform(-1.0, 1.0, chain.n)
        drawn = np.clip(drawn, chain.limits.lower, chain.limits.upper)
        if best is not None and np.linalg.norm(drawn - q) >= np.linalg.norm(best - q):
            continue
        if spacious.valid(drawn):
            best = _go_back(spacious, drawn, q)
    return best


def _go_back(spacious: Checker, free: Array, q: Array) -> Array:
    """The free configuration nearest to ``q`` that a bisection finds on the way there."""
    low, high = 0.0, 1.0
    # Bisections of the way back to the configuration that was asked for.
    for _ in range(12):
        middle = 0.5 * (low + high)
        if spacious.valid(free + middle * (q - free)):
            low = middle
        else:
            high = middle
    return np.asarray(free + low * (q - free))

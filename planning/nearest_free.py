"""The nearest free configuration that is found beside one that is not free."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from obstacles.checker import Checker

#: Clearance that a configuration found to be free has at least, margins taken off [m].
_ROOM = 1e-3
#: Steps of the descent out of what is touched, and how near pairs count in it [m].
_STEPS, _NEAR = 40, 0.02
#: Farthest step of any joint in it [rad or m].
_STRIDE = 0.2
#: Random configurations about the one that is not free, if the descent fails, and how far off they
#: are drawn: from hardly to all over the joints' ranges.
_DRAWS = 240
_NARROWEST = 0.02
#: Halvings of the way back to what was asked for.
_HALVINGS = 12


@dataclass(frozen=True, slots=True, eq=False)
class NearestFree:
    """A configuration that is free, near one that is not.

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
        """As values a program can use."""
        return {
            "joints": self.joints.tolist(),
            "distance": self.distance,
            "tip_distance": self.tip_distance,
            "clearance": self.clearance,
        }


def nearest_free(checker: Checker, q: Array, seed: int = 0) -> NearestFree | None:
    """A free configuration near one that is not, inside the limits; None if none was found.

    Descends on what overlaps: the least step that brings all near pairs apart, to first order,
    again and again. Where that fails, random draws farther and farther off are tried. From what is
    found it goes back towards ``q`` as far as all stays free. It is near, not proved to be nearest.

    Args:
        checker: The robot in its scene, margins included.
        q: Shape (n,).
        seed: Of the draws; the same seed gives the same answer.
    """
    chain = checker.model.chain
    roomy = Checker(checker.model, checker.slack + _ROOM)
    inside = np.clip(q, chain.limits.lower, chain.limits.upper)
    found = _descended(roomy, inside)
    if found is None:
        found = _drawn(roomy, inside, np.random.default_rng(seed))
    if found is None:
        return None
    found = _back(roomy, found, inside)
    moved = forward(chain, found)[:3, 3] - forward(chain, q)[:3, 3]
    clearance, _ = checker.clearance(found)
    return NearestFree(
        found, float(np.linalg.norm(found - q)), float(np.linalg.norm(moved)), clearance
    )


def _descended(roomy: Checker, q: Array) -> Array | None:
    limits = roomy.model.chain.limits
    here = q
    for _ in range(_STEPS):
        if roomy.valid(here):
            return here
        near = roomy.gradient(here, _NEAR)
        touching = near.distances <= _ROOM
        if not touching.any():
            return None
        # What is near but apart may come nearer, though not into touch.
        wanted = np.where(touching, 2.0 * _ROOM - near.distances, 0.0)
        held = touching | (near.gradients @ _away(near.gradients[touching], wanted[touching]) < 0)
        step = _away(near.gradients[held], wanted[held])
        longest = float(np.abs(step).max())
        if not longest > 0.0:
            return None
        step *= min(1.0, _STRIDE / longest)
        here = np.clip(here + step, limits.lower, limits.upper)
    return None


def _away(gradients: Array, wanted: Array) -> Array:
    """The least step that changes distances as wanted, to first order, shape (n,)."""
    return np.asarray(np.linalg.lstsq(gradients, wanted, rcond=1e-3)[0])


def _drawn(roomy: Checker, q: Array, random: np.random.Generator) -> Array | None:
    chain = roomy.model.chain
    low, high = chain.sampling_bounds()
    best: Array | None = None
    for k in range(_DRAWS):
        share = _NARROWEST ** (1.0 - k / _DRAWS)
        drawn = q + share * (high - low) * random.uniform(-1.0, 1.0, chain.n)
        drawn = np.clip(drawn, chain.limits.lower, chain.limits.upper)
        if best is not None and np.linalg.norm(drawn - q) >= np.linalg.norm(best - q):
            continue
        if roomy.valid(drawn):
            best = _back(roomy, drawn, q)
    return best


def _back(roomy: Checker, free: Array, q: Array) -> Array:
    """The free configuration nearest to ``q`` that a bisection finds on the way there."""
    sure, maybe = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (sure + maybe)
        if roomy.valid(free + middle * (q - free)):
            sure = middle
        else:
            maybe = middle
    return np.asarray(free + sure * (q - free))

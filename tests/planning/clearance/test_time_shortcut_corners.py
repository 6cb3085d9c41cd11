"""Two corners made one outside of them, and the joint limits that it has to keep to."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.clearance.levels import clearance_levels
from planning.clearance.time_shortcut import _Bounds, _meet, quicken_kernel
from planning.search.sampled_check import look_of
from planning.timing.estimate import estimate_limits
from planning.values.preferred_clearance import PreferredClearance
from tests.planning.scenes import box
from tests.planning.search.test_shortcut import HALF, RADIUS, gap
from tests.planning.slider import slider

PREFERRED = 0.02
MOTION = estimate_limits(np.full(2, 2.0), np.full(2, 8.0), np.full(2, 80.0))
SCENE = Scene((box("block", (2.0 * HALF, 2.0 * HALF, 0.3), (0.0, 0.0, 0.0)),))


def corner_outside(path: Array, k: int) -> Array:
    """Waypoint k after waypoints k and k + 1 of a path were put together outside of them."""
    trial = path.copy()
    _meet(path, k, trial)
    return np.asarray(trial[k])


def test_skew_legs_are_made_longer_to_where_they_are_closest() -> None:
    """As bounded least squares have it, wherever no bound is met or both legs are at theirs."""
    random, compared = np.random.default_rng(0), 0
    for _ in range(300):
        n = int(random.integers(3, 8))
        path = np.cumsum(random.normal(size=(4, n)), axis=0)
        a, b, c = path[1] - path[0], path[2] - path[3], path[2] - path[1]
        most = np.linalg.norm(c) / np.array([np.linalg.norm(a), np.linalg.norm(b)])
        free = np.linalg.lstsq(np.stack([a, -b], axis=1), c, rcond=None)[0]
        found = corner_outside(path, 1)
        # Neither leg is made longer by more than the distance of the waypoints.
        assert np.linalg.norm(found - 0.5 * (path[1] + path[2])) <= np.linalg.norm(c) + 1e-9
        if (free > 0.0).all() and (free < most).all():
            s, t = lsq_linear(np.stack([a, -b], axis=1), c, (np.zeros(2), most), tol=1e-14).x
            np.testing.assert_allclose(found, 0.5 * (path[1] + s * a + path[2] + t * b), atol=1e-6)
            compared += 1
    assert compared > 20


def around(chamfer: float, spare: float) -> Array:
    """A path past both upper corners of the block, with a short leg above it."""
    # Lines at 45 degrees that pass the block's corners at the preferred clearance and some more.
    height = 2.0 * HALF + np.sqrt(2.0) * (RADIUS + PREFERRED + spare)
    return np.array([[x, height - abs(x)] for x in (-0.6, -chamfer, chamfer, 0.6)])


def quicker(path: Array, upper: float) -> Array:
    """The path made quicker, with y at most ``upper``."""
    preferred, *_, least = clearance_levels(
        Checker.of(slider(), SCENE), PreferredClearance(PREFERRED)
    )
    limits = np.concatenate([MOTION, [[-2.0, -2.0], [2.0, upper]]])
    slack = float(least.slack)
    bounds = _Bounds(look_of(preferred, 0.0), look_of(least), slack, limits, 300.0, True)
    return quicken_kernel(least.model.arrays, bounds, path, True, True)


@pytest.mark.parametrize("seed", range(12))
def test_a_corner_outside_the_joint_limits_is_not_taken(seed: int) -> None:
    random = np.random.default_rng(seed)
    path = around(random.uniform(0.005, 0.02), random.uniform(1e-4, 1e-3))
    assert gap(path) > PREFERRED
    top = path[:, 1].max()
    outside = 2.0 * top - path[1, 1] + path[2, 0]
    wide = quicker(path, 2.0)
    assert wide[:, 1].max() == pytest.approx(outside, abs=1e-9)
    assert len(wide) == 3
    tight = quicker(path, top + random.uniform(0.1, 0.9) * (outside - top))
    assert tight[:, 1].max() <= top + 1e-12
    for way in (wide, tight):
        assert np.array_equal(way[[0, -1]], path[[0, -1]])
        assert gap(way) > 0.0
    # To the last bit: the limit itself can be taken.
    np.testing.assert_array_equal(quicker(path, float(wide[:, 1].max())), wide)

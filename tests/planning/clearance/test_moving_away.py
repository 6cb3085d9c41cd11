"""Paths moved away from what they pass and made quicker: free by FCL, with the same ends."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.clearance.levels import clearance_levels
from planning.clearance.moving_away import keep_clear
from planning.clearance.time_shortcut import _Bounds, _meet, quicken, quicken_kernel
from planning.search.shortcut import look_of
from planning.timing.estimate import LEG_ROWS, estimate_limits, estimated_time
from planning.values.deadline import Deadline
from planning.values.preferences import PreferredClearance
from tests.planning.scenes import HOME, box, builtin
from tests.planning.search.test_shortcut import HALF, RADIUS, gap
from tests.planning.slider import slider

#: Of two links in the plane of x and z: a bar beside the straight motion.
START, GOAL = np.array([-1.2, 0.9]), np.array([1.2, 0.9])


def distances(path: Array, scene: Scene, name: str = "planar_rr", step: float = 0.01) -> Array:
    """Distances along a path, by FCL at steps of so many radians."""
    world, values = FclWorld(builtin(name), scene), []
    for a, b in pairwise(path):
        steps = int(np.abs(b - a).max() / step) + 2
        values += [
            world.clearance(a + share * (b - a)).distance for share in np.linspace(0.0, 1.0, steps)
        ]
    return np.array(values)


@cache
def grazing_scene() -> tuple[Scene, Array]:
    """A bar that the straight motion between START and GOAL passes at 3 mm, and that motion."""
    path, low, high = np.array([START, GOAL]), 0.5, 2.6
    for _ in range(40):
        middle = 0.5 * (low + high)
        scene = Scene((box("bar", (0.1, 1.0, 0.1), (middle, 0.0, 0.0)),))
        low, high = (middle, high) if distances(path, scene).min() < 3e-3 else (low, middle)
    return Scene((box("bar", (0.1, 1.0, 0.1), (high, 0.0, 0.0)),)), path


def test_a_grazing_path_keeps_the_preferred_clearance_where_there_is_room() -> None:
    scene, path = grazing_scene()
    assert 2e-3 < distances(path, scene).min() < 4e-3
    levels = clearance_levels(Checker.of(builtin("planar_rr"), scene), PreferredClearance())
    clear = keep_clear(levels, path, Deadline.after(60.0))
    assert np.array_equal(clear[[0, -1]], path)
    assert distances(clear, scene).min() > 0.02 - 1e-6


def test_a_spacious_path_stays_as_it_is() -> None:
    levels = clearance_levels(Checker.of(builtin("planar_rr"), Scene()), PreferredClearance())
    path = np.array([START, [0.0, 0.5], GOAL])
    assert keep_clear(levels, path, Deadline.after(60.0)) is path


def test_after_the_deadline_waypoints_stay_where_they_are() -> None:
    scene, path = grazing_scene()
    levels = clearance_levels(Checker.of(builtin("planar_rr"), scene), PreferredClearance())
    late = keep_clear(levels, path, Deadline.after(-1.0))
    assert distances(late, scene).min() < 4e-3


def test_near_a_tight_goal_only_the_end_is_closer() -> None:
    robot, goal = builtin("panda"), HOME + np.array([0.9, 0.3, 0.0, 0.2, 0.0, 0.0, 0.0])
    floor = tight_floor(goal)
    checker = Checker.of(robot, floor)
    path = np.array([HOME, goal])
    assert checker.free(*path)
    levels = clearance_levels(checker, PreferredClearance())
    clear = keep_clear(levels, path, Deadline.after(60.0))
    assert all(checker.free(a, b) for a, b in pairwise(clear))
    before, after = (shortfall(way, floor) for way in (path, clear))
    assert after <= before


def tight_floor(goal: Array) -> Scene:
    """A floor 8 mm below the Panda in ``goal``."""
    low, high = -1.0, 1.5
    for _ in range(40):
        middle = 0.5 * (low + high)
        scene = Scene((box("floor", (0.6, 0.6, 0.02), (0.75, 0.0, middle)),))
        close = FclWorld(builtin("panda"), scene).clearance(goal).distance < 8e-3
        low, high = (low, middle) if close else (middle, high)
    return Scene((box("floor", (0.6, 0.6, 0.02), (0.75, 0.0, low)),))


def shortfall(path: Array, scene: Scene) -> float:
    """Mean distance that lacks to the preferred one along a path [m]."""
    return float(np.maximum(0.02 - distances(path, scene, "panda"), 0.0).mean())


LIMITS = estimate_limits(np.full(2, 2.0), np.full(2, 8.0), np.full(2, 80.0))


def seconds(path: Array) -> float:
    return estimated_time(np.array(path), len(path), LIMITS, np.empty((LEG_ROWS, len(path))))


def levels_in(scene: Scene, preferred: float = 0.02) -> tuple[Checker, ...]:
    checker = Checker.of(builtin("planar_rr"), scene)
    return clearance_levels(checker, PreferredClearance(preferred))


def detours(count: int, scene: Scene) -> list[Array]:
    """Paths of proved legs from START to GOAL through random waypoints."""
    checker, random, found = levels_in(scene)[-1], np.random.default_rng(7), list[Array]()
    while len(found) < count:
        between = random.uniform(-1.6, 1.6, (int(random.integers(1, 6)), 2))
        path = np.array([START, *between[np.argsort(between[:, 0])], GOAL])
        if all(checker.free(a, b) for a, b in pairwise(path)):
            found.append(path)
    return found


def test_detours_become_quicker_and_stay_free() -> None:
    scene, _ = grazing_scene()
    levels, gained = levels_in(scene), []
    for path in detours(10, scene):
        quick = quicken(levels, path, LIMITS)
        assert np.array_equal(quick[[0, -1]], path[[0, -1]])
        assert distances(quick, scene, step=0.05).min() > 0.0
        assert all(levels[-1].free(a, b) for a, b in pairwise(quick))
        assert np.array_equal(quick, quicken(levels, path, LIMITS))
        gained.append(seconds(quick) / seconds(path))
    assert np.median(gained) < 0.9


def test_where_nothing_is_near_the_straight_motion_is_left() -> None:
    levels = levels_in(Scene())
    for path in detours(10, Scene()):
        quick = quicken(levels, path, LIMITS)
        assert seconds(quick) < 1.01 * seconds(np.array([START, GOAL]))


def test_clearance_is_not_given_away_for_a_short_time() -> None:
    scene, path = grazing_scene()
    levels = levels_in(scene)
    clear = keep_clear(levels, path, Deadline.after(60.0))
    quick = quicken(levels, clear, LIMITS)
    assert seconds(quick) <= seconds(clear)
    lacking = [np.maximum(0.02 - distances(p, scene, step=0.02), 0.0).mean() for p in (path, quick)]
    assert lacking[1] < 0.25 * lacking[0]


def test_legs_that_keep_the_preferred_clearance_are_replaced_by_such_legs() -> None:
    scene, _ = grazing_scene()
    levels, gained = levels_in(scene), []
    for path in detours(12, scene):
        if all(levels[0].free(a, b) for a, b in pairwise(path)):
            quick = quicken(levels, path, LIMITS, spacious=True)
            assert distances(quick, scene, step=0.02).min() > 0.02 - 1e-6
            gained.append(seconds(quick) / seconds(path))
    assert len(gained) > 2
    assert np.median(gained) < 0.95


def test_without_a_preferred_clearance_paths_stay_as_they_are() -> None:
    path = np.array([START, [0.0, 0.2], GOAL])
    assert quicken(levels_in(Scene(), 0.0), path, LIMITS) is path
    straight = path[[0, -1]]
    assert quicken(levels_in(Scene()), straight, LIMITS) is straight


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

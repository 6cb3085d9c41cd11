"""Paths made quicker: the same ends, every leg proved, less time, and no clearance for nothing."""

from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.clearance.levels import clearance_levels
from planning.clearance.moving_away import keep_clear
from planning.clearance.time_shortcut import quicken
from planning.timing.estimate import LEG_ROWS, estimate_limits, estimated_time
from planning.values.deadline import Deadline
from planning.values.preferred_clearance import PreferredClearance
from tests.planning.clearance.test_moving_away import GOAL, START, distances, grazing_scene
from tests.planning.scenes import builtin

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

"""Paths moved away from what they pass and made quicker: free by FCL, with the same ends."""

from functools import cache
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.clearance.levels import clearance_levels
from planning.clearance.moving_away import keep_clear
from planning.clearance.time_shortcut import quicken
from planning.timing.estimate import LEG_ROWS, estimate_limits, estimated_time
from planning.values.deadline import Deadline
from planning.values.preferences import PreferredClearance
from tests.planning.scenes import HOME, box, builtin

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

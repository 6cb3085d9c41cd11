"""Levels of clearance, and paths that are moved away from what they pass."""

import itertools
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Scene
from planning.clearance.levels import (
    clearance_levels,
    clearance_trials,
    leg_states,
    path_levels,
)
from planning.clearance.moving_away import keep_clear
from planning.clearance.time_shortcut import quicken
from planning.timing.estimate import LEG_ROWS, estimate_limits, estimated_time
from planning.values.deadline import Deadline
from planning.values.preferences import PreferredClearance
from tests.planning.scenes import HOME, box, builtin, pillar

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


def test_without_a_preferred_clearance_paths_become_quicker_and_stay_free() -> None:
    scene, _ = grazing_scene()
    levels, gained = levels_in(scene, 0.0), []
    assert len(levels) == 1
    for path in detours(10, scene):
        quick = quicken(levels, path, LIMITS)
        assert np.array_equal(quick[[0, -1]], path[[0, -1]])
        assert distances(quick, scene, step=0.02).min() > 0.0
        assert all(levels[0].free(a, b) for a, b in pairwise(quick))
        gained.append(seconds(quick) / seconds(path))
    assert np.median(gained) < 0.9
    straight = np.array([START, GOAL])
    assert quicken(levels_in(Scene()), straight, LIMITS) is straight


def test_paths_of_many_waypoints_become_quicker_too() -> None:
    scene, _ = grazing_scene()
    levels, gained = levels_in(scene), []
    for path in detours(5, scene):
        legs = (np.linspace(a, b, 20, endpoint=False) for a, b in pairwise(path))
        many = np.concatenate([*legs, path[-1:]])
        quick = quicken(levels, many, LIMITS)
        assert all(levels[-1].free(a, b) for a, b in pairwise(quick))
        gained.append(seconds(quick) / seconds(many))
    assert max(gained) <= 1.0
    assert min(gained) < 1.0


RNG = np.random.default_rng(3)


def test_levels_hold_the_distances_that_fcl_measures() -> None:
    robot = builtin("planar_rr")
    scene = Scene((box("bar", (0.1, 1.0, 0.1), (1.4, 0.0, 0.0)),))
    world = FclWorld(robot, scene)
    levels = clearance_levels(Checker.of(robot, scene), PreferredClearance(0.2))
    seen = set()
    for q in RNG.uniform(-2.5, 2.5, (400, 2)):
        distance = world.clearance(q).distance
        for level, least in zip(levels[:-1], (0.2, 0.1), strict=True):
            if abs(distance - least) > 1e-6:
                assert level.valid(q) == (distance > least)
                seen.add((least, distance > least))
    assert len(seen) == 4


def test_own_links_have_a_smaller_distance() -> None:
    assert PreferredClearance().own_links == 0.005
    assert PreferredClearance(0.01).own_links == 0.0025
    levels = clearance_levels(Checker.of(builtin("panda"), Scene()), PreferredClearance())
    assert [level.model.own_margin for level in levels] == [0.005, 0.0025, 0.0]


def turned_twice(gap: float) -> RobotGeometry:
    """A rod on a block that turns about one axis by two joints, so far from it, and an arm."""
    limit = '<limit lower="-3" upper="3" velocity="1" effort="1" acceleration="5"/>'
    urdf = f"""<robot name="turned_twice">
<link name="between"><collision><origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry>
</collision></link>
<link name="base"><collision><origin xyz="0 0 {-0.1 - gap:.6f}"/><geometry>
<box size="0.1 0.2 0.2"/></geometry></collision></link>
<link name="rod"><collision><origin xyz="0 0 0.05"/><geometry>
<cylinder radius="0.04" length="0.1"/></geometry></collision></link>
<link name="arm"><collision><origin xyz="0 0 0.5"/><geometry><sphere radius="0.1"/></geometry>
</collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="between"/>
<axis xyz="0 0 1"/>{limit}</joint>
<joint name="turn_back" type="revolute"><parent link="between"/><child link="rod"/>
<axis xyz="0 0 1"/>{limit}</joint>
<joint name="tilt" type="revolute"><parent link="rod"/><child link="arm"/><axis xyz="0 1 0"/>
{limit.replace("3", "0.5")}</joint></robot>"""
    description = parse_urdf(urdf)
    return robot_geometry(serial_chain(description, "base", "arm"), description, {}, None)


@pytest.mark.parametrize("gap", [0.0045, 0.0055, 0.02])
def test_links_that_are_always_near_bound_what_is_preferred_between_own_links(gap: float) -> None:
    robot = turned_twice(gap)
    checker = Checker.of(robot, Scene())
    levels = clearance_levels(checker, PreferredClearance())
    own = levels[0].model.own_margin
    assert own == (0.005 if gap > 0.0058 else pytest.approx(0.98 * gap / 1.16))
    level = next(path_levels(levels))
    assert all(level.planned.valid(q) for q in RNG.uniform(-0.5, 0.5, (20, 3)))


def test_a_margin_above_the_preferred_distance_leaves_no_other_level() -> None:
    wide = Checker.of(builtin("panda"), pillar(), 0.05)
    assert clearance_levels(wide, PreferredClearance(0.05)) == (wide,)
    between = clearance_levels(wide, PreferredClearance(0.08))
    assert [level.model.margin for level in between] == [0.08, 0.05]


def test_where_own_links_are_in_the_way_a_second_level_asks_less_of_them() -> None:
    robot, random = builtin("kr6_sixx"), np.random.default_rng(0)
    checker = Checker.of(robot, Scene())
    levels = clearance_levels(checker, PreferredClearance(0.02))
    states = random.uniform(*robot.chain.sampling_bounds(), (400, 6))
    ends = states[Checker(levels[0].model.with_margins(0.025, 0.006)).each_valid(states)]
    told = set[tuple[int, ...]]()
    for start, goal in itertools.pairwise(ends):
        on_way = leg_states(np.array([start, goal]))
        if not checker.each_valid(on_way).all():
            continue
        trials = list(clearance_trials(levels, start, goal))
        told.add(tuple(trial.max_edges for trial in trials))
        if len(trials) == 2:
            first, second = (trial.level.planned for trial in trials)
            assert second.each_valid(on_way).any()
            assert second.model.margin == first.model.margin
            assert second.model.own_margin < first.model.own_margin
    assert told == {(2000,), (500, 500)}


def test_quicker_paths_stay_within_the_ranges_of_the_joints() -> None:
    robot, random = builtin("panda"), np.random.default_rng(3)
    limits = robot.chain.limits
    bounds = estimate_limits(limits.velocity, np.full(7, 10.0), np.full(7, 250.0))
    levels = clearance_levels(Checker.of(robot, Scene()), PreferredClearance())
    reach, changed = limits.upper - limits.lower, 0
    for _ in range(40):
        # Waypoints next to the ends of some ranges, where half of the shifts would leave them.
        path = np.array([HOME, *random.uniform(limits.lower, limits.upper, (3, 7)), HOME + 0.2])
        at_end = random.uniform(size=(3, 7)) < 0.5
        path[1:4] = np.where(at_end, limits.upper - 1e-3 * reach, path[1:4])
        if not all(levels[-1].free(a, b) for a, b in pairwise(path)):
            continue
        quick = quicken(levels, path, bounds)
        assert ((limits.lower <= quick) & (quick <= limits.upper)).all()
        assert np.array_equal(quick[[0, -1]], path[[0, -1]])
        changed += not np.array_equal(quick, path)
    assert changed > 3

"""Levels of clearance: the preferred distances first, what has to be kept last."""

import itertools

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
    ClearanceSearch,
    clearance_levels,
    highest_level,
    leg_states,
    path_levels,
)
from planning.preflight_result import Ready
from planning.values.preferred_clearance import PreferredClearance
from tests.planning.scenes import HOME, box, builtin, pillar
from tests.planning.slider import slider

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


def test_the_last_level_is_the_checker_itself() -> None:
    checker = Checker.of(builtin("panda"), pillar(), 0.001)
    assert clearance_levels(checker, PreferredClearance())[-1] is checker
    assert clearance_levels(checker, PreferredClearance(0.0)) == (checker,)


def test_a_margin_above_the_preferred_distance_leaves_no_other_level() -> None:
    wide = Checker.of(builtin("panda"), pillar(), 0.05)
    assert clearance_levels(wide, PreferredClearance(0.05)) == (wide,)
    between = clearance_levels(wide, PreferredClearance(0.08))
    assert [level.model.margin for level in between] == [0.08, 0.05]


def test_the_highest_level_keeps_only_goals_that_keep_it() -> None:
    robot = builtin("panda")
    levels = clearance_levels(Checker.of(robot, Scene()), PreferredClearance())
    folded = np.array([0.0, 0.0, 0.0, -3.06, 0.0, 0.0, 0.0])
    goals = [folded, HOME + 0.1]
    answer = highest_level(levels, HOME, goals)
    assert answer is not None
    level, kept = answer
    assert level is levels[0]
    assert [list(q) for q in kept] == [list(q) for q in goals if level.valid(q)]
    assert highest_level(levels[-1:], HOME, goals) is None


#: A block of 0.3 m; the ball of the slider has a radius of 0.05 m.
BLOCK = Scene((box("block", (0.3, 0.3, 0.3), (0.0, 0.0, 0.0)),))
PREFERRED = 0.04


def trials(start: Array, goal: Array) -> ClearanceSearch:
    """Those of the slider that passes the block."""
    checker = Checker.of(slider(), BLOCK)
    levels = clearance_levels(checker, PreferredClearance(PREFERRED))
    return ClearanceSearch(Ready(start, [goal], (checker,), ()), levels)


def edges(found: ClearanceSearch) -> list[int]:
    """Edges that the first searches may look at."""
    return [trial.max_edges for trial in found.first()]


def test_a_straight_motion_that_is_free_but_for_the_clearance_has_a_short_search() -> None:
    through, beside, far = (
        edges(trials(np.array([-0.6, y]), np.array([0.6, y]))) for y in (0.0, 0.22, 0.4)
    )
    assert through == far == [2000]
    assert beside == [500]


def test_where_own_links_are_never_near_there_is_no_second_level() -> None:
    found = trials(np.array([-0.6, 0.0]), np.array([0.6, 0.0]))
    list(found.first())
    assert not list(found.later(np.array([[-0.6, 0.0], [-0.6, 0.6], [0.6, 0.6], [0.6, 0.0]])))


def test_less_is_asked_of_own_links_where_a_path_that_was_found_has_them_near() -> None:
    robot, random = builtin("ur5e"), np.random.default_rng(0)
    checker = Checker.of(robot, Scene())
    levels = clearance_levels(checker, PreferredClearance(0.02))
    states = random.uniform(-2.5, 2.5, (1500, 6))
    roomy = Checker(levels[0].model.with_margins(0.025, 0.006)).each_valid(states)
    near = states[checker.each_valid(states) & ~levels[0].each_valid(states)]
    straight = next(
        (a, b)
        for a, b in itertools.pairwise(states[roomy])
        if levels[0].each_valid(leg_states(np.array([a, b]))).all()
    )
    found = ClearanceSearch(Ready(straight[0], [straight[1]], (checker,), ()), levels)
    (first,) = found.first()
    assert first.max_edges == 2000
    assert not list(found.later(np.array(straight)))
    (later,) = found.later(np.array([straight[0], near[0], straight[1]]))
    assert later.max_edges == 500
    assert later.level.planned.model.margin == first.level.planned.model.margin
    assert later.level.planned.model.own_margin < first.level.planned.model.own_margin


def test_where_own_links_are_in_the_way_most_of_the_search_asks_less_of_them() -> None:
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
        searches = list(ClearanceSearch(Ready(start, [goal], (checker,), ()), levels).first())
        told.add(tuple(trial.max_edges for trial in searches))
        if len(searches) == 2:
            assert searches[1].level.planned.each_valid(on_way).any()
            assert (
                searches[1].level.planned.model.own_margin
                < searches[0].level.planned.model.own_margin
            )
    assert told == {(2000,), (500, 500)}

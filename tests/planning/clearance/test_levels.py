"""Levels of clearance: the preferred distances first, what has to be kept last."""

import itertools

import numpy as np
import pytest

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
from planning.values.preferences import PreferredClearance
from tests.planning.scenes import box, builtin, pillar

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

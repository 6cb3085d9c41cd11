"""The searches for a path with the preferred clearance: which, and how long."""

import itertools

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.clearance.levels import ClearanceSearch, clearance_levels, leg_states
from planning.preflight_result import Ready
from planning.values.preferred_clearance import PreferredClearance
from tests.planning.scenes import box, builtin
from tests.planning.slider import slider

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

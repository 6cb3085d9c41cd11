"""The sweep: earliest first, every instant once, stopping where somebody else has to decide."""

import itertools

import numpy as np
import pytest

from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import PointCloud
from planning.proof.collision.sweep import ASKING, DONE, FULL, PAUSED
from planning.proof.collision.sweep_state import (
    CENTER,
    DEPTH,
    FIRST,
    HALF,
    LAST,
    OBSTACLE,
    OPEN,
    PROBE,
    REFERRED,
    TOP,
    VISITS,
    enlarge,
)
from tests.planning.proof.sweeping import Started, start, through
from tests.planning.scenes import box

ALONG = through([-0.9, 0.0], [0.3, 0.0])
THERE_AND_BACK = through([-0.9, 0.0], [0.39, 0.0], [-0.9, 0.0])


def settled(started: Started) -> list[tuple[float, float]]:
    """Sweep interval by interval: the times of those that were settled, in their order."""
    times, sweep = [], started.sweep
    while True:
        state = started.go(most=1)
        assert state in (PAUSED, DONE)
        if not sweep.counters[OPEN] and not sweep.counters[PROBE]:
            first, last = sweep.counters[FIRST], sweep.counters[LAST]
            begins = started.trajectory.breaks[first] if first == last else 0.0
            middle, half = begins + sweep.interval[CENTER], sweep.interval[HALF]
            times.append((float(middle - half), float(middle + half)))
        if state == DONE:
            return times


def test_a_free_motion_is_done_with_the_clearance_it_has() -> None:
    started = start(ALONG)
    assert started.go() == DONE
    # The ball ends at x = 0.3, 0.1 before it touches.
    assert 0.05 <= started.sweep.clearance[OBSTACLE] <= 0.1
    i, j = started.sweep.closest[OBSTACLE]
    assert started.table.names(int(i), int(j)) == ("ball", "wall")


def test_without_sharpness_it_is_done_sooner_and_still_free() -> None:
    dull, sharp = start(THERE_AND_BACK), start(THERE_AND_BACK)
    assert dull.go(sharp=False) == sharp.go(sharp=True) == DONE
    assert dull.sweep.counters[VISITS] < sharp.sweep.counters[VISITS]
    assert 0.0 < dull.sweep.clearance[OBSTACLE] <= sharp.sweep.clearance[OBSTACLE]


@pytest.mark.parametrize("most", [1, 3, 7])
def test_paused_it_goes_on_as_if_it_had_not_been(most: int) -> None:
    whole, parts = start(ALONG), start(ALONG)
    assert whole.go() == DONE
    states = [parts.go(most=most)]
    while states[-1] == PAUSED:
        states.append(parts.go(most=most))
    assert states[-1] == DONE
    assert len(states) >= whole.sweep.counters[VISITS] // most
    np.testing.assert_array_equal(parts.sweep.clearance, whole.sweep.clearance)
    assert parts.sweep.counters[VISITS] == whole.sweep.counters[VISITS]


def test_intervals_are_settled_from_the_start_to_the_end_without_a_gap() -> None:
    trajectory = through([-0.9, 0.0], [0.3, 0.0], [0.3, 0.5], [-0.2, 0.1], times=[0, 1, 1.5, 4])
    times = settled(start(trajectory))
    assert times[0] == (0.0, 0.0)
    assert times[1][0] == pytest.approx(0.0, abs=1e-12)
    for (_, end), (begin, _) in itertools.pairwise(times[1:]):
        assert begin == pytest.approx(end, abs=1e-9)
    assert times[-1][1] == pytest.approx(4.0)
    assert len(times) > 5


def test_where_they_touch_it_asks_for_the_pair() -> None:
    started = start(through([0.0, 0.0], [0.8, 0.0]))
    assert started.go() == ASKING
    sweep = started.sweep
    assert sweep.counters[REFERRED] == 1
    i, j = sweep.referred[0]
    assert started.table.names(int(i), int(j)) == ("ball", "wall")
    # In the middle of the interval they overlap, which halving can't change.
    x = 0.8 * sweep.interval[CENTER]
    assert 0.4 - 1e-6 <= x <= 0.6 + 1e-6
    assert sweep.referred_moves[0] >= 0.8 * sweep.interval[HALF] - 1e-12


def test_a_small_clearance_is_told_to_a_fifth() -> None:
    started = start(THERE_AND_BACK)
    assert started.go() == DONE
    assert 0.8 * 0.01 <= started.sweep.clearance[OBSTACLE] <= 0.01


def test_what_touches_at_the_start_is_asked_about_first() -> None:
    started = start(through([0.45, 0.0], [-0.9, 0.0]))
    assert started.go() == ASKING
    assert started.sweep.counters[VISITS] == 1
    assert started.sweep.interval[CENTER] == started.sweep.interval[HALF] == 0.0


def test_what_touches_at_the_end_is_asked_about_when_its_time_has_come() -> None:
    """The end is looked at early, for how near things come; what touches there is no first."""
    started = start(through([-0.9, 0.0], [0.2, 0.0], [0.45, 0.0]))
    assert started.go() == ASKING
    sweep = started.sweep
    assert sweep.counters[PROBE] == 0
    first, last = sweep.counters[FIRST], sweep.counters[LAST]
    begins = started.trajectory.breaks[first] if first == last else 0.0
    assert begins + sweep.interval[CENTER] < 2.0


def test_the_end_tells_how_sharp_a_bound_has_to_be() -> None:
    """Only the end is near: what is far from it is not halved for the sake of its own distance."""
    near, far = start(through([-0.9, 0.0], [0.399, 0.0])), start(through([-0.9, 0.0], [0.25, 0.0]))
    assert near.go() == far.go() == DONE
    assert 0.9 * 0.001 <= near.sweep.clearance[OBSTACLE] <= 0.001
    assert 0.9 * 0.15 <= far.sweep.clearance[OBSTACLE] <= 0.15


def test_a_graze_is_halved_until_that_is_of_no_use() -> None:
    """At the distance that must be kept, all along: no interval proves it, none disproves it."""
    started = start(through([0.3, -0.2], [0.3, 0.2]), margin=0.1)
    assert started.go() == ASKING
    counters = started.sweep.counters
    moved = started.sweep.referred_moves[0]
    assert counters[DEPTH] > 10 or counters[VISITS] == 1
    assert moved < 1e-6


@pytest.mark.parametrize(("margin", "state"), [(0.0, DONE), (0.099, DONE), (0.101, ASKING)])
def test_margins_are_kept_from_obstacles(margin: float, state: int) -> None:
    assert start(ALONG, margin=margin).go() == state


def test_without_room_it_says_so_and_goes_on_with_more() -> None:
    points = np.random.default_rng(1).uniform([0.4, -0.9, -0.5], [0.9, 0.9, 0.5], (200, 3))
    cloud = Scene(
        (Obstacle("cloud", PointCloud(points, 0.01)), box("b", (0.1, 0.1, 0.1), (0, 0.5, 0)))
    )
    whole = start(ALONG, cloud)
    assert whole.go() == DONE
    small = start(ALONG, cloud)
    k = len(small.table.arrays.roots)
    narrow = small.sweep._replace(
        pairs=small.sweep.pairs[: k + 1].copy(), directions=small.sweep.directions[: k + 1].copy(),
        referred=small.sweep.referred[: k + 1].copy(),
    )  # fmt: skip
    started, enlarged = small._replace(sweep=narrow), 0
    while (state := started.go()) == FULL:
        visits, top = started.sweep.counters[VISITS], started.sweep.counters[TOP]
        assert top > 0
        # Once more without more room: nothing is lost and nothing is gained.
        assert started.go() == FULL
        assert started.sweep.counters[VISITS] == visits
        started, enlarged = started._replace(sweep=enlarge(started.sweep)), enlarged + 1
    assert state == DONE
    assert enlarged > 0
    np.testing.assert_array_equal(started.sweep.clearance, whole.sweep.clearance)


def test_a_robot_among_nothing_is_done() -> None:
    started = start(ALONG, Scene())
    assert started.go() == DONE
    assert np.isinf(started.sweep.clearance).all()

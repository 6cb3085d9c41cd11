"""The sweep: earliest first, every instant once, and what stays open."""

import itertools

import numpy as np
import pytest

from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace, PointCloud, Sphere
from planning.proof.collision.interval_check import check_interval
from planning.proof.collision.pair_table import PairTable
from planning.proof.collision.sweep import ASKING, DONE, FULL, PAUSED
from planning.proof.collision.sweep_state import (
    BEGIN,
    CENTER,
    DEPTH,
    END,
    FIRST,
    HALF,
    LAST,
    OBSTACLE,
    OPEN,
    OWN,
    PROBE,
    REFERRED,
    TOP,
    VISITS,
    Sweep,
    enlarge,
    pop_interval,
    push_halves,
)
from planning.proof.motion_bounds import RADIUS, VALUE
from tests.planning.proof.sweeping import WALL, Started, start, start_sweep, through
from tests.planning.scenes import box
from tests.planning.slider import slider

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


def random_motion(seed: int, pieces: int = 5) -> Trajectory:
    """Joined cubics of unequal lengths."""
    random = np.random.default_rng(seed)
    lengths = random.uniform(0.01, 1.0, pieces)
    coefficients = random.normal(size=(pieces, 2, 4)) * 0.2
    for k in range(1, pieces):
        coefficients[k, :, 0] = coefficients[k - 1] @ lengths[k - 1] ** np.arange(4)
    breaks = np.concatenate([[0.0], np.cumsum(lengths)])
    return Trajectory(slider().chain.joint_names, breaks, coefficients)


def begun(trajectory: Trajectory) -> Sweep:
    return start_sweep(trajectory, PairTable.of(slider(), WALL, 0.0).arrays)


def span(trajectory: Trajectory, w: Sweep) -> tuple[float, float]:
    """The last interval from the start of the trajectory [s]."""
    one = w.counters[FIRST] == w.counters[LAST]
    begins = trajectory.breaks[w.counters[FIRST]] if one else 0.0
    return float(begins + w.interval[BEGIN]), float(begins + w.interval[END])


def test_joints_are_enclosed_on_every_interval() -> None:
    random = np.random.default_rng(5)
    for seed in range(4):
        trajectory = random_motion(6 + seed)
        w = begun(trajectory)
        while w.counters[TOP] > 0:
            pop_interval(trajectory.breaks, trajectory.coefficients, w)
            times = np.clip(np.linspace(*span(trajectory, w), 25), 0.0, trajectory.duration)
            away = np.abs(trajectory.sample(times) - w.joints[:, VALUE]).max(axis=0)
            assert (away <= w.joints[:, RADIUS] + 1e-12).all()
            assert w.interval[HALF] >= 0.5 * (w.interval[END] - w.interval[BEGIN])
            if w.counters[DEPTH] < 3 or random.random() < 0.3:
                push_halves(w, trajectory.breaks, True)


INTERVAL_CHECK_THERE_AND_BACK = through([-0.9, 0.0], [0.35, 0.0], [-0.9, 0.0])


def check(started: Started, intervals: int = 1) -> bool:
    """Look at the first interval, the start alone, or at the third one, the whole motion."""
    trajectory = started.trajectory
    for _ in range(intervals):
        pop_interval(trajectory.breaks, trajectory.coefficients, started.sweep)
    return bool(check_interval(started.table.arrays, started.sweep))


def left(started: Started) -> tuple[int, int]:
    """Pairs left open, and pairs referred."""
    counters = started.sweep.counters
    return int(counters[OPEN]), int(counters[REFERRED])


def at(x: float, scene: Scene = WALL, margin: float = 0.0) -> Started:
    """A motion that begins at x and goes away."""
    return start(through([x, 0.0], [-1.0, 0.0]), scene, margin)


@pytest.mark.parametrize("x", [-0.5, 0.0, 0.39, 0.3999])
def test_what_is_apart_is_settled_with_a_clearance_that_is_true(x: float) -> None:
    """Where that is small it is told to a tenth, else 18 cm are enough."""
    started = at(x)
    assert check(started)
    assert left(started) == (0, 0)
    assert min(0.18, 0.91 * (0.4 - x)) <= started.sweep.clearance[OBSTACLE] <= 0.4 - x


@pytest.mark.parametrize("x", [0.4, 0.41, 0.5])
def test_what_touches_is_referred(x: float) -> None:
    started = at(x)
    assert check(started)
    assert left(started) == (0, 1)
    assert started.sweep.clearance[OBSTACLE] == np.inf


@pytest.mark.parametrize(("reach", "expected"), [(0.04, (0, 1)), (0.3, (1, 0))])
def test_an_overlap_is_referred_as_soon_as_it_is_seen(
    reach: float, expected: tuple[int, int]
) -> None:
    """Over an interval that moves little, where the distance is asked for; else it is halved."""
    started = start(through([0.5 - reach, 0.0], [0.5 + reach, 0.0]))
    assert check(started, 3)
    assert left(started) == expected


@pytest.mark.parametrize(("x", "referred"), [(0.29, 0), (0.31, 1)])
def test_margins_of_the_motion_and_of_the_obstacle_add_up(x: float, referred: int) -> None:
    (wall,) = WALL.obstacles
    scene = Scene((Obstacle("wall", wall.shape, wall.T_world_obstacle, 0.06),))
    started = at(x, scene, margin=0.04)
    assert check(started)
    assert left(started) == (0, referred)


def test_a_pair_that_may_touch_is_not_looked_at() -> None:
    started = at(0.5, Scene(WALL.obstacles, {("ball", "wall")}))
    assert check(started)
    assert left(started) == (0, 0)
    assert np.isinf(started.sweep.clearance).all()
    # Among others that it may not touch, in one tree with them.
    others = [box(f"b{k}", (0.1, 0.1, 0.1), (0.5, 0.3 + 0.2 * k, 0.0)) for k in range(3)]
    among = at(0.5, Scene([*WALL.obstacles, *others], {("ball", "wall")}))
    assert check(among)
    assert left(among) == (0, 0)
    assert 0.05 <= among.sweep.clearance[OBSTACLE] <= 0.2
    touching = at(0.5, Scene([*WALL.obstacles, *others], {("ball", "b0")}))
    assert check(touching)
    assert left(touching) == (0, 1)


def test_over_an_interval_that_moves_farther_than_the_gap_it_stays_open() -> None:
    """0.05 before the wall in its middle, 1.3 m away at its ends: it proves nothing."""
    started = start(INTERVAL_CHECK_THERE_AND_BACK)
    assert check(started, 3)
    assert left(started) == (1, 0)
    i, j = started.sweep.pairs[started.sweep.starts[1]]
    assert started.table.names(int(i), int(j)) == ("ball", "wall")


def test_along_a_wall_motion_costs_no_distance() -> None:
    """A direction is found in which the ball does not move: one interval settles two metres."""
    started = start(through([0.0, -0.3], [0.0, 0.3]))
    assert check(started, 3)
    assert left(started) == (0, 0)
    # Its ball and box alone would leave 0.1 m of the 0.4 m.
    assert 0.05 <= started.sweep.clearance[OBSTACLE] <= 0.4
    near = start(through([0.39, -0.3], [0.39, 0.3]))
    assert check(near, 3)
    assert left(near) == (0, 0)
    assert 0.008 <= near.sweep.clearance[OBSTACLE] <= 0.01


def test_a_sum_of_many_pairs_leaves_what_each_leaves() -> None:
    scene = Scene((
        Obstacle("floor", HalfSpace(np.array([0.0, 1.0, 0.0]), -0.02)),
        box("far", (0.1, 0.1, 0.1), (0.5, 0.9, 0.9)),
        box("touched", (0.1, 0.1, 0.1), (-0.5, 0.0, 0.0)),
        Obstacle("ball2", Sphere(0.1), transform(None, [-0.5, 0.2, 0.0])),
    ))  # fmt: skip
    started = start(through([-0.5, 0.0], [0.0, 0.0]), scene)
    assert check(started)
    opened, referred = left(started)
    assert opened == 0
    names = {started.table.names(int(i), int(j))[1] for i, j in started.sweep.referred[:referred]}
    assert names == {"floor", "touched"}
    # The other ball is 0.05 away.
    assert 0.04 <= started.sweep.clearance[OBSTACLE] <= 0.05


def test_without_room_for_what_stays_open_it_says_so() -> None:
    started = start(INTERVAL_CHECK_THERE_AND_BACK)
    k = len(started.table.arrays.roots)
    narrow = started.sweep._replace(pairs=started.sweep.pairs[:k].copy())
    assert not check(started._replace(sweep=narrow), 3)


def test_own_links_are_not_kept_a_margin_apart() -> None:
    started = at(0.1, Scene(), margin=0.5)
    assert check(started)
    assert left(started) == (0, 0)
    assert started.sweep.clearance[OWN] == np.inf

"""One interval of time: what is settled on it, what stays open and what is left to the referee."""

import numpy as np
import pytest

from kinematics.pose import transform
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace, Sphere
from planning.proof.collision.interval_check import check_interval, sharp_enough
from planning.proof.collision.sweep_state import OBSTACLE, OPEN, OWN, REFERRED, pop_interval
from tests.planning.proof.sweeping import WALL, Started, start, through
from tests.planning.scenes import box

THERE_AND_BACK = through([-0.9, 0.0], [0.35, 0.0], [-0.9, 0.0])


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
    started = start(THERE_AND_BACK)
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
    started = start(THERE_AND_BACK)
    k = len(started.table.arrays.roots)
    narrow = started.sweep._replace(pairs=started.sweep.pairs[:k].copy())
    assert not check(started._replace(sweep=narrow), 3)


def test_clearances_that_are_told_need_to_be_sharp() -> None:
    """Not at all, beyond what is of use to anybody, or a share of the least one met."""
    assert sharp_enough(0.01, False) == -np.inf
    assert sharp_enough(np.inf, False) == -np.inf
    small, medium, far = (sharp_enough(nearest, True) for nearest in (1e-3, 0.01, np.inf))
    assert 0.0 < small < 1e-3
    assert small < medium < 0.01
    assert medium < far < np.inf
    assert medium / small == pytest.approx(10.0)
    assert sharp_enough(1e6, True) == far


def test_own_links_are_not_kept_a_margin_apart() -> None:
    started = at(0.1, Scene(), margin=0.5)
    assert check(started)
    assert left(started) == (0, 0)
    assert started.sweep.clearance[OWN] == np.inf

"""Shortened paths: every leg free by FCL, ends kept, never longer; looks at legs together."""

from itertools import pairwise

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.search.shortcut import (
    _MAX_CHECKS,
    path_is_free,
    shortcut,
)
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, box, builtin
from tests.planning.slider import slider

#: Of two links in the plane of x and z: a bar that the outer one meets on the straight way.
START, GOAL = np.array([-1.2, 0.4]), np.array([1.2, -0.4])
BAR = Scene((box("bar", (0.1, 1.0, 0.1), (1.3, 0.0, 0.0)),))


def length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def least_distance(path: Array, scene: Scene, name: str = "planar_rr") -> float:
    """The least distance along a path, by FCL at steps of a hundredth of a radian."""
    world, least = FclWorld(builtin(name), scene), np.inf
    for a, b in pairwise(path):
        steps = int(np.abs(b - a).max() / 0.01) + 2
        for share in np.linspace(0.0, 1.0, steps):
            least = min(least, world.clearance(a + share * (b - a)).distance)
    return float(least)


def detour(checker: Checker, random: np.random.Generator) -> Array:
    """A path of many proved legs from START to GOAL that wanders about."""
    low, high = np.array([-2.5, -2.4]), np.array([2.5, 2.4])
    points = [START]
    while not (len(points) > 8 and checker.free(points[-1], GOAL)):
        q = random.uniform(low, high)
        if checker.free(points[-1], q):
            points.append(q)
    return np.array([*points, GOAL])


@pytest.mark.parametrize("seed", range(8))
def test_what_comes_back_is_free_shorter_and_has_the_same_ends(seed: int) -> None:
    checker = Checker.of(builtin("planar_rr"), BAR)
    path = detour(checker, np.random.default_rng(seed))
    short = shortcut(checker, path, Deadline.after(60.0))
    assert np.array_equal(short[[0, -1]], path[[0, -1]])
    assert least_distance(short, BAR) > 0.0
    # The bar can't be gone through: no way round it is nearly as short as the straight one.
    assert length(short) > 1.02 * length(path[[0, -1]])
    assert length(short) < 0.5 * length(path)


@pytest.mark.parametrize("slack", [0.0, 0.02, 0.05])
def test_slack_and_margin_are_kept(slack: float) -> None:
    margin = 0.03
    checker = Checker(Checker.of(builtin("planar_rr"), BAR, margin).model, slack)
    path = detour(checker, np.random.default_rng(5))
    short = shortcut(checker, path, Deadline.after(60.0))
    assert least_distance(short, BAR) >= margin + slack
    # Cut as near as is allowed: so the limit is what keeps it away.
    assert least_distance(short, BAR) < margin + slack + 0.05


def test_links_are_kept_off_each_other() -> None:
    """Panda folds: its hand would meet its forearm on the straight way."""
    checker = Checker.of(builtin("panda"), Scene())
    start = np.array([2.8, 1.2, 0.8, -0.8, 0.7, 1.2, 0.5])
    goal = np.array([2.4, -1.3, -0.7, -0.1, 2.8, 0.3, -2.2])
    assert not checker.free(start, goal)
    path, random = [start, HOME, goal], np.random.default_rng(1)
    while not all(checker.free(a, b) for a, b in pairwise(path)):
        path[1] = HOME + random.uniform(-1.0, 1.0, 7)
    short = shortcut(checker, np.array(path), Deadline.after(60.0))
    assert len(short) > 2
    assert least_distance(short, Scene(), "panda") > 0.0


def test_when_time_is_up_the_path_is_proved_all_the_same() -> None:
    checker = Checker.of(builtin("planar_rr"), BAR)
    path = detour(checker, np.random.default_rng(2))
    short = shortcut(checker, path, Deadline.after(-1.0))
    assert np.array_equal(short[[0, -1]], path[[0, -1]])
    assert length(short) <= length(path)
    assert least_distance(short, BAR) > 0.0


def test_the_same_path_is_shortened_in_the_same_way() -> None:
    checker = Checker.of(builtin("planar_rr"), BAR)
    path = detour(checker, np.random.default_rng(3))
    first, again = (shortcut(checker, path, Deadline.after(60.0)) for _ in range(2))
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("seed", range(6))
def test_what_is_looked_at_with_a_clearance_keeps_it_between_looks_too(seed: int) -> None:
    """Looks farther apart than a clearance would let corners of the bar come much nearer."""
    clearance = 0.03
    proof = Checker.of(builtin("planar_rr"), BAR)
    wished = Checker.of(builtin("planar_rr"), BAR, clearance)
    path = detour(wished, np.random.default_rng(seed))
    short = shortcut(wished, path, Deadline.after(60.0), proof)
    assert least_distance(short, BAR) >= 0.9 * clearance


@pytest.mark.parametrize("cuts", [False, True])
def test_a_path_that_was_only_looked_at_keeps_the_clearance_by_looks(cuts: bool) -> None:
    proof = Checker.of(builtin("planar_rr"), BAR)
    wished = Checker.of(builtin("planar_rr"), BAR, 0.03)
    path = detour(wished, np.random.default_rng(2))
    short = shortcut(wished, path, Deadline.after(60.0), cuts=cuts, proves=False)
    assert np.array_equal(short[[0, -1]], path[[0, -1]])
    assert len(short) < len(path)
    assert least_distance(short, BAR) >= 0.9 * 0.03
    assert path_is_free(proof, short)


def test_without_cuts_waypoints_are_left_out_and_none_is_new() -> None:
    checker = Checker.of(builtin("planar_rr"), BAR)
    path = detour(checker, np.random.default_rng(2))
    short = shortcut(checker, path, Deadline.after(60.0), cuts=False)
    places = [np.flatnonzero((path == q).all(axis=1)) for q in short]
    assert all(len(place) == 1 for place in places)
    assert (np.diff(np.concatenate(places)) > 0).all()
    assert 2 < len(short) < len(path)
    assert checker.polyline(short)[0].free


def test_a_leg_that_cannot_be_proved_is_found_in_any_place() -> None:
    """A foil between the looks at a motion of many metres."""
    checker = Checker.of(slider(), Scene((box("foil", (1e-5, 1.0, 0.4), (0.07, 0.0, 0.0)),)))
    far, above = np.array([18.0, 0.0]), np.array([0.0, 3.0])
    path = np.array([-far, 0.5 * -far, far])
    looked = shortcut(checker, path, Deadline.after(60.0), proves=False)
    assert len(looked) == 2
    assert not path_is_free(checker, np.array([-far, far]))
    assert not path_is_free(checker, np.array([above, -far, far, above]))
    assert path_is_free(checker, np.array([-far, above, far]))
    assert path_is_free(checker, far[None])


RADIUS, HALF = 0.05, 0.15
#: A ball on a table, and a block that it goes around.
BLOCKED = Checker.of(slider(), Scene((box("block", (0.3, 0.3, 0.3), (0.0, 0.0, 0.0)),)))
OPEN = Checker.of(slider(), Scene())
AROUND = np.array([[-0.6, 0.0], [-0.5, 0.5], [0.0, 0.7], [0.5, 0.5], [0.6, 0.0]])


def gap(path: Array) -> float:
    """The ball's distance from the block along a path, in closed form at many places."""
    least = np.inf
    for a, b in pairwise(path):
        points = a + np.linspace(0.0, 1.0, 400)[:, None] * (b - a)
        outside = np.maximum(np.abs(points) - HALF, 0.0)
        least = min(least, float(np.linalg.norm(outside, axis=1).min()) - RADIUS)
    return least


def test_the_way_round_the_block_is_nearly_the_shortest() -> None:
    """A taut string round the block's corners, wider by the ball's radius, can't be beaten."""
    short = shortcut(BLOCKED, AROUND, Deadline.after(60.0))
    assert np.array_equal(short[[0, -1]], AROUND[[0, -1]])
    corner = np.hypot(0.6 - HALF, HALF)
    tangent = np.sqrt(corner**2 - RADIUS**2)
    turned = np.arctan2(HALF, 0.6 - HALF) + np.arcsin(RADIUS / corner)
    taut = 2.0 * (tangent + RADIUS * turned) + 2.0 * HALF
    assert taut < length(short) < 1.06 * taut


@pytest.mark.parametrize("count", [1, 2, 3])
def test_short_paths_keep_their_ends(count: int) -> None:
    path = AROUND[:count]
    short = shortcut(OPEN, path, Deadline.after(60.0))
    np.testing.assert_array_equal(short, path[[0, -1]] if count > 1 else path)


def test_a_path_through_one_point_twice_loses_its_loop() -> None:
    loop = np.array([[-0.6, 0.0], [-0.6, 0.5], [-0.3, 0.5], [-0.6, 0.0], [-0.6, -0.5]])
    short = shortcut(BLOCKED, loop, Deadline.after(60.0))
    np.testing.assert_array_equal(short, loop[[0, -1]])


def test_more_waypoints_than_checks_in_the_open_leave_the_ends() -> None:
    """A bisection looks at the last waypoint first."""
    many = np.random.default_rng(1).uniform(-0.9, 0.9, (2 * _MAX_CHECKS, 2))
    np.testing.assert_array_equal(shortcut(OPEN, many, Deadline.after(60.0)), many[[0, -1]])

"""The steps of shortening on a table: what they cut, what they leave, what they spend."""

from itertools import pairwise

import numpy as np
import pytest

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.collision.checker import Checker
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.scenes.scene import Scene
from planning.search.sampled_check import Look
from planning.search.shortcut import (
    _MAX_CHECKS,
    Corners,
    Held,
    cut_corners,
    path_length,
    shortcut,
    skip_waypoints,
    thin_waypoints,
)
from planning.values.deadline import Deadline
from tests.planning.scenes import box, builtin
from tests.planning.slider import slider

RADIUS, HALF = 0.05, 0.15
#: A ball on a table, and a block that it goes around.
BLOCKED = Checker.of(slider(), Scene((box("block", (0.3, 0.3, 0.3), (0.0, 0.0, 0.0)),)))
OPEN = Checker.of(slider(), Scene())
AROUND = np.array([[-0.6, 0.0], [-0.5, 0.5], [0.0, 0.7], [0.5, 0.5], [0.6, 0.0]])


@kernel
def skip(model: ModelArrays, slack: float, points: Array, count: int, checks: Indices) -> int:
    held = Held(Look(model.margin, model.own_margin, slack), slack, False)
    return skip_waypoints(model, workspace(model), held, points, count, checks)


@kernel
def thin_tried(
    model: ModelArrays, slack: float, points: Array, tried: Indices, count: int, checks: Indices
) -> int:
    held = Held(Look(model.margin, model.own_margin, slack), slack, False)
    return thin_waypoints(model, workspace(model), held, Corners(points, tried, checks), count)


@kernel
def cut(
    model: ModelArrays, slack: float, points: Array, tried: Indices, count: int, worth: float,
    checks: Indices,
) -> int:  # fmt: skip
    held = Held(Look(model.margin, model.own_margin, slack), slack, False)
    return cut_corners(model, workspace(model), held, Corners(points, tried, checks), count, worth)


@kernel
def length_of(points: Array, count: int) -> float:
    return path_length(points, count)


def gap(path: Array) -> float:
    """The ball's distance from the block along a path, in closed form at many places."""
    least = np.inf
    for a, b in pairwise(path):
        points = a + np.linspace(0.0, 1.0, 400)[:, None] * (b - a)
        outside = np.maximum(np.abs(points) - HALF, 0.0)
        least = min(least, float(np.linalg.norm(outside, axis=1).min()) - RADIUS)
    return least


def length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def spent(count: int) -> Indices:
    return np.array([count], dtype=np.int64)


def with_room(path: Array, more: int = 40) -> Array:
    points = np.full((len(path) + more, path.shape[1]), np.nan)
    points[: len(path)] = path
    return points


def one_round(checker: Checker, path: Array, worth: float = 0.0) -> tuple[Array, Indices, int]:
    """A round of cuts: the path, the cuts that failed at each waypoint, and the checks."""
    points, checks = with_room(path), spent(0)
    tried = np.zeros(len(points), dtype=np.int64)
    arrays = checker.model.arrays
    count = cut(arrays, checker.slack, points, tried, len(path), worth, checks)
    return points[:count].copy(), tried[:count].copy(), int(checks[0])


def thin(model: ModelArrays, slack: float, points: Array, count: int, checks: Indices) -> int:
    """``thin_tried`` where nothing is known of any corner."""
    return thin_tried(model, slack, points, np.zeros(count, dtype=np.int64), count, checks)


def test_corners_that_are_known_to_stay_are_not_tried_again() -> None:
    """After rounds of cuts the same waypoints stay, for fewer checks."""
    points, tried, checks = with_room(AROUND), np.zeros(len(with_room(AROUND)), np.int64), spent(0)
    arrays, count = BLOCKED.model.arrays, len(AROUND)
    for _ in range(8):
        count = cut(arrays, 0.0, points, tried, count, 1e-3, checks)
    again, known, anew = points.copy(), spent(0), spent(0)
    assert (tried[1 : count - 1] > 0).any()
    kept = thin_tried(arrays, 0.0, points, tried, count, known)
    assert thin(arrays, 0.0, again, count, anew) == kept
    np.testing.assert_array_equal(points[:kept], again[:kept])
    assert known[0] < anew[0]


@pytest.mark.parametrize("leave_out", [skip, thin])
def test_without_a_block_only_the_ends_stay(leave_out: object) -> None:
    assert callable(leave_out)
    points, checks = AROUND.copy(), spent(0)
    assert leave_out(OPEN.model.arrays, 0.0, points, len(points), checks) == 2
    np.testing.assert_array_equal(points[:2], AROUND[[0, -1]])
    assert checks[0] == (1 if leave_out is skip else len(AROUND) - 2)


@pytest.mark.parametrize("leave_out", [skip, thin])
def test_waypoints_that_are_left_out_leave_a_free_path_of_old_ones(leave_out: object) -> None:
    assert callable(leave_out)
    fine = np.concatenate([a + np.linspace(0.0, 0.9, 6)[:, None] * (b - a)
                           for a, b in pairwise(AROUND)] + [AROUND[-1:]])  # fmt: skip
    points = fine.copy()
    count = leave_out(BLOCKED.model.arrays, 0.0, points, len(points), spent(0))
    kept = points[:count]
    assert 3 <= count < len(fine) // 2
    assert gap(kept) > 0.0
    order = [int(np.flatnonzero((fine == point).all(axis=1))[0]) for point in kept]
    assert order == sorted(set(order))
    assert (order[0], order[-1]) == (0, len(fine) - 1)


@pytest.mark.parametrize("leave_out", [skip, thin])
def test_when_the_checks_are_spent_nothing_more_is_left_out(leave_out: object) -> None:
    """Not even without a block: what has not been proved stays as it was."""
    assert callable(leave_out)
    points, checks = AROUND.copy(), spent(_MAX_CHECKS)
    assert leave_out(OPEN.model.arrays, 0.0, points, len(points), checks) == len(AROUND)
    np.testing.assert_array_equal(points, AROUND)
    assert checks[0] == _MAX_CHECKS


def test_a_bisection_that_runs_out_of_checks_goes_no_farther_than_was_proved() -> None:
    """The one check that is left fails: what follows is the next waypoint."""
    points, checks = AROUND.copy(), spent(_MAX_CHECKS - 1)
    count = skip(BLOCKED.model.arrays, 0.0, points, len(points), checks)
    np.testing.assert_array_equal(points[:count], AROUND)
    assert gap(points[:count]) > 0.0


def test_a_corner_in_the_open_is_cut_off_whole_to_the_last_bit() -> None:
    path = np.array([[0.1, 0.7], [0.3, 0.3], [0.7, 0.1]])
    short, _, checks = one_round(OPEN, path)
    np.testing.assert_array_equal(short, path[[0, 2]])
    assert checks == 1


def test_a_corner_at_the_block_is_cut_by_the_widest_share_that_is_free() -> None:
    corner = np.array([[-0.6, -0.1], [0.0, 0.35], [0.6, -0.1]])
    short, tried, _ = one_round(BLOCKED, corner)
    assert gap(short) > 0.0
    shares = [0.5, 0.25, 0.125]
    cuts = [np.array([corner[1] + s * (end - corner[1]) for end in corner[[0, 2]]]) for s in shares]
    free = [gap(np.array([corner[0], *cut, corner[2]])) > 0.0 for cut in cuts]
    assert free == [False, True, True]
    np.testing.assert_allclose(short, [corner[0], *cuts[1], corner[2]], atol=1e-15)
    # New corners have not been tried, those beside them have a new neighbour.
    assert tried.tolist() == [0, 0, 0, 0]


def test_a_corner_that_no_cut_improves_stays_and_is_not_tried_again() -> None:
    tight = np.array([[-0.201, -0.1], [-0.201, 0.201], [0.1, 0.201]])
    assert gap(tight) > 0.0
    short, tried, checks = one_round(BLOCKED, tight)
    np.testing.assert_array_equal(short, tight)
    assert tried.tolist() == [0, 4, 0]
    assert checks >= 4
    points, again = with_room(tight), spent(0)
    marks = np.zeros(len(points), dtype=np.int64)
    marks[1] = 4
    assert cut(BLOCKED.model.arrays, 0.0, points, marks, 3, 0.0, again) == 3
    assert again[0] == 0


def test_a_corner_is_tried_again_when_its_neighbour_has_moved() -> None:
    """The second corner's mark is wiped out by the first one's cut."""
    path = np.array([[-0.9, 0.9], [-0.6, 0.6], [-0.3, 0.9], [0.3, 0.9]])
    points, checks = with_room(path), spent(0)
    marks = np.zeros(len(points), dtype=np.int64)
    marks[2] = 4
    count = cut(OPEN.model.arrays, 0.0, points, marks, 4, 0.0, checks)
    assert count == 2
    np.testing.assert_array_equal(points[:2], path[[0, 3]])


def test_a_corner_worth_less_than_asked_for_is_left() -> None:
    path = np.array([[0.2, 0.5], [0.5, 0.501], [0.8, 0.5]])
    gain = length(path) - length(path[[0, 2]])
    for worth, left in ((0.9 * gain, 2), (1.1 * gain, 3)):
        short, _, checks = one_round(OPEN, path, worth)
        assert len(short) == left
        assert checks == 3 - left


def test_a_round_stops_where_the_checks_do() -> None:
    points, checks = with_room(AROUND), spent(_MAX_CHECKS)
    marks = np.zeros(len(points), dtype=np.int64)
    assert cut(OPEN.model.arrays, 0.0, points, marks, 5, 0.0, checks) == 5
    np.testing.assert_array_equal(points[:5], AROUND)


def test_a_motion_that_grazes_counts_as_many_checks() -> None:
    """The tip of a stretched arm passes a wall at a millimetre."""
    wall = Scene((box("wall", (0.2, 1.0, 0.2), (2.101, 0.0, 0.0)),))
    grazing = Checker.of(builtin("planar_rr"), wall)
    swing = np.array([[-0.8, 0.0], [0.0, 0.0], [0.8, 0.0]])
    assert grazing.segment(swing[0], swing[2]).intervals > 60
    checks = spent(0)
    assert thin(grazing.model.arrays, 0.0, swing, 3, checks) == 2
    assert checks[0] == 2


def test_in_no_time_waypoints_are_left_out_but_no_corner_is_cut() -> None:
    late = shortcut(BLOCKED, AROUND, Deadline.after(-1.0))
    rested = shortcut(BLOCKED, AROUND, Deadline.after(60.0))
    points = AROUND.copy()
    arrays = BLOCKED.model.arrays
    count = skip(arrays, 0.0, points, len(points), spent(0))
    count = thin(arrays, 0.0, points, count, spent(0))
    np.testing.assert_array_equal(late, points[:count])
    assert length(rested) < length(late)
    assert gap(late) > 0.0
    assert gap(rested) > 0.0


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


def test_lengths_are_those_of_numpy() -> None:
    path = np.random.default_rng(0).normal(size=(9, 5))
    for count in range(1, 10):
        assert length_of(path, count) == pytest.approx(length(path[:count]), rel=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_of_a_path_that_was_shortened_no_waypoint_can_be_left_out(seed: int) -> None:
    random, path = np.random.default_rng(seed), [AROUND[0]]
    while len(path) < 12 or not BLOCKED.free(path[-1], AROUND[-1]):
        q = random.uniform(-0.9, 0.9, 2)
        if BLOCKED.free(path[-1], q):
            path.append(q)
    short = shortcut(BLOCKED, np.array([*path, AROUND[-1]]), Deadline.after(60.0))
    again = short.copy()
    assert thin(BLOCKED.model.arrays, 0.0, again, len(again), spent(0)) == len(short)
    assert gap(short) > 0.0


def test_more_waypoints_than_checks_in_the_open_leave_the_ends() -> None:
    """A bisection looks at the last waypoint first."""
    many = np.random.default_rng(1).uniform(-0.9, 0.9, (2 * _MAX_CHECKS, 2))
    np.testing.assert_array_equal(shortcut(OPEN, many, Deadline.after(60.0)), many[[0, -1]])

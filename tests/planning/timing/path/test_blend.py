"""Rounded polylines: continuity, deviation, merging, bad input, and corners that FCL finds free."""

import itertools
from collections.abc import Iterator
from itertools import islice, product

import numpy as np
import pytest
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.timing.path.blend import (
    blend,
    certified_reaches,
    largest_reaches,
    merge,
    reach_for_deviation,
)
from planning.timing.path.path import JointPath
from planning.values.deadline import Deadline
from tests.obstacles.collision.test_checker import arena
from tests.planning.scenes import box, builtin


def distance_to_polyline(points: Array, waypoints: Array) -> Array:
    """Distance of each point from the nearest leg."""
    best = np.full(len(points), np.inf)
    for a, b in itertools.pairwise(waypoints):
        w = np.clip(((points - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - w[:, None] * (b - a), axis=1))
    return best


def jumps(path: JointPath, derivative: int) -> Array:
    """Jump of q or a derivative at the inner breaks, from numpy's polynomials."""
    result = []
    for before, after, length in zip(
        path.coefficients[:-1], path.coefficients[1:], path.lengths[:-1], strict=True
    ):
        ends = []
        for c, u in ((before, length), (after, 0.0)):
            rates = [np.polynomial.Polynomial(row).deriv(derivative) for row in c]
            ends.append(np.array([rate(u) for rate in rates]))
        result.append(np.abs(ends[1] - ends[0]).max())
    return np.array(result)


@pytest.mark.parametrize("n", [1, 2, 7, 20])
@pytest.mark.parametrize("part", [0.05, 0.7, 1.0])
def test_blended_paths_are_smooth_and_keep_their_ends(n: int, part: float) -> None:
    rng = np.random.default_rng(n)
    for _ in range(10):
        waypoints = rng.uniform(-3.0, 3.0, (int(rng.integers(3, 9)), n))
        path = blend(waypoints, part * largest_reaches(waypoints))
        assert jumps(path, 0).max(initial=0.0) < 1e-14
        sharp = np.zeros(len(path.lengths) - 1, dtype=bool)
        sharp[[i - 1 for i in path.corners]] = True
        tangents = jumps(path, 1)
        assert tangents[~sharp].max(initial=0.0) < 1e-14
        assert sharp.any() == (n == 1 and len(merge(waypoints)) > 2)
        ends = path.sample([0.0, path.breaks[-1]])
        np.testing.assert_allclose(ends, waypoints[[0, -1]], atol=1e-14)


@pytest.mark.parametrize("n", [2, 3, 7])
def test_the_deviation_is_the_reach_times_a_quarter_of_the_turn(n: int) -> None:
    rng = np.random.default_rng(10 + n)
    for _ in range(50):
        waypoints = rng.normal(size=(3, n))
        reach = float(largest_reaches(waypoints)[0] * rng.uniform(0.05, 1.0))
        path = blend(waypoints, [reach])
        legs = np.diff(waypoints, axis=0)
        units = legs / np.linalg.norm(legs, axis=1)[:, None]
        parabola = float(np.linalg.norm(legs[0])) - reach
        points = path.sample(np.linspace(parabola, parabola + 2.0 * reach, 2001))
        nearest = np.linalg.norm(points - waypoints[1], axis=1).min()
        assert nearest == pytest.approx(reach * np.linalg.norm(units[1] - units[0]) / 4.0, rel=1e-9)
        assert distance_to_polyline(points, waypoints).max() <= nearest * (1.0 + 1e-12)


@pytest.mark.parametrize("deviation", [0.0, 1e-3, 0.05, 10.0])
def test_a_deviation_asked_for_is_kept(deviation: float) -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        waypoints = rng.uniform(-2.0, 2.0, (6, 4))
        reaches = reach_for_deviation(waypoints, deviation)
        assert (reaches <= largest_reaches(waypoints)).all()
        path = blend(waypoints, reaches)
        points = path.sample(np.linspace(0.0, path.breaks[-1], 4001))
        assert distance_to_polyline(points, waypoints).max() <= deviation + 1e-12
        corner = np.linalg.norm(points[:, None] - waypoints, axis=2).min(axis=0)
        assert (corner <= deviation + 3e-3).all()
    assert len(blend(waypoints, np.zeros(4)).corners) == 4


def test_points_that_repeat_or_lie_on_a_leg_are_merged() -> None:
    a, b, c = np.array([0.1, 0.2, 0.3]), np.array([1.1, -0.4, 2.0]), np.array([0.0, 1.0, 1.0])
    ts = np.linspace(0.0, 1.0, 13)[:, None]
    points = np.concatenate([a + ts * (b - a), [b, b + 1e-13], b + ts * (c - b), [c]])
    np.testing.assert_allclose(merge(points), [a, b, c], atol=1e-12)
    reaches = np.full(len(points) - 2, 0.01)
    path = blend(points, reaches)
    assert len(path.lengths) == 3
    np.testing.assert_allclose(path.length, np.linalg.norm(b - a) + np.linalg.norm(c - b))
    # The only reach that means anything is that of the corner, which is the first of its copies.
    assert np.count_nonzero(largest_reaches(points)) == 1
    np.testing.assert_array_equal(merge([a, a, a]), [a])


def test_a_slow_bend_is_not_taken_for_a_line() -> None:
    angles = np.linspace(0.0, 0.5, 50_001)[::10]
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    kept = merge(circle)
    assert distance_to_polyline(circle[::50], kept).max() < 1e-9


def test_a_reversal_stays_a_stop() -> None:
    waypoints = np.array([[0.0, 0.0], [1.0, 0.0], [0.2, 0.0], [0.2, 1.0]])
    assert largest_reaches(waypoints)[0] == 0.0
    path = blend(waypoints, [0.3, 0.1])
    assert path.corners == (1,)
    np.testing.assert_allclose(path.sample([1.0]), [[1.0, 0.0]])
    with pytest.raises(InvalidOption):
        blend(waypoints, [-0.3, 0.1])


def test_reaches_that_nearly_meet_leave_a_piece_to_reckon_with() -> None:
    waypoints = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]])
    for gap in (0.0, 1e-16, 1e-13, 1e-10, 1e-8):
        path = blend(waypoints, [0.5 - gap, 0.5])
        assert path.lengths.min() > 0.9e-7
        assert jumps(path, 0).max() < 1e-15
        assert jumps(path, 1).max() < 1e-15
        assert path.length == pytest.approx(3.0, rel=1e-7)


@pytest.mark.parametrize(
    "waypoints",
    [[], [[]], [1.0, 2.0], [[1.0], [2.0, 3.0]], [[0.0], [np.nan]], [["a"], ["b"]]],
)
def test_malformed_waypoints_are_refused(waypoints: ArrayLike) -> None:
    with pytest.raises(InvalidTrajectory):
        merge(waypoints)


@pytest.mark.parametrize("reaches", [[], [0.1, 0.1], [-0.1], [np.nan], [0.51]])
def test_malformed_reaches_are_refused(reaches: list[float]) -> None:
    with pytest.raises(InvalidOption):
        blend([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], reaches)


def test_a_path_without_length_is_refused() -> None:
    for waypoints in ([[1.0, 2.0]], [[1.0, 2.0]] * 4):
        with pytest.raises(InvalidTrajectory, match="no length"):
            blend(waypoints, np.zeros(max(len(waypoints) - 2, 0)))
    with pytest.raises(InvalidOption, match="blend tolerance"):
        reach_for_deviation([[0.0], [1.0], [0.0]], -1.0)


def test_malformed_paths_are_refused() -> None:
    good = np.zeros((1, 2, 3))
    for c, lengths in (
        (good[0], [1.0]),
        (good[:, :, :1], [1.0]),
        (good, [0.0]),
        (good, [1.0, 1.0]),
        (good + np.inf, [1.0]),
        (good, [np.nan]),
    ):
        with pytest.raises(InvalidTrajectory):
            JointPath(c, np.array(lengths))
    path = blend([[0.0], [1.0]], [])
    for places in ([-0.1], [1.1], [np.nan]):
        with pytest.raises(InvalidOption):
            path.sample(places)


#: Of two links in the plane of x and z: the way from BEFORE to BEHIND round the corner folds the
#: outer link, so that its tip passes inside of a bar that the straight way would meet.
BEFORE, CORNER, BEHIND = np.array([-0.9, 0.6]), np.array([0.0, 1.7]), np.array([0.9, 0.6])
WAY = np.array([BEFORE, CORNER, BEHIND])
ROBOT = builtin("planar_rr")


def scene(at: tuple[float, float], size: float = 0.02) -> Scene:
    """A bar across the plane, by where it is in x and z."""
    return Scene((box("bar", (size, 1.0, size), (at[0], 0.0, at[1])),))


def least_distance(
    way: Array, reaches: Array, where: Scene, smooth: bool, count: int = 300
) -> float:
    """Along the rounded path, by FCL at many places."""
    path, world = blend(way, reaches, smooth=smooth), FclWorld(ROBOT, where)
    places = np.linspace(0.0, path.length, count)
    return min(float(world.clearance(q).distance) for q in path.sample(places))


def inside(
    smooth: bool = False, size: float = 0.02, slack: float = 0.0
) -> Iterator[tuple[float, float]]:
    """Places of a bar that the legs pass and the corner rounded fully does not."""
    reaches = largest_reaches(WAY)
    for x, z in product(np.linspace(0.8, 1.4, 13), np.linspace(0.4, 1.1, 15)):
        at = float(x), float(z)
        c = Checker(Checker.of(ROBOT, scene(at, size)).model, slack)
        if not (c.free(BEFORE, CORNER) and c.free(CORNER, BEHIND)):
            continue
        if least_distance(WAY, reaches, scene(at, size), smooth, 60) <= 0.0:
            yield at


@pytest.mark.parametrize("smooth", [False, True])
def test_what_is_rounded_is_free_and_not_much_narrower_than_it_could_be(smooth: bool) -> None:
    places, largest = list(islice(inside(smooth), 6)), float(largest_reaches(WAY)[0])
    assert len(places) >= 2
    for at in places:
        where = scene(at)
        (reach,) = certified_reaches(
            Checker.of(ROBOT, where), WAY, Deadline.after(60.0), smooth=smooth
        )
        assert 0.0 <= reach < largest
        assert least_distance(WAY, np.array([reach]), where, smooth) > 0.0
        # Halved no oftener than was needed: with twice the reach something is met, or nearly.
        wide = np.array([2.0 * reach]) if reach > 0.0 else 0.05 * largest_reaches(WAY)
        assert least_distance(WAY, wide, where, smooth) < 0.02


def test_without_obstacles_corners_are_rounded_fully() -> None:
    checker = Checker.of(ROBOT, Scene())
    way = np.array([BEFORE, CORNER, BEHIND, [0.9, -0.3]])
    for smooth in (False, True):
        found = certified_reaches(checker, way, Deadline.after(60.0), smooth=smooth)
        np.testing.assert_array_equal(found, largest_reaches(way))
    most = np.array([0.1, 5.0])
    found = certified_reaches(checker, way, Deadline.after(60.0), most=most)
    np.testing.assert_array_equal(found, np.minimum(most, largest_reaches(way)))


def test_slack_and_margin_are_kept_on_the_curve() -> None:
    slack, margin = 0.01, 0.005
    where = scene(next(inside(slack=slack + margin)))
    checker = Checker(Checker.of(ROBOT, where, margin).model, slack)
    (reach,) = certified_reaches(checker, WAY, Deadline.after(60.0))
    assert reach > 0.0
    assert least_distance(WAY, np.array([reach]), where, False) >= margin + slack


def test_corners_not_looked_at_in_time_stay_sharp() -> None:
    checker = Checker.of(ROBOT, Scene())
    found = certified_reaches(checker, WAY, Deadline.after(-1.0))
    np.testing.assert_array_equal(found, [0.0])


def test_a_corner_whose_every_curve_is_barred_is_a_stop() -> None:
    """No clearance is so large that any rounding keeps it, the corner itself included."""
    checker = Checker.of(ROBOT, scene((0.0, -3.0)))
    barred = Checker(checker.model, 10.0)
    np.testing.assert_array_equal(certified_reaches(barred, WAY, Deadline.after(60.0)), [0.0])


def proved(checker: Checker, way: Array, reaches: Array, smooth: bool) -> Array:
    """Which curved pieces of a blended path ``Checker.curve`` proves free."""
    path = blend(way, reaches, smooth=smooth)
    pieces = path.coefficients * path.lengths[:, None, None] ** np.arange(4 if smooth else 3)
    curved = pieces[pieces[:, :, 2:].any(axis=(1, 2))]
    return np.array([checker.curve(*piece.T).free for piece in curved])


@pytest.mark.parametrize("smooth", [False, True])
def test_reaches_are_the_widest_whose_curves_of_the_blended_path_are_free(smooth: bool) -> None:
    """Found and halved once, all is free; a corner twice as wide as found has a curve that is not.

    Ways lead past obstacles as near as random ones do; half of the corners come closer than the
    clearance that is preferred.
    """
    random, seen = np.random.default_rng(17), set[str]()
    robot = builtin("ur5e")
    for trial in range(12):
        checker = Checker.of(robot, arena(robot, trial))
        level = Checker(checker.model.with_margins(0.03, 0.005))
        drawn = random.uniform(-2.0, 2.0, (300, 6))
        way = drawn[checker.each_valid(drawn)][:8]
        most = random.uniform(0.2, 1.0, len(way) - 2) * largest_reaches(way)
        later = Deadline.after(60.0)
        found = certified_reaches(checker, way, later, smooth=smooth, most=most, preferred=(level,))
        assert proved(checker, way, found, smooth).all()
        for i, reach in enumerate(found):
            one = np.zeros_like(found)
            halves = np.log2(most[i] / reach) if reach > 0.0 else 7.0
            assert halves == pytest.approx(round(halves), abs=1e-9)
            one[i] = reach
            kept = level.valid(way[i + 1]) and reach > 0.0
            if kept and proved(level, way, one, smooth).all():
                by = level
            else:
                by = checker
                for k in range(3 if level.valid(way[i + 1]) else 0):
                    one[i] = most[i] / 2.0**k
                    assert not proved(level, way, one, smooth).all()
            seen.add("preferred" if by is level else "free" if reach > 0.0 else "stop")
            for k in range(round(halves)):
                one[i] = most[i] / 2.0**k
                assert not proved(by, way, one, smooth).all()
    assert seen >= {"preferred", "free"}

"""Corners rounded as widely as FCL finds free, and not at all where nothing is."""

from collections.abc import Iterator
from itertools import islice, product

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.timing.path.blend import blend, certified_reaches, largest_reaches
from planning.values.deadline import Deadline
from tests.obstacles.collision.test_checker import arena
from tests.planning.scenes import box, builtin

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

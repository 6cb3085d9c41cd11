"""Corners rounded as widely as FCL finds free, and not at all where nothing is."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice, product

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.checker import Checker, Motion
from obstacles.fcl_distance import FclWorld
from obstacles.scene import Scene
from planning.deadline import Deadline
from planning.timing.blend import blend, largest_reaches
from planning.timing.corner_blending import certified_reaches
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


@dataclass(frozen=True, eq=False)
class Recorder(Checker):
    """A checker that keeps the curves it is asked about."""

    curves: list[Array] = field(default_factory=list)

    def curve(self, b0: Array, b1: Array, b2: Array, b3: Array | None = None) -> Motion:
        """As the checker says."""
        bend = np.zeros_like(b0) if b3 is None else b3
        self.curves.append(np.stack([b0, b1, b2, bend], axis=-1))
        return Checker.curve(self, b0, b1, b2, b3)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("part", [1.0, 0.3])
def test_the_curves_that_are_proved_are_those_of_the_blended_path(
    smooth: bool, part: float
) -> None:
    way = np.array([BEFORE, CORNER, BEHIND, [0.2, -0.4]])
    most = part * largest_reaches(way)
    recorder = Recorder(Checker.of(ROBOT, Scene()).model)
    reaches = certified_reaches(recorder, way, Deadline.after(60.0), smooth=smooth, most=most)
    np.testing.assert_array_equal(reaches, most)
    path = blend(way, reaches, smooth=smooth)
    curved = np.flatnonzero(path.coefficients[:, :, 2:].any(axis=(1, 2)))
    assert len(recorder.curves) == len(curved) == (4 if smooth else 2)
    share = np.linspace(0.0, 1.0, 9)
    for piece in curved:
        places = path.breaks[piece] + share * path.lengths[piece]
        wanted = path.sample(np.minimum(places, path.breaks[piece + 1]))
        looks = [(c @ share ** np.arange(4)[:, None]).T for c in recorder.curves]
        # A curve and the same one backwards are the same configurations.
        gaps = [np.abs(found[::turn] - wanted).max() for found in looks for turn in (1, -1)]
        assert min(gaps) < 1e-12

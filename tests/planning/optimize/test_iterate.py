"""Motions while they are optimised: values by scipy, ends as given."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from kinematics.arrays import Array
from planning.optimize.iterate import Iterate, set_ends
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End
from tests.planning.optimize.motions import PANDA, SPACE, iterate


def random_ends(seed: int, accelerations: bool = True) -> tuple[End, End]:
    rng = np.random.default_rng(seed)
    ends = [End(*rng.normal(size=(3 if accelerations else 2, 7))) for _ in range(2)]
    return ends[0], ends[1]


def rates(at: Iterate, place: float, order: int) -> Array:
    """A derivative with respect to time, by scipy."""
    spline = BSpline(at.space.knots, at.points, at.space.degree)
    return np.asarray(spline(place, nu=order) / at.duration**order)


def test_samples_and_trajectory_are_scipys_spline_in_time() -> None:
    at, u = iterate(1), np.linspace(0.0, 1.0, 41)
    motion = at.trajectory(PANDA.joint_names)
    assert motion.duration == pytest.approx(at.duration, rel=1e-15)
    for order in range(4):
        wanted = BSpline(SPACE.knots, at.points, SPACE.degree)(u, nu=order)
        scale = 1e-10 * np.abs(wanted).max()
        np.testing.assert_allclose(at.sample(u, order), wanted, atol=scale)
        times = np.minimum(u * at.duration, motion.duration)
        timed = wanted / at.duration**order
        np.testing.assert_allclose(motion.sample(times, order), timed, atol=2.0 * scale)


@pytest.mark.parametrize("accelerations", [False, True])
@pytest.mark.parametrize("degree", [3, 5])
def test_ends_are_exact_and_the_rest_stays(accelerations: bool, degree: int) -> None:
    space = SplineSpace.uniform(degree, 12)
    points = np.random.default_rng(2).normal(size=(12, 7))
    start, end = random_ends(3, accelerations)
    at = Iterate(space, points, 0.7).with_ends(start, end)
    for given, place in ((start, 0.0), (end, 1.0)):
        for order, values in enumerate(given.derivatives):
            np.testing.assert_allclose(rates(at, place, order), values, atol=1e-9)
    touched = 3 if accelerations else 2
    np.testing.assert_array_equal(at.points[touched:-touched], points[touched:-touched])
    assert (at.points[touched - 1] != points[touched - 1]).any()


def test_setting_ends_leaves_the_iterate_it_came_from_alone() -> None:
    at = iterate(4)
    before = at.points.copy()
    at.with_ends(*random_ends(5))
    np.testing.assert_array_equal(at.points, before)


def test_setting_ends_twice_changes_nothing_more() -> None:
    points, (start, end) = iterate(6).points.copy(), random_ends(7)
    set_ends(SPACE, points, 1.3, start, end)
    once = points.copy()
    set_ends(SPACE, points, 1.3, start, end)
    np.testing.assert_allclose(points, once, atol=1e-12)


def test_the_slower_a_motion_the_farther_its_velocity_moves_the_control_point() -> None:
    start, end = random_ends(8, accelerations=False)
    moved = [
        Iterate(SPACE, iterate(9).points, T).with_ends(start, end).points[1] for T in (1.0, 2.0)
    ]
    np.testing.assert_allclose(
        moved[1] - start.position, 2.0 * (moved[0] - start.position), atol=1e-12
    )


def test_part_of_the_way_to_another_motion_is_linear_in_points_and_duration() -> None:
    one, other = iterate(10), Iterate(SPACE, iterate(11).points, 2.7)
    for share in (0.0, 0.25, 1.0):
        between = one.toward(other, share)
        mean = (1.0 - share) * one.points + share * other.points
        np.testing.assert_allclose(between.points, mean, atol=1e-14)
        assert between.duration == pytest.approx((1.0 - share) * 1.3 + share * 2.7)

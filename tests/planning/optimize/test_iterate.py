"""Motions while they are optimised, and their splines: values by scipy, ends as given."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from kinematics.arrays import Array
from planning.optimize.iterate import Iterate
from planning.optimize.spline import SplineSpace


def rates(at: Iterate, place: float, order: int) -> Array:
    """A derivative with respect to time, by scipy."""
    spline = BSpline(at.space.knots, at.points, at.space.degree)
    return np.asarray(spline(place, nu=order) / at.duration**order)


def spaces(seed: int) -> list[SplineSpace]:
    rng = np.random.default_rng(seed)
    found = []
    for degree in range(1, 8):
        for pieces in (1, 2, 5, 11):
            inner = np.sort(rng.uniform(0.01, 0.99, pieces - 1))
            found.append(SplineSpace(degree, (0.0, *(float(b) for b in inner), 1.0)))
    return found


@pytest.mark.parametrize("space", spaces(0), ids=lambda s: f"{s.degree}-{s.pieces}")
def test_values_derivatives_and_pieces_are_those_of_scipy(space: SplineSpace) -> None:
    rng = np.random.default_rng(space.degree)
    points, u, T = rng.normal(size=(space.count, 3)), np.linspace(0.0, 1.0, 101), 2.5
    reference = BSpline(space.knots, points, space.degree)
    motion = space.trajectory(("a", "b", "c"), points, T)
    for order in range(space.degree + 1):
        wanted = reference(u, nu=order)
        scale = 1e-9 * np.abs(wanted).max()
        np.testing.assert_allclose(space.matrix(u, order) @ points, wanted, atol=scale)
        rates = motion.sample(u[:-1] * T, order) * T**order
        # At a break another piece may be taken, where this derivative jumps.
        if order < space.degree:
            np.testing.assert_allclose(rates, wanted[:-1], atol=10.0 * scale)


@pytest.mark.parametrize("space", spaces(1)[::3], ids=lambda s: f"{s.degree}-{s.pieces}")
def test_control_points_of_derivatives_enclose_them(space: SplineSpace) -> None:
    points = np.random.default_rng(7).normal(size=(space.count, 2))
    u = np.linspace(0.0, 1.0, 301)
    for order, D in enumerate(space.differences, start=1):
        controls, values = D @ points, space.matrix(u, order) @ points
        derived = BSpline(space.knots[order:-order], controls, space.degree - order)(u)
        np.testing.assert_allclose(derived, values, atol=1e-9 * np.abs(values).max())
        slack = 1e-9 * np.abs(controls).max()
        assert (values <= controls.max(axis=0) + slack).all()
        assert (values >= controls.min(axis=0) - slack).all()


def test_gram_matrices_are_integrals() -> None:
    space = SplineSpace.uniform(4, 9)
    points = np.random.default_rng(3).normal(size=space.count)
    fine = np.linspace(0.0, 1.0, 200_001)
    for order, G in enumerate(space.gram):
        values = space.matrix(fine, order) @ points
        assert points @ G @ points == pytest.approx(np.trapezoid(values**2, fine), rel=1e-4)

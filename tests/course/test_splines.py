"""Lecture 20: natural cubic splines through waypoints at given times."""

from typing import Any

import httpx
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.course.example import ask

TIMES = [0.0, 0.8, 1.5, 2.7, 4.0]
POINTS = [[0.0, 0.4], [0.5, -0.2], [0.3, 0.1], [1.1, 0.9], [0.7, 0.3]]
LIMITS = {"velocity": [50.0, 50.0], "acceleration": [500.0, 500.0], "jerk": [9e4, 9e4]}


@pytest.fixture(scope="module")
def segments(service: httpx.Client) -> list[dict[str, Any]]:
    body = {
        "path": {"joints": POINTS},
        "limits": LIMITS,
        "timing": {"method": "spline", "interpolation": "natural_spline", "times": TIMES},
    }
    found: list[dict[str, Any]] = ask(service, "retime", body)["trajectory"]["segments"]
    return found


def value(segments: list[dict[str, Any]], joint: int, t: float, order: int = 0) -> float:
    one = next(s for s in segments if s["t0"] - 1e-12 <= t <= s["t1"] + 1e-12)
    poly = np.polynomial.Polynomial(one["coefficients"][joint])
    return float(poly.deriv(order)(t - one["t0"]) if order else poly(t - one["t0"]))


@pytest.mark.parametrize("joint", [0, 1])
def test_scipy_has_the_same_spline(segments: list[dict[str, Any]], joint: int) -> None:
    spline = CubicSpline(TIMES, [row[joint] for row in POINTS], bc_type="natural")
    for t in np.linspace(0.0, 4.0, 41):
        assert value(segments, joint, float(t)) == pytest.approx(float(spline(t)), abs=1e-9)


def test_times_may_begin_anywhere_and_limits_are_not_needed(
    service: httpx.Client, segments: list[dict[str, Any]]
) -> None:
    # The spline of the notes is defined by points and times alone.
    later = [t + 5.0 for t in TIMES]
    timing = {"method": "spline", "interpolation": "natural_spline", "times": later}
    body = {"path": {"joints": POINTS}, "timing": timing}
    moved = ask(service, "retime", body)["trajectory"]["segments"]
    assert [one["t0"] for one in moved] == pytest.approx(later[:-1])
    for one, other in zip(moved, segments, strict=True):
        np.testing.assert_allclose(one["coefficients"], other["coefficients"], atol=1e-9)

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


def notes_coefficients(values: Any) -> Any:
    """The linear system of the notes: 4N unknowns of P_i(t) = a3 t³ + a2 t² + a1 t + a0."""
    n = len(TIMES) - 1
    rows, right = [], []

    def row(terms: list[tuple[int, int, float, float]], value: float) -> None:
        """One equation: sum of sign * (derivative of P_i at t) = value."""
        line = np.zeros(4 * n)
        for i, order, t, sign in terms:
            powers = np.polynomial.polynomial.polyder(np.eye(4), order, axis=1)
            line[4 * i : 4 * i + 4] += sign * np.polynomial.polynomial.polyval(t, powers.T)
        rows.append(line)
        right.append(value)

    for i in range(n):
        row([(i, 0, TIMES[i], 1.0)], values[i])
    row([(n - 1, 0, TIMES[n], 1.0)], values[n])
    for order in range(3):
        for i in range(n - 1):
            t = TIMES[i + 1]
            row([(i, order, t, 1.0), (i + 1, order, t, -1.0)], 0.0)
    row([(0, 2, TIMES[0], 1.0)], 0.0)
    row([(n - 1, 2, TIMES[n], 1.0)], 0.0)
    assert len(rows) == 4 * n
    return np.linalg.solve(np.array(rows), right).reshape(n, 4)


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
@pytest.mark.parametrize("piece", range(4))
def test_each_piece_solves_the_system_of_the_notes(
    segments: list[dict[str, Any]], joint: int, piece: int
) -> None:
    a = notes_coefficients([row[joint] for row in POINTS])[piece]
    for t in np.linspace(TIMES[piece], TIMES[piece + 1], 7):
        expected = np.polynomial.polynomial.polyval(t, a)
        assert value(segments, joint, float(t)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("knot", range(5))
def test_interpolation(segments: list[dict[str, Any]], joint: int, knot: int) -> None:
    expected = POINTS[knot][joint]
    assert value(segments, joint, TIMES[knot]) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("knot", [1, 2, 3])
def test_derivatives_are_continuous(segments: list[dict[str, Any]], knot: int, order: int) -> None:
    before = next(s for s in segments if abs(s["t1"] - TIMES[knot]) < 1e-12)
    after = next(s for s in segments if abs(s["t0"] - TIMES[knot]) < 1e-12)
    for joint in (0, 1):
        left = value([before], joint, TIMES[knot], order)
        assert left == pytest.approx(value([after], joint, TIMES[knot], order), abs=1e-9)


@pytest.mark.parametrize("joint", [0, 1])
def test_no_acceleration_at_the_ends(segments: list[dict[str, Any]], joint: int) -> None:
    assert value(segments, joint, TIMES[0], 2) == pytest.approx(0.0, abs=1e-9)
    assert value(segments, joint, TIMES[-1], 2) == pytest.approx(0.0, abs=1e-9)


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

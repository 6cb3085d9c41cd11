"""Interpolations against scipy's own: B-splines, Hermite cubics and Bernstein polynomials."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicHermiteSpline, make_interp_spline

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.interpolation import INTERPOLATIONS, interpolate

NAMES = ("a", "b", "c")


def samples(seed: int, count: int = 8) -> tuple[Array, Array, Array, Array]:
    random = np.random.default_rng(seed)
    times = 2.5 + np.cumsum(random.uniform(0.02, 1.5, count))
    q, v, a = random.normal(size=(3, count, 3))
    return times, q, v, a


@pytest.mark.parametrize("seed", range(20))
def test_against_scipy(seed: int) -> None:
    times, q, v, a = samples(seed)
    at = np.linspace(times[0], times[-1], 301)
    expected: dict[str, Any] = {
        "linear": make_interp_spline(times, q, k=1),
        "cubic": CubicHermiteSpline(times, q, v),
        "quintic": BPoly.from_derivatives(times, np.stack([q, v, a], axis=1)),
        "natural_spline": make_interp_spline(times, q, k=3, bc_type="natural"),
        "clamped_spline": make_interp_spline(times, q, k=3, bc_type="clamped"),
    }
    assert set(expected) == set(INTERPOLATIONS)
    for name, curve in expected.items():
        made = interpolate(NAMES, times, q, name, v, a)
        np.testing.assert_allclose(made.sample(at - times[0]), curve(at), atol=1e-10, rtol=1e-9)
        assert made.duration == pytest.approx(times[-1] - times[0], rel=1e-15)
        # scipy's own are continuous to their order.
        for order in range({"linear": 1, "cubic": 2}.get(name, 3)):
            assert np.abs(made.jumps(order)).max() < 1e-9 / np.diff(times).min() ** order


def test_only_what_is_needed_must_be_given() -> None:
    times, q, v, _ = samples(1)
    assert interpolate(NAMES, times, q, "linear").degree == 1
    assert interpolate(NAMES, times, q, "natural_spline").degree == 3
    with pytest.raises(InvalidOption, match="velocities"):
        interpolate(NAMES, times, q, "cubic")
    with pytest.raises(InvalidOption, match="accelerations"):
        interpolate(NAMES, times, q, "quintic", v)


@pytest.mark.parametrize(
    ("times", "positions", "match"),
    [
        ([0.0], [[0.0]], "two finite times"),
        ([0.0, 1.0, 1.0], [[0.0]] * 3, "time 2"),
        ([0.0, np.nan], [[0.0]] * 2, "finite"),
        ([0.0, 1.0], [[0.0]] * 3, "2 rows of 1"),
        ([0.0, 1.0], [[0.0], [0.0, 1.0]], "2 rows of 1"),
        ([0.0, 1.0], [[0.0], [np.inf]], "not all finite"),
    ],
)
def test_malformed_samples(times: list[float], positions: list[list[float]], match: str) -> None:
    with pytest.raises(InvalidTrajectory, match=match):
        interpolate(("a",), times, positions, "linear")


def test_unknown_names_are_answered_with_the_known_ones() -> None:
    with pytest.raises(InvalidOption, match="akima") as caught:
        interpolate(("a",), [0.0, 1.0], [[0.0], [1.0]], "akima")
    assert "natural_spline" in (caught.value.hint or "")


@pytest.mark.parametrize("name", ["velocities", "accelerations"])
@pytest.mark.parametrize("bad", [np.zeros((2, 2)), np.zeros(3), np.full((3, 1), np.nan), "x"])
def test_malformed_derivatives_are_named(name: str, bad: Array) -> None:
    rows = {"velocities": np.zeros((3, 1)), "accelerations": np.zeros((3, 1))} | {name: bad}
    with pytest.raises(InvalidTrajectory, match=f"the {name} of the samples"):
        interpolate(("a",), [0.0, 1.0, 2.0], np.zeros((3, 1)), "quintic", **rows)


@pytest.mark.parametrize("times", [[], [0.0], [[0.0, 1.0]], [0.0, np.inf], [1.0, 0.0], [0.0, 0.0]])
def test_times_that_do_not_increase_are_refused(times: list[float]) -> None:
    with pytest.raises(InvalidTrajectory, match=r"two finite times|not after the one before"):
        interpolate(("a",), times, np.zeros((len(times), 1)), "linear")

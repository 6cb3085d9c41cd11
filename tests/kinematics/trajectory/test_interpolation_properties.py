"""Interpolations by what defines them: what they reproduce, what is continuous, what is least."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import polynomial as power_basis

from kinematics.arrays import Array
from kinematics.errors import InvalidTrajectory
from kinematics.trajectory.interpolation import INTERPOLATIONS, interpolate
from kinematics.trajectory.trajectory import Trajectory

Samples = tuple[Array, Array, Array, Array]
NAMES = ("a", "b")


@st.composite
def samples(draw: Callable[..., int]) -> Samples:
    """Times, positions, velocities and accelerations of two joints."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    count = draw(st.integers(2, 7))
    times = rng.uniform(-5.0, 5.0) + np.cumsum(rng.uniform(0.05, 2.0, count))
    q, v, a = rng.normal(size=(3, count, 2))
    return times, q, v, a


def through(given_samples: Samples, name: str) -> Trajectory:
    """The trajectory of an interpolation through samples."""
    times, q, v, a = given_samples
    return interpolate(NAMES, times, q, name, v, a)


@settings(max_examples=25)
@given(samples(), st.sampled_from(INTERPOLATIONS))
def test_the_trajectory_starts_at_zero_and_meets_every_sample(rows: Samples, name: str) -> None:
    times, q, v, a = rows
    made = through(rows, name)
    at = times - times[0]
    assert made.duration == pytest.approx(at[-1], rel=1e-15)
    np.testing.assert_allclose(made.sample(at), q, atol=1e-10)
    given_derivatives = {"cubic": [v], "quintic": [v, a]}.get(name, [])
    for order, values in enumerate(given_derivatives, start=1):
        scale = float(np.abs(values).max()) + 1.0 / float(np.diff(times).min()) ** order
        np.testing.assert_allclose(made.sample(at, order), values, atol=1e-10 * scale)


@pytest.mark.parametrize(
    ("name", "continuous"),
    [("linear", 1), ("cubic", 2), ("quintic", 3), ("natural_spline", 3), ("clamped_spline", 3)],
)
@settings(max_examples=25)
@given(samples())
def test_as_many_derivatives_are_continuous_as_promised(
    name: str, continuous: int, rows: Samples
) -> None:
    made, shortest = through(rows, name), float(np.diff(rows[0]).min())
    for order in range(continuous):
        assert np.abs(made.jumps(order)).max(initial=0.0) < 1e-9 / shortest**order


@settings(max_examples=25)
@given(samples())
def test_splines_end_as_their_names_say(rows: Samples) -> None:
    ends = [0.0, float(rows[0][-1] - rows[0][0])]
    natural, clamped = (through(rows, f"{kind}_spline") for kind in ("natural", "clamped"))
    scale = float(np.abs(np.diff(rows[1], axis=0)).max()) / float(np.diff(rows[0]).min()) ** 2
    assert np.abs(natural.sample(ends, 2)).max() < 1e-9 * scale
    assert np.abs(clamped.sample(ends, 1)).max() < 1e-9 * scale


def bending(made: Trajectory) -> float:
    """The integral of the squared acceleration over all joints, exactly."""
    total = 0.0
    for h, c in zip(np.diff(made.breaks), made.derivative(2).coefficients, strict=True):
        for joint in c:
            total += float(
                power_basis.polyval(h, power_basis.polyint(power_basis.polymul(joint, joint)))
            )
    return total


@settings(max_examples=25)
@given(samples(), st.integers(0, 1000))
def test_no_curve_through_the_samples_bends_less_than_the_natural_spline(
    rows: Samples, seed: int
) -> None:
    # Hermite cubics through the same positions with any velocities at all.
    times, q, _, _ = rows
    v = np.random.default_rng(seed).normal(size=q.shape)
    natural = through(rows, "natural_spline")
    other = interpolate(NAMES, times, q, "cubic", v)
    assert bending(natural) <= bending(other) * (1.0 + 1e-9) + 1e-12
    own = natural.sample(np.clip(times - times[0], 0.0, natural.duration), 1)
    same = interpolate(NAMES, times, q, "cubic", own)
    assert bending(same) == pytest.approx(bending(natural), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("name", "degree"), [("linear", 1), ("cubic", 3), ("quintic", 5)])
@settings(max_examples=25)
@given(samples())
def test_a_polynomial_of_its_degree_is_reproduced(name: str, degree: int, rows: Samples) -> None:
    times = rows[0]
    c = np.random.default_rng(len(times)).normal(size=(degree + 1, 2))
    t = times - times[0]
    q, v, a = (power_basis.polyval(t, power_basis.polyder(c, k)).T for k in range(3))
    made = interpolate(NAMES, times, q, name, v, a)
    between = np.linspace(0.0, t[-1], 50)
    expected = power_basis.polyval(between, c).T
    np.testing.assert_allclose(made.sample(between), expected, atol=1e-8 * np.abs(expected).max())


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

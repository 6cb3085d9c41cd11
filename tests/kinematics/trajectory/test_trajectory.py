"""Trajectories as values, messages and tables, and interpolations beside numpy's and scipy's."""

import csv
import io
import json
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.polynomial import polynomial as power_basis
from numpy.typing import ArrayLike
from scipy.interpolate import BPoly, CubicHermiteSpline, make_interp_spline

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.export import csv_text, joint_trajectory
from kinematics.trajectory.polynomial import (
    unit_roots_kernel,
)
from kinematics.trajectory.trajectory import (
    INTERPOLATIONS,
    MAX_DEGREE,
    MAX_SAMPLES,
    REST,
    Trajectory,
    concatenate,
    interpolate,
    stay,
)
from tests.properties import numbers, trajectories


def names(n: int) -> tuple[str, ...]:
    return tuple(f"joint{i}" for i in range(n))


def random_trajectory(rng: np.random.Generator, m: int, n: int, k: int) -> Trajectory:
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.5, m))])
    return Trajectory(names(n), breaks, rng.normal(size=(m, n, k)))


def reference_range(c: Array, h: float, order: int) -> tuple[float, float]:
    """Range of a derivative on [0, h] by numpy's companion matrix, complex roots included.

    The real parts of all roots are candidates: what a nearly double root loses in its real part
    costs nothing in the value, and a candidate too many does no harm.
    """
    p = power_basis.polyder(c, order) if order < len(c) else np.zeros(1)
    inner = np.trim_zeros(power_basis.polyder(p), "b") if len(p) > 1 else np.zeros(0)
    roots = power_basis.polyroots(inner).real if len(inner) > 1 else np.zeros(0)
    candidates = np.concatenate([[0.0, h], roots[(roots > 0.0) & (roots < h)]])
    values = power_basis.polyval(candidates, p)
    return float(values.min()), float(values.max())


def made(joint_names: tuple[str, ...], breaks: ArrayLike, coefficients: ArrayLike) -> Trajectory:
    return Trajectory(joint_names, np.asarray(breaks), np.asarray(coefficients))


def piece(c: ArrayLike, h: float) -> Trajectory:
    return made(("joint",), [0.0, h], np.asarray(c, dtype=float)[None, None])


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4, 5, 7, 10])
def test_extrema_agree_with_numpys_roots(degree: int) -> None:
    rng = np.random.default_rng(degree)
    trajectory = random_trajectory(rng, 60, 5, degree + 1)
    for order in range(4):
        lower, upper = trajectory.piece_extrema(order)
        scale = np.abs(upper - lower).max() + np.abs(upper).max() + 1.0
        for i in range(trajectory.pieces):
            h = float(np.diff(trajectory.breaks)[i])
            for j in range(trajectory.n):
                low, high = reference_range(trajectory.coefficients[i, j], h, order)
                assert lower[i, j] == pytest.approx(low, abs=1e-12 * scale)
                assert upper[i, j] == pytest.approx(high, abs=1e-12 * scale)
        found = trajectory.extrema(order)
        np.testing.assert_allclose(found.minimum, lower.min(axis=0), atol=1e-13 * scale)
        np.testing.assert_allclose(found.maximum, upper.max(axis=0), atol=1e-13 * scale)


@pytest.mark.parametrize(
    ("c", "h"),
    [
        ([2.0], 1.0),
        ([0.0], 1.0),
        ([1.0, 2.0, 0.0, 0.0, 0.0], 3.0),
        ([0.0, 0.0, 0.0, 0.0, 1.0], 2.0),
        ([1e-300, 0.0, 1e-300], 1.0),
        ([1e150, -3e150, 1e150, 2e150], 2.0),
        ([1.0, -1.0, 1e-18, 1e-30], 5.0),
        ([0.0, 1.0, -1e6], 1e-6),
        ([0.0, 1e-9, -1e-12], 1e4),
        (list(power_basis.polyfromroots([0.5] * 5)), 1.0),
        (list(power_basis.polyfromroots([0.25, 0.25, 0.75, 0.75])), 1.0),
        (list(power_basis.polyfromroots([0.5, 0.5 + 1e-9, 0.5 - 1e-9])), 1.0),
        (list(power_basis.polyfromroots([0.0, 0.0, 1.0, 1.0])), 1.0),
        ([0.0, 0.0, 1.0, -2.0, 1.0], 2.0),
    ],
)
def test_extrema_of_degenerate_pieces(c: list[float], h: float) -> None:
    trajectory = piece(np.array(c), h)
    for order in range(4):
        low, high = reference_range(np.array(c), h, order)
        found = trajectory.extrema(order)
        size = max(abs(low), abs(high))
        assert found.minimum[0] == pytest.approx(low, rel=1e-12, abs=1e-12 * size)
        assert found.maximum[0] == pytest.approx(high, rel=1e-12, abs=1e-12 * size)
        dense = trajectory.sample(np.linspace(0.0, h, 10_001), order)
        assert dense.max() <= found.maximum[0] + 1e-13 * size
        assert dense.min() >= found.minimum[0] - 1e-13 * size


def test_ends_are_sampled_and_times_beyond_them_refused() -> None:
    trajectory = made(
        ("a", "b"), [0.0, 0.1, 0.3], [[[0.0, 1.0], [1.0, 0.0]], [[0.1, 2.0], [1.0, 0.0]]]
    )
    np.testing.assert_array_equal(trajectory.start, [0.0, 1.0])
    np.testing.assert_allclose(trajectory.end, [0.5, 1.0], atol=1e-16)
    for times in ([-1e-6], [0.300001], [np.nan], [[0.0]]):
        with pytest.raises(InvalidOption, match="outside"):
            trajectory.sample(times)
    with pytest.raises(InvalidOption, match="order -1"):
        trajectory.sample([0.0], -1)


def test_jumps_are_found() -> None:
    pieces = [[[0.0, 1.0, 2.0]], [[1.0 + 1e-3, 3.25, 1.0]]]
    trajectory = made(("a",), [0.0, 0.5, 1.5], pieces)
    position, velocity, acceleration = trajectory.continuity()
    assert position == pytest.approx(1e-3, rel=1e-9)
    assert velocity == pytest.approx(0.25)
    assert acceleration == pytest.approx(2.0)
    assert piece(np.array([1.0, 2.0]), 1.0).continuity() == (0.0, 0.0, 0.0)


def test_reversing_runs_the_same_motion_backwards() -> None:
    trajectory = random_trajectory(np.random.default_rng(11), 6, 3, 5)
    back = trajectory.reverse()
    assert back.duration == trajectory.duration
    times = np.linspace(0.0, trajectory.duration, 301)
    times = times[np.abs(times[:, None] - trajectory.breaks).min(axis=1) > 1e-9]
    for order in range(4):
        expected = (-1.0) ** order * trajectory.sample(times, order)
        actual = back.sample(trajectory.duration - times, order)
        np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


def test_concatenation_pads_degrees_and_refuses_other_joints() -> None:
    first = piece(np.array([0.0, 1.0]), 1.0)
    second = piece(np.array([1.0, 1.0, 3.0]), 2.0)
    joined = concatenate([first, second])
    assert joined.degree == 2
    assert joined.continuity().position == 0.0
    with pytest.raises(InvalidTrajectory, match="different joints"):
        concatenate([first, made(("other",), [0.0, 1.0], [[[0.0]]])])
    with pytest.raises(InvalidTrajectory):
        concatenate([])


@pytest.mark.parametrize("period", [0.01, 0.1, 0.3, 1.0 / 3.0, 0.7, 5.0])
@pytest.mark.parametrize("duration", [0.3, 1.0, 0.1 * 3, 2.1, 1e-6])
def test_uniform_samples_ascend_and_end_exactly(period: float, duration: float) -> None:
    times = piece(np.zeros(1), duration).uniform_samples(period)
    steps = np.diff(times)
    assert times[0] == 0.0
    assert times[-1] == duration
    assert (steps > 0.0).all()
    assert (steps <= period * (1.0 + 1e-5)).all()
    assert np.allclose(steps[:-1], period)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: made((), [0, 1], np.zeros((1, 0, 1))), "names"),
        (lambda: made(("a", "a"), [0, 1], np.zeros((1, 2, 1))), "distinct"),
        (lambda: made(("a",), [0], np.zeros((0, 1, 1))), "at least one piece"),
        (lambda: made(("a",), [1, 2], np.zeros((1, 1, 1))), "start at 1"),
        (lambda: made(("a",), [0, 1, 1], np.zeros((2, 1, 1))), "after break 1"),
        (lambda: made(("a",), [0, np.nan], np.zeros((1, 1, 1))), "finite"),
        (lambda: made(("a",), [0, 1], [[[np.inf]]]), "finite"),
        (lambda: made(("a",), [0, 1], np.zeros((2, 1, 1))), "do not fit"),
        (lambda: made(("a",), [0, 1], np.zeros((1, 2, 1))), "do not fit"),
        (lambda: made(("a",), [0, 1], np.zeros((1, 1, 0))), "do not fit"),
        (lambda: made(("a",), [0, 1], np.zeros((1, 1))), "do not fit"),
        (lambda: made(("a",), [0, 1], np.zeros((1, 1, 40))), "degree 39"),
        (lambda: made(("a",), [0, 1], [[["x"]]]), "not an array of numbers"),
    ],
)
def test_malformed_trajectories_are_refused(make: Callable[[], Trajectory], match: str) -> None:
    with pytest.raises(InvalidTrajectory, match=match):
        make()


def test_a_trajectory_is_a_value() -> None:
    trajectory = random_trajectory(np.random.default_rng(2), 3, 2, 4)
    again = pickle.loads(pickle.dumps(trajectory))
    assert again == trajectory
    assert hash(again) == hash(trajectory)
    assert trajectory != trajectory.dilate(1.5)
    assert Trajectory(("x", "y"), trajectory.breaks, trajectory.coefficients) != trajectory
    with pytest.raises(ValueError, match="read-only"):
        trajectory.breaks[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.coefficients[0, 0, 0] = 1.0


def test_keeping_still_is_a_trajectory() -> None:
    still = stay(names(3), [0.1, -0.2, 0.3])
    assert still.duration == REST
    np.testing.assert_array_equal(still.start, [0.1, -0.2, 0.3])
    np.testing.assert_array_equal(still.end, still.start)
    assert not still.peaks(1).value.any()
    for position, duration in (([0.1], 1.0), ([0.1, 0.2, np.nan], 1.0), ([0.0] * 3, 0.0)):
        with pytest.raises(InvalidTrajectory):
            stay(names(3), position, duration)


def test_the_highest_degree_is_taken_and_the_next_refused() -> None:
    c = np.zeros(MAX_DEGREE + 1)
    c[-1] = 1.0
    assert piece(c, 1.0).end[0] == 1.0
    with pytest.raises(InvalidTrajectory, match=f"degree {MAX_DEGREE + 1}"):
        piece(np.append(c, 1.0), 1.0)


ORDERS = st.integers(0, 3)
SHARES = st.floats(0.02, 0.98)


def instants(trajectory: Trajectory) -> Array:
    """Instants inside the pieces, none at a break, where derivatives jump."""
    lengths = np.diff(trajectory.breaks)[:, None]
    return np.asarray((trajectory.breaks[:-1, None] + lengths * np.linspace(0.03, 0.97, 9)).ravel())


def size(trajectory: Trajectory, order: int) -> float:
    """A bound of the derivative of this order over all pieces, from the moduli of its terms."""
    c, h = np.abs(trajectory.coefficients), np.diff(trajectory.breaks)[:, None]
    for _ in range(order):
        c = c[:, :, 1:] * np.arange(1.0, c.shape[2]) if c.shape[2] > 1 else 0.0 * c
    return float((c * h[..., None] ** np.arange(c.shape[2])).sum(axis=2).max()) + 1e-6


@given(trajectories(), ORDERS)
def test_samples_are_those_of_numpys_polynomials(trajectory: Trajectory, order: int) -> None:
    times = instants(trajectory)
    found = trajectory.sample(times, order)
    for row, t in zip(found, times, strict=True):
        i = int(np.searchsorted(trajectory.breaks, t)) - 1
        for j in range(trajectory.n):
            expected = Polynomial(trajectory.coefficients[i, j]).deriv(order)(
                t - trajectory.breaks[i]
            )
            assert row[j] == pytest.approx(expected, rel=1e-9, abs=1e-12 * size(trajectory, order))


@given(trajectories(), ORDERS, ORDERS)
def test_derivatives_of_derivatives_are_derivatives(
    trajectory: Trajectory, first: int, second: int
) -> None:
    times = instants(trajectory)
    found = trajectory.derivative(first).sample(times, second)
    expected = trajectory.sample(times, first + second)
    np.testing.assert_allclose(
        found, expected, rtol=1e-9, atol=1e-12 * size(trajectory, first + second)
    )


@given(trajectories(), st.floats(0.1, 10.0), ORDERS)
def test_dilation_divides_each_derivative_by_its_power(
    trajectory: Trajectory, factor: float, order: int
) -> None:
    times = instants(trajectory)
    slow = trajectory.dilate(factor)
    assert slow.duration == pytest.approx(factor * trajectory.duration, rel=1e-12)
    found = slow.sample(np.minimum(times * factor, slow.duration), order) * factor**order
    expected = trajectory.sample(times, order)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * size(trajectory, order))
    peaks, slower = trajectory.peaks(order).value, slow.peaks(order).value * factor**order
    np.testing.assert_allclose(slower, peaks, rtol=1e-9, atol=1e-11 * size(trajectory, order))


@given(trajectories(), SHARES)
def test_the_parts_of_a_split_play_as_the_whole(trajectory: Trajectory, share: float) -> None:
    time = share * trajectory.duration
    head, tail = trajectory.split(time)
    assert head.duration == pytest.approx(time, rel=1e-15)
    assert head.duration + tail.duration == pytest.approx(trajectory.duration, rel=1e-12)
    whole = concatenate([head, tail])
    times = instants(trajectory)
    times = times[np.abs(times - time) > 1e-9]
    scale = size(trajectory, 0)
    np.testing.assert_allclose(
        whole.sample(times), trajectory.sample(times), rtol=1e-9, atol=1e-12 * scale
    )
    # Where pieces meet these trajectories may jump.
    if np.abs(trajectory.breaks - time).min() > 1e-9 * trajectory.duration:
        assert float(np.abs(tail.start - head.end).max()) < 1e-12 * scale


@given(trajectories(), ORDERS)
def test_no_sample_is_beyond_the_extrema_and_they_are_reached(
    trajectory: Trajectory, order: int
) -> None:
    low, low_time, high, high_time = trajectory.extrema(order)
    rates, hair = trajectory.derivative(order), 1e-12 * size(trajectory, order)
    values = trajectory.sample(instants(trajectory), order)
    assert (values >= low - hair).all()
    assert (values <= high + hair).all()
    for extreme, time in ((low, low_time), (high, high_time)):
        for j in range(trajectory.n):
            # At a break the extreme may belong to the piece that ends there.
            places = np.searchsorted(trajectory.breaks, [time[j] - 1e-9, time[j] + 1e-9]) - 1
            reached = [
                Polynomial(rates.coefficients[i, j])(time[j] - trajectory.breaks[i])
                for i in np.clip(places, 0, trajectory.pieces - 1)
            ]
            assert min(abs(value - extreme[j]) for value in reached) <= 1e-9 * size(
                trajectory, order
            )
    peaks = trajectory.peaks(order).value
    np.testing.assert_allclose(peaks, np.maximum(np.abs(low), np.abs(high)), rtol=1e-12)


COEFFICIENTS = st.integers(1, 8).flatmap(lambda count: numbers(count, 3.0))
SAMPLES = np.linspace(0.0, 1.0, 501)


def from_roots(roots: list[float]) -> Array:
    """Ascending coefficients of the monic polynomial of some roots."""
    return np.asarray(power_basis.polyfromroots(roots), dtype=np.float64)


def roots_in_unit(c: Array) -> Array:
    """Sign changes in (0, 1] by the kernel."""
    n = len(c)
    roots, spare = np.full((2, n + 1), np.nan)
    return roots[: unit_roots_kernel(c, n, np.zeros((n + 1, n + 1)), roots, spare)]


# -------------------------------------------------------------------------------- derivatives


# --------------------------------------------------------------------------------------- roots


@pytest.mark.parametrize(
    ("roots", "expected"),
    [
        ([], []),
        ([0.5], [0.5]),
        ([0.2, 0.7], [0.2, 0.7]),
        ([0.2, 0.2000001], [0.2, 0.2000001]),
        ([-0.5, 0.25, 2.0], [0.25]),
        ([0.3, 0.3, 0.3], [0.3]),
        ([0.1, 0.3, 0.5, 0.7, 0.9], [0.1, 0.3, 0.5, 0.7, 0.9]),
        ([1.0], [1.0]),
        ([0.4, 1.0], [0.4, 1.0]),
        ([-1.0, -2.0, 1.5], []),
        ([1e-9, 1.0 - 1e-9], [1e-9, 1.0 - 1e-9]),
    ],
)
@pytest.mark.parametrize("factor", [1.0, -3e-7, 1e9])
def test_sign_changes_are_found_where_they_were_put(
    roots: list[float], expected: list[float], factor: float
) -> None:
    found = roots_in_unit(factor * from_roots(roots))
    assert len(found) == len(expected)
    # A triple root is known to a third of the digits.
    tolerance = 3e-5 if roots.count(0.3) == 3 else 1e-9
    np.testing.assert_allclose(found, expected, atol=tolerance)


@given(COEFFICIENTS)
def test_between_neighbouring_roots_the_sign_does_not_change(c: Array) -> None:
    found = roots_in_unit(c)
    assert (np.diff(found) >= 0.0).all()
    assert ((found > 0.0) & (found <= 1.0)).all()
    values = power_basis.polyval(SAMPLES, c)
    clear = np.abs(values) > 1e-9 * (np.abs(c).sum() + 1e-300)
    for low, high in zip([0.0, *found], [*found, 1.0], strict=True):
        between = np.logical_and(np.greater(SAMPLES, low), np.less(SAMPLES, high))
        signs = np.sign(values[clear & between])
        assert (signs == signs[:1]).all()


def test_a_double_root_is_answered_where_it_is_or_not_at_all() -> None:
    for root in np.linspace(0.05, 0.95, 19):
        for others in ([], [0.99], [-0.3, 2.0]):
            found = roots_in_unit(from_roots([root, root, *others]))
            places = [root, *(other for other in others if 0.0 < other <= 1.0)]
            assert all(np.abs(np.subtract(places, x)).min() < 1e-6 for x in found)
            assert all(np.abs(found - other).min() < 1e-9 for other in places[1:])


def test_samples_at_a_break_are_of_the_piece_that_begins_there() -> None:
    motion = made(("joint",), [0.0, 1.0, 3.0], [[[0.0, 1.0]], [[10.0, 2.0]]])
    times = np.array([0.0, 1.0, 0.999, 3.0, 1.0, 0.0, 2.0])
    np.testing.assert_allclose(motion.sample(times)[:, 0], [0, 10, 0.999, 14, 10, 0, 12])
    np.testing.assert_allclose(motion.sample(times, 1)[:, 0], [1, 2, 1, 2, 2, 1, 2])
    assert not motion.sample(times, 2).any()


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
        ([], [], "two finite times"),
        ([[0.0, 1.0]], [[0.0]], "two finite times"),
        ([1.0, 0.0], [[0.0]] * 2, "not after the one before"),
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


PERIODS = st.floats(0.01, 3.0)


def ticks(message: dict[str, object]) -> list[int]:
    """Times of all points in whole nanoseconds."""
    points: list[dict[str, dict[str, int]]] = message["points"]  # type: ignore[assignment]
    stamps = [point["time_from_start"] for point in points]
    assert all(0 <= stamp["nanosec"] < 10**9 for stamp in stamps)
    return [stamp["sec"] * 10**9 + stamp["nanosec"] for stamp in stamps]


def column(message: dict[str, object], name: str) -> Array:
    """One quantity of all points, shape (p, n)."""
    points: list[dict[str, object]] = message["points"]  # type: ignore[assignment]
    return np.array([point[name] for point in points])


@given(trajectories(), PERIODS)
def test_points_are_samples_of_the_trajectory(trajectory: Trajectory, period: float) -> None:
    message = joint_trajectory(trajectory, period)
    times = trajectory.uniform_samples(period)
    for order, name in enumerate(("positions", "velocities", "accelerations")):
        told, exact = column(message, name), trajectory.sample(times, order)
        # An end that is at rest to rounding is told to be at rest.
        slow = (
            (order == 1) & (told == 0.0) & (np.abs(exact) <= 1e-7 * trajectory.peaks(1).value.max())
        )
        slow[1:-1] = False
        np.testing.assert_array_equal(told, np.where(slow, 0.0, exact))
    assert message["joint_names"] == list(trajectory.joint_names)
    assert all(point["effort"] == [] for point in message["points"])


@given(trajectories(), PERIODS)
def test_times_are_nanoseconds_that_strictly_increase_to_the_end(
    trajectory: Trajectory, period: float
) -> None:
    found = np.array(ticks(joint_trajectory(trajectory, period)))
    expected = trajectory.uniform_samples(period) * 1e9
    assert found[0] == 0
    assert (np.diff(found) > 0).all()
    assert np.abs(found - expected).max() <= 0.5 + 1e-6


def test_the_message_is_plain_json_with_its_header() -> None:
    message = joint_trajectory(stay(("a", "b"), [0.5, -1.0], 1.0), 0.5, "base_link")
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "base_link"}
    assert json.loads(json.dumps(message, allow_nan=False)) == message
    assert joint_trajectory(stay(("a",), [0.0]), 1.0)["header"]["frame_id"] == ""


@given(trajectories(), PERIODS)
def test_the_table_reads_back_bit_by_bit(trajectory: Trajectory, period: float) -> None:
    rows = list(csv.reader(io.StringIO(csv_text(trajectory, period))))
    times = trajectory.uniform_samples(period)
    values = [trajectory.sample(times, order) for order in range(3)]
    # Ends slower than 1e-7 of the largest speed are at rest.
    for end in (0, -1):
        ends = values[1][end]
        ends[np.abs(ends) <= 1e-7 * trajectory.peaks(1).value.max(initial=0.0)] = 0.0
    expected = np.column_stack([times, *values])
    np.testing.assert_array_equal(np.array(rows[1:], dtype=np.float64), expected)
    kinds = ("position", "velocity", "acceleration")
    assert rows[0] == [
        "time",
        *(f"{kind}.{name}" for kind in kinds for name in trajectory.joint_names),
    ]


def test_names_with_commas_and_quotes_stay_one_column() -> None:
    text = csv_text(stay(('a,"b"', "c\nd"), [0.0, 1.0], 1.0), 0.5)
    rows = list(csv.reader(io.StringIO(text)))
    assert rows[0][1:3] == ['position.a,"b"', "position.c\nd"]
    assert {len(row) for row in rows} == {7}


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf"), 0.4 / MAX_SAMPLES])
def test_periods_that_make_no_table_are_refused(period: float) -> None:
    still = stay(("a",), [0.0], 1.0)
    for export in (joint_trajectory, csv_text):
        with pytest.raises(InvalidOption):
            export(still, period)

"""Grids for jerk-limited motion: where their knots are, and limits against derivatives of time."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from planning.timing.jerk.grid import KnotLimits, derivatives, grid
from planning.timing.jerk.jerk_limited import time_path_with_jerk
from planning.timing.jerk.ruckig import line_phases
from planning.timing.path.blend import blend, largest_reaches
from planning.timing.path.path import JointPath
from planning.timing.speed.effort_limits import effort_rows
from planning.values.limits import EffortLimits
from tests.planning.scenes import HOME, builtin

UR5E_HOME = np.array([-0.6, -1.2, 1.6, -1.97, -1.57, 0.0])


def line(length: float, n: int = 1) -> JointPath:
    return blend(np.stack([np.zeros(n), np.eye(n)[0] * length]), [], smooth=True)


def no_more(path: JointPath, places: Array) -> KnotLimits:
    """Further limits that limit nothing."""
    return KnotLimits(np.full(len(places), np.inf), np.zeros((len(places), 0, 4)))


def limits(v: float, a: float, j: float, n: int = 1) -> Array:
    return np.outer([v, a, j], np.ones(n))


def rounded(seed: int, n: int = 3, count: int = 5) -> JointPath:
    waypoints = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, n))
    return blend(waypoints, largest_reaches(waypoints), smooth=True)


@pytest.mark.parametrize(("name", "start"), [("ur5e", UR5E_HOME), ("panda", HOME)])
@pytest.mark.parametrize("speed", [0.25, 0.5, 0.8])
def test_a_turn_of_the_base_under_a_tool_speed_takes_the_time_that_ruckig_takes(
    name: str, start: Array, speed: float
) -> None:
    """The tip moves on a circle: its speed limits the base's by the radius."""
    chain = builtin(name).chain
    effort = EffortLimits(chain, tool_speed=speed)
    bounds = np.stack([chain.limits.velocity, chain.limits.acceleration, chain.limits.jerk])
    radius = float(np.hypot(*forward(chain, start)[:2, 3]))
    for angle in (0.2, 0.7 + 0.6, 1.7):
        end = start + angle * np.eye(chain.n)[0]
        path = blend(np.stack([start, end]), [], smooth=True)
        timed = time_path_with_jerk(path, chain.joint_names, *bounds, extra=effort_rows(effort))
        along = [min(bounds[0, 0], speed / radius), bounds[1, 0], bounds[2, 0]]
        least = line_phases(angle, along)[:, 4].sum()
        # Between knots a hundredth more may be left: the motion is slowed down for it later.
        assert radius * timed.trajectory.peaks(1).value[0] <= 1.01 * speed
        assert 0.99 * least <= timed.trajectory.duration <= 1.06 * least


def test_no_length_of_a_line_makes_it_slower_than_its_neighbours() -> None:
    """Ramps of two fifths end where the fourth and sixth of ten knots are, but for rounding."""
    bounds = limits(1.0, 1.0, 5.0)
    for length in np.random.default_rng(0).uniform(0.1, 1.5, 40):
        timed = time_path_with_jerk(line(length), ("a",), *bounds, extra=no_more)
        least = line_phases(float(length), bounds[:, 0])[:, 4].sum()
        assert 0.999 * least <= timed.trajectory.duration <= 1.05 * least


@pytest.mark.parametrize("ends", [(0.0, 0.0), (0.3, 0.0), (0.0, 0.3), (0.2, 0.4)])
def test_knots_rise_from_end_to_end_and_take_in_every_break(ends: tuple[float, float]) -> None:
    for seed in range(10):
        path = rounded(seed)
        made = grid(path, limits(1.0, 3.0, 20.0, 3), ends)
        steps = np.diff(made.places)
        assert made.places[0] == 0.0
        assert made.places[-1] == path.breaks[-1]
        assert np.isin(path.breaks, made.places).all()
        assert steps.min() > 1e-7 * path.length
        assert made.rows.lengths.min() == 0.0
        assert (made.rows.lengths[1:-1] > 0.0).all()
        assert made.rows.lengths[[0, -1]].tolist() == [0.0, 0.0]
        middles = 0.5 * (made.places[1:] + made.places[:-1])
        assert (path.breaks[made.pieces] < middles).all()
        assert (middles < path.breaks[made.pieces + 1]).all()


def test_at_rest_the_parameter_leaves_the_end_as_the_cube_of_time() -> None:
    """Where the path is passed at speed, places and parameter are the same."""
    path = line(1.0)
    resting = grid(path, limits(1.0, 1.0, 5.0), extra=no_more)
    passing = grid(path, limits(1.0, 1.0, 5.0), (0.5, 0.5), no_more)
    np.testing.assert_array_equal(passing.speeds, [[1.0], [0.0]] * np.ones_like(passing.places))
    np.testing.assert_allclose(passing.rows.lengths[1:-1], np.diff(passing.places), atol=1e-15)
    assert resting.speeds[0, [0, -1]].tolist() == [0.0, 0.0]
    tau = np.cumsum(resting.rows.lengths)[:-1]
    slope = np.diff(resting.places) / np.diff(tau)
    between = np.stack([resting.speeds[0, 1:], resting.speeds[0, :-1]])
    assert (between.min(axis=0) - 1e-12 <= slope).all()
    assert (slope <= between.max(axis=0) + 1e-12).all()
    # Second derivatives are the slopes of the first.
    bend = np.diff(resting.speeds[0]) / np.diff(tau)
    sides = np.sort(np.stack([resting.speeds[1, 1:], resting.speeds[1, :-1]]), axis=0)
    width = sides[1] - sides[0] + 0.2 * np.abs(sides).max()
    assert (sides[0] - width <= bend).all()
    assert (bend <= sides[1] + width).all()


@pytest.mark.parametrize("seed", range(4))
def test_rows_are_the_derivatives_of_the_motion_as_shares_of_the_limits(seed: int) -> None:
    """With c = dtau/dt squared as a quadratic in tau, by the chain rule at single knots."""
    path, rng = rounded(seed), np.random.default_rng(seed)
    bounds = rng.uniform(0.5, 20.0, (3, 3))
    made = grid(path, bounds, (0.0, 0.4))
    phi1, phi2 = made.speeds
    for i in rng.integers(1, len(made.pieces), 12):
        c, d = rng.uniform(0.1, 2.0), rng.normal()
        # tau' = sqrt(c), tau'' = c' / 2: s'' = phi'' c + phi' c' / 2.
        s1, s2 = phi1[i] * np.sqrt(c), phi2[i] * c + 0.5 * phi1[i] * d
        q1, q2 = (path.sample([made.places[i]], order)[0] for order in (1, 2))
        ratios = (q1 * s2 + q2 * s1**2) / bounds[1]
        used = made.rows.knot_rows[i, : made.rows.knot_counts[i], :2] @ [c, d]
        if made.rows.knot_counts[i] == 3:
            np.testing.assert_allclose(used, ratios, atol=1e-9 * np.abs(ratios).max())
        else:
            # On a straight leg the tightest joint decides for all.
            assert abs(used[0]) == pytest.approx(np.abs(ratios).max(), rel=1e-9)
        speed = np.sqrt(made.rows.caps[i]) * phi1[i] * np.abs(q1) / bounds[0]
        assert speed.max() == pytest.approx(1.0, rel=1e-9)


def test_the_speed_asked_for_at_an_end_caps_it() -> None:
    made = grid(line(1.0), limits(1.0, 1.0, 5.0), (0.25, 0.0))
    assert made.rows.caps[0] == 0.25**2
    assert made.rows.caps[-1] == np.inf
    assert made.rows.pulls[0] > 0.0
    assert made.rows.pulls[1] == 0.0
    assert grid(line(1.0), limits(1.0, 1.0, 5.0), (3.0, 0.0)).rows.caps[0] == 1.0


def test_further_limits_are_added_to_those_of_the_joints() -> None:
    """Caps are lowered, and rows in d2s/dt2 and (ds/dt)^2 turned into rows in c and c'."""

    def more(path: JointPath, places: Array) -> KnotLimits:
        rows = np.tile([2.0, 3.0, -5.0, 7.0], (len(places), 1, 1))
        return KnotLimits(np.full(len(places), 0.04), rows)

    path, bounds = rounded(1), limits(1.0, 3.0, 20.0, 3)
    plain, made = grid(path, bounds), grid(path, bounds, extra=more)
    np.testing.assert_array_equal(plain.places, made.places)
    phi1, phi2 = made.speeds
    with np.errstate(divide="ignore"):
        np.testing.assert_array_equal(made.rows.caps, np.minimum(plain.rows.caps, 0.04 / phi1**2))
    expected = np.stack([2.0 * phi2 + 3.0 * phi1**2, phi1], axis=1)
    np.testing.assert_allclose(made.rows.knot_rows[:, 0, :2], expected, rtol=1e-12)
    assert (made.rows.knot_rows[:, 0, 2:] == [-5.0, 7.0]).all()
    np.testing.assert_array_equal(made.rows.knot_rows[:, 1:], plain.rows.knot_rows)
    np.testing.assert_array_equal(made.rows.knot_counts, plain.rows.knot_counts + 1)


def test_derivatives_of_pieces_are_those_of_numpys_polynomials() -> None:
    rng = np.random.default_rng(2)
    for size in (2, 3, 4, 6):
        c, u = rng.normal(size=(5, 2, size)), rng.uniform(0.0, 1.0, (5, 2))
        for order, values in enumerate(derivatives(c, u), 1):
            for piece in range(5):
                for joint in range(2):
                    exact = np.polynomial.Polynomial(c[piece, joint]).deriv(order)(u[piece])
                    np.testing.assert_allclose(values[piece, :, joint], exact, atol=1e-12)

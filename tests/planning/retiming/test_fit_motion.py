"""Cubics that stand for recorded motions: near at every instant, few, and smooth."""

import numpy as np
import pytest
import scipy

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from planning.retiming.simplify import FittedMotion, fit_motion


def record(seed: int, noise: float) -> tuple[Array, Array]:
    """Times that are not quite even, and a smooth motion with noise of sensors."""
    rng = np.random.default_rng(seed)
    t = np.sort(np.linspace(0.0, 4.0, 500) + rng.uniform(-1e-3, 1e-3, 500))
    a, w, p = rng.uniform([[0.1], [0.5], [0.0]], [[0.5], [4.0], [6.0]], (3, 6))
    return t + 5.0, a * np.sin(np.outer(t, w) + p) + noise * rng.uniform(-1.0, 1.0, (500, 6))


def dense_deviation(found: FittedMotion, t: Array, q: Array) -> float:
    at = np.linspace(0.0, found.trajectory.duration, 20_000)
    line = np.array([np.interp(at, t - t[0], column) for column in q.T]).T
    return float(np.abs(found.trajectory.sample(at) - line).max())


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(("noise", "tolerance"), [(0.0, 1e-3), (5e-4, 2e-3), (0.0, 2e-4)])
def test_the_bound_holds_at_every_instant(seed: int, noise: float, tolerance: float) -> None:
    t, q = record(seed, noise)
    found = fit_motion(t, q, tolerance)
    off = dense_deviation(found, t, q)
    assert off <= found.deviation <= tolerance
    assert off > 0.3 * found.deviation
    motion = found.trajectory
    assert motion.pieces < (100 if tolerance > 2e-4 else 250)
    np.testing.assert_allclose([motion.start, motion.end], q[[0, -1]], atol=1e-12)
    inner = motion.breaks[1:-1]
    for k in range(3):
        before = motion.sample(inner - 1e-9, k)
        np.testing.assert_allclose(before, motion.sample(inner, k), atol=1e-5)


def test_a_motion_from_rest_to_rest_is_proved_for_a_robot() -> None:
    robot = aw.load_robot("ur5e")
    t = np.linspace(0.0, 3.0, 300)
    s = (t / 3.0) ** 3 * (10.0 - 15.0 * t / 3.0 + 6.0 * (t / 3.0) ** 2)
    start = np.array([0.0, -1.4, 1.5, -1.6, -1.5, 0.2])
    q = (start + 0.8 * s[:, None]).round(4)
    found = fit_motion(t, q, 5e-4, robot, rest=True)
    assert found.certificate is not None
    assert found.certificate.verified
    np.testing.assert_allclose(found.trajectory.sample([0.0, 3.0], 1), 0.0, atol=1e-12)
    fast = fit_motion(0.05 * t, q, 5e-4, robot, rest=True).certificate
    assert fast is not None
    assert not fast.verified
    assert fast.violation is not None


def test_what_can_not_be_fitted_is_refused() -> None:
    t, q = record(0, 5e-3)
    with pytest.raises(InvalidOption, match="the nearest is"):
        fit_motion(t, q, 1e-4)
    with pytest.raises(InvalidOption, match="tolerance"):
        fit_motion(t, q, 0.0)
    with pytest.raises(InvalidTrajectory, match="not after"):
        fit_motion(t[::-1], q, 1e-2)
    with pytest.raises(InvalidTrajectory, match="3 samples"):
        fit_motion(t[:3], q[:3], 1e-2)
    with pytest.raises(InvalidTrajectory, match="in its order"):
        fit_motion(t, q, 1e-2, aw.load_robot("ur5e"), joint_names=list("abcdef"))
    with pytest.raises(InvalidTrajectory, match="6 value"):
        fit_motion(t, q, 1e-2, aw.load_robot("panda"))


def test_few_samples_beyond_the_tolerance_are_refused_in_words() -> None:
    for count in range(4, 30):
        samples = np.random.default_rng(count).normal(size=(count, 2))
        with pytest.raises(InvalidOption, match="no motion of cubics was found"):
            fit_motion(np.arange(float(count)), samples, 1e-9)


@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_a_record_is_fitted_where_a_spline_through_its_samples_is_near(
    seed: int, rest: bool
) -> None:
    rng = np.random.default_rng(seed)
    u = np.linspace(0.0, 1.0, 150)
    record = np.outer(u, rng.normal(size=3)) + 0.1 * np.sin(np.outer(u, rng.uniform(5, 30, 3)))
    record = np.round(record + 1e-3 * np.outer(np.cos(np.pi * np.arange(150)), [1, 0, 0]), 4)
    times = 0.01 * np.arange(150)
    through = scipy.interpolate.CubicSpline(times, record, bc_type="clamped" if rest else "natural")
    fine = np.linspace(0.0, times[-1], 30 * 149 + 1)
    even = np.stack([np.interp(fine, times, row) for row in record.T], axis=-1)
    tolerance = 1.1 * float(np.abs(through(fine) - even).max())
    found = aw.fit_motion(times, record, tolerance, rest=rest)
    off = np.abs(found.trajectory.sample(fine) - even).max()
    assert off <= found.deviation <= tolerance
    if rest:
        assert not found.trajectory.sample([0.0, times[-1]], 1).round(9).any()

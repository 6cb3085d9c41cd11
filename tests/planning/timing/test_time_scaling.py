"""Uniform dilation: exact powers, the least factor, ratios of at most 1 in floating point."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory, stay
from planning.timing.time_scaling import dilate, fit, peak_ratios


def random_trajectory(rng: np.random.Generator, n: int) -> Trajectory:
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, 6))])
    names = tuple(f"j{i}" for i in range(n))
    return Trajectory(names, breaks, rng.normal(size=(6, n, 5)) * 10.0 ** rng.uniform(-3, 3))


@pytest.mark.parametrize("seed", range(40))
def test_the_least_factor_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    trajectory = random_trajectory(rng, 4)
    limits = [10.0 ** rng.uniform(-2, 2, 4) for _ in range(3)]
    slow, factor, _ = dilate(trajectory, *limits)
    needed = [
        float((trajectory.peaks(order).value / limit).max()) ** (1.0 / order)
        for order, limit in enumerate(limits, start=1)
    ]
    assert factor == pytest.approx(max(1.0, *needed), rel=1e-11)
    ratios = [peak_ratios(slow, limit, order).max() for order, limit in enumerate(limits, start=1)]
    assert max(ratios) <= 1.0
    fast, speed_up, _ = fit(trajectory, *limits)
    assert speed_up == pytest.approx(max(needed), rel=1e-11)
    ratios = [peak_ratios(fast, limit, order).max() for order, limit in enumerate(limits, start=1)]
    assert 1.0 - 1e-11 < max(ratios) <= 1.0


def test_what_is_inside_its_limits_stays_as_it_is() -> None:
    trajectory = random_trajectory(np.random.default_rng(1), 3)
    same, factor, _ = dilate(trajectory, trajectory.peaks(1).value, np.full(3, np.inf))
    assert factor == 1.0
    assert same is trajectory
    assert dilate(trajectory).factor == 1.0


def test_one_limit_alone_is_enough() -> None:
    trajectory = random_trajectory(np.random.default_rng(2), 2)
    half = trajectory.peaks(2).value / 4.0
    assert dilate(trajectory, acceleration=half).factor == pytest.approx(2.0, rel=1e-11)
    eighth = trajectory.peaks(3).value / 8.0
    assert dilate(trajectory, jerk=eighth).factor == pytest.approx(2.0, rel=1e-11)


@pytest.mark.parametrize(
    "limits", [[1.0], [1.0, 0.0], [1.0, -1.0], [1.0, np.nan], ["a", "b"], [[1.0, 1.0]]]
)
def test_malformed_limits_are_refused(limits: ArrayLike) -> None:
    trajectory = random_trajectory(np.random.default_rng(3), 2)
    for stretch in (dilate, fit):
        with pytest.raises(InvalidOption, match="velocity limits"):
            stretch(trajectory, limits)


def test_no_motion_or_no_limit_has_no_fastest_scaling() -> None:
    trajectory = random_trajectory(np.random.default_rng(4), 2)
    for still, limit in ((stay(["a", "b"], [0.0, 1.0]), 1.0), (trajectory, np.inf)):
        with pytest.raises(InvalidOption, match="no limit bounds"):
            fit(still, np.full(2, limit))

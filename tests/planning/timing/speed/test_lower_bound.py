"""Lower bounds of a motion's time: never above a motion, near the least time, exact on a line."""

from typing import Any

import numpy as np
import pytest

import armwright as aw
from planning.timing.path.blend import blend, largest_reaches
from planning.timing.speed.lower_bound import lower_bound
from planning.timing.speed.minimum_time import time_path
from planning.timing.spline.spline import chord_knots, spline_path
from tests.planning.retiming.test_near_exact_paths import KINDS, METHODS, relative


@pytest.mark.parametrize("method", METHODS, ids=lambda method: "-".join(method.values()) or "usual")
def test_no_motion_is_faster_than_its_bound(method: dict[str, Any]) -> None:
    rng, found = np.random.default_rng(METHODS.index(method)), 0
    for trial in range(40):
        points = relative(rng, KINDS[trial % 5], int(rng.integers(2, 60)))
        n = points.shape[1]
        limits: dict[str, Any] = {
            "velocity": rng.uniform(0.3, 3.0, n),
            "acceleration": rng.uniform(2.0, 15.0, n),
        }
        limits["jerk"] = 10.0 ** rng.uniform(1.0, 4.0) * limits["acceleration"]
        within = 10.0 ** rng.uniform(-4.0, -1.0) if method.get("method") != "spline" else None
        timed = aw.retime(
            points, limits=limits, timing_options=aw.TimingOptions(**method), tolerance=within
        )
        assert timed.lower_bound <= timed.trajectory.duration
        found += timed.lower_bound > 0.5 * timed.trajectory.duration
        # The way counts, not the pace.
        slower = timed.trajectory.dilate(rng.uniform(1.0, 5.0))
        if np.abs(timed.trajectory.sample([0.0, timed.trajectory.duration], 1)).max() < 1e-9:
            again = lower_bound(slower, limits["velocity"], limits["acceleration"])
            assert again == pytest.approx(timed.lower_bound, rel=0.02)
    assert found > 15


@pytest.mark.parametrize("kind", ["corners", "spline"])
def test_the_bound_is_near_the_least_time_of_a_fine_grid(kind: str) -> None:
    rng, gaps = np.random.default_rng(3), []
    for _ in range(30):
        n = int(rng.integers(1, 8))
        points = np.cumsum(rng.normal(size=(int(rng.integers(3, 9)), n)), axis=0)
        if kind == "corners":
            path = blend(points, rng.uniform(0.0, 1.0) * largest_reaches(points))
        else:
            path = spline_path(points, chord_knots(points), "natural")
        v, a = rng.uniform(0.5, 3.0, n), rng.uniform(1.0, 20.0, n)
        names = tuple(f"joint_{i}" for i in range(n))
        motion = time_path(path, names, v, a, resolution=4000).trajectory
        found = lower_bound(motion, v, a)
        assert found <= motion.duration
        gaps.append(motion.duration / found - 1.0)
    assert np.median(gaps) < 0.003
    assert max(gaps) < 0.02


@pytest.mark.parametrize("seed", range(10))
def test_the_bound_of_a_line_is_its_least_time(seed: int) -> None:
    rng = np.random.default_rng(seed)
    way, v, a = rng.uniform(0.01, 5.0), rng.uniform(0.2, 3.0), rng.uniform(0.5, 20.0)
    exact = way / v + v / a if way > v * v / a else 2.0 * np.sqrt(way / a)
    line = np.array([[0.3, 0.0], [0.3 + way, 0.0]])
    for method in ("toppra", "jerk_limited"):
        limits = {name: np.full(2, value) for name, value in (("velocity", v), ("acceleration", a))}
        limits["jerk"] = np.full(2, 50.0 * a)
        options = aw.TimingOptions(method)
        timed = aw.retime(line, limits=limits, timing_options=options)
        assert timed.lower_bound == pytest.approx(exact, rel=1e-3)
        assert timed.lower_bound <= exact
    moving = aw.TimingOptions("toppra", end_velocity=[0.5 * v, 0.0])
    timed = aw.retime(line, limits=limits, timing_options=moving)
    assert timed.lower_bound <= timed.trajectory.duration < 1.001 * timed.lower_bound

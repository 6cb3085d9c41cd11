"""Nearly exact paths, sampled, rounded, jittered or repeated: each is timed by each method."""

from typing import Any

import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array

KINDS = ("arc", "zigzag", "recorded", "line", "steps")
METHODS: tuple[dict[str, Any], ...] = (
    {},
    {"method": "toppra"},
    {"method": "toppra", "solver": "toppra"},
    {"method": "jerk_limited"},
    {"method": "jerk_limited", "solver": "double_s"},
    {"method": "jerk_limited", "solver": "quintic_spline"},
    {"method": "spline"},
)


def relative(rng: np.random.Generator, kind: str, k: int) -> Array:
    """A path of about k waypoints that is nearly one of a kind, shape (k', n)."""
    n, u = int(rng.integers(1, 8)), np.linspace(0.0, 1.0, k)[:, None]
    if rng.random() < 0.3:
        u = np.sort(rng.random((k, 1)), axis=0)
    a, b = rng.normal(size=(2, n))
    if kind == "arc":
        turn = rng.uniform(0.01, 6.3) * u
        points = 10.0 ** rng.uniform(-3.0, 0.3) * (np.cos(turn) * a + np.sin(turn) * b)
    elif kind == "zigzag":
        tooth = np.abs((u * rng.integers(1, min(k, 20) + 1)) % 2 - 1)
        points = u * a + 10.0 ** rng.uniform(-3.0, 0.0) * tooth * b
    elif kind == "recorded":
        points = u * a + 0.2 * np.sin(u * rng.uniform(0.0, 15.0, n) + rng.uniform(0.0, 6.0, n))
    else:
        points = (u if kind == "line" else np.floor(u * rng.integers(1, 9)) / 8) * a
    points = points + rng.uniform(-1.0, 1.0, n)
    if rng.random() < 0.5:
        points += rng.normal(size=points.shape) * 10.0 ** rng.uniform(-16.0, -3.0)
    if rng.random() < 0.6:
        points = points.round(int(rng.integers(1, 17)))
    if rng.random() < 0.3:
        at = rng.integers(0, k, max(k // 5, 1))
        apart = rng.choice([0.0, 1e-15, 1e-13, 1e-12, 1e-11, 1e-9, 1e-6])
        points = np.insert(points, at, points[at] + rng.normal(size=(len(at), n)) * apart, axis=0)
    return np.ascontiguousarray(points)


def timed(rng: np.random.Generator, points: Array, method: dict[str, Any]) -> None:
    """Time a path within limits and tolerances of any size, and check that it is followed."""
    n, tolerances = points.shape[1], dict[str, float]()
    limits = {"velocity": np.full(n, 2.0), "acceleration": np.full(n, 8.0)}
    limits["jerk"] = np.full(n, 8.0 * 10.0 ** rng.uniform(1.0, 2.7))
    if method.get("method") != "spline" and rng.random() < 0.6:
        name = str(rng.choice(["path", "blend"]))
        tolerances[name] = 10.0 ** rng.uniform(-6.0, -1.0)
    options = aw.TimingOptions(**method, blend_tolerance=tolerances.get("blend"))
    found = aw.retime(
        points, limits=limits, timing_options=options, tolerance=tolerances.get("path")
    )
    assert found.certificate.verified
    ends = found.trajectory.sample([0.0, found.trajectory.duration])
    np.testing.assert_allclose(ends, points[[0, -1]], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", METHODS, ids=lambda method: "-".join(method.values()) or "usual")
def test_relatives_of_exact_paths_are_timed(kind: str, method: dict[str, Any]) -> None:
    rng = np.random.default_rng([KINDS.index(kind), METHODS.index(method)])
    for _ in range(20):
        timed(rng, relative(rng, kind, int(rng.integers(2, 120))), method)


@pytest.mark.parametrize("method", METHODS[:4], ids=lambda one: "-".join(one.values()) or "usual")
def test_three_thousand_recorded_waypoints_are_timed(method: dict[str, Any]) -> None:
    rng = np.random.default_rng(5)
    for tolerance in (None, 1e-3):
        u = np.linspace(0.0, 1.0, 3000)[:, None]
        points = u * rng.uniform(-1.0, 1.0, 6) + 0.2 * np.sin(u * rng.uniform(3.0, 9.0, 6))
        limits = {"velocity": np.full(6, 2.0), "acceleration": np.full(6, 8.0)}
        limits["jerk"] = np.full(6, 80.0)
        options = aw.TimingOptions(**method)
        found = aw.retime(
            points.round(4), limits=limits, timing_options=options, tolerance=tolerance
        )
        assert found.certificate.verified
        assert "left out" in found.notes[0] or "smooth curve" in found.notes[0]

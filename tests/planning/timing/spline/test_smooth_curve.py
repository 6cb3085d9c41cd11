"""Smooth curves near paths: within the tolerance at every place, continuous, through the ends."""

import numpy as np
import pytest

from planning.timing.spline.spline import smooth_curve
from tests.planning.timing.path.test_fewest_points import KINDS, recorded
from tests.planning.timing.path.test_simplification import are_near_in_order, dense


@pytest.mark.parametrize("norm", [2.0, np.inf])
@pytest.mark.parametrize("kind", KINDS)
def test_a_curve_keeps_to_the_path_in_its_order(kind: str, norm: float) -> None:
    rng = np.random.default_rng(KINDS.index(kind))
    found_any = False
    for _ in range(4):
        points = recorded(rng, 300, kind)
        tolerance = float(rng.choice([2e-3, 1e-2, 3e-2]))
        found = smooth_curve(points, tolerance, norm)
        if found is None:
            continue
        found_any = True
        curve, bound = found
        assert bound <= tolerance
        length = float(curve.breaks[-1])
        places = curve.sample(np.linspace(0.0, length, 1500).clip(max=length))
        np.testing.assert_allclose(places[[0, -1]], points[[0, -1]], atol=1e-12)
        given = dense(points, 4)
        spacing = sum(
            np.linalg.norm(np.diff(rows, axis=0), axis=1).max() for rows in (given, places)
        )
        # Euclidean distances are this many times those of the joint farthest off at most.
        factor = 1.0 if norm == 2.0 else np.sqrt(points.shape[1])
        assert are_near_in_order(given, places, factor * bound + spacing)
        breaks = curve.breaks[1:-1]
        if len(breaks):
            for order in range(3):
                before = curve.sample(breaks - 1e-9, order)
                after = curve.sample(breaks + 1e-9, order)
                scale = max(1.0, np.abs(curve.sample(breaks, 3)).max())
                np.testing.assert_allclose(before, after, atol=1e-7 * scale)
    # Sharp corners are none of a smooth curve's: straight lines stand for them.
    assert found_any or kind in {"corners", "loop"}


def test_a_curve_through_noise_has_few_pieces() -> None:
    rng = np.random.default_rng(0)
    u = np.linspace(0.0, 1.0, 3000)[:, None]
    exact = u * [1.0, 0.3, -0.4] + 0.2 * np.sin(u * [9.0, 7.0, 5.0])
    found = smooth_curve(exact + rng.normal(0.0, 1e-4, exact.shape), 1e-3, np.inf)
    assert found is not None
    assert len(found[0].lengths) < 100


def test_no_curve_stands_for_a_point() -> None:
    assert smooth_curve(np.zeros((9, 3)), 1e-3, np.inf) is None
    back = np.array([[0.0, 0.0], [1e-4, 0.0], [0.0, 0.0]])
    assert smooth_curve(back, 1e-3, np.inf) is None

"""Compositions of polynomials against numpy's."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from planning.timing.path.path import compose_kernel


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("top", [0, 1, 2, 3])
def test_compositions_are_those_of_numpy(top: int, degree: int) -> None:
    rng = np.random.default_rng(10 * top + degree)
    for _ in range(20):
        # Entries above the degree that is named must not matter.
        outer = rng.normal(size=6)
        inner = rng.normal(size=degree)
        out = np.zeros(top * degree + 1)
        compose_kernel(outer, top, inner, np.empty(top * degree + 1), out)
        composed = Polynomial(outer[: top + 1])(Polynomial([0.0, *inner]))
        expected = np.asarray(composed.coef, dtype=np.float64)
        np.testing.assert_allclose(out[: len(expected)], expected, rtol=1e-12, atol=1e-12)
        assert not out[len(expected) :].any()

"""Three-vectors beside numpy, and exactly: each component is one rounding a step."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compiled.vec3 import Vector, add, cross, dot, load, scale, store, subtract

_numbers = st.floats(-1e6, 1e6, allow_subnormal=False)
_vectors = st.tuples(_numbers, _numbers, _numbers)


@settings(deadline=None)  # the first example compiles
@given(_vectors, _vectors, _numbers)
def test_vectors_are_those_of_numpy(a: Vector, b: Vector, s: float) -> None:
    x, y = np.array(a), np.array(b)
    assert add(a, b) == tuple(x + y)
    assert subtract(a, b) == tuple(x - y)
    assert scale(s, a) == tuple(s * x)
    assert cross(a, b) == tuple(np.cross(x, y))


@settings(deadline=None)  # the first example compiles
@given(_vectors, _vectors)
def test_a_scalar_product_is_right_to_its_rounding(a: Vector, b: Vector) -> None:
    exact = sum(Fraction(x) * Fraction(y) for x, y in zip(a, b, strict=True))
    terms = sum(abs(x * y) for x, y in zip(a, b, strict=True))
    assert abs(dot(a, b) - float(exact)) <= 4 * np.finfo(float).eps * terms + 1e-300


@pytest.mark.parametrize("at", [0, 1, 4])
def test_a_vector_is_written_into_three_columns_and_read_from_them(at: int) -> None:
    row = np.arange(7.0)
    store(row, at, (-1.0, -2.0, -3.0))
    expected = np.arange(7.0)
    expected[at : at + 3] = -1.0, -2.0, -3.0
    np.testing.assert_array_equal(row, expected)
    assert load(row, at) == (-1.0, -2.0, -3.0)

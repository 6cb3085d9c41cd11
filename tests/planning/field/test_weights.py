"""Weights of a field: one for all points or one each, shared among them, in range."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.errors import InvalidOption
from planning.field.weights import MAX_WEIGHT, FieldWeights, positive, share, whole

BOTH = ("attractive_weights", "repulsive_weights")


def weighted(name: str, value: Any) -> FieldWeights:
    return FieldWeights(**{name: value})


def refused(**options: Any) -> InvalidOption:
    with pytest.raises(InvalidOption) as caught:
        FieldWeights(**options)
    return caught.value


@pytest.mark.parametrize("name", BOTH)
def test_one_number_is_the_weight_of_every_point(name: str) -> None:
    weights = weighted(name, 0.7)
    for m in (1, 5):
        each = dict(zip(BOTH, weights.each(m), strict=True))[name]
        np.testing.assert_array_equal(each, np.full(m, 0.7))


@pytest.mark.parametrize("values", [[0.0, 1.0, 2.5], (3, 0, 1)])
def test_one_number_each_keeps_its_place(values: Any) -> None:
    attractive, repulsive = FieldWeights(attractive_weights=values, repulsive_weights=2.0).each(3)
    np.testing.assert_array_equal(attractive, values)
    np.testing.assert_array_equal(repulsive, [2.0, 2.0, 2.0])


def test_arrays_of_weights_can_be_written_to_without_harm() -> None:
    """Kernels are compiled for arrays that can be: each call answers its own."""
    weights = FieldWeights(attractive_weights=[1.0, 2.0])
    weights.each(2)[0][:] = 9.0
    np.testing.assert_array_equal(weights.each(2)[0], [1.0, 2.0])


@pytest.mark.parametrize("name", BOTH)
@pytest.mark.parametrize("m", [1, 2, 4])
def test_as_many_weights_as_points_are_needed(name: str, m: int) -> None:
    with pytest.raises(InvalidOption) as caught:
        weighted(name, [1.0, 1.0, 1.0]).each(m)
    assert caught.value.message == f"{name} has 3 value(s), there are {m} control points"
    assert caught.value.details["control_points"] == m


def test_shares_of_one_number_and_none_of_one_each() -> None:
    weights = FieldWeights(attractive_weights=3.0, repulsive_weights=[1.0, 2.0], attractive_cap=0.4)
    shared = weights.with_share(0.25)
    assert shared.attractive_weights == 0.75
    assert shared.repulsive_weights == [1.0, 2.0]
    assert shared.attractive_cap == 0.4
    assert weights.with_share(1.0) is weights
    assert weights.attractive_weights == 3.0


def test_the_sum_of_shared_weights_is_that_of_one() -> None:
    for m in (1, 3, 11):
        attractive, repulsive = FieldWeights(2.0, repulsive_weights=0.5).with_share(1.0 / m).each(m)
        assert attractive.sum() == pytest.approx(2.0)
        assert repulsive.sum() == pytest.approx(0.5)


@pytest.mark.parametrize("value", [0.0, MAX_WEIGHT])
def test_weights_at_their_ends_are_taken(value: float) -> None:
    attractive, repulsive = FieldWeights(value, repulsive_weights=[value]).each(1)
    assert attractive[0] == repulsive[0] == value


@pytest.mark.parametrize(
    "value", [-1e-9, 1.001 * MAX_WEIGHT, np.nan, np.inf, True, "1", ["1"], [None], [[1.0]], [], {}]
)  # fmt: skip
@pytest.mark.parametrize("name", BOTH)
def test_weights_out_of_range_are_refused_by_name(name: str, value: Any) -> None:
    assert refused(**{name: value}).message.startswith(f"{name} must be a number from 0 to 1e+09")


@pytest.mark.parametrize("name", ["attractive_cap", "influence_distance", "least_distance"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, True, None])
def test_distances_are_positive(name: str, value: Any) -> None:
    assert refused(**{name: value}).message.startswith(f"{name} must be a positive number")


@pytest.mark.parametrize(("least", "taken"), [(0.099, True), (0.1, False), (0.2, False)])
def test_the_least_distance_is_below_the_influence(least: float, taken: bool) -> None:
    if taken:
        assert FieldWeights(least_distance=least, influence_distance=0.1).least_distance == least
    else:
        error = refused(least_distance=least, influence_distance=0.1)
        assert "not below the influence_distance 0.1 m" in error.message
        assert error.hint


def test_every_option_has_a_default_that_is_in_range() -> None:
    defaults = FieldWeights()
    assert FieldWeights(**{f.name: getattr(defaults, f.name) for f in fields(defaults)}).each(2)


@given(st.one_of(st.floats(min_value=5e-324, max_value=1.7e308), st.integers(1, 10**30)))
def test_finite_numbers_above_zero_are_taken(value: float) -> None:
    positive("size", value)


@pytest.mark.parametrize(
    "value",
    [
        0,
        0.0,
        -0.0,
        -1,
        -1e-300,
        float("nan"),
        float("inf"),
        -float("inf"),
        True,
        "1",
        None,
        [1.0],
        1j,
    ],
)
def test_all_else_is_refused_by_name(value: Any) -> None:
    with pytest.raises(InvalidOption) as refused:
        positive("size", value)
    assert refused.value.message == f"size must be a positive number, not {value!r}"


@given(st.integers(-20, 20))
def test_whole_numbers_are_taken_from_least_to_most(value: int) -> None:
    if -3 <= value <= 7:
        whole("count", value, -3, 7)
    else:
        with pytest.raises(InvalidOption, match=f"from -3 to 7, not {value}"):
            whole("count", value, -3, 7)


@pytest.mark.parametrize("value", [True, False, 2.0, 2.5, "2", None, float("nan")])
def test_what_is_not_whole_is_refused(value: Any) -> None:
    with pytest.raises(InvalidOption, match="count must be a whole number"):
        whole("count", value, 0, 7)


@pytest.mark.parametrize("value", [0, 0.0, 1e-9, 0.5, 0.999])
def test_shares_are_taken_from_nothing_to_less_than_all(value: float) -> None:
    share("part", value)


@pytest.mark.parametrize("value", [-1e-9, 1, 1.0, True, None, "0.5", float("nan"), [0.1]])
def test_what_is_no_share_is_refused(value: Any) -> None:
    with pytest.raises(InvalidOption, match="part must be a number from 0 to less than 1"):
        share("part", value)

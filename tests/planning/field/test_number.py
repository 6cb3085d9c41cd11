"""Numbers among options: what counts as one, and which are in range."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.errors import InvalidOption
from planning.field.number import positive, share, whole


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

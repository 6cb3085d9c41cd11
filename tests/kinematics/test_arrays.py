"""Read-only copies: what is copied, what is passed on, and that nobody can write to either."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from kinematics.arrays import frozen


@pytest.mark.parametrize(
    "values",
    [
        [1, 2, 3],
        (0.5, -1.0),
        np.arange(3, dtype=np.int32),
        np.arange(6.0).reshape(2, 3).T,
        np.arange(4.0)[::2],
        np.arange(3.0, dtype=np.float32),
        np.arange(3.0).astype(">f8"),
        2.5,
        [],
    ],
    ids=str,
)
def test_the_copy_has_the_same_values_and_cannot_be_written_to(values: ArrayLike) -> None:
    array = frozen(values)
    np.testing.assert_array_equal(array, np.asarray(values, dtype=np.float64))
    assert array.dtype == np.dtype("=f8")
    assert array.flags.c_contiguous
    assert not array.flags.writeable
    assert array.shape == np.shape(values)


def test_a_frozen_array_is_passed_on_without_a_copy() -> None:
    array = frozen([1.0, 2.0])
    assert frozen(array) is array


def test_later_writes_to_the_original_do_not_reach_the_copy() -> None:
    original = np.array([1.0, 2.0])
    array = frozen(original)
    original[0] = 9.0
    assert array.tolist() == [1.0, 2.0]
    assert original.flags.writeable


def test_a_read_only_view_of_a_writable_array_is_copied() -> None:
    original = np.zeros(3)
    view = original[:]
    view.setflags(write=False)
    array = frozen(view)
    original[1] = 5.0
    assert array.tolist() == [0.0, 0.0, 0.0]


def test_a_read_only_array_in_columns_is_laid_out_by_rows() -> None:
    columns = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    columns.setflags(write=False)
    array = frozen(columns)
    assert array is not columns
    assert array.flags.c_contiguous
    np.testing.assert_array_equal(array, columns)


class Tagged(np.ndarray):
    """An array that could do anything when it is read."""


def test_a_subclass_of_an_array_becomes_an_array() -> None:
    tagged = Tagged((2,))
    tagged[:] = [1.0, 2.0]
    tagged.setflags(write=False)
    assert tagged.base is None
    array = frozen(tagged)
    assert type(array) is np.ndarray
    assert array.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("values", ["one", [[1.0], [1.0, 2.0]], object()])
def test_what_is_no_array_of_numbers_is_refused(values: ArrayLike) -> None:
    with pytest.raises((TypeError, ValueError)):
        frozen(values)

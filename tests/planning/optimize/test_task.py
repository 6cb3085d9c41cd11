"""Ends and tasks of optimised motions."""

from dataclasses import replace

import numpy as np
import pytest

from planning.optimize.task import End
from tests.planning.optimize.motions import PANDA, task
from tests.planning.scenes import HOME

NONE = np.zeros(7)


def test_an_end_at_rest_fixes_position_and_velocity_and_where_smooth_the_acceleration() -> None:
    rough, smooth = End.at_rest(HOME, smooth=False), End.at_rest(HOME, smooth=True)
    assert (rough.order, smooth.order) == (1, 2)
    assert (len(rough.derivatives), len(smooth.derivatives)) == (2, 3)
    for end in (rough, smooth):
        assert end.still
        np.testing.assert_array_equal(end.derivatives[0], HOME)
        assert not np.any(end.derivatives[1:])


@pytest.mark.parametrize(
    ("end", "still"),
    [
        (End(HOME, NONE), True),
        (End(HOME, NONE, NONE), True),
        (End(HOME, 1e-9 * np.eye(7)[3]), False),
        (End(HOME, NONE, 1e-9 * np.eye(7)[3]), False),
    ],
)
def test_only_without_velocity_and_acceleration_an_end_is_still(end: End, still: bool) -> None:
    assert end.still is still


def test_what_is_given_of_an_end_can_not_be_changed_afterwards() -> None:
    velocity, acceleration = np.ones(7), np.ones(7)
    end = End(HOME, velocity, acceleration)
    velocity[0] = acceleration[0] = 5.0
    assert end.velocity[0] == 1.0
    for values in end.derivatives:
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 2.0


def test_limits_are_ordered_by_derivative_and_left_out_where_there_are_none() -> None:
    asked = task()
    assert list(asked.orders) == [1, 2]
    np.testing.assert_array_equal(asked.orders[1], PANDA.limits.velocity)
    np.testing.assert_array_equal(asked.orders[2], PANDA.limits.acceleration)
    jerk = np.full(7, np.inf)
    for values, orders in ((jerk, [2]), (np.where(np.arange(7) == 2, 5.0, jerk), [2, 3])):
        bounds = {"velocity": jerk, "acceleration": np.ones(7), "jerk": values}
        assert list(replace(task(), bounds=bounds).orders) == orders


def test_a_task_is_still_where_both_ends_are() -> None:
    asked, moving = task(), End(HOME, np.ones(7))
    assert asked.still
    assert not replace(asked, start=moving).still
    assert not replace(asked, end=moving).still
    assert asked.chain is PANDA

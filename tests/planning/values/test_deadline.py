"""Deadlines, their parts, and the record of work that time ended."""

import time

import pytest

from planning.values.deadline import Deadline


def test_time_that_remains_ends_nothing() -> None:
    deadline = Deadline.after(60.0)
    assert not deadline.passed
    assert not deadline.sooner_than(1.0)
    assert 59.0 < deadline.remaining <= 60.0
    assert not deadline.interruptions.occurred


def test_a_look_at_a_deadline_that_passed_is_recorded() -> None:
    deadline = Deadline(time.monotonic() - 1.0)
    assert deadline.remaining == 0.0
    assert not deadline.interruptions.occurred  # nobody asked whether to stop
    assert deadline.passed
    assert deadline.interruptions.occurred


def test_too_little_time_is_recorded() -> None:
    deadline = Deadline.after(60.0)
    assert deadline.sooner_than(120.0)
    assert deadline.interruptions.occurred


@pytest.mark.parametrize("seconds", [0.0, -1.0])
def test_a_part_shares_the_record_of_the_whole(seconds: float) -> None:
    whole = Deadline.after(60.0)
    part = whole.within(seconds)
    assert part.passed
    assert whole.interruptions.occurred
    assert not whole.passed


def test_deadlines_are_compared_by_their_moment() -> None:
    one, other = Deadline(5.0), Deadline(5.0)
    one.interruptions.occurred = True
    assert one == other
    assert hash(one) == hash(other)

"""Durations of tasks, and the share of background jobs."""

import pytest

from service.workers.load import BACKGROUND_SHARE, BackgroundShare, Durations


def test_the_mean_follows_what_is_measured() -> None:
    durations = Durations()
    first = durations.mean("plan")
    assert 0.0 < first < 1.0
    durations.note("plan", 3.0)
    assert durations.mean("plan") == 3.0, "the first measurement replaces the guess"
    assert durations.mean("ik") == first
    for _ in range(100):
        durations.note("plan", 1.0)
    assert durations.mean("plan") == pytest.approx(1.0, abs=0.01)


def test_the_spread_follows_what_is_measured() -> None:
    durations = Durations()
    assert durations.spread("plan") == 0.0
    for _ in range(20):
        durations.note("plan", 0.3)
    assert durations.spread("plan") < 1e-15
    for number in range(400):
        durations.note("plan", 0.2 if number % 2 else 0.4)
    assert abs(durations.spread("plan") - 0.1) < 0.01


def test_large_requests_say_little_of_small_ones() -> None:
    durations = Durations()
    for _ in range(50):
        durations.note("task", 8.0, 300_000)
    assert durations.mean("task") == durations.mean("task", 270_000) == 8.0
    # A size that never ran: in proportion to the nearest one that did, and never more than that.
    assert durations.mean("task", 3_000) < 0.2
    assert durations.mean("task", 3_000_000) == 8.0
    durations.note("task", 0.4, 3_000)
    assert durations.mean("task", 2_500) == 0.4
    assert durations.mean("task", 300_000) == 8.0
    assert durations.spread("task", 3_000) == 0.0
    assert 0.4 < durations.mean("task") < 8.0


def test_background_jobs_get_their_share() -> None:
    """Workers that are never idle: what is due is given, and the times add up to the share."""
    share, times = BackgroundShare(), {True: 0.0, False: 0.0}
    for _ in range(5000):
        background = share.is_due
        seconds = 2.0 if background else 0.05
        share.note(seconds, background=background)
        times[background] += seconds
    assert times[True] / sum(times.values()) == pytest.approx(BACKGROUND_SHARE, abs=0.01)


def test_what_is_owed_is_bounded() -> None:
    share = BackgroundShare()
    share.note(1e6, background=True)
    for _ in range(290):
        share.note(1.0, background=False)
        assert not share.is_due
    share.note(20.0, background=False)
    assert share.is_due

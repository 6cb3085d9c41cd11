"""Values of problem documents, read without trust; and when a request is sent again."""

from typing import Any

import pytest

import armwright_client as ours
from armwright_client import errors
from armwright_client.job import EventReader


@pytest.mark.parametrize(
    ("value", "number"),
    [(1, 1.0), (0.5, 0.5), (-2, -2.0), (True, None), (None, None), ("1", None), ([1], None)],
)
def test_a_number_is_a_number(value: object, number: float | None) -> None:
    assert errors.number(value) == number


@pytest.mark.parametrize(
    ("value", "joints"),
    [({"joints": [1, 0.5]}, [1.0, 0.5]), ({"joints": [1], "more": 2}, [1.0]), ({"joints": []}, []),
     ({"joints": [1, None]}, None), ({"joints": [True]}, None), ({"joints": "12"}, None),
     ({}, None), ([1.0], None), (None, None)],
)  # fmt: skip
def test_joints_are_numbers(value: object, joints: list[float] | None) -> None:
    assert errors.joints_of(value) == joints


def failed(**values: Any) -> errors.PlanningFailed:
    return errors.PlanningFailed(ours.Problem(code="PLANNING_FAILED", details=values), 422)


def test_a_failed_plan_tells_what_is_in_the_way() -> None:
    error = failed(
        blocked_by=[{"pair": ["hand", "shelf"], "share": 1}, {"pair": ["hand"], "share": 0.5},
                    {"pair": ["a", "b"], "share": "much"}, "?",
                    {"pair": ["c", "d"], "share": 0.25}],
        would_unblock=["shelf", 3, "post"], reason="limit", fraction=0.5, nearest={"joints": [1]},
    )  # fmt: skip
    assert error.blocked_by == [(("hand", "shelf"), 1.0), (("c", "d"), 0.25)]
    assert error.would_unblock == ["shelf", "post"]
    assert (error.reason, error.fraction, error.nearest) == ("limit", 0.5, [1.0])


@pytest.mark.parametrize("wrong", [None, "text", 3, {"a": 1}, [None]])
def test_what_is_not_there_is_nothing(wrong: object) -> None:
    error = failed(
        blocked_by=wrong, would_unblock=wrong, reason=[wrong], fraction="x", nearest=wrong
    )
    assert (error.blocked_by, error.would_unblock) == ([], [])
    assert (error.reason, error.fraction, error.nearest) == (None, None, None)


def test_an_error_says_what_it_knows() -> None:
    for fields, text in (
        ({"code": "X", "detail": "d", "hint": "h"}, "X: d. h"),
        ({"code": "X", "title": "t"}, "X: t"),
        ({"title": "t"}, "t"),
        ({"detail": "d"}, "d"),
        ({}, "HTTP status 418"),
        ({"code": "X"}, "X: HTTP status 418"),
    ):
        document: dict[str, Any] = fields
        assert str(errors.ApiError(ours.Problem(**document), 418)) == text


# -------------------------------------------------------------------------------- asking again


# ------------------------------------------------------------------------------------- events


def read(*lines: str) -> list[ours.JobEvent]:
    reader = EventReader()
    return [event for line in lines for event in reader.feed(line)]


def test_an_event_is_complete_at_an_empty_line() -> None:
    assert read("data: a") == []
    assert read("data: a", "") == [ours.JobEvent("message", "a")]
    assert read("data: a", "", "") == [ours.JobEvent("message", "a")]
    assert read("event: x", "id: 1", "") == [], "an event without data is none"


def test_lines_of_data_are_joined_and_the_last_name_counts() -> None:
    lines = ("event: a", "event: b", "id: 1", "id: 2", "data: x", "data:y", "data", "")
    assert read(*lines) == [ours.JobEvent("b", "x\ny\n", "2")]


def test_comments_and_unknown_fields_are_passed_over() -> None:
    assert read(": keep-alive", "", "retry: 3", "data: a: b", "") == [
        ours.JobEvent("message", "a: b")
    ]


def test_one_space_after_the_colon_is_not_data() -> None:
    assert read("data:  two", "") == [ours.JobEvent("message", " two")]

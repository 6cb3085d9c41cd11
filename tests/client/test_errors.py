"""Every problem has a class and values that are read without trust; the package exports them."""

import pickle
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from types import ModuleType
from typing import Any

import pytest

import armwright_client
import armwright_client as ours
from armwright_client import errors
from armwright_client.errors import BY_CODE, ApiError, from_problem
from armwright_client.job import EventReader
from armwright_wire.base import Wire
from armwright_wire.errors import ArmwrightError
from armwright_wire.plans.job import Problem
from service.http.errors import KINDS

#: What stands behind models of the same name.
INNER = {"JobAnswer"}
#: The codes that the interface promises.
CONTRACT = [
    "START_STATE_IN_COLLISION",
    "GOAL_IN_COLLISION",
    "START_STATE_INVALID",
    "GOAL_STATE_INVALID",
    "START_STATE_VIOLATES_PATH_CONSTRAINTS",
    "GOAL_VIOLATES_PATH_CONSTRAINTS",
    "NO_IK_SOLUTION",
    "PLANNING_FAILED",
    "INVALID_MOTION_PLAN",
    "TIMED_OUT",
    "PREEMPTED",
    "INVALID_GROUP_NAME",
    "INVALID_LINK_NAME",
    "INVALID_OBJECT_NAME",
    "INVALID_GOAL_CONSTRAINTS",
    "INVALID_ROBOT_STATE",
    "UNRECOGNIZED_GOAL_TYPE",
    "CRASH",
    "INVALID_ROBOT_DESCRIPTION",
    "INVALID_SCENE",
    "MISSING_LIMIT",
    "PAYLOAD_TOO_LARGE",
    "OVERLOADED",
    "UNAUTHENTICATED",
    "NOT_FOUND",
    "CONFLICT",
    "VALIDATION_ERROR",
]


def classes() -> list[type[ArmwrightError]]:
    found = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    return [kind for kind in found if issubclass(kind, ArmwrightError)]


def modules() -> list[ModuleType]:
    found = walk_packages(armwright_client.__path__, "armwright_client.")
    return [import_module(module.name) for module in found]


@pytest.mark.parametrize("code", sorted({*CONTRACT, *KINDS}))
def test_every_code_has_a_class_of_its_own(code: str) -> None:
    error = from_problem(Problem(code=code, detail="so it is", hint="Try this."), 422)
    assert type(error) is BY_CODE[code] is not ApiError
    assert error.code == code
    assert str(error) == f"{code}: so it is. Try this."


def test_no_two_classes_share_a_code() -> None:
    codes = [kind.code for kind in classes() if issubclass(kind, ApiError) and kind.code]
    assert sorted(codes) == sorted(set(codes)) == sorted(BY_CODE)


def test_an_unknown_code_is_an_api_error() -> None:
    error = from_problem(Problem(code="FROM_THE_FUTURE"), 418)
    assert type(error) is ApiError
    assert (error.problem.code, error.status) == ("FROM_THE_FUTURE", 418)
    assert str(error) == "FROM_THE_FUTURE: HTTP status 418"


def test_values_of_a_problem_can_be_read() -> None:
    details = {"pair": ["hand", "shelf"], "depth": 0.012}
    collision = from_problem(Problem(code="GOAL_IN_COLLISION", details=details), 422)
    assert isinstance(collision, errors.InCollision)
    assert (collision.pair, collision.depth) == (("hand", "shelf"), 0.012)
    details = {"joint": "elbow", "value": 4.0, "limit": 3}
    outside = from_problem(Problem(code="START_STATE_INVALID", details=details), 422)
    assert isinstance(outside, errors.OutsideLimits)
    assert (outside.joint, outside.value, outside.limit) == ("elbow", 4.0, 3.0)


@pytest.mark.parametrize("details", [{}, {"pair": "hand", "depth": "deep", "joint": 3}])
def test_values_that_are_not_there_are_none(details: dict[str, object]) -> None:
    collision = errors.GoalInCollision(Problem(details=details), 422)
    outside = errors.GoalStateInvalid(Problem(details=details), 422)
    assert (collision.pair, collision.depth) == (None, None)
    assert (outside.joint, outside.value, outside.limit) == (None, None, None)


def test_errors_survive_the_way_between_processes() -> None:
    for error in (
        errors.Overloaded(Problem(code="OVERLOADED", detail="later"), 429, 2.0),
        errors.UnexpectedAnswer("GET /healthz was answered 502", 502, "<html>"),
        errors.InvalidArgument("no", hint="Yes."),
    ):
        twin = pickle.loads(pickle.dumps(error))
        assert type(twin) is type(error)
        assert str(twin) == str(error)


def test_every_error_stands_below_the_base_and_in_the_documented_tree() -> None:
    tree = errors.__doc__ or ""
    for kind in classes():
        assert issubclass(kind, ArmwrightError)
        single = issubclass(kind, ApiError) and kind.__base__ is ApiError and kind.code
        assert single or kind.__name__ in tree, kind
        assert kind.__doc__


def test_every_error_and_every_model_is_exported() -> None:
    for kind in classes():
        assert getattr(armwright_client, kind.__name__) is kind
    for module in modules():
        for name, value in vars(module).items():
            if isinstance(value, type) and issubclass(value, Wire) and name == value.__name__:
                exported = value in vars(armwright_client).values()
                assert exported or name in INNER, name


def test_the_package_is_typed() -> None:
    assert (Path(armwright_client.__path__[0]) / "py.typed").is_file()


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

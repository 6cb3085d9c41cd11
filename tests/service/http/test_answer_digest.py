"""Digests of answers: measured times do not count, everything else does."""

import json
from typing import Any

import pytest

from service.http.keeping import answer_digest, differences

ANSWER: dict[str, Any] = {
    "planner": "rrt",
    "stages": [{"name": "rrt", "milliseconds": 3.25}],
    "path": {"joints": [[0.1, -0.0], [1e-300, 2.0]]},
}


def content(**changes: Any) -> bytes:
    return json.dumps(ANSWER | changes).encode()


def test_measured_times_do_not_count() -> None:
    slower = content(stages=[{"name": "rrt", "milliseconds": 99.0}], plan_id="x")
    assert answer_digest(slower) == answer_digest(content())
    assert differences(content(), slower, 10) == []


@pytest.mark.parametrize(
    ("changes", "pointer"),
    [
        ({"planner": "prm"}, "/planner"),
        ({"stages": []}, "/stages"),
        ({"path": {"joints": [[0.1, -0.0], [1.0000000000000002e-300, 2.0]]}}, "/path/joints/1/0"),
        ({"a/b~": 1}, "/a~1b~0"),
    ],
)
def test_any_other_value_counts(changes: dict[str, Any], pointer: str) -> None:
    assert answer_digest(content(**changes)) != answer_digest(content())
    assert differences(content(), content(**changes), 10) == [pointer]


def test_no_more_differences_are_named_than_asked_for() -> None:
    assert differences(b'{"a":[1,2,3]}', b'{"a":[4,5,6]}', 2) == ["/a/0", "/a/1"]

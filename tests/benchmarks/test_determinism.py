"""The judging of answers that ought to be one."""

from typing import Any

import pytest

from benchmarks.determinism import Told, differences, faults, read_answer


def plan(duration: float, *, deterministic: bool = True, milliseconds: float = 1.0) -> Any:
    return {
        "status": "success",
        "stages": [{"name": "shortcut", "milliseconds": milliseconds, "detail": "in 12 ms"}],
        "trajectory": {"duration": duration},
        "reproducibility": {"deterministic": deterministic},
    }


def problem(code: str, **details: Any) -> Any:
    return {"status": 422, "code": code, "detail": "none", "details": details}


def of_a_job(content: Any, number: int) -> Any:
    ended = {"id": str(number), "created": number, "expires": number, "error": None}
    return ended | {"status": "succeeded", "result": content}


def judged(*contents: Any) -> str | None:
    return faults([read_answer(content) for content in contents])


def test_times_and_names_of_jobs_are_no_differences() -> None:
    assert judged(plan(1.0), plan(1.0, milliseconds=2.0)) is None
    assert judged(of_a_job(plan(1.0), 1), of_a_job(plan(1.0), 2)) is None
    assert read_answer(plan(1.0)) == read_answer(plan(1.0, milliseconds=2.0))


def test_a_difference_that_nobody_tells_is_a_fault() -> None:
    assert judged(plan(1.0), plan(1.0 + 1e-15)) == "2 answers that do not say so"
    assert judged(plan(1.0), problem("PLANNING_FAILED")) is not None
    assert judged(of_a_job(plan(1.0), 1), of_a_job(plan(2.0), 2)) is not None
    assert judged(problem("NO_IK_SOLUTION", starts=3), problem("NO_IK_SOLUTION", starts=4))


def test_what_says_that_time_ended_it_may_be_any_answer() -> None:
    assert judged(plan(1.0), plan(2.0, deterministic=False), problem("TIMED_OUT")) is None
    assert judged(problem("NO_IK_SOLUTION", deterministic=False), plan(1.0)) is None
    # One of the two says nothing: the other one is its excuse, but a third is none.
    assert judged(plan(1.0), plan(2.0, deterministic=False), plan(3.0)) is not None


@pytest.mark.parametrize("number", [0, 1])
def test_where_answers_differ_is_told(number: int) -> None:
    found: list[Told] = [
        read_answer(plan(1.0)),
        read_answer(plan(2.0)),
        read_answer(plan(3.0, deterministic=False)),
    ]
    assert list(differences(found[number:])) == (
        [".trajectory.duration: 1.0 or 2.0"] if number == 0 else []
    )

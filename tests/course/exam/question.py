"""A question of the exam: a request, the number that it must answer, and the verdict."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Literal, NamedTuple

import httpx
import numpy as np

#: Rounding of a few hundred operations on numbers of the size of one.
ROUNDING = 1e-8
#: Codes of refusals by which the service says that it does not know what is asked.
NO_DOOR = {"VALIDATION_ERROR", "NOT_FOUND"}
Verdict = Literal["right", "wrong", "no door"]


class Question(NamedTuple):
    """A request and its answer by independent code.

    Args:
        lecture: Of the notes, where the method is taught.
        kind: Kind of question, the same for those that differ by arm and numbers.
        path: Endpoint below /v1/; with `{}` for the name of the robot, as in the body.
        body: The request, arrays as they are; none for a GET.
        pick: Names the field that is asked for, with dots, or takes it from the answer; from the
            problem where `refused` is set.
        expected: What is right, or computes it.
        robot: Table of the robot, as `POST /v1/robots` takes it without the name.
        tolerance: Largest absolute difference.
        compare: Says how an answer differs, nothing where it does not; by numbers, or by equality
            of words and truths, if left out.
        refused: Whether a refusal is right.
        issue: Point of issue 37 that the question stands for, 0 for none.
    """

    lecture: int
    kind: str
    path: str
    body: dict[str, Any] | None
    pick: str | Callable[[Any], Any]
    expected: Any
    robot: dict[str, Any] | None = None
    tolerance: float = ROUNDING
    compare: Callable[[Any, Any, float], str | None] | None = None
    refused: bool = False
    issue: int = 0


def split(more: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Fields of a question by which it is judged, and those of its request."""
    judged = {key: more[key] for key in more if key in Question._fields[-4:]}
    return judged, {key: more[key] for key in more if key not in judged}


class At(NamedTuple):
    """A robot in a configuration, to be asked about.

    Args:
        robot: Its table.
        q: The configuration.
    """

    robot: dict[str, Any]
    q: Any

    def __call__(
        self, lecture: int, kind: str, door: str, pick: Any, expected: Any, /, **more: Any
    ) -> Question:
        """A question; what is no field of one is a field of the request."""
        judged, body = split(more)
        path, body = f"robots/{{}}/{door}", {"joints": self.q} | body
        return Question(lecture, kind, path, body, pick, expected, self.robot, **judged)


class Result(NamedTuple):
    """A question with its verdict.

    Args:
        question: What was asked.
        path: Path that was asked.
        body: The request.
        expected: What is right.
        seconds: From request to answer.
        verdict: Right, wrong, or no door.
        answer: What was picked, or the problem.
        reason: How they differ.
    """

    question: Question
    path: str
    body: Any
    expected: Any
    seconds: float
    verdict: Verdict
    answer: Any
    reason: str


def close(answer: Any, expected: Any, tolerance: float) -> str | None:
    """Differences of numbers, or of words and truths."""
    if isinstance(expected, str | bool):
        return None if answer == expected else f"{answer!r} for {expected!r}"
    found, right = np.asarray(answer, dtype=float), np.asarray(expected, dtype=float)
    if found.shape != right.shape:
        return f"shape {found.shape} for {right.shape}"
    difference = float(np.abs(found - right).max(initial=0.0))
    return None if difference <= tolerance else f"differs by {difference:.3g}"


def holds(answer: Any, expected: Any, _tolerance: float) -> str | None:
    """Whether a word is said."""
    return None if expected in str(answer) else f"no {expected!r} in {answer!r}"


def plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def field(answer: Any, path: str) -> Any:
    """A field of a field of an answer."""
    for name in path.split("."):
        answer = answer[int(name) if name.lstrip("-").isdigit() else name]
    return answer


class Exam:
    """A sitting of the exam at a service.

    Args:
        client: Of the service.
    """

    def __init__(self, client: httpx.Client) -> None:
        self._client = client
        self._names: dict[str, str] = {}

    def ask(self, question: Question) -> Result:
        """Ask a question and judge the answer."""
        name, right = self._stored(question.robot), question.expected
        path, body = "/v1/" + question.path.format(name), plain(question.body)
        if body and body.get("robot") == "{}":
            body["robot"] = name
        start = time.perf_counter()
        response = self._client.get(path) if body is None else self._client.post(path, json=body)
        seconds = time.perf_counter() - start
        answer, expected = response.json(), right() if callable(right) else right
        judged = partial(Result, question, path, body, expected, seconds)
        code, is_unknown = answer.get("code"), "unknown field" in answer.get("detail", "")
        if (response.status_code != 200) != question.refused or is_unknown:
            has_door = (question.refused and not is_unknown) or code not in NO_DOOR
            reason = f"{response.status_code} {code}"
            return judged("wrong" if has_door else "no door", answer, reason)
        pick = question.pick
        try:
            found = field(answer, pick) if isinstance(pick, str) else pick(answer)
        except (KeyError, IndexError, TypeError) as error:
            return judged("no door", answer, f"not answered: {error!r}")
        difference = (question.compare or close)(found, expected, question.tolerance)
        return judged("wrong" if difference else "right", found, difference or "")

    def _stored(self, robot: dict[str, Any] | None) -> str:
        """Name of a robot, which is stored first."""
        if robot is None:
            return ""
        robot = plain(robot)
        key = repr(robot)
        if key not in self._names:
            name = f"exam_{len(self._names)}"
            stored = self._client.post("/v1/robots", json={"name": name, **robot})
            if stored.status_code != 201:
                raise AssertionError(stored.text)
            self._names[key] = name
        return self._names[key]


def table(results: list[Result]) -> str:
    """A table by lecture: questions, right, wrong, no door, median and longest time."""
    lines = [
        "| lecture | questions | right | wrong | no door | median [ms] | most [ms] |",
        "|---|---|---|---|---|---|---|",
    ]
    for lecture in [*sorted({one.question.lecture for one in results}), 0]:
        rows = [one for one in results if lecture in (0, one.question.lecture)]
        counts = [
            sum(one.verdict == word for one in rows) for word in ("right", "wrong", "no door")
        ]
        times = [1e3 * one.seconds for one in rows]
        cells = [
            lecture or "all",
            len(rows),
            *counts,
            f"{np.median(times):.1f}",
            f"{max(times):.0f}",
        ]
        lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    return "\n".join(lines)


def spread(questions: list[Question], each: int) -> list[Question]:
    """The first few of every kind."""
    kinds: dict[tuple[int, str], list[Question]] = {}
    for one in questions:
        kinds.setdefault((one.lecture, one.kind), []).append(one)
    return [one for group in kinds.values() for one in group[:each]]

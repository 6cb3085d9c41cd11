"""An exam of the course notes at a service: questions on other arms and numbers, judged by lecture.

Run it with `python -m benchmarks.server.course_exam`: the application runs in this process, and is
asked over HTTP. `--url` names a server that runs. Answers are those of `tests/course/exam`, which
imports nothing of the product. Questions that are wrong, or have no door, are listed with request,
answer and what is right.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.course.exam.paper import paper
from tests.course.exam.question import Exam, Result, plain, spread, table
from tests.course.in_process import service_in_process


@contextmanager
def client_of(url: str | None) -> Iterator[httpx.Client]:
    """A client of a server that runs, or of one in this process."""
    if url:
        with httpx.Client(base_url=url, timeout=60.0) as client:
            yield client
        return
    with tempfile.TemporaryDirectory() as folder, service_in_process(Path(folder)) as client:
        yield client


def short(value: Any, most: int = 600) -> str:
    """A value as JSON on one line, cut off where it is long."""
    text = json.dumps(plain(value), ensure_ascii=False)
    return text if len(text) <= most else text[:most] + " …"


def failures(results: list[Result]) -> str:
    """Questions that are not answered right, by kind; the first of each in full."""
    kinds: dict[tuple[int, str, str], list[Result]] = {}
    for one in results:
        if one.verdict != "right":
            kinds.setdefault((one.question.issue, one.question.kind, one.verdict), []).append(one)
    lines = []
    for (point, kind, verdict), ones in sorted(kinds.items()):
        total = sum(one.question.kind == kind for one in results)
        first = ones[0]
        where = f"lecture {first.question.lecture}, issue 37.{point}"
        method = "GET" if first.body is None else "POST"
        lines += [
            f"### {kind}: {verdict} ({len(ones)} of {total}; {where})",
            *(f"- {one.reason}" for one in ones[:6]),
            f"- request: `{method} {first.path}` `{short(first.body, 1500)}`",
            f"- table: `{short(first.question.robot, 900)}`",
            f"- answer: `{short(first.answer)}`",
            f"- right: `{short(first.expected)}`",
            "",
        ]
    return "\n".join(lines)


def main() -> None:
    """Sit the exam, and print the table and what is not right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--url", help="of a server that runs; one in this process if left out")
    parser.add_argument("--seed", type=int, default=37, help="of the numbers and arms")
    parser.add_argument("--each", type=int, default=99, help="questions of each kind at most")
    parser.add_argument("--only", default="", help="part of the kinds that are asked")
    options = parser.parse_args()
    asked = [one for one in spread(paper(options.seed), options.each) if options.only in one.kind]
    with client_of(options.url) as client:
        exam = Exam(client)
        results = [exam.ask(one) for one in asked]
    print(table(results))
    print()
    print(failures(results))


if __name__ == "__main__":
    main()

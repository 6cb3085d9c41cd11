"""Pages with requests: each is sent, and the answer must contain what is printed."""

import json
import re
from pathlib import Path
from typing import Any

import httpx
import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs/course").glob("[0-9]*.md"))
#: Pages beside the course that have requests and answers.
OTHERS = [
    ROOT / "docs" / f"{name}.md"
    for name in (
        "dynamics",
        "exports",
        "kinematics",
        "reach",
        "robots",
        "tasks",
        "smooth_motions",
        "tool_paths",
        "tours",
        "tracking",
    )
]
#: A request block and the first answer block after it.
PAIR = re.compile(
    r"```http\n(GET|POST) (\S+)\n(.*?)```\n(?:(?!```).)*```(json|xml)\n(.*?)```", re.DOTALL
)
#: Printed numbers are rounded to four decimals.
HALF_DIGIT = 5.001e-5
#: The last item of a list that is not printed in full.
REST = "..."
ARM = "course_arm"


def contains(answer: Any, printed: Any, place: str = "answer") -> None:
    """Fail where an answer lacks what a page prints of it."""
    if isinstance(printed, dict):
        for key, value in printed.items():
            assert key in answer, f"{place}.{key}"
            contains(answer[key], value, f"{place}.{key}")
    elif isinstance(printed, list):
        if printed and printed[-1] == REST:
            printed = printed[:-1]
            assert len(answer) > len(printed), place
        else:
            assert len(answer) == len(printed), place
        for i, value in enumerate(printed):
            contains(answer[i], value, f"{place}[{i}]")
    elif isinstance(printed, float):
        assert answer == pytest.approx(printed, abs=HALF_DIGIT), place
    else:
        assert answer == printed, place


def pairs(page: Path) -> list[tuple[str, str, str, str, str]]:
    """Method, path, body, form of the answer and its printed part, of every request of a page."""
    found: list[tuple[str, str, str, str, str]] = PAIR.findall(page.read_text("utf-8"))
    return found


def arm_request() -> str:
    """The request of the page about tables that stores the arm of all later pages."""
    (body,) = (
        body for page in PAGES for _, path, body, *_ in pairs(page)
        if path == "/v1/robots" and ARM in body
    )  # fmt: skip
    return body


def send(service: httpx.Client, method: str, path: str, body: str) -> httpx.Response:
    headers = {"Content-Type": "application/json"}
    return service.request(method, path, content=body.encode(), headers=headers)


@pytest.mark.parametrize("page", [*PAGES, *OTHERS], ids=lambda page: page.stem)
def test_answers_are_as_printed(service: httpx.Client, page: Path) -> None:
    service.delete(f"/v1/robots/{ARM}")
    if not any(path == "/v1/robots" for _, path, *_ in pairs(page)):
        assert send(service, "POST", "/v1/robots", arm_request()).status_code == 201
    assert pairs(page)
    assert len(pairs(page)) == page.read_text("utf-8").count("```http")
    for method, path, body, form, printed in pairs(page):
        response = send(service, method, path, body)
        if form == "xml":
            assert all(line.strip() in response.text for line in printed.splitlines()), path
            continue
        excerpt = json.loads(printed)
        assert response.is_error == ("code" in excerpt), response.text
        contains(response.json(), excerpt)


def test_a_wrong_digit_is_noticed() -> None:
    contains({"a": [0.12341, 2.0]}, {"a": [0.1234, REST]})
    with pytest.raises(AssertionError, match=r"answer\.a\[0\]"):
        contains({"a": [0.1236]}, {"a": [0.1234]})
    with pytest.raises(AssertionError, match=r"answer\.a"):
        contains({"a": [0.1234, 1.0]}, {"a": [0.1234]})


def test_the_index_lists_every_page() -> None:
    index = (ROOT / "docs/course/README.md").read_text("utf-8")
    assert len(PAGES) >= 9
    for page in PAGES:
        assert f"({page.name})" in index, page.name

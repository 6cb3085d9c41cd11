"""The documents: code that runs, links that lead somewhere, an index that is complete."""

import re
from pathlib import Path
from typing import Any

import pytest

from planning.values.deadline import Deadline

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
#: Words of a page at most.
LONGEST = 1_500
#: Pages of tables, whose rows don't count, beside those of benchmarks and of the reference.
TABLES = {"examples.md"}
#: The page of all objects, in which fields are looked up.
LOOKED_UP = "http_objects.md"
STATUS = re.compile(
    r"^Status: (accepted|superseded|withdrawn|proposed)[^.]*(\(.*\)[^.]*)*\. "
    r"Date: \d{4}-\d\d-\d\d\.$"
)


#: Pages without a code block, with the reason.
WITHOUT_CODE = {
    "docs/README.md": "a list of the pages",
    "docs/glossary.md": "words and what they mean",
    "docs/decisions": "why things are as they are; the code is the rest of the repository",
    "docs/reference": "made by scripts/reference.py: tables, and requests with their answers",
}
#: Deadlines of blocks are so many times as long here: other work on the machine fails no page.
PATIENCE = 20.0
#: A Python block, and what it prints where the page says so.
BLOCK = re.compile(r"```python\n(.*?)```(?:\s*prints\s*```\n(.*?)```)?", re.DOTALL)


def blocks() -> list[Any]:
    """Python code blocks of the pages below ``docs``, in their order, with what they print."""
    return [
        pytest.param(*block, id=f"{page.stem}-{i}")
        for page in PAGES
        if page.parent != ROOT
        for i, block in enumerate(BLOCK.findall(page.read_text("utf-8")))
    ]


def has_a_reason(page: Path) -> bool:
    """Whether a page may be without code."""
    name = str(page.relative_to(ROOT))
    return any(name == path or name.startswith(f"{path}/") for path in WITHOUT_CODE)


def test_every_page_shows_its_subject_in_code() -> None:
    pages = [page for page in PAGES if page.parent != ROOT]
    without = [
        page for page in pages if not re.search(r"^ *```\w", page.read_text("utf-8"), re.MULTILINE)
    ]
    assert [page.name for page in without if not has_a_reason(page)] == []
    assert all((ROOT / path).exists() for path in WITHOUT_CODE)


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Deadlines that a busy machine keeps too."""
    after = Deadline.after
    monkeypatch.setattr(Deadline, "after", lambda seconds: after(PATIENCE * seconds))


@pytest.mark.usefixtures("patience")
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("code", "printed"), blocks())
def test_code_runs_as_it_stands(
    code: str, printed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    exec(compile(code, "docs", "exec"), {"__name__": "docs"})
    assert printed, "the page does not say what this prints"
    assert capsys.readouterr().out == printed


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]*(?:#[^)\s]*)?)\)", text):
        if "://" in target:
            continue
        path, _, heading = target.partition("#")
        file = page if not path else (page.parent / path).resolve()
        assert file.exists(), f"{page.name}: {target}"
        if heading and file.suffix == ".md":
            assert heading in headings(file), f"{page.name}: {target}"


def headings(page: Path) -> set[str]:
    """Anchors of a page's headings, as they are made for Markdown on the web."""
    lines = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}


def test_every_page_is_in_the_index() -> None:
    index = (ROOT / "docs/README.md").read_text("utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert page.name == "README.md" or f"({page.name})" in index, page.name


@pytest.mark.parametrize("page", sorted((ROOT / "docs").rglob("*.md")), ids=lambda page: page.stem)
def test_pages_stay_short(page: Path) -> None:
    text = page.read_text("utf-8")
    if page.parent.name == "reference" or page.name in TABLES or page.name.startswith("benchmarks"):
        text = re.sub(r"```.*?```|^\|.*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    assert len(text.split()) <= LONGEST or page.name == LOOKED_UP, page.name


def test_every_decision_is_listed_with_status_and_date() -> None:
    index = (ROOT / "docs/decisions/README.md").read_text("utf-8")
    for page in (ROOT / "docs/decisions").glob("0*.md"):
        lines = page.read_text("utf-8").splitlines()
        title = lines[0].removeprefix("# ").partition(". ")[2]
        assert f"[{title}]({page.name})" in index, page.name
        assert STATUS.match(lines[2]), f"{page.name}: {lines[2]}"


def test_the_walk_of_a_request_names_each_file_once() -> None:
    page = (ROOT / "docs/architecture.md").read_text("utf-8")
    steps = re.findall(r"^\| (\d+) \| `([^`]+)` \|", page, re.MULTILINE)
    files = [file for _, file in steps]
    assert [int(number) for number, _ in steps] == list(range(1, len(steps) + 1))
    assert len(set(files)) == len(files)
    for file in files:
        assert (ROOT / file).is_file(), file


def test_the_picture_of_the_walk_names_files_that_are_there() -> None:
    picture = (ROOT / "docs/pictures/plan_walk.svg").read_text("utf-8")
    entries = re.findall(r'class="(\w?)"[^>]*>([^<]+)<|>(\d+)\. ([^<]+\.py)<', picture)
    folder = ""
    named: list[list[str]] = []
    for kind, text, _, file in entries:
        if kind == "f":
            folder = text
        elif kind == "t":
            named.append([])
        elif file:
            named[-1].append(f"{folder}/{file}")
    assert len(named) == 2
    for files in named:
        assert len(files) == len(set(files)) > 20
        assert [file for file in files if not (ROOT / file).is_file()] == []

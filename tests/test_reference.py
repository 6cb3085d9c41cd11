"""Reference pages: as the code makes them, with every setting, problem, metric and operation."""

from pathlib import Path

import pytest

from scripts.reference import FOLDER, pages, stale
from service.http.errors import KINDS
from service.settings import Settings


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    with pytest.MonkeyPatch.context() as patch:
        for name in Settings.model_fields:
            patch.delenv(f"ARMWRIGHT_{name.upper()}", raising=False)
        return pages()


def test_no_page_is_stale(made: dict[str, str]) -> None:
    assert stale(made) == [], "run python scripts/reference.py"


def test_a_changed_page_and_one_that_nothing_makes_are_noticed(
    made: dict[str, str], tmp_path: Path
) -> None:
    for path in FOLDER.glob("*.md"):
        (tmp_path / path.name).write_text(path.read_text("utf-8"), "utf-8")
    (tmp_path / "metrics.md").write_text("# Metrics\n", "utf-8")
    (tmp_path / "gone.md").write_text("# Gone\n", "utf-8")
    assert stale(made, tmp_path) == ["gone.md", "metrics.md"]


def test_everything_has_its_line(made: dict[str, str]) -> None:
    assert all(
        f"`ARMWRIGHT_{name.upper()}`" in made["settings.md"] for name in Settings.model_fields
    )
    assert all(f"`{code}`" in made["problems.md"] for code in KINDS)
    assert "`armwright_jobs`" in made["metrics.md"]
    assert "`POST /v1/plan`" in made["http_planning.md"]
    assert all(page.endswith("\n") for page in made.values())


def test_every_problem_has_a_hint() -> None:
    assert all(kind.hint.endswith(".") for kind in KINDS.values())

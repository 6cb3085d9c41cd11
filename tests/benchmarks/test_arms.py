"""The table of arms: every upload is there, and rows become lines of the page."""

from pathlib import Path

import pytest

from benchmarks import arms
from benchmarks.problems.example_arms import package
from kinematics.tree.chain_ends import likely_tip
from kinematics.urdf.urdf import parse_urdf

ROW = ["UR3", "6", "`tool0`", "38,937", "2.6 s", "70%", "6 of 6", "0.01, 0.40 s", "30 of 30", "0"]


def test_a_row_is_a_line_of_markdown() -> None:
    head, rule, line = arms.table(arms.COLUMNS, [ROW]).splitlines()
    assert head.count("|") == rule.count("|") == line.count("|")
    assert "| 38,937 | 2.6 s | 70% | 6 of 6 | 0.01, 0.40 s | 30 of 30 | 0 |" in line


def test_the_page_is_rewritten_between_its_marks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    marks = [arms.BEGIN.format("arms"), "old", arms.END.format("arms"), "between"]
    marks += [arms.BEGIN.format("suspected"), "old", arms.END.format("suspected")]
    page.write_text("\n".join(["before", *marks, "after\n"]))
    monkeypatch.setattr(arms, "measure", lambda _: ROW)
    monkeypatch.setattr("sys.argv", ["arms", "--arms", "UR3", "--write", str(page)])
    arms.main()
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "between" in text
    assert "old" not in text
    assert "| UR3 | 6 |" in text


@pytest.mark.parametrize("name", arms.UPLOADS)
def test_tips_are_what_an_upload_chooses_or_a_refusal_names(name: str) -> None:
    urdf, tip = arms.UPLOADS[name]
    description = parse_urdf((package() / urdf).read_text())
    choice = likely_tip(description, description.root)
    ends = [link for link in description.links if not description.children(link)]
    if tip is None:
        assert choice.tip is not None or len(ends) == 1
    else:
        assert choice.tip is None
        assert tip in choice.candidates[:5]

"""A release: a changelog and a reference that have the version."""

import re
from pathlib import Path

from armwright_client.version import VERSION

ROOT = Path(__file__).parents[1]


def test_the_changelog_has_the_version_with_its_date() -> None:
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    sections = re.findall(r"^## \[([^\]]+)\](.*)$", text, re.MULTILINE)
    released = [(name, rest) for name, rest in sections if name != "Unreleased"]
    name, rest = released[0]
    assert name == VERSION
    assert re.fullmatch(r" - \d{4}-\d\d-\d\d", rest)
    assert len(sections) - len(released) <= 1
    assert sections[0][0] in {"Unreleased", VERSION}


def test_a_release_is_short_and_says_first_what_to_do() -> None:
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    for release in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        lines = [line for line in release.splitlines()[1:] if line]
        assert len(lines) <= 25, release
        assert lines[0] == "### To do before an upgrade"


def test_the_reference_shows_the_version() -> None:
    page = (ROOT / "docs/reference/http_health.md").read_text("utf-8")
    assert f'"version": "{VERSION}"' in page

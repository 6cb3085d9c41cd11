"""The site's pages: all named by the navigation, with links that lead to pages of the site."""

import json
import re
from pathlib import Path

import pytest
import yaml

from scripts.site import CONFIGURATION, ROOT, navigation, notebook_page, relink, write_pages


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site") / "pages"
    write_pages(folder)
    return folder


def test_every_page_is_in_the_navigation_once(folder: Path) -> None:
    names = [path.relative_to(folder).as_posix() for path in folder.rglob("*.md")]
    nav = navigation(yaml.safe_load(CONFIGURATION.read_text("utf-8"))["nav"], names)
    listed = re.findall(r"[\w/.-]+\.md", json.dumps(nav))
    assert sorted(listed) == sorted(names)


def test_links_lead_to_pages_of_the_site(folder: Path) -> None:
    for path in folder.rglob("*.md"):
        text = re.sub(r"```.*?```", "", path.read_text("utf-8"), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)#\s]+)", text):
            if not target.startswith(("http", "data:")):
                assert (path.parent / target).is_file(), f"{path.name}: {target}"


def test_what_no_section_names_joins_one_and_what_is_missing_is_refused() -> None:
    nav = [{"How-to": ["a.md"]}, {"Reference": ["folder/*"]}]
    names = ["a.md", "b.md", "folder/README.md", "folder/b.md"]
    assert navigation(nav, names) == [
        {"How-to": ["a.md", "b.md"]},
        {"Reference": ["folder/README.md", "folder/b.md"]},
    ]
    with pytest.raises(ValueError, match=r"a\.md"):
        navigation(nav, names[1:])


def test_links_beyond_the_site_become_text_and_code_stays() -> None:
    page = ROOT / "docs/a.md"
    where = {ROOT / "client/README.md": "client.md", page: "a.md"}
    text = "[client](../client/README.md#errors) [code](../planning/problem.py)\n```\n[x](y)\n```"
    wanted = "[client](client.md#errors) code\n```\n[x](y)\n```"
    assert relink(text, page, "a.md", where) == wanted


def test_notebooks_become_pages_with_what_they_print_and_draw() -> None:
    outputs = [
        {"output_type": "stream", "text": "2\n"},
        {"output_type": "display_data", "data": {"image/png": "AAAA"}},
    ]
    cells = [
        {"cell_type": "markdown", "source": ["# Title\n", "text"]},
        {"cell_type": "code", "source": "print(2)", "outputs": outputs},
    ]
    assert notebook_page({"cells": cells}) == (
        "# Title\ntext\n\n```python\nprint(2)\n```\n\n```text\n2\n```\n\n"
        "![Picture](data:image/png;base64,AAAA)\n"
    )

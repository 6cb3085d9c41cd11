"""The example that carries a crate over a wall, and what its page says that it prints."""

import importlib.util
import re
import sys
from pathlib import Path

import httpx
import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/pick_and_place.md").read_text("utf-8")


def test_the_example_prints_what_the_page_says(
    client: httpx.Client, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = importlib.util.spec_from_file_location("crate", ROOT / "examples/pick_and_place.py")
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    monkeypatch.setattr(sys, "argv", ["crate", "--url", str(client.base_url)])
    example.main()
    printed = re.search(r"prints\s*```\n(.*?)```", PAGE, re.DOTALL)
    assert printed is not None
    plans, _, refusal = capsys.readouterr().out.partition("not allowed to touch the table: ")
    assert plans == printed[1]
    assert refusal.startswith("START_STATE_IN_COLLISION")
    assert "('crate', 'table')" in refusal

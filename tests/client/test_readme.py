"""What the README shows works as it stands."""

import re
from pathlib import Path
from typing import Any

import pytest

import armwright_client
from armwright_client import Client

pytestmark = pytest.mark.timeout(300)

README = (Path(__file__).parents[2] / "client" / "README.md").read_text(encoding="utf-8")


def test_the_example_runs(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    example = re.findall(r"```python\n(.*?)```", README, re.DOTALL)[0]
    names: dict[str, Any] = {}
    exec(compile(example.replace("http://127.0.0.1:8000", url), "README.md", "exec"), names)
    assert names["plan"].certificate.verified
    assert len(capsys.readouterr().out.splitlines()) == 3


def test_every_method_is_named() -> None:
    with Client() as client:
        for group in (client, client.robots, client.scenes, client.jobs):
            for name in dir(group):
                public = not name.startswith("_") and name != "close"
                assert not public or f"`{name}`" in README or f"`client.{name}`" in README, name


def test_every_name_is_exported() -> None:
    prose = re.sub(r"```.*?```", "", README, flags=re.DOTALL)
    named = set(re.findall(r"\b(?:[A-Z][a-z]+){2,}\b", prose))
    foreign = {"ValidationError", "HTTPTransport"}
    assert named - foreign - {"NumPy"} <= set(armwright_client.__all__)

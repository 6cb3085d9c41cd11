"""What the README shows works as it stands."""

import re
from pathlib import Path

import pytest

import armwright_client
from armwright_client import Client

pytestmark = pytest.mark.timeout(300)

README = (Path(__file__).parents[2] / "client" / "README.md").read_text(encoding="utf-8")


BLOCKS = re.findall(r"```python\n(.*?)```(?:\s*prints\s*```\n(.*?)```)?", README, re.DOTALL)


@pytest.mark.parametrize(("code", "printed"), BLOCKS, ids=range(len(BLOCKS)))
def test_each_block_runs_as_pasted(
    url: str, capsys: pytest.CaptureFixture[str], code: str, printed: str
) -> None:
    exec(compile(code.replace("http://127.0.0.1:8000", url), "README.md", "exec"), {})
    out = capsys.readouterr().out
    assert out == (printed or out)
    assert out.strip()


def test_the_blocks_are_all_here() -> None:
    assert len(BLOCKS) == README.count("```python") >= 5


def test_every_method_is_named() -> None:
    with Client() as client:
        for group in (client, client.robots, client.scenes, client.jobs):
            for name in dir(group):
                public = not name.startswith("_") and name != "close"
                assert not public or f"`{name}`" in README or f"`client.{name}`" in README, name


def test_every_name_is_exported() -> None:
    prose = re.sub(r"```.*?```", "", README, flags=re.DOTALL)
    named = set(re.findall(r"\b(?:[A-Z][a-z]+){2,}\b", prose))
    foreign = {"ValidationError", "HTTPTransport", "WebSocket"}
    assert named - foreign - {"NumPy"} <= set(dir(armwright_client))

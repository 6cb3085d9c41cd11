"""Commands run in this process, and what they print."""

import json
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from command_line.main import main


class Printed(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The standard output as JSON."""
        return json.loads(self.out)


Run = Callable[..., Printed]


def runner(capsys: pytest.CaptureFixture[str]) -> Run:
    """A function that runs a command from its words."""

    def run(*words: str) -> Printed:
        capsys.readouterr()
        code = main(words)
        return Printed(code, *capsys.readouterr())

    return run

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.command_line.commands import Run, runner
from tests.service.kernel_store import frozen_kernels


@pytest.fixture(scope="package", autouse=True)
def _no_command_compiles() -> Iterator[None]:
    """The first command that needs a kernel which is not on the list fails."""
    with frozen_kernels():
        yield


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs a command with a data folder and a cache of its own."""
    monkeypatch.setenv("ARMWRIGHT_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.setattr("command_line.backends.local.cache_folder", lambda: tmp_path / "cache")
    monkeypatch.delenv("ARMWRIGHT_URL", raising=False)
    return runner(capsys)

"""A lock on a file: held once, and taken back by the system."""

import subprocess
import sys
from pathlib import Path

import pytest

from service.storage.database import FileLock, FileLocked

_HOLD = "import sys; from service.storage.database import FileLock; from pathlib import Path; \
lock = FileLock(Path(sys.argv[1])); print('locked', flush=True); sys.stdin.read()"


def test_a_process_that_is_killed_holds_nothing(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(tmp_path / "lock")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"locked\n"
    with pytest.raises(FileLocked):
        FileLock(tmp_path / "lock")
    process.kill()
    process.communicate()
    FileLock(tmp_path / "lock").release()

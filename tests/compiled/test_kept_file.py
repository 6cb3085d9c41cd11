"""Kept files: all that is not as it was written, or that others can have written, is not read."""

import os
import random
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from compiled import kept_file
from compiled.kept_file import is_kept, make_private, read_kept, write_kept

CONTENT = random.Random(0).randbytes(1000)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    file = tmp_path / "folder" / "one.kept"
    write_kept(file, CONTENT)
    return file


def test_what_was_written_is_read_and_is_its_owners_alone(file: Path) -> None:
    assert read_kept(file) == CONTENT
    assert is_kept(file)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    write_kept(file, b"", public=True)
    assert read_kept(file) == b""
    assert stat.S_IMODE(file.stat().st_mode) == 0o644
    assert [one.name for one in file.parent.iterdir()] == [file.name]


def test_no_file_with_another_bit_is_read(file: Path) -> None:
    whole, chance = file.read_bytes(), random.Random(1)
    for _ in range(500):
        damaged = bytearray(whole)
        damaged[chance.randrange(len(whole))] ^= 1 << chance.randrange(8)
        file.write_bytes(damaged)
        assert read_kept(file) is None
    for length in (0, 1, 20, 48, len(whole) - 1):
        file.write_bytes(whole[:length])
        assert read_kept(file) is None
    file.write_bytes(whole + b"\0")
    assert read_kept(file) is None
    file.write_bytes(whole)
    assert read_kept(file) == CONTENT


def test_a_file_of_another_name_is_not_read(file: Path) -> None:
    other = file.with_name("two.kept")
    other.hardlink_to(file)
    assert read_kept(other) is None
    assert read_kept(file) == CONTENT


@pytest.mark.parametrize("mode", [0o602, 0o666, 0o620])
def test_a_file_that_others_can_write_is_not_read(file: Path, mode: int) -> None:
    status = file.stat()
    os.chown(file, status.st_uid, _another_group(status))
    assert read_kept(file) == CONTENT
    file.chmod(mode)
    assert not is_kept(file)
    assert read_kept(file) is None
    write_kept(file, CONTENT)
    assert read_kept(file) == CONTENT


def _another_group(status: os.stat_result) -> int:
    """A group that the file may be given to and that has not its owner's number."""
    groups = [*os.getgroups(), *([12345] if os.geteuid() == 0 else [])]
    found = [group for group in groups if group != status.st_uid]
    return found[0] if found else status.st_gid


def test_a_file_of_another_owner_is_not_read(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fstat = os.fstat

    def of_another(descriptor: int) -> os.stat_result:
        values = list(fstat(descriptor))
        values[stat.ST_UID] = os.geteuid() + 54321
        return os.stat_result(values)

    monkeypatch.setattr(os, "fstat", of_another)
    assert read_kept(file) is None
    with pytest.raises(PermissionError, match="keeps no owners and modes"):
        write_kept(file, b"new")
    monkeypatch.undo()
    assert read_kept(file) == CONTENT
    # The owner of the program's code is trusted: who may change that needs no file.
    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    monkeypatch.setattr(kept_file, "_own_owner", lambda: file.stat().st_uid)
    assert read_kept(file) == CONTENT


@pytest.mark.parametrize("make", [os.mkfifo, Path.mkdir])
def test_what_is_no_file_is_not_read_and_nobody_waits(
    tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(tmp_path / "odd")
    assert read_kept(tmp_path / "odd") is None
    assert not is_kept(tmp_path / "odd")
    assert read_kept(tmp_path / "missing") is None


def test_folders_are_made_for_their_owner_and_those_that_are_there_stay(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    make_private(tmp_path / "a" / "b")
    for folder, mode in ((tmp_path, 0o755), (tmp_path / "a", 0o700), (tmp_path / "a/b", 0o700)):
        assert stat.S_IMODE(folder.stat().st_mode) == mode
    make_private(tmp_path / "a")
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        make_private(tmp_path / "file" / "below")

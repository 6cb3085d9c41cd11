"""Files stored for later processes: written whole, and read only as they were written.

All that is kept on disk to save work (machine code, prepared robots and scenes, convex pieces,
spheres, distances) goes through here. A file begins with a digest of its name and its content.
What is damaged, of another name, of another owner or open to others is not read, and is made anew.
"""

import errno
import hashlib
import os
import stat
import tempfile
from functools import cache
from pathlib import Path

#: How a kept file begins; a digest of its name and of all that follows comes next.
_MAGIC = b"armwright kept 1\n"
_START = len(_MAGIC) + hashlib.sha256().digest_size


def read_kept(file: Path) -> bytes | None:
    """Content of a stored file; None where there is none that can be trusted."""
    try:
        # Without a wait for whoever writes into a pipe that lies there.
        descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as stream:
            whole = stream.read() if _is_trusted(os.fstat(descriptor)) else b""
    except OSError:
        return None
    content = memoryview(whole)[_START:]
    return bytes(content) if whole[:_START] == _head(file.name, content) else None


def is_kept(file: Path) -> bool:
    """Whether a file is there that only its owner can have written; its content is not read."""
    try:
        return _is_trusted(file.stat())
    except OSError:
        return False


def write_kept(file: Path, content: bytes, *, public: bool = False) -> None:
    """Keep a content; another process sees all of it or nothing.

    Args:
        file: Path of the file; its folder is made if need be.
        content: All of it.
        public: Whether every user of the machine may read it.

    Raises:
        OSError: It can't be written, or not so that nobody else can.
    """
    make_private(file.parent)
    part: Path | None = None
    try:
        with tempfile.NamedTemporaryFile(dir=file.parent, prefix=".", delete=False) as stream:
            part = Path(stream.name)
            if public:
                os.fchmod(stream.fileno(), 0o644)
            stream.write(_head(file.name, content))
            stream.write(content)
            status = os.fstat(stream.fileno())
        if not _is_trusted(status):
            raise OSError(
                errno.EPERM, "its file system keeps no owners and modes, choose another", str(file)
            )
        part.replace(file)
    except OSError:
        if part is not None:
            part.unlink(missing_ok=True)
        raise


def make_private(folder: Path) -> None:
    """Make a folder, and those above it that are missing, for their owner alone.

    Raises:
        OSError: It can't be made.
    """
    if not folder.is_dir():
        make_private(folder.parent)
        folder.mkdir(mode=0o700, exist_ok=True)


def _head(name: str, content: bytes | memoryview) -> bytes:
    digest = hashlib.sha256(os.fsencode(name) + b"\0")
    digest.update(content)
    return _MAGIC + digest.digest()


def _is_trusted(status: os.stat_result) -> bool:
    """Whether only who may change this program's own code, or its process, can have written it."""
    # A group with its owner's number is the owner's alone: many systems give each user one.
    others = stat.S_IWOTH if status.st_gid == status.st_uid else stat.S_IWOTH | stat.S_IWGRP
    return (
        stat.S_ISREG(status.st_mode)
        and not status.st_mode & others
        and status.st_uid in (0, os.geteuid(), _own_owner())
    )


@cache
def _own_owner() -> int:
    return Path(__file__).stat().st_uid

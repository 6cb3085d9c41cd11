"""A PostgreSQL server of Debian's for tests, with a database for each that asks."""

import itertools
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg

_USER = "armwright"
#: Longest time until a server that was started answers [s].
_START = 30.0


class PostgreSQL:
    """A server on a socket in a folder of its own.

    Args:
        folder: Which is empty.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._numbers = itertools.count()
        self._process: subprocess.Popen[bytes] | None = None
        self._account = _account(folder) if os.getuid() == 0 else None
        initialise = [_program("initdb"), "-D", str(folder / "data"), "-U", _USER]
        subprocess.run(
            [*initialise, "--auth=trust", "--encoding=UTF8", "--locale=C.UTF-8", "--no-sync"],
            check=True, capture_output=True, cwd=folder, user=self._account,
        )  # fmt: skip

    @property
    def pid(self) -> int:
        """The number of its first process, below which all others are."""
        assert self._process is not None
        return self._process.pid

    def start(self) -> None:
        """Start the server and wait until it answers."""
        # Nothing here outlives the machine.
        options = {
            "unix_socket_directories": self.folder, "listen_addresses": "", "fsync": "off",
            "shared_buffers": "16MB", "max_connections": 60,
        }  # fmt: skip
        given = [part for name, value in options.items() for part in ("-c", f"{name}={value}")]
        with (self.folder / "log").open("ab") as log:
            self._process = subprocess.Popen(
                [_program("postgres"), "-D", str(self.folder / "data"), *given],
                stdout=subprocess.DEVNULL, stderr=log, cwd=self.folder, user=self._account,
            )  # fmt: skip
        end = time.monotonic() + _START
        while True:
            try:
                psycopg.connect(self._address("postgres")).close()
                return
            except psycopg.OperationalError:
                if time.monotonic() > end or self._process.poll() is not None:
                    raise RuntimeError((self.folder / "log").read_text()) from None
                time.sleep(0.05)

    def stop(self) -> None:
        """Stop the server at once, whoever is connected."""
        if self._process is not None:
            self._process.send_signal(signal.SIGINT)
            self._process.wait(20.0)
            self._process = None

    def database(self) -> str:
        """The URL of a new database."""
        name = f"test_{next(self._numbers)}"
        with psycopg.connect(self._address("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}".encode())
        return f"postgresql+psycopg://{_USER}@/{name}?host={self.folder}"

    def _address(self, database: str) -> str:
        return f"host={self.folder} user={_USER} dbname={database} connect_timeout=3"


@contextmanager
def postgresql() -> Iterator[PostgreSQL]:
    """A server that runs, and is removed afterwards."""
    folder = Path(tempfile.mkdtemp(prefix="armwright-postgresql-", dir="/tmp"))
    server = PostgreSQL(folder)
    try:
        server.start()
        yield server
    finally:
        server.stop()
        shutil.rmtree(folder)


def _program(name: str) -> str:
    """A program of PostgreSQL; Debian keeps those of the server apart."""
    found = shutil.which(name) or next(
        (str(p) for p in sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"), reverse=True)),
        None,
    )
    assert found, f"the tests need {name}: apt-get install postgresql"
    return found


def _account(folder: Path) -> str:
    """A user without rights, since PostgreSQL refuses to run as root; the folder becomes theirs."""
    names = {entry.pw_name for entry in pwd.getpwall()}
    account = "postgres" if "postgres" in names else "nobody"
    shutil.chown(folder, account)
    return account

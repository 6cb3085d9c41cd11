"""Servers that share a database: who is alive, by the clock of the database."""

from typing import Any

from sqlalchemy import (
    ColumnElement,
    Double,
    bindparam,
    delete,
    func,
    insert,
    literal_column,
    select,
)
from sqlalchemy import update as update_table

from service.storage.database import Database
from service.storage.tables import servers

#: Silence after which a server counts as dead [s]: others then take over what it worked on.
LIFETIME = 15.0
#: How often a server shows that it is alive [s]; several times within its lifetime.
HEARTBEAT = 3.0
#: Days between the origins of the Julian day and of Unix time, and seconds of a day.
_UNIX_ORIGIN = 2440587.5
_DAY = 86400.0


def now(database: Database) -> ColumnElement[float]:
    """The time of the database's clock, which all servers share [s since the epoch]."""
    if database.is_file:
        return literal_column(f"(julianday('now') - {_UNIX_ORIGIN}) * {_DAY}", Double)
    return func.extract("epoch", func.clock_timestamp()).cast(Double)


def is_abandoned(
    database: Database, server: ColumnElement[Any], this_server: str
) -> ColumnElement[bool]:
    """Whether the server of a row is dead, or the row has none.

    Args:
        database: Database whose clock counts.
        server: The column that names the server.
        this_server: The server that asks, which is alive.
    """
    living = select(servers.c.id).where(servers.c.seen > now(database) - LIFETIME)
    return server.is_(None) | ((server != this_server) & server.not_in(living))


class ServerStore:
    """The servers of a database; every method blocks and is safe in any thread."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._now = now(database)
        self._is_dead = servers.c.seen <= self._now - LIFETIME
        self._seen = update_table(servers).where(servers.c.id == bindparam("of_id"))

    def register(self, server: str, capacity: int = 0) -> None:
        """Note a server that has started; the only one of a file puts an end to those before.

        Args:
            server: Name of the server.
            capacity: Jobs for agents that it works on at a time.
        """
        with self._database.transaction(durable=False) as connection:
            outdated = delete(servers)
            connection.execute(
                outdated if self._database.is_file else outdated.where(self._is_dead)
            )
            times = {"started": self._now, "seen": self._now}
            connection.execute(insert(servers).values(id=server, capacity=capacity, **times))

    def capacity(self) -> int:
        """Jobs for agents that all living servers work on at a time."""
        living = select(func.sum(servers.c.capacity)).where(~self._is_dead)
        with self._database.reading() as connection:
            return int(connection.execute(living).scalar() or 0)

    def beat(self, server: str) -> bool:
        """Show that a server is alive; false if others took it for dead and forgot it."""
        with self._database.transaction(durable=False) as connection:
            seen = self._seen.values(seen=self._now).where(~self._is_dead)
            return connection.execute(seen, {"of_id": server}).rowcount == 1

    def remove(self, server: str) -> None:
        """Forget a server that ends."""
        with self._database.transaction(durable=False) as connection:
            connection.execute(delete(servers).where(servers.c.id == server))

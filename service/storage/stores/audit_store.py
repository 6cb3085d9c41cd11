"""The audit log: who changed what, and when."""

import time
from dataclasses import dataclass

from sqlalchemy import Connection, insert, select

from service.storage.database import Database
from service.storage.tables import audit


@dataclass(frozen=True, slots=True)
class Actor:
    """Actor: the caller who changes something.

    Args:
        tenant: Tenant of the actor.
        api_key: Id of the key that was shown; None without keys or at the command line.
    """

    tenant: str
    api_key: str | None = None


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """One change.

    Args:
        time: Seconds since the epoch.
        tenant: Tenant who owns the changed thing.
        api_key: Id of the key that was shown, if there was one.
        action: Action, such as "create".
        target: Target of the action, such as "robot arm".
    """

    time: float
    tenant: str
    api_key: str | None
    action: str
    target: str


_INSERT = insert(audit)
_COLUMNS = (audit.c.time, audit.c.tenant, audit.c.api_key, audit.c.action, audit.c.target)


def note(connection: Connection, actor: Actor, action: str, target: str) -> None:
    """Add an entry in the transaction of the change that it tells of."""
    entry = {
        "time": time.time(), "tenant": actor.tenant, "api_key": actor.api_key, "action": action,
        "target": target,
    }  # fmt: skip
    connection.execute(_INSERT, entry)


def last_entries(database: Database, limit: int) -> list[AuditEntry]:
    """The last entries, newest first.

    Raises:
        StorageUnavailable: The database can't be used now.
    """
    chosen = select(*_COLUMNS).order_by(audit.c.id.desc()).limit(limit)
    return [AuditEntry(*row) for row in database.rows(chosen)]

"""All that the service keeps: robots, scenes, jobs, plans, answers of idempotency keys, keys."""

import secrets

from service.storage.database import Database
from service.storage.stores.document_store import DocumentStore
from service.storage.stores.idempotency_store import IdempotencyStore
from service.storage.stores.job_store import JobStore, QueueStore
from service.storage.stores.key_store import KeyStore
from service.storage.stores.plan_store import PlanStore
from service.storage.stores.server_store import ServerStore


class Store:
    """The tables of one database, for one server or command.

    Args:
        database: Open database, which the store closes.
    """

    def __init__(self, database: Database) -> None:
        #: Name of this server among those that share the database.
        self.server = secrets.token_hex(8)
        self.database = database
        self.documents = DocumentStore(database)
        self.answers = IdempotencyStore(database, self.server)
        self.jobs = JobStore(database, self.server)
        self.plans = PlanStore(database)
        self.queue = QueueStore(database, self.server)
        self.servers = ServerStore(database)
        self.keys = KeyStore(database)

    def close(self) -> None:
        """Let go of the database."""
        self.database.close()


def open_store(url: str, *, exclusive: bool = False) -> Store:
    """The storage of a database URL, made or migrated where needed.

    Args:
        url: ``sqlite:///<path>`` or ``postgresql+psycopg://...``.
        exclusive: Whether to lock a SQLite file for this server.

    Raises:
        StoreError: The URL is of another kind, the database can't be used, or another server uses
            its file.
    """
    return Store(Database(url, exclusive=exclusive))

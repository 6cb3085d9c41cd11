"""All that the service keeps: robots, scenes, jobs and answers of idempotency keys."""

from service.storage.database import Database
from service.storage.document_store import DocumentStore
from service.storage.idempotency_store import IdempotencyStore
from service.storage.job_store import JobStore


class Store:
    """The tables of one database.

    Args:
        database: That is open; the store closes it.
    """

    def __init__(self, database: Database) -> None:
        self.database = database
        self.documents = DocumentStore(database)
        self.answers = IdempotencyStore(database)
        self.jobs = JobStore(database)

    def close(self) -> None:
        """Let go of the database."""
        self.database.close()


def open_store(url: str, *, exclusive: bool = False) -> Store:
    """The storage of a database URL, made or migrated where needed.

    Args:
        url: ``sqlite:///<path>`` or ``postgresql+psycopg://...``.
        exclusive: Whether to lock a SQLite file for this server, and to take back what a server of
            before had claimed.

    Raises:
        StoreError: The URL is of another kind, the database can't be used, or another server uses
            its file.
    """
    database = Database(url, exclusive=exclusive)
    store = Store(database)
    if exclusive and database.is_file:
        store.answers.forget_claims()
    return store

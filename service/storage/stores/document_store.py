"""Robots and scenes as documents, by name."""

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy import Connection, bindparam, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from service.storage.database import Database
from service.storage.stores.audit_store import Actor, note
from service.storage.stores.idempotency_store import KeptAnswer, keep_answer
from service.storage.tables import DEFAULT_TENANT, documents
from service.validation import ProblemError, storage_problem


@dataclass(frozen=True, slots=True)
class Record:
    """Metadata of a stored document.

    Args:
        name: Unique among its kind.
        hash: SHA-256 of the content.
        version: 1 when created, one more with each replacement.
        created: Seconds since the epoch.
        updated: Seconds since the epoch.
        size: Length of the content [byte].
    """

    name: str
    hash: str
    version: int
    created: float
    updated: float
    size: int


@dataclass(frozen=True, slots=True)
class Document:
    """A stored document."""

    record: Record
    content: bytes


#: Raises where a change is not meant for the document that there is, told by its hash or None.
Precondition = Callable[[str | None], None]

#: Whoever uses a service without keys.
_ANYBODY = Actor(DEFAULT_TENANT)
_IS_DOCUMENT = (
    (documents.c.tenant == bindparam("of_tenant"))
    & (documents.c.kind == bindparam("of_kind"))
    & (documents.c.name == bindparam("of_name"))
)
_RECORD = (
    documents.c.name,
    documents.c.hash,
    documents.c.version,
    documents.c.created,
    documents.c.updated,
    func.length(documents.c.content),
)
_FIND = select(*_RECORD).where(_IS_DOCUMENT)
# Locked until the transaction ends; SQLite knows no locks of rows, its writers wait for each other.
_LOCK = select(documents.c.hash).where(_IS_DOCUMENT).with_for_update()
_GET = select(*_RECORD, documents.c.content).where(_IS_DOCUMENT)
_LIST = (
    select(*_RECORD)
    .where(
        documents.c.tenant == bindparam("of_tenant"),
        documents.c.kind == bindparam("of_kind"),
        documents.c.name > bindparam("after"),
    )
    .order_by(documents.c.name)
    .limit(bindparam("count"))
)
_INSERT = insert(documents).returning(*_RECORD)
_REPLACE = (
    update(documents)
    .where(_IS_DOCUMENT)
    .values(
        content=bindparam("new_content"),
        hash=bindparam("new_hash"),
        version=documents.c.version + 1,
        updated=bindparam("now"),
    )
    .returning(*_RECORD)
)
_DELETE = delete(documents).where(_IS_DOCUMENT)
_SIZE = select(func.coalesce(func.sum(func.length(documents.c.content)), 0)).where(
    documents.c.tenant == bindparam("of_tenant")
)


class DocumentStore:
    """Documents in a database; every method blocks and is safe in any thread.

    Args:
        database: Database of the table.
        actor: Actor on whose behalf documents are read and changed; those of other tenants are not
            seen.
        storage_limit: Size of all documents of the tenant [byte]; None for any.
    """

    def __init__(
        self,
        database: Database,
        actor: Actor = _ANYBODY,
        storage_limit: int | None = None,
    ) -> None:
        self._database = database
        self._actor = actor
        self._tenant = actor.tenant
        self._storage_limit = storage_limit

    def create(
        self, kind: str, name: str, content: bytes, answer: KeptAnswer[Record] | None = None
    ) -> Record:
        """Keep a new document, and in the same transaction the answer that tells of it.

        Raises:
            ProblemError: CONFLICT, the name is taken; QUOTA_EXCEEDED.
        """
        try:
            with self._database.transaction() as connection:
                record = self._insert(connection, kind, name, content)
                if answer is not None:
                    keep_answer(connection, answer.key, answer.of(record))
                return record
        except IntegrityError:
            raise storage_problem(
                "CONFLICT",
                f"there already is a {kind} named {name!r}",
                hint=f"Choose another name, delete that {kind}, or replace it with PUT.",
                name=name,
            ) from None

    def replace(
        self, kind: str, name: str, content: bytes, precondition: Precondition | None = None
    ) -> Record:
        """Keep a document, new or in place of the one of that name.

        Args:
            kind: Kind of document.
            name: Name of the document.
            content: Content of the document.
            precondition: Asked in the transaction that stores the document.

        Raises:
            ProblemError: QUOTA_EXCEEDED; or what the precondition raises.
        """
        try:
            return self._replace(kind, name, content, precondition)
        except IntegrityError:  # another server created it between the two statements
            return self._replace(kind, name, content, precondition)

    def record(self, kind: str, name: str) -> Record:
        """Metadata of the document of a name.

        Raises:
            ProblemError: NOT_FOUND.
        """
        row = self._database.row(_FIND, self._parameters(kind, name))
        if row is None:
            raise _not_found(kind, name)
        return Record(*row)

    def get(self, kind: str, name: str) -> Document:
        """The document of a name.

        Raises:
            ProblemError: NOT_FOUND.
        """
        row = self._database.row(_GET, self._parameters(kind, name))
        if row is None:
            raise _not_found(kind, name)
        *values, content = row
        return Document(Record(*values), bytes(content))

    def list(self, kind: str, after: str, limit: int) -> list[Record]:
        """The first `limit` documents whose names sort after `after`, by name."""
        # Names that sort after one with a NUL are those that sort after the part before it.
        first = after.partition("\0")[0]
        bounds = {"of_tenant": self._tenant, "of_kind": kind, "after": first, "count": limit}
        return [Record(*row) for row in self._database.rows(_LIST, bounds)]

    def delete(self, kind: str, name: str, precondition: Precondition | None = None) -> None:
        """Forget a document.

        Args:
            kind: Kind of document.
            name: Name of the document.
            precondition: Asked in the transaction that deletes the document, if there is one.

        Raises:
            ProblemError: NOT_FOUND; or what the precondition raises.
        """
        with self._database.transaction() as connection:
            current = self._lock(connection, kind, name)
            if precondition is not None and current is not None:
                precondition(current)
            gone = connection.execute(_DELETE, self._parameters(kind, name)).rowcount
            if gone:
                note(connection, self._actor, "delete", f"{kind} {name}")
        if gone == 0:
            raise _not_found(kind, name)

    def _parameters(self, kind: str, name: str) -> dict[str, object]:
        # PostgreSQL takes no NUL, and no document has a name with one, or an empty name.
        known = "" if "\0" in name else name
        return {"of_tenant": self._tenant, "of_kind": kind, "of_name": known}

    def _insert(self, connection: Connection, kind: str, name: str, content: bytes) -> Record:
        now = time.time()
        row = connection.execute(
            _INSERT,
            {
                "tenant": self._tenant,
                "kind": kind,
                "name": name,
                "content": content,
                "hash": hashlib.sha256(content).hexdigest(),
                "version": 1,
                "created": now,
                "updated": now,
            },
        ).one()
        self._check_storage(connection)
        note(connection, self._actor, "create", f"{kind} {name}")
        return Record(*row)

    def _lock(self, connection: Connection, kind: str, name: str) -> str | None:
        """Hash of a document that nobody else can change until the transaction ends."""
        return connection.execute(_LOCK, self._parameters(kind, name)).scalar_one_or_none()

    def _replace(
        self, kind: str, name: str, content: bytes, precondition: Precondition | None
    ) -> Record:
        values = {
            "new_content": content,
            "new_hash": hashlib.sha256(content).hexdigest(),
            "now": time.time(),
        }
        with self._database.transaction() as connection:
            current = self._lock(connection, kind, name)
            if precondition is not None:
                precondition(current)
            parameters = self._parameters(kind, name) | values
            row = connection.execute(_REPLACE, parameters).one_or_none()
            if row is None:
                return self._insert(connection, kind, name, content)
            self._check_storage(connection)
            note(connection, self._actor, "replace", f"{kind} {name}")
        return Record(*row)

    def _check_storage(self, connection: Connection) -> None:
        """Refuse what was just stored, if it is too much; the transaction is undone then."""
        if self._storage_limit is None:
            return
        size = connection.execute(_SIZE, {"of_tenant": self._tenant}).scalar_one()
        if size > self._storage_limit:
            raise storage_problem(
                "QUOTA_EXCEEDED",
                f"robots and scenes would take {size} of the {self._storage_limit} bytes that this "
                "API key allows",
                hint="Delete some of them, or have the limit raised.",
                size=size,
                storage_limit=self._storage_limit,
            )


def _not_found(kind: str, name: str) -> ProblemError:
    return storage_problem(
        "NOT_FOUND",
        f"there is no {kind} named {name!r}",
        hint=f"GET /v1/{kind}s lists those there are.",
        name=name,
    )

"""Answers that idempotency keys stand for."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from typing import Generic, TypeVar

from sqlalchemy import Connection, bindparam, delete, insert, select, update
from sqlalchemy.exc import IntegrityError

from service.storage.database import Database
from service.storage.stores.server_store import is_abandoned
from service.storage.tables import DEFAULT_TENANT, answers
from service.validation import ProblemError, request_problem

T = TypeVar("T")

#: How long an idempotency key is remembered [s].
_KEY_LIFETIME = 24 * 3600.0


@dataclass(frozen=True, slots=True)
class Recorded:
    """The answer that a request was given."""

    status: int
    headers: dict[str, str]
    body: bytes


@dataclass(frozen=True, slots=True)
class IdempotencyKey:
    """An idempotency key, which stands for one request.

    Args:
        key: Key as the caller chose it.
        endpoint: Method and path of the request.
        tenant: Tenant whose request it is.
    """

    key: str
    endpoint: str
    tenant: str = DEFAULT_TENANT


@dataclass(frozen=True, slots=True)
class KeptAnswer(Generic[T]):
    """An answer that is kept in the transaction that makes what it tells of.

    Args:
        key: The idempotency key that stands for it from then on.
        of: Makes the answer of what was stored.
    """

    key: IdempotencyKey
    of: Callable[[T], Recorded]


_IS_KEY = (
    (answers.c.tenant == bindparam("of_tenant"))
    & (answers.c.key == bindparam("of_key"))
    & (answers.c.endpoint == bindparam("of_endpoint"))
)
_ANSWER = update(answers).where(_IS_KEY)
_CLAIM = insert(answers)
_FORGET = delete(answers).where(_IS_KEY, answers.c.status.is_(None))
_OUTDATED = delete(answers).where(answers.c.created < bindparam("oldest"))


class IdempotencyStore:
    """Idempotency keys in a database; every method blocks and is safe in any thread.

    Args:
        database: Database of the table.
        server: Server that claims the keys.
    """

    def __init__(self, database: Database, server: str) -> None:
        self._database = database
        self._server = server
        # Keys whose requests this server works on. A claim of its own beside these was left by a
        # fault of the storage, which could not take it back.
        self._working: set[IdempotencyKey] = set()
        self._lock = Lock()
        self._earlier = select(
            answers.c.request_hash, answers.c.status, answers.c.headers, answers.c.body
        ).where(_IS_KEY)
        # Whoever claimed these is gone, or works on them no longer.
        self._left = delete(answers).where(
            _IS_KEY,
            answers.c.status.is_(None),
            is_abandoned(database, answers.c.server, server) | (answers.c.server == server),
        )

    def begin(self, key: IdempotencyKey, request_hash: str) -> Recorded | None:
        """Claim a key, or give the answer it already stands for.

        Raises:
            ProblemError: IDEMPOTENCY_KEY_REUSED, it stands for another request; CONFLICT, that
                request is still being worked on.
        """
        with self._lock:
            is_worked_on = key in self._working
            self._working.add(key)
        if is_worked_on:
            row = self._database.row(self._earlier, _parameters(key))
            if row is None:
                raise _in_work(key)
            return _earlier(key, request_hash, *row)
        try:
            earlier = self._claim(key, request_hash)
        except BaseException:
            self.release(key)
            raise
        if earlier is not None:
            self.release(key)
        return earlier

    def _claim(self, key: IdempotencyKey, request_hash: str) -> Recorded | None:
        now = time.time()
        claim = {
            "tenant": key.tenant, "key": key.key, "endpoint": key.endpoint, "created": now,
            "request_hash": request_hash, "server": self._server,
        }  # fmt: skip
        try:
            with self._database.transaction(durable=False) as connection:
                connection.execute(_OUTDATED, {"oldest": now - _KEY_LIFETIME})
                connection.execute(self._left, _parameters(key))
                row = connection.execute(self._earlier, _parameters(key)).one_or_none()
                if row is None:
                    connection.execute(_CLAIM, claim)
                    return None
        except IntegrityError:  # another server claimed it between the two statements
            raise _in_work(key) from None
        return _earlier(key, request_hash, *row)

    def release(self, key: IdempotencyKey) -> None:
        """Note that the request of a claimed key is answered, whatever could be stored of it."""
        with self._lock:
            self._working.discard(key)

    def finish(self, key: IdempotencyKey, answer: Recorded) -> None:
        """Keep the answer that a claimed key stands for from now on."""
        self.release(key)
        with self._database.transaction() as connection:
            keep_answer(connection, key, answer)

    def forget(self, key: IdempotencyKey) -> None:
        """Give a claimed key back; one that stands for an answer stays."""
        self.release(key)
        with self._database.transaction(durable=False) as connection:
            connection.execute(_FORGET, _parameters(key))


def keep_answer(connection: Connection, key: IdempotencyKey, answer: Recorded) -> None:
    """Keep the answer of a claimed key in a transaction, together with what it tells of."""
    values = {
        "status": answer.status,
        "headers": json.dumps(answer.headers),
        "body": answer.body,
    }
    connection.execute(_ANSWER, _parameters(key) | values)


def _parameters(key: IdempotencyKey) -> dict[str, object]:
    return {"of_tenant": key.tenant, "of_key": key.key, "of_endpoint": key.endpoint}


def _earlier(
    key: IdempotencyKey,
    request_hash: str,
    hash_then: str,
    status: int | None,
    headers: str,
    body: bytes,
) -> Recorded:
    if request_hash != hash_then:
        raise request_problem(
            "IDEMPOTENCY_KEY_REUSED",
            f"the Idempotency-Key {key.key!r} was used for a request with another body",
            hint="Use a new key for a new request.",
        )
    if status is None:
        raise _in_work(key)
    return Recorded(status, json.loads(headers), bytes(body))


def _in_work(key: IdempotencyKey) -> ProblemError:
    return request_problem(
        "CONFLICT",
        f"the first request with the Idempotency-Key {key.key!r} is still being worked on",
        hint="Ask again in a moment; the answer will be that of the first request.",
        retry_after=1,
    )

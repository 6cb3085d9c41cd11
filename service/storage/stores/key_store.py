"""API keys as they are stored: the digest of a secret, and what it allows."""

import dataclasses
import time
from dataclasses import dataclass
from typing import Literal

from sqlalchemy import bindparam, insert, select, update
from sqlalchemy.exc import IntegrityError

from service.storage.database import Database
from service.storage.stores.audit_store import Actor, note
from service.storage.tables import DEFAULT_TENANT, api_keys

Scope = Literal["read", "plan", "admin"]
#: What a key may do, the least first; each allows what those before it allow.
SCOPES: tuple[Scope, ...] = ("read", "plan", "admin")


@dataclass(frozen=True, slots=True)
class ApiKey:
    """An API key without its secret.

    Args:
        id: Public part of the key.
        name: Purpose of the key.
        digest: SHA-256 of its secret part, in hexadecimal digits.
        scope: Scope: to read, also to plan, or also to change robots and scenes.
        tenant: Tenant whose robots, scenes and jobs the key shows.
        created: Seconds since the epoch, as the next two.
        expires: Time from which the key is refused; None for never.
        revoked: Time at which the key was revoked.
        rate: Requests a minute; None for any number.
        job_limit: Jobs that may wait or run; None for any number.
        storage_limit: Size of all documents of the tenant [byte]; None for any.
    """

    id: str
    name: str
    digest: str
    scope: Scope = "plan"
    tenant: str = DEFAULT_TENANT
    created: float = 0.0
    expires: float | None = None
    revoked: float | None = None
    rate: int | None = None
    job_limit: int | None = None
    storage_limit: int | None = None

    def is_valid(self, now: float) -> bool:
        """Whether it is accepted at a time, in seconds since the epoch."""
        return self.revoked is None and (self.expires is None or now < self.expires)


_COLUMNS = tuple(api_keys.c[field.name] for field in dataclasses.fields(ApiKey))
_FIND = select(*_COLUMNS).where(api_keys.c.id == bindparam("of_id"))
_LIST = select(*_COLUMNS).order_by(api_keys.c.created, api_keys.c.id)
_ANY = select(api_keys.c.id).limit(1)
_REVOKE = (
    update(api_keys)
    .where(api_keys.c.id == bindparam("of_id"), api_keys.c.revoked.is_(None))
    .values(revoked=bindparam("now"))
    .returning(api_keys.c.tenant)
)


class KeyStore:
    """API keys in a database; every method blocks and is safe in any thread."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, key: ApiKey) -> bool:
        """Keep a new key; false if there is one of its id."""
        try:
            with self._database.transaction() as connection:
                connection.execute(insert(api_keys), dataclasses.asdict(key))
                note(connection, Actor(key.tenant), "create", f"key {key.id}")
        except IntegrityError:
            return False
        return True

    def find(self, key_id: str) -> ApiKey | None:
        """The key of an id, valid or not."""
        row = self._database.row(_FIND, {"of_id": key_id})
        return None if row is None else ApiKey(*row)

    def list(self) -> list[ApiKey]:
        """All keys, the oldest first."""
        return [ApiKey(*row) for row in self._database.rows(_LIST)]

    def revoke(self, key_id: str) -> bool:
        """Refuse a key from now on; false if there is none, or it was revoked already."""
        with self._database.transaction() as connection:
            tenant = connection.execute(
                _REVOKE, {"of_id": key_id, "now": time.time()}
            ).scalar_one_or_none()
            if tenant is not None:
                note(connection, Actor(tenant), "revoke", f"key {key_id}")
        return tenant is not None

    def are_there_any(self) -> bool:
        """Whether a key was ever made: revoked ones count, so that revoking opens nothing."""
        return self._database.row(_ANY) is not None

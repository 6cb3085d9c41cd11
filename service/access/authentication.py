"""Authentication: from what a caller shows to who it is.

API keys as callers show them: ``aw_<id>_<secret>``.

Callers: on whose behalf a request is answered, what that allows, and what a request needs.
"""

import hashlib
import hmac
import math
import re
import secrets
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from service.storage.stores.key_store import SCOPES, ApiKey, KeyStore, Scope
from service.storage.tables import DEFAULT_TENANT
from service.validation import ProblemError, request_problem

#: Key in the scope of a request, with its `Caller`.
CALLER = "armwright.caller"


@dataclass(frozen=True, slots=True)
class Caller:
    """Caller: the sender of a request.

    Args:
        tenant: Tenant whose robots, scenes and jobs it sees.
        api_key: Id of the key that was shown; None without keys.
        scope: Scope of what it may do.
        job_limit: Jobs that may wait or run; None for any number.
        storage_limit: Size of all documents of the tenant [byte]; None for any.
    """

    tenant: str = DEFAULT_TENANT
    api_key: str | None = None
    scope: Scope = "admin"
    job_limit: int | None = None
    storage_limit: int | None = None

    def may(self, scope: Scope) -> bool:
        """Whether its scope allows what another one allows."""
        return SCOPES.index(self.scope) >= SCOPES.index(scope)


#: The caller of a service without keys.
ANYONE = Caller()


def caller_of(scope: Mapping[str, Any]) -> Caller:
    """The caller of a request, by the scope of the request."""
    caller: Caller = scope.get(CALLER, ANYONE)
    return caller


def client_of(scope: Mapping[str, Any]) -> str:
    """The client of a request, as far as clients take turns: its key, or else its address."""
    caller: Caller = scope.get(CALLER, ANYONE)
    key = caller.api_key
    if key is not None:
        return key
    address: tuple[str, int] | None = scope.get("client")
    return "" if address is None else address[0]


#: Pages that say what the service is, and nothing of what it holds.
_PUBLIC = re.compile(r"/|/docs(/.*)?|/openapi\.json|/v1/problems(/.*)?")
_HEALTH = frozenset({"/healthz", "/readyz"})
_METRICS = "/metrics"
#: Robots, scenes and tools themselves, not what is computed about them.
_DOCUMENTS = re.compile(r"/v1/(robots|scenes|tools)(/[^/]*)?")
_READING = frozenset({"GET", "HEAD"})


def needed_scope(
    method: str, path: str, *, public_health: bool, public_metrics: bool
) -> Scope | None:
    """The scope that a request needs; None if anybody may ask.

    Args:
        method: Method of the request.
        path: Path of the request.
        public_health: Whether anybody may ask for health and readiness.
        public_metrics: Whether anybody may ask for metrics.
    """
    if method == "OPTIONS" or _PUBLIC.fullmatch(path):
        return None
    if path in _HEALTH:
        return None if public_health else "read"
    if path == _METRICS:
        return None if public_metrics else "admin"
    if method in _READING:
        return "read"
    return "admin" if _DOCUMENTS.fullmatch(path) else "plan"


#: Random bytes of the public and of the secret part: the secret has 256 bits.
_ID_BYTES = 6
_SECRET_BYTES = 32
_FORM = re.compile(r"aw_([0-9a-f]{12})_([0-9a-f]{64})")


class Credentials(NamedTuple):
    """The two parts of an API key.

    Args:
        id: Id by which it is found; no secret.
        secret: Known to the caller alone.
    """

    id: str
    secret: str

    def __str__(self) -> str:
        return f"aw_{self.id}_{self.secret}"


def new_credentials() -> Credentials:
    """The parts of a new API key, from the random numbers of the system."""
    return Credentials(secrets.token_hex(_ID_BYTES), secrets.token_hex(_SECRET_BYTES))


def parse(text: str) -> Credentials | None:
    """The parts of an API key; None if it has not the form of one."""
    match = _FORM.fullmatch(text)
    return None if match is None else Credentials(match[1], match[2])


def digest(secret: str) -> str:
    """SHA-256 of a secret, in hexadecimal digits; with 256 random bits nobody can search it."""
    return hashlib.sha256(secret.encode()).hexdigest()


def fits(secret: str, stored_digest: str) -> bool:
    """Whether a secret has a digest, in a time that does not depend on where they differ."""
    return hmac.compare_digest(digest(secret), stored_digest)


#: How long a key is believed that was looked up [s]: revoking takes effect within that time.
_BELIEVED = 2.0
#: Keys that are remembered.
_REMEMBERED = 1024
#: Compared with where there is no key of an id, so that this takes as long.
_NO_DIGEST = digest("")


class Authenticator:
    """The API keys of a service, looked up and remembered for a moment.

    Args:
        keys: All keys.
    """

    def __init__(self, keys: KeyStore) -> None:
        self._keys = keys
        self._remembered: dict[str, tuple[float, ApiKey | None]] = {}
        self._needed: tuple[float, bool] = (-math.inf, False)

    def authenticate(self, headers: Mapping[str, str]) -> tuple[Caller, ApiKey | None]:
        """The caller of a request; its key, too, if there are keys. May block.

        Args:
            headers: Headers of the request, by names in lower case.

        Raises:
            ProblemError: UNAUTHENTICATED; STORAGE_UNAVAILABLE.
        """
        if not self._are_keys_needed():
            return ANYONE, None
        shown = _key_in(headers)
        if shown is None:
            raise _unauthenticated("this service needs an API key")
        parts = parse(shown)
        if parts is None:
            raise _unauthenticated("the API key is malformed")
        key = self._find(parts.id)
        known = fits(parts.secret, _NO_DIGEST if key is None else key.digest)
        if key is None or not known:
            raise _unauthenticated("the API key is not known")
        if not key.is_valid(time.time()):
            raise _unauthenticated("the API key has expired or was revoked")
        return Caller(key.tenant, key.id, key.scope, key.job_limit, key.storage_limit), key

    def is_remembered(self, headers: Mapping[str, str]) -> bool:
        """Whether `authenticate` answers without asking the database."""
        now = time.monotonic()
        if now - self._needed[0] >= _BELIEVED:
            return False
        if not self._needed[1]:
            return True
        parts = parse(_key_in(headers) or "")
        if parts is None:
            return True
        return parts.id in self._remembered and now - self._remembered[parts.id][0] < _BELIEVED

    def _are_keys_needed(self) -> bool:
        looked_up, needed = self._needed
        now = time.monotonic()
        if now - looked_up >= _BELIEVED:
            needed = self._keys.are_there_any()
            self._needed = now, needed
        return needed

    def _find(self, key_id: str) -> ApiKey | None:
        now = time.monotonic()
        looked_up, key = self._remembered.get(key_id, (-math.inf, None))
        if now - looked_up >= _BELIEVED:
            key = self._keys.find(key_id)
            if len(self._remembered) >= _REMEMBERED:
                self._remembered.clear()
            self._remembered[key_id] = now, key
        return key


def _key_in(headers: Mapping[str, str]) -> str | None:
    """The API key that a request shows, by either header."""
    kind, _, token = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer":
        return token.strip()
    return headers.get("x-api-key")


def _unauthenticated(detail: str) -> ProblemError:
    return request_problem(
        "UNAUTHENTICATED",
        detail,
        hint="Send the header Authorization: Bearer aw_<id>_<secret>, or X-API-Key. Whoever runs "
        "the service makes one with `armwright keys create`.",
    )

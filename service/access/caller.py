"""Callers: on whose behalf a request is answered, what that allows, and what a request needs."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.storage.stores.key_store import SCOPES, Scope
from service.storage.tables import DEFAULT_TENANT

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

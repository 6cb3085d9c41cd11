"""Callers: on whose behalf a request is answered, and what that allows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.storage.key_store import SCOPES, Scope
from service.storage.tables import DEFAULT_TENANT

#: Key in the scope of a request, with its `Caller`.
CALLER = "armwright.caller"


@dataclass(frozen=True, slots=True)
class Caller:
    """Whoever sent a request.

    Args:
        tenant: Whose robots, scenes and jobs there are for it.
        api_key: Id of the key that was shown; None without keys.
        scope: What it may do.
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
    key = caller_of(scope).api_key
    if key is not None:
        return key
    address: tuple[str, int] | None = scope.get("client")
    return "" if address is None else address[0]

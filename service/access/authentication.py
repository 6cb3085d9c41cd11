"""Authentication: from what a caller shows to who it is."""

import math
import time
from collections.abc import Mapping

from service.access import secret
from service.access.caller import ANYONE, Caller
from service.problem import ProblemError, request_problem
from service.storage.stores.key_store import ApiKey, KeyStore

#: How long a key is believed that was looked up [s]: revoking takes effect within that time.
_BELIEVED = 2.0
#: Keys that are remembered.
_REMEMBERED = 1024
#: Compared with where there is no key of an id, so that this takes as long.
_NO_DIGEST = secret.digest("")


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
        parts = secret.parse(shown)
        if parts is None:
            raise _unauthenticated("the API key is malformed")
        key = self._find(parts.id)
        known = secret.fits(parts.secret, _NO_DIGEST if key is None else key.digest)
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
        parts = secret.parse(_key_in(headers) or "")
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

"""Rules: which scope a request needs, by its method and path."""

import re

from service.storage.key_store import Scope

#: Pages that say what the service is, and nothing of what it holds.
_PUBLIC = re.compile(r"/|/docs(/.*)?|/openapi\.json|/v1/problems(/.*)?")
_HEALTH = frozenset({"/healthz", "/readyz"})
_METRICS = "/metrics"
#: Robots and scenes themselves, not what is computed about them.
_DOCUMENTS = re.compile(r"/v1/(robots|scenes)(/[^/]*)?")
_READING = frozenset({"GET", "HEAD"})


def needed_scope(
    method: str, path: str, *, public_health: bool, public_metrics: bool
) -> Scope | None:
    """The scope that a request needs; None if anybody may ask.

    Args:
        method: Of the request.
        path: Of the request.
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

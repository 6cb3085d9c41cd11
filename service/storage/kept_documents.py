"""Robots and scenes as kept plans have them, before those that are stored now."""

from collections.abc import Sequence

from service.problem import ProblemError
from service.storage.cache_key import Reference
from service.storage.document_store import Document, DocumentStore, Record
from service.storage.plan_store import PlanStore


class KeptDocuments:
    """Documents by name: pinned ones as they were kept, all others as they are stored now.

    Args:
        current: Those that are stored now.
        plans: That hold the kept ones.
        tenant: Whose.
        pinned: Robots and scenes that mean the kept document of their hash.
    """

    def __init__(
        self,
        current: DocumentStore,
        plans: PlanStore,
        tenant: str,
        pinned: Sequence[Reference],
    ) -> None:
        self._current = current
        self._plans = plans
        self._tenant = tenant
        self._pinned: dict[tuple[str, str], str] = {
            (item.kind, item.name): item.hash for item in pinned
        }

    def recall(self, kind: str, name: str) -> Record | None:
        """Metadata of a document, if this process remembers it."""
        return None if (kind, name) in self._pinned else self._current.recall(kind, name)

    def record(self, kind: str, name: str) -> Record:
        """Metadata of a document.

        Raises:
            ProblemError: NOT_FOUND; CONFLICT, the kept document was not stored with the plan.
        """
        if (kind, name) not in self._pinned:
            return self._current.record(kind, name)
        return self.get(kind, name).record

    def get(self, kind: str, name: str) -> Document:
        """A document.

        Raises:
            ProblemError: NOT_FOUND; CONFLICT, the kept document was not stored with the plan.
        """
        digest = self._pinned.get((kind, name))
        if digest is None:
            return self._current.get(kind, name)
        content = self._plans.document(digest, self._tenant)
        if content is None:
            raise ProblemError(
                "CONFLICT",
                f"the {kind} {name!r} was replaced while the plan was being made, and not kept",
                stage="storage",
                hint=f'Say "documents": "current" to use the {kind} of that name as it is now.',
            )
        # When it was stored is not known any more, and nobody asks.
        return Document(Record(name, digest, 1, 0.0, 0.0, len(content)), content)

"""Robots and scenes by name: where their documents are, and under which keys they are prepared.

Of a kept plan they are documents as they were kept with it.
"""

from collections.abc import Sequence

from kinematics.model.robot_names import builtin_names
from service.storage.caches.cache_key import Kind, Reference, builtin_reference
from service.storage.stores.document_store import Document, DocumentStore, Record
from service.storage.stores.plan_store import PlanStore
from service.validation import ProblemError, storage_problem


class KeptDocuments:
    """Documents by name: pinned ones as they were kept, all others as they are stored now.

    Args:
        current: Documents that are stored now.
        plans: Store of the plans with the kept documents.
        tenant: Tenant who owns them.
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
            raise storage_problem(
                "CONFLICT",
                f"the {kind} {name!r} was replaced while the plan was being made, and not kept",
                hint=f'Say "documents": "current" to use the {kind} of that name as it is now.',
            )
        # When it was stored is not known any more, and nobody asks.
        return Document(Record(name, digest, 1, 0.0, 0.0, len(content)), content)


class RobotRepository:
    """The built-in robots, and the robots and scenes of a store. All methods block.

    Args:
        documents: Documents of robots and scenes.
        folder: Folder of prepared robots and scenes.
    """

    def __init__(self, documents: DocumentStore | KeptDocuments, folder: str) -> None:
        self._documents = documents
        self._folder = folder

    def look_up(self, names: Sequence[tuple[Kind, str | None]]) -> list[Reference | None]:
        """Robots, built-in ones first, and stored scenes of names; None without a name.

        Raises:
            ProblemError: NOT_FOUND.
        """
        return [None if name is None else self._find(kind, name) for kind, name in names]

    def _find(self, kind: Kind, name: str) -> Reference:
        if kind == "robot" and is_built_in(name):
            return builtin_reference(name, self._folder)
        try:
            record = self._documents.record(kind, name)
        except ProblemError as error:
            if kind == "robot":
                every = ", ".join(builtin_names())
                error.hint = f"GET /v1/robots lists those there are; built in: {every}."
            raise
        return Reference(kind, name, record.hash, self._folder)

    def document(self, reference: Reference) -> tuple[Reference, bytes]:
        """The current document of a robot or scene, and the reference of what it describes.

        Args:
            reference: The robot or scene, perhaps as it was before it was replaced.

        Raises:
            ProblemError: NOT_FOUND, it was deleted meanwhile.
        """
        document = self._documents.get(reference.kind, reference.name)
        current = Reference(reference.kind, reference.name, document.record.hash, self._folder)
        return current, document.content


def is_built_in(name: str) -> bool:
    """Whether a robot of this name comes with the app."""
    return name in builtin_names()

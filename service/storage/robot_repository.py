"""Robots and scenes by name: where their documents are, and under which keys they are prepared.

Of a kept plan they are documents as they were kept with it.
"""

from collections.abc import Callable, Sequence

from kinematics.model.robot_names import builtin_names
from service.storage.caches.cache_key import Kind, Reference, builtin_reference
from service.storage.stores.document_store import DocumentStore
from service.validation import ProblemError, storage_problem


class RobotRepository:
    """The built-in robots, and the robots and scenes of a store. All methods block.

    Args:
        documents: Documents that are stored now.
        folder: Folder of prepared robots and scenes.
        pinned: Robots and scenes that mean the document of their hash that a plan was kept with.
        kept: Finds such a document by its hash, None where there is none.
    """

    def __init__(
        self,
        documents: DocumentStore,
        folder: str,
        pinned: Sequence[Reference] = (),
        kept: Callable[[str], bytes | None] = lambda _: None,
    ) -> None:
        self._documents = documents
        self._folder = folder
        self._pinned = {(item.kind, item.name): item.hash for item in pinned}
        self._kept = kept

    def look_up(self, names: Sequence[tuple[Kind, str | None]]) -> list[Reference | None]:
        """Robots, built-in ones first, and stored scenes of names; None without a name.

        Raises:
            ProblemError: NOT_FOUND; CONFLICT, a kept document was not stored with the plan.
        """
        return [None if name is None else self._find(kind, name) for kind, name in names]

    def _find(self, kind: Kind, name: str) -> Reference:
        if kind == "robot" and is_built_in(name):
            return builtin_reference(name, self._folder)
        digest = self._pinned.get((kind, name))
        if digest is not None:
            self._kept_document(kind, name, digest)
            return Reference(kind, name, digest, self._folder)
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
            ProblemError: NOT_FOUND, it was deleted meanwhile; CONFLICT as `look_up`.
        """
        kind, name = reference.kind, reference.name
        digest = self._pinned.get((kind, name))
        if digest is not None:
            content = self._kept_document(kind, name, digest)
        else:
            stored = self._documents.get(kind, name)
            digest, content = stored.record.hash, stored.content
        return Reference(kind, name, digest, self._folder), content

    def _kept_document(self, kind: Kind, name: str, digest: str) -> bytes:
        content = self._kept(digest)
        if content is None:
            raise storage_problem(
                "CONFLICT",
                f"the {kind} {name!r} was replaced while the plan was being made, and not kept",
                hint=f'Say "documents": "current" to use the {kind} of that name as it is now.',
            )
        return content


def is_built_in(name: str) -> bool:
    """Whether a robot of this name comes with the app."""
    return name in builtin_names()

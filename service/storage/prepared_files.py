"""Files of prepared robots and scenes: where they lie, and how they go."""

import contextlib
import hashlib
from pathlib import Path

from service.storage.cache_key import Reference

_DECOMPOSITIONS = "decompositions"


def document_hash(document: bytes) -> str:
    """Content hash of a document, the same as in the storage."""
    return hashlib.sha256(document).hexdigest()


def decompositions(folder: str) -> Path:
    """Folder of the convex parts of meshes."""
    return Path(folder) / _DECOMPOSITIONS


def prepared_file(reference: Reference) -> Path:
    """File of a prepared robot or scene."""
    return Path(reference.folder) / f"{reference.hash}.{reference.kind}"


def forget(reference: Reference) -> None:
    """Remove the file of a reference, if there is one."""
    with contextlib.suppress(OSError):
        prepared_file(reference).unlink(missing_ok=True)

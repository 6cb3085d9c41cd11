"""Files of prepared robots and scenes: where they lie, and how they go."""

import contextlib
import hashlib
import stat
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from service.storage.cache_key import Reference

_DECOMPOSITIONS = "decompositions"


def document_hash(document: bytes) -> str:
    """Content hash of a document, the same as in the storage."""
    return hashlib.sha256(document).hexdigest()


@lru_cache(16)
def decompositions(folder: str) -> Path:
    """Folder of the convex parts of meshes, of their spheres and of distances of links."""
    return Path(folder) / _DECOMPOSITIONS


def prepared_file(reference: Reference) -> Path:
    """File of a prepared robot or scene."""
    return Path(reference.folder) / f"{reference.hash}.{reference.kind}"


def visual_file(reference: Reference) -> Path:
    """File of the visual geometry of a prepared robot."""
    return Path(reference.folder) / f"{reference.hash}.{reference.kind}.visuals"


def note_meshes(reference: Reference, files: Sequence[Path]) -> None:
    """Note the files of solids that were written for a reference: they go with it."""
    if files:
        names = "\n".join(file.name for file in files)
        _mesh_list(reference).write_text(names, encoding="ascii")


def forget(reference: Reference) -> None:
    """Remove the file of a reference, if there is one, and those of its meshes.

    Another robot or scene may have the same mesh: its parts are computed again where needed.
    """
    meshes = _mesh_list(reference)
    with contextlib.suppress(OSError):
        for name in meshes.read_text(encoding="ascii").split():
            (decompositions(reference.folder) / Path(name).name).unlink(missing_ok=True)
    for file in (meshes, visual_file(reference), prepared_file(reference)):
        with contextlib.suppress(OSError):
            file.unlink(missing_ok=True)


def trim(folder: str, limit: int) -> int:
    """Remove the files that were written first until a folder has at most `limit` bytes.

    They are built again when they are asked for.

    Returns:
        The bytes that are left.
    """
    found = []
    for file in Path(folder).rglob("*"):
        with contextlib.suppress(OSError):
            status = file.stat()
            if stat.S_ISREG(status.st_mode):
                found.append((status.st_mtime, status.st_size, file))
    total = sum(size for _, size, _ in found)
    for _, size, file in sorted(found):
        if total <= limit:
            break
        with contextlib.suppress(OSError):
            file.unlink(missing_ok=True)
            total -= size
    return total


def _mesh_list(reference: Reference) -> Path:
    return Path(reference.folder) / f"{reference.hash}.{reference.kind}.meshes"

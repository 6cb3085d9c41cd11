"""Files of prepared robots and scenes: where they lie, and how they go."""

import contextlib
import hashlib
import stat
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from compiled.kept_file import read_kept, write_kept
from service.storage.caches.cache_key import Reference

_DECOMPOSITIONS = "decompositions"
_LIST = ".meshes"


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
    """Note the files of solids that a reference needs: they go with the last one that does."""
    if files:
        names = "\n".join(file.name for file in files)
        write_kept(_mesh_list(reference), names.encode("ascii"))


def forget(reference: Reference) -> None:
    """Remove the file of a reference, if there is one, and those of its solids.

    What another robot or scene needs too stays: one of the same meshes, or the same with other
    limits.
    """
    meshes = _mesh_list(reference)
    own = _names(meshes)
    if own:
        for other in Path(reference.folder).glob(f"*{_LIST}"):
            own -= set() if other == meshes else _names(other)
    for name in own:
        with contextlib.suppress(OSError):
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
    return Path(reference.folder) / f"{reference.hash}.{reference.kind}{_LIST}"


def _names(file: Path) -> set[str]:
    """Names of the files that a list has; none where it can't be read."""
    content = read_kept(file)
    return set() if content is None else set(content.decode("ascii").split())

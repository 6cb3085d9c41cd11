"""Keys of prepared robots and scenes, by which requests name them to workers."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

Kind = Literal["robot", "scene"]


@dataclass(frozen=True, slots=True)
class Mount:
    """What a request has the robot work with.

    Args:
        tool: The tool, JSON; None where there is none.
        tcp: Name of its tip; None where it has one, or the tip is another.
        held: An attached object with the pose of the tip on it, JSON; None where the tip is no
            object's.
        others: Tools that stages of a task take in its place, by name, JSON.
        margins: Distances that links keep from obstacles [m].
        own_margin: Distance that links keep from each other [m].
    """

    tool: bytes | None
    tcp: str | None = None
    held: bytes | None = None
    others: tuple[tuple[str, bytes], ...] = ()
    margins: tuple[tuple[str, float], ...] = ()
    own_margin: float = 0.0


@dataclass(frozen=True, slots=True)
class Reference:
    """A robot or scene that a worker is to load.

    Args:
        kind: Kind: robot or scene.
        name: Name of the robot or scene.
        hash: SHA-256 of its document; of a built-in robot its name.
        folder: Folder of prepared robots and scenes.
        built_in: Whether the robot comes with the app, so that there is no document.
        mount: The tool and tip of the robot; None for those of its own.
    """

    kind: Kind
    name: str
    hash: str
    folder: str
    built_in: bool = False
    mount: Mount | None = None


@lru_cache(64)
def builtin_reference(name: str, folder: str = "") -> Reference:
    """The reference of a robot that comes with the app."""
    return Reference("robot", name, name, folder, built_in=True)


class NotPrepared(Exception):
    """Error of a reference without a usable file: its document has to be prepared again."""

    def __init__(self, reference: Reference) -> None:
        super().__init__(reference.name)
        self.reference = reference

"""Cache of prepared robots and scenes on disk: built once, loaded by the hash of their document.

The files are pickles, so none is opened that anybody but the service can have written or that is
not as this version wrote it (`compiled.kept_file`); what is not read is built anew.
"""

import hashlib
import pickle
import sys
from dataclasses import dataclass, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from compiled.kept_file import read_kept, write_kept
from kinematics.errors import ArmwrightError
from kinematics.model.chain import Chain, Inertia, Limits, Link
from kinematics.tree.fingers import Finger, Fingers
from obstacles.convex.piece import Piece
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.robots.visual_geometry import VisualBody, VisualGeometry
from obstacles.scenes.scene import Obstacle, Scene
from service.storage.caches.cache_key import NotPrepared, Reference
from service.storage.caches.prepared_files import prepared_file, visual_file
from service.version import VERSION

#: Raised when pickles of before must not be read any more.
_FORMAT = 4


#: When a caller is told to ask again while the folder can't be written to [s].
_RETRY_AFTER = 2


@cache
def _format() -> str:
    """Changes whenever what is pickled does; files of another format are built anew."""
    robots = (Chain, Limits, Link, Inertia, RobotGeometry, Finger, Fingers)
    layout = [
        (cls.__name__, [item.name for item in fields(cls)])
        for cls in (*robots, Piece, Scene, Obstacle)
    ]
    layout += [(cls.__name__, [*cls._fields]) for cls in (VisualGeometry, VisualBody)]
    versions = _FORMAT, VERSION, sys.version_info[:2], np.__version__
    return hashlib.sha256(repr((*versions, layout)).encode()).hexdigest()


class FolderUnusable(ArmwrightError):
    """The folder of prepared robots and scenes can't be written to: its disk is full, say."""

    code = "STORAGE_UNAVAILABLE"

    def __init__(self, error: OSError) -> None:
        super().__init__(
            f"prepared robots and scenes can't be kept: {error.strerror}",
            hint="Ask again after the time in Retry-After. Whoever runs the service looks whether "
            "the disk of its data folder is full.",
            stage="storage",
            retry_after=_RETRY_AFTER,
        )


@dataclass(frozen=True)
class PreparedRobot:
    """A robot that was built.

    Args:
        answer: Model of the robot as the service answers it, JSON.
        packed_chain: Chain of the robot, pickled; `chain` is the same as a value.
        packed_geometry: Solids of the robot, pickled; `geometry` is the same as a value.
    """

    answer: bytes
    packed_chain: bytes
    packed_geometry: bytes

    @cached_property
    def chain(self) -> Chain:
        """The chain; that of the geometry is equal."""
        chain: Chain = pickle.loads(self.packed_chain)
        return chain

    @cached_property
    def geometry(self) -> RobotGeometry:
        """The chain with its solids."""
        geometry: RobotGeometry = pickle.loads(self.packed_geometry)
        return geometry

    @classmethod
    def of(cls, geometry: RobotGeometry, answer: bytes) -> "PreparedRobot":
        """A robot that has just been built."""
        return cls(
            answer,
            pickle.dumps(geometry.chain, pickle.HIGHEST_PROTOCOL),
            pickle.dumps(geometry, pickle.HIGHEST_PROTOCOL),
        )


def write(reference: Reference, value: PreparedRobot | Scene) -> None:
    """Keep what was built; another process sees all of the file or nothing.

    Raises:
        FolderUnusable: The folder can't be written to.
    """
    if isinstance(value, PreparedRobot):
        parts: tuple[bytes, ...] = (value.answer, value.packed_chain, value.packed_geometry)
    else:
        parts = (pickle.dumps(value, pickle.HIGHEST_PROTOCOL),)
    _write(prepared_file(reference), parts)


def write_visuals(reference: Reference, value: VisualGeometry) -> None:
    """Keep the visual geometry of a robot.

    Raises:
        FolderUnusable: The folder can't be written to.
    """
    _write(visual_file(reference), (pickle.dumps(value, pickle.HIGHEST_PROTOCOL),))


def read_visuals(reference: Reference) -> VisualGeometry:
    """The visual geometry of a robot.

    Raises:
        NotPrepared: There is no usable file.
    """
    visuals: VisualGeometry = _unpickled(visual_file(reference), reference)[0]
    return visuals


def _write(file: Path, parts: tuple[bytes, ...]) -> None:
    """Write a file whole or not at all."""
    try:
        write_kept(file, pickle.dumps((_format(), parts), pickle.HIGHEST_PROTOCOL))
    except OSError as error:
        raise FolderUnusable(error) from error


def read_robot(reference: Reference) -> PreparedRobot:
    """The robot of a reference.

    Raises:
        NotPrepared: There is no usable file.
    """
    return PreparedRobot(*_read_entry(prepared_file(reference), reference))


def read_scene_and_size(reference: Reference) -> tuple[Scene, int]:
    """The scene of a reference, and how many bytes its pickle has.

    Raises:
        NotPrepared: There is no usable file.
    """
    return _unpickled(prepared_file(reference), reference)


def _unpickled(file: Path, reference: Reference) -> tuple[Any, int]:
    """The one value of a file, and how many bytes its pickle has."""
    (packed,) = _read_entry(file, reference)
    try:
        return pickle.loads(packed), len(packed)
    except Exception:  # noqa: BLE001  written by this version and yet unreadable: built anew
        raise NotPrepared(reference) from None


def _read_entry(file: Path, reference: Reference) -> tuple[bytes, ...]:
    parts: tuple[bytes, ...]
    content = read_kept(file)
    if content is None:
        raise NotPrepared(reference)
    try:
        written, parts = pickle.loads(content)
    except Exception:  # noqa: BLE001  of another version: built anew
        raise NotPrepared(reference) from None
    if written != _format():
        raise NotPrepared(reference)
    return parts

"""Files of a robot's spheres and grids, for later processes on this machine."""

import contextlib
from pathlib import Path

import numpy as np

from compiled.compiler import store
from compiled.kept_file import is_kept, write_kept
from obstacles.kept_files import keep_files_in, written_files
from obstacles.robots.robot_geometry import RobotGeometry


def kept_solids() -> Path:
    """Folder of what is kept of built-in robots: beside this user's machine code."""
    return store.user_folder() / "solids"


def keep_robot(robot: RobotGeometry) -> None:
    """Read what is kept of a robot's links where it is, and make it where it is not.

    It takes up to 0.9 s to make, which every process would take for itself.
    """
    folder = kept_solids()
    keep_files_in(folder)
    note = folder / f"{robot.content_hash}.kept"
    if is_kept(note):
        return
    from obstacles.collision.checker import Checker  # noqa: PLC0415  seldom needed, and long
    from obstacles.scenes.scene import Scene  # noqa: PLC0415

    with written_files():
        Checker.of(robot, Scene()).clearance(np.zeros(robot.chain.n))
    with contextlib.suppress(OSError):  # made anew each time where nothing can be kept
        write_kept(note, b"")

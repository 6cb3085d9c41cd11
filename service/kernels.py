"""Every kernel that a request can reach, compiled and loaded before there are requests."""

import logging
import os
from pathlib import Path
from typing import NamedTuple

from kinematics.compiled import kernel_build, kernel_list, kernel_store
from kinematics.compiled.kernel_build import BuildFailed, Report
from service import warm_requests

_log = logging.getLogger(__name__)

#: The kernels that the service's tests reach, with the types of their arguments.
LIST = Path(__file__).with_name("kernels.txt")


class Counts(NamedTuple):
    """Outcome of the list of kernels.

    Attributes:
        total: kernels on the list.
        compiled: those of them that had to be compiled.
        outdated: lines of the list that name a kernel or a type that is not there, and what went
            wrong with kernels that can't be compiled for the listed types any more.
    """

    total: int
    compiled: int
    outdated: tuple[str, ...]


def compile_kernels(report: Report = lambda *_: None, processes: int | None = None) -> Counts:
    """Compile the kernels of the list that are not on disk.

    Args:
        report: called at the beginning and after each kernel; not at all if nothing is missing.
        processes: how many compile at once; one a core if left out.

    Raises:
        BuildFailed: a process that compiled kernels died.
    """
    entries, outdated = kernel_list.read(LIST)
    missing = kernel_build.missing_entries(entries)
    if missing:
        processes = processes or len(os.sched_getaffinity(0))
        outdated = [*outdated, *kernel_build.build(missing, processes, report)]
    return Counts(len(entries), len(missing), tuple(outdated))


def prepare(report: Report) -> None:
    """Make this process able to answer any request without compiling.

    A list of kernels that does not fit the code costs time, and no request: what it lacks is found
    by requests of our own.

    Args:
        report: as for `compile_kernels`.
    """
    if load_kernels():
        return
    try:
        compile_kernels(report)
    except BuildFailed as error:
        _log.warning("kernels could not be compiled: %s", error)
    if not load_kernels():
        _log.warning("the list of kernels does not fit the code; `make kernel-list` writes it anew")
        for _ in warm_requests.steps():
            pass


def load_kernels() -> bool:
    """Load the kernels of the list that Python calls, as far as they are on disk.

    Returns:
        Whether that is all of them.
    """
    entries, unknown = kernel_list.read(LIST)
    complete = kernel_list.load([entry for entry in entries if entry.door])
    return complete and not any(map(kernel_list.called_by_python, unknown))


def keep_in_package() -> None:
    """Have this process keep what it compiles where every user of the installation finds it."""
    os.environ["NUMBA_CACHE_DIR"] = str(kernel_store.shipped_folder())


def prune() -> int:
    """Remove the machine code that the list does not name from the user's folder.

    Returns:
        How many files that were.
    """
    entries, _ = kernel_list.read(LIST)
    return kernel_store.prune({name for entry in entries for name in entry.files})

"""Every kernel that a request can reach, compiled and loaded before there are requests."""

import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from compiled.compiler import build, kernel_list, store
from compiled.compiler.build import BuildFailed, Report
from compiled.compiler.kernel_list import Entry
from service.warm_up import warm_requests

_log = logging.getLogger(__name__)

#: The kernels that the service's tests reach, with the types of their arguments.
LIST = Path(__file__).parents[1] / "kernels.txt"
#: Names of those that Python calls in the demonstration, half of all with what they call.
FIRST = Path(__file__).parents[1] / "first_kernels.txt"
#: Set to 1, it makes the service ready once the kernels of the demonstration are there; what other
#: requests need is compiled when they come.
FIRST_ONLY = "ARMWRIGHT_KERNELS_FIRST"


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


def compile_kernels(
    report: Report = lambda *_: None, processes: int | None = None, *, first_only: bool = False
) -> Counts:
    """Compile the kernels of the list that are not on disk.

    Args:
        report: called at the beginning and after each kernel; not at all if nothing is missing.
        processes: how many compile at once; one a core if left out.
        first_only: only those that the demonstration reaches.

    Raises:
        BuildFailed: a process that compiled kernels died.
    """
    entries, outdated = _listed(first_only)
    missing = build.missing_entries(entries)
    if missing:
        processes = processes or len(os.sched_getaffinity(0))
        outdated = [*outdated, *build.build(missing, processes, report)]
    return Counts(len(entries), len(missing), tuple(outdated))


def count_missing() -> int:
    """Count the kernels of the list that are not on disk."""
    entries, _ = kernel_list.read(LIST)
    return len(build.missing_entries(entries))


def prepare(report: Report) -> None:
    """Make this process able to answer any request without compiling.

    With ARMWRIGHT_KERNELS_FIRST=1 only the requests of the demonstration: what others need, they
    compile. Where the list of kernels does not fit the code, requests of our own compile what plain
    ones need, and others what they lack.

    Args:
        report: as for `compile_kernels`.
    """
    first_only = _first_only()
    if load_kernels(first_only=first_only):
        return
    try:
        compile_kernels(report, first_only=first_only)
    except BuildFailed as error:
        _log.warning("kernels could not be compiled: %s", error)
    if not load_kernels(first_only=first_only) and not first_only:
        _log.warning("the list of kernels does not fit the code; `make kernel-list` writes it anew")
        for _ in warm_requests.steps():
            pass


def enrich() -> Iterator[None]:
    """Steps that prepare more than compiled code; none where only first kernels are there."""
    if not _first_only():
        yield from warm_requests.steps()


def load_kernels(*, first_only: bool = False) -> bool:
    """Load the kernels of the list that Python calls, as far as they are on disk.

    Args:
        first_only: only those that the demonstration reaches.

    Returns:
        Whether that is all of them.
    """
    entries, unknown = _listed(first_only)
    complete = kernel_list.load([entry for entry in entries if entry.door])
    return complete and not any(map(kernel_list.called_by_python, unknown))


def keep_in_package() -> None:
    """Have this process keep what it compiles where every user of the installation finds it."""
    os.environ["NUMBA_CACHE_DIR"] = str(store.shipped_folder())


def prune() -> int:
    """Remove the machine code that the list does not name from the user's folder.

    Returns:
        How many files that were.
    """
    entries, _ = kernel_list.read(LIST)
    return store.prune({name for entry in entries for name in entry.files})


def first_names() -> frozenset[str]:
    """Names of the kernels that Python calls in the demonstration."""
    lines = FIRST.read_text("utf-8").splitlines()
    return frozenset(line for line in lines if line and not line.startswith("#"))


def _listed(first_only: bool) -> tuple[list[Entry], list[str]]:
    entries, unknown = kernel_list.read(LIST)
    return kernel_list.needed_by(first_names(), entries) if first_only else entries, unknown


def _first_only() -> bool:
    return os.environ.get(FIRST_ONLY, "") not in ("", "0")

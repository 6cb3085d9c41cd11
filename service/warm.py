"""Loads or compiles every kernel, so that no request has to wait for it."""

import importlib
import time
from functools import cache

from service.workers.fork_server import Report
from service.workers.launch import Recipe

#: What the service's workers need.
RECIPE = Recipe(modules=("service.tasks",), warm="service.warm:warm")
#: Functions ``"module:name"`` without arguments that make kernels ready; called in this order.
WARMERS: tuple[str, ...] = (
    "service.tasks.kinematics:warm",
    "service.tasks.dynamics:warm",
    "service.warm_requests:builtin_robots",
    "service.warm_requests:requests",
)


def warm(report: Report) -> None:  # noqa: ARG001
    """Make this process able to answer any request at once."""
    warm_kernels()


def warm_kernels() -> dict[str, float]:
    """Call every warmer that was not called yet in this process, or before it was forked.

    Returns:
        How long each took [s].
    """
    return {warmer: _warm(warmer) for warmer in WARMERS}


@cache
def _warm(warmer: str) -> float:
    module, _, name = warmer.partition(":")
    start = time.perf_counter()
    getattr(importlib.import_module(module), name)()
    return time.perf_counter() - start

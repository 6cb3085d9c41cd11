"""Compiles or loads every kernel, so that no request has to wait for it."""

import importlib
import time

#: Functions ``"module:name"`` without arguments that make kernels ready; called in this order.
WARMERS: tuple[str, ...] = ()


def warm_kernels() -> dict[str, float]:
    """Call every warmer; the second time in a process there is nothing left to do.

    Returns:
        How long each took [s].
    """
    seconds: dict[str, float] = {}
    for warmer in WARMERS:
        module, _, name = warmer.partition(":")
        start = time.perf_counter()
        getattr(importlib.import_module(module), name)()
        seconds[warmer] = time.perf_counter() - start
    return seconds

"""Ctrl-C: a command ends at once and in silence, whatever is being loaded or computed."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

#: Exit code of a command that Ctrl-C ended, as shells have it.
INTERRUPTED = 130
#: Time after which a command that goes on is interrupted again [s], and how often.
_PERIOD, _MOST = 1.0, 3
_state = {"times": 0}


def interrupted() -> bool:
    """Whether Ctrl-C was pressed."""
    return _state["times"] > 0


@contextmanager
def ends_quietly() -> Iterator[None]:
    """Note Ctrl-C, which raises `KeyboardInterrupt` as ever; show no faults that follow from it.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed, whatever it made of the block.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _state["times"] = 0
    before = signal.signal(signal.SIGINT, _note)
    try:
        yield
    except BaseException:
        if not interrupted():
            raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        if not interrupted():
            signal.signal(signal.SIGINT, before)
    if interrupted():
        # Where it was raised inside of an exec, Python ends by the signal, until the next exec.
        exec("")
        raise KeyboardInterrupt


def _note(*_: Any) -> None:
    """Interrupt; libraries in C++ may lose it in a callback, so that it comes again."""
    _state["times"] += 1
    if _state["times"] > _MOST:
        os._exit(INTERRUPTED)
    sys.unraisablehook = lambda _: None
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the end is under way
    signal.signal(signal.SIGALRM, _note)
    signal.setitimer(signal.ITIMER_REAL, _PERIOD)
    raise KeyboardInterrupt

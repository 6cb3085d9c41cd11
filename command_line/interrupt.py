"""Ctrl-C: a command ends at once and in silence, whatever is being loaded or computed."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_state = {"interrupted": False}


def interrupted() -> bool:
    """Whether Ctrl-C was pressed."""
    return _state["interrupted"]


@contextmanager
def ends_quietly() -> Iterator[None]:
    """Note Ctrl-C, which raises `KeyboardInterrupt` as ever; show no faults that follow from it.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed, whatever it made of the block.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _state["interrupted"] = False
    before = signal.signal(signal.SIGINT, _note)
    try:
        yield
    except BaseException:
        if interrupted():
            raise KeyboardInterrupt from None
        raise
    finally:
        if not interrupted():
            signal.signal(signal.SIGINT, before)


def _note(*_: Any) -> None:
    _state["interrupted"] = True
    sys.unraisablehook = lambda _: None
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the end is under way
    raise KeyboardInterrupt

"""Progress of a long piece of work, on a terminal or in a log."""

import time
from typing import TextIO

#: A terminal is written to at most this often, a file or pipe more seldom [s].
_TERMINAL_PERIOD = 0.2
_FILE_PERIOD = 10.0


def progress_text(done: int, total: int, seconds_left: float | None) -> str:
    """Number of compiled kernels of all, and the time that the rest may take."""
    text = f"Compiling kernels: {done} of {total}"
    return text if seconds_left is None else f"{text}, about {seconds_left:.0f} s left"


class Terminal:
    """Shows progress: in one line of a terminal, or in a few lines of a file.

    Args:
        stream: where to write.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._same_line = stream.isatty()
        self._start = time.monotonic()
        self._next = 0.0

    def show(self, done: int, total: int, seconds_left: float | None) -> None:
        """Show how far the work has come, unless that was shown just now."""
        now, ends = time.monotonic(), done == total
        if not ends and now < self._next:
            return
        self._next = now + (_TERMINAL_PERIOD if self._same_line else _FILE_PERIOD)
        text = progress_text(done, total, seconds_left)
        if ends:
            text = f"{progress_text(done, total, None)} in {now - self._start:.0f} s"
        if self._same_line:
            self._stream.write(f"\r\x1b[K{text}" + ("\n" if ends else ""))
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

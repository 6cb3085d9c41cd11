"""The entry point of the command ``armwright``.

Commands of the server start as quickly as before: nothing that they do not need is imported.
"""

import gc
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from command_line.interrupt import INTERRUPTED, ends_quietly

#: Commands that `service.cli` parses.
SERVER_COMMANDS = ("serve", "agent", "warm", "keys", "audit")

#: Commands that run until Ctrl-C, and then end what they have started.
_ENDED_BY_CTRL_C = ("studio", "mcp")

#: New objects after which garbage is searched for while a command runs.
_COLLECTED_AFTER = 200_000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and give the exit code.

    Args:
        arguments: Arguments of the command line, without the program's name.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words and words[0] in (*SERVER_COMMANDS, *_ENDED_BY_CTRL_C):
        return _run(words)
    try:
        with ends_quietly(), _seldom_collected():
            return _run(words)
    except KeyboardInterrupt:
        return INTERRUPTED


@contextmanager
def _seldom_collected() -> Iterator[None]:
    """Search for garbage seldom: what a command imports stays, and searching it takes long."""
    before = gc.get_threshold()
    gc.set_threshold(_COLLECTED_AFTER, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


def _run(words: list[str]) -> int:
    if words and words[0] in SERVER_COMMANDS:
        from service.cli import main as server_main  # noqa: PLC0415

        return server_main(words)
    from command_line.app import run  # noqa: PLC0415

    return run(words)


if __name__ == "__main__":
    sys.exit(main())

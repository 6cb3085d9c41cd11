"""The command line: ``armwright serve``, ``agent``, ``warm``, ``keys`` and ``audit``.

Only what parsing needs is imported at first: no command waits for what another one needs.
"""

import argparse
import math
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and give the exit code."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    if chosen.version:
        from service.version import VERSION  # noqa: PLC0415

        print(f"armwright {VERSION}")
        return 0
    if chosen.command is None:
        parser.print_help()
        return 2
    if chosen.command in ("keys", "audit"):
        from service import keys_command  # noqa: PLC0415

        return keys_command.run(chosen)
    if chosen.command == "warm":
        return _warm(chosen)
    given = {name: value for name, value in vars(chosen).items() if value is not None}
    options = {name: given[name] for name in _SERVE_OPTIONS if name in given}
    is_agent = chosen.command == "agent"
    if is_agent and "ARMWRIGHT_PORT" not in os.environ:
        options.setdefault("port", AGENT_PORT)
    return _serve(options, is_agent=is_agent)


def _serve(options: dict[str, Any], *, is_agent: bool) -> int:
    from service.task_references import RECIPE  # noqa: PLC0415
    from service.workers.fork.launch import launch  # noqa: PLC0415

    # What takes longest begins first: it loads while the server is imported here.
    launched = launch(RECIPE)
    from service.server import serve  # noqa: PLC0415

    code = serve(options, launched, is_agent=is_agent)
    if launched.process.poll() is None:  # no application took it over
        launched.end()
    return code


#: Port of an agent's health and metrics, unless another one is named.
AGENT_PORT = 8001
_SERVE_OPTIONS = ("host", "port", "data_dir", "workers", "log_level", "insecure")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="armwright", description="Certified motion planning for robot arms over HTTP."
    )
    parser.add_argument("--version", action="store_true", help="print the version")
    commands = parser.add_subparsers(dest="command", metavar="command")
    serve = commands.add_parser(
        "serve",
        help="answer requests until SIGTERM",
        description="Answer requests until SIGTERM. Every setting is also an environment variable, "
        "ARMWRIGHT_HOST for --host and so on; the command line wins.",
    )
    serve.add_argument("--port", type=int, help="port to listen on, 0 for a free one (8000)")
    serve.add_argument("--data-dir", type=Path, help="folder of the database (the user's data)")
    serve.add_argument(
        "--insecure",
        action="store_true",
        default=None,
        help="listen beyond this machine though there are no API keys",
    )
    agent = commands.add_parser(
        "agent",
        help="work on jobs of servers that share a database, until SIGTERM",
        description="Work on the jobs that servers with ARMWRIGHT_JOBS=agents accept, until "
        "SIGTERM. ARMWRIGHT_DATABASE_URL names the PostgreSQL database of them all; every other "
        "setting is an environment variable as for serve. The port answers /healthz, /readyz and "
        "/metrics.",
    )
    agent.add_argument("--port", type=int, help=f"port, 0 for a free one ({AGENT_PORT})")
    agent.add_argument("--data-dir", type=Path, help="folder of prepared robots and scenes")
    for server in (serve, agent):
        server.add_argument("--host", help="address to listen on (127.0.0.1)")
        server.add_argument("--workers", type=int, help="worker processes (one a core)")
        server.add_argument("--log-level", choices=("debug", "info", "warning", "error"))
    warm = commands.add_parser(
        "warm",
        help="compile all kernels into their cache on disk",
        description="Compile every kernel that a request can reach, one process a core. What is "
        "on disk already stays, so that an interrupted run goes on where it stopped.",
    )
    warm.add_argument("--processes", type=int, help="how many compile at once (one a core)")
    warm.add_argument(
        "--in-package",
        action="store_true",
        help="keep them beside the code, where every user of this installation finds them",
    )
    warm.add_argument(
        "--prune",
        action="store_true",
        help="afterwards remove the user's machine code that this version does not need",
    )
    warm.add_argument(
        "--first",
        action="store_true",
        help="only those that a first plan needs, as `make demo` does",
    )
    _add_keys(commands)
    return parser


def _add_keys(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    keys = commands.add_parser(
        "keys",
        help="make, list and revoke API keys",
        description="Make, list and revoke API keys. From the first one on the service answers "
        "nobody without one.",
    )
    actions = keys.add_subparsers(dest="keys", metavar="action", required=True)
    create = actions.add_parser("create", help="make a key and print it, this one time")
    create.add_argument("--name", required=True, help="what it is for")
    create.add_argument("--tenant", default="default", help="whose robots and jobs it shows")
    create.add_argument(
        "--scope",
        choices=("read", "plan", "admin"),
        default="plan",
        help="read; also plan and run jobs; also change robots and scenes (plan)",
    )
    create.add_argument("--days", type=_positive, help="how long it is valid (for ever)")
    create.add_argument("--rate", type=_count, help="requests a minute")
    create.add_argument("--jobs", type=_count, help="jobs that may wait or run")
    create.add_argument("--storage", type=_count, help="size of robots and scenes [byte]")
    listing = actions.add_parser("list", help="list all keys, without their secrets")
    revoke = actions.add_parser("revoke", help="refuse a key from now on")
    revoke.add_argument("id", help="the part of the key between aw_ and the next _")
    audit = commands.add_parser("audit", help="show who changed robots, scenes and keys")
    audit.add_argument("--limit", type=_count, default=100, help="how many entries (100)")
    for parser in (create, listing, revoke, audit):
        parser.add_argument("--data-dir", type=Path, help="folder of the database")


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise ValueError
    return value


def _count(text: str) -> int:
    value = int(text)
    if value < 1:
        raise ValueError
    return value


def _warm(chosen: argparse.Namespace) -> int:
    from service.warm_up import kernels  # noqa: PLC0415

    if chosen.in_package:
        kernels.keep_in_package()
    show = Terminal(sys.stderr).show
    counts = kernels.compile_kernels(show, chosen.processes, first_only=chosen.first)
    print(f"{counts.total} kernels are there, {counts.compiled} of them compiled now")
    others = kernels.count_missing() if chosen.first else 0
    if others:
        print(f"{others} more, which other requests need, the first service or `warm` will compile")
    for line in counts.outdated:
        print(f"the list of kernels is out of date: {line}", file=sys.stderr)
    if chosen.prune:
        print(f"{kernels.prune()} files removed that this version does not need")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The command line: ``armwright serve``, ``armwright warm``.

Only what parsing needs is imported at first: no command waits for what another one needs.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any


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
    if chosen.command == "warm":
        return _warm(chosen.processes, chosen.in_package, chosen.prune)
    given = {name: value for name, value in vars(chosen).items() if value is not None}
    return _serve({name: given[name] for name in _SERVE_OPTIONS if name in given})


def _serve(options: dict[str, Any]) -> int:
    from service.recipe import RECIPE  # noqa: PLC0415
    from service.workers.launch import launch  # noqa: PLC0415

    # What takes longest begins first: it loads while the server is imported here.
    launched = launch(RECIPE)
    from service.server import serve  # noqa: PLC0415

    code = serve(options, launched)
    if launched.process.poll() is None:  # no application took it over
        launched.end()
    return code


_SERVE_OPTIONS = ("host", "port", "data_dir", "workers", "log_level")


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
    serve.add_argument("--host", help="address to listen on (127.0.0.1)")
    serve.add_argument("--port", type=int, help="port to listen on, 0 for a free one (8000)")
    serve.add_argument("--data-dir", type=Path, help="folder of the database (the user's data)")
    serve.add_argument("--workers", type=int, help="worker processes (one a core)")
    serve.add_argument("--log-level", choices=("debug", "info", "warning", "error"))
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
    return parser


def _warm(processes: int | None, in_package: bool, prune: bool) -> int:
    from service import kernels  # noqa: PLC0415
    from service.progress import Terminal  # noqa: PLC0415

    if in_package:
        kernels.keep_in_package()
    counts = kernels.compile_kernels(Terminal(sys.stderr).show, processes)
    print(f"{counts.total} kernels are there, {counts.compiled} of them compiled now")
    for line in counts.outdated:
        print(f"the list of kernels is out of date: {line}", file=sys.stderr)
    if prune:
        print(f"{kernels.prune()} files removed that this version does not need")
    return 0


if __name__ == "__main__":
    sys.exit(main())

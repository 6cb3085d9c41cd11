"""The commands that typer parses: all but those of the server."""

from collections.abc import Sequence
from importlib import import_module
from typing import Annotated

import typer

from command_line.output import print_line
from command_line.problems import ExitCode

#: Help of the commands that `service.cli` parses, before typer is imported.
_SERVER = {
    "serve": "Answer requests over HTTP until SIGTERM.",
    "agent": "Work on jobs of servers that share a database, until SIGTERM.",
    "warm": "Compile all kernels into their cache on disk.",
    "keys": "Make, list and revoke API keys.",
    "audit": "Show who changed robots, scenes and keys.",
}
#: Every word behind a command of the server is for its own parser.
_PASSED_ON = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
#: Modules of the commands, which are imported for the command that runs, in the order of the help.
_MODULES = {
    "plan": "motions",
    "ik": "kinematics",
    "fk": "kinematics",
    "jacobian": "formulas",
    "pose": "formulas",
    "equations": "formulas",
    "check": "motions",
    "validate": "motions",
    "witness": "motions",
    "retime": "motions",
    "simulate": "motions",
    "reach": "kinematics",
    "excite": "identify",
    "identify": "identify",
    "calibrate": "identify",
    "fit": "identify",
    "task": "task",
    "tour": "task",
    "project": "files",
    "convert": "motions",
    "export": "files",
    "sweep": "files",
    "view": "view",
    "replay": "view",
    "studio": "studio",
    "mcp": "studio",
    "robots": "robots",
    "scenes": "robots",
    "bench": "bench",
    "doctor": "doctor",
}


def run(words: Sequence[str]) -> int:
    """Run a command and give the exit code.

    Args:
        words: Arguments of the command line.
    """
    try:
        _app(words)(args=list(words), prog_name="armwright")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else ExitCode.SUCCESS
    return ExitCode.SUCCESS


def _app(words: Sequence[str]) -> typer.Typer:
    app = typer.Typer(
        help="Certified motion planning for robot arms.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback()(_options)
    for name in words[:1] if words and words[0] in _MODULES else _MODULES:
        module = import_module(f"{__package__}.commands.{_MODULES[name]}")
        app.command(name)(getattr(module, name))
    for name, text in _SERVER.items():
        app.command(name, help=text, rich_help_panel="Server", context_settings=_PASSED_ON)(_serve)
    return app


def _show_version(wanted: bool) -> None:
    if wanted:
        from service.version import VERSION  # noqa: PLC0415

        print_line(f"armwright {VERSION}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Certified motion planning for robot arms."""


def _serve(context: typer.Context) -> None:
    """Hand a command of the server to its own parser."""
    from service.cli import main  # noqa: PLC0415

    raise typer.Exit(main([str(context.info_name), *context.args]))

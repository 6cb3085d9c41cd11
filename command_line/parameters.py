"""Parameters that commands share, as groups that a command's signature names once."""

import inspect
from collections.abc import Callable
from contextvars import copy_context
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_type_hints

import typer

from command_line.problems import shows_problems


class Connection(NamedTuple):
    """Place of the computation and form of the answer."""

    url: Annotated[
        str | None,
        typer.Option(
            envvar="ARMWRIGHT_URL", help="Address of a service; computed here if left out."
        ),
    ] = None
    token: Annotated[
        str | None, typer.Option(envvar="ARMWRIGHT_TOKEN", help="API key of that service.")
    ] = None
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the answer of the API instead of tables.")
    ] = False


class RobotSource(NamedTuple):
    """The robot of a command, and what its description leaves open."""

    robot: Annotated[
        str,
        typer.Argument(
            help="Name of a robot, or path of a URDF, .xacro or MJCF, a folder with one, a .zip, "
            "or the JSON of an upload, or example-robot-data:NAME for a URDF of that package."
        ),
    ]
    srdf: Annotated[Path | None, typer.Option(help="SRDF file that belongs to the URDF.")] = None
    xacro: Annotated[
        list[str] | None,
        typer.Option(help="Argument of a .xacro file as name:=value; may be given several times."),
    ] = None
    base_link: Annotated[str | None, typer.Option(help="Link that the chain begins at.")] = None
    tip_link: Annotated[str | None, typer.Option(help="Last link of the chain.")] = None
    joint_limits: Annotated[
        Path | None, typer.Option(help="Limits by joint, JSON or MoveIt's joint_limits.yaml.")
    ] = None
    default_limits: Annotated[
        str | None,
        typer.Option(
            help="Rules for limits that are missing: acceleration=10 x velocity,"
            "jerk=10 x acceleration."
        ),
    ] = None
    allow_suspected: Annotated[
        bool,
        typer.Option(
            "--allow-suspected",
            help="Let pairs of links touch that the lint of `armwright robots` suspects.",
        ),
    ] = False
    visual_solids: Annotated[
        bool,
        typer.Option(
            "--visual-solids", help="Links without collision geometry collide as they look."
        ),
    ] = False


class Request(NamedTuple):
    """Deadline of a request, and any further fields of it."""

    timeout: Annotated[
        float | None, typer.Option(help="Deadline [s]; 10 if left out.", min=0.001)
    ] = None
    fields: Annotated[
        Path | None,
        typer.Option(help="JSON file with further fields of the request, as the API has them."),
    ] = None
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the answer to this file.")
    ] = None


Scene = Annotated[
    str | None, typer.Option(help="JSON or MoveIt YAML file; with --url also a stored scene.")
]
Margin = Annotated[float, typer.Option(help="Distance to keep from obstacles [m].", min=0.0)]
Tool = Annotated[
    str | None,
    typer.Option(
        help="Tool on the robot: a built-in one (parallel_jaw, three_jaw, suction_cup, torch, "
        "spindle), JSON or its file; with --url also a stored one."
    ),
]
Tip = Annotated[
    str | None,
    typer.Option(help='Its tip, or that of a held object: {"object": id, "pose": ...}.'),
]


class Recorded(NamedTuple):
    """Motion of a recording that is meant, where it holds several."""

    topic: Annotated[str | None, typer.Option(help="Topic of a rosbag or MCAP file.")] = None
    prefix: Annotated[str | None, typer.Option(help="Text before the joints' names there.")] = None
    span: Annotated[
        str | None, typer.Option(help="First and last instant between commas, 0 being the first.")
    ] = None


class Mounted(NamedTuple):
    """The tool that the robot works with."""

    tool: Tool = None
    tcp: Tip = None


class Cell(NamedTuple):
    """The tool that the robot works with, and what is around it."""

    tool: Tool = None
    tcp: Tip = None
    scene: Scene = None
    margin: Margin = 0.0


def command(function: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameter groups are spread out, and whose problems are shown.

    Args:
        function: Takes values and groups (named tuples of annotated fields), mostly `Connection`.
    """
    hints = get_type_hints(function, include_extras=True)
    groups: dict[str, Any] = {}
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(function).parameters.values():
        kind = hints[parameter.name]
        if hasattr(kind, "_fields"):
            groups[parameter.name] = kind
            parameters += _fields(kind)
        else:
            parameters.append(parameter.replace(kind=parameter.KEYWORD_ONLY, annotation=kind))

    def run(**values: Any) -> None:
        arguments = dict(values)
        for name, kind in groups.items():
            arguments[name] = kind(**{field: arguments.pop(field) for field in kind._fields})
        with shows_problems(values.get("as_json", False)):
            # In a context of its own, which ends with what the command has printed.
            copy_context().run(function, **arguments)

    run.__name__ = function.__name__
    run.__doc__ = inspect.getdoc(function)
    run.__annotations__ = {item.name: item.annotation for item in parameters}
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def _fields(kind: Any) -> list[inspect.Parameter]:
    """Fields of a group as parameters."""
    hints = get_type_hints(kind, include_extras=True)
    return [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=kind._field_defaults.get(name, inspect.Parameter.empty),
            annotation=hints[name],
        )
        for name in kind._fields
    ]

"""The commands ``armwright robots`` and ``armwright scenes``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from command_line import values
from command_line.backends.backend import Backend, connect
from command_line.output import print_answer, print_line, print_notes, print_table
from command_line.parameters import Connection, RobotSource, command
from command_line.problems import invalid_value
from command_line.robot_files import valid_name

_LIMITS = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")


@command
def robots(
    connection: Connection,
    words: Annotated[
        list[str] | None,
        typer.Argument(
            help="A robot by name or file to show; add, and a file, folder or public name to add; "
            "remove, and a name. All robots if left out."
        ),
    ] = None,
    xacro: Annotated[
        list[str] | None, typer.Option(help="Argument of a .xacro file as name:=value.")
    ] = None,
    tip_link: Annotated[
        str | None, typer.Option(help="Last link of the chain of a robot that is added.")
    ] = None,
    default_limits: Annotated[
        str | None, typer.Option(help="Rules for limits that a robot that is added does not have.")
    ] = None,
    kept_as: Annotated[
        str | None, typer.Option("--as", help="Name to add a robot under, in place of its own.")
    ] = None,
) -> None:
    """List robots; show joints, limits, named states and lint of one; add or remove one."""
    with connect(connection) as backend:
        match words or []:
            case []:
                rows = backend.robot_names()
            case ["add", name]:
                source = RobotSource(
                    name, xacro=xacro, tip_link=tip_link, default_limits=default_limits
                )
                _add(backend, source, kept_as, connection.as_json)
                return
            case ["remove", name]:
                backend.forget_robot(name)
                return
            case [robot]:
                name = backend.robot_name(RobotSource(robot, xacro=xacro))
                _show_robot(backend.robot_model(name), connection.as_json)
                return
            case _:
                hint = "Give one robot, `add` and what to add, or `remove` and a name."
                raise invalid_value("robots", "these are too many words", hint)
    print_answer({"robots": rows}, connection.as_json)
    print_table(
        "Robots",
        ("name", "joints", "built in"),
        ((row["name"], row["joints"], row["built_in"]) for row in rows),
    )


def _add(backend: Backend, source: RobotSource, kept_as: str | None, as_json: bool) -> None:
    """Add a robot of a description, and tell whose it is."""
    from command_line.added_robots import document_of, find  # noqa: PLC0415

    found = find(source.robot)
    name = kept_as or valid_name(Path(source.robot).name.partition(".")[0])
    kept = backend.keep_robot(document_of(found, source, name))
    told = {"name": name, "source": found.source, "licence": found.licence, "kept": kept}
    print_answer(told, as_json)
    print_line(f"{name}: kept in {kept}")
    print_line(f"source: {found.source}")
    print_line(f"licence: {found.licence or 'none is told; ask its authors before you use it'}")


def _show_robot(model: dict[str, Any], as_json: bool) -> None:
    print_answer(model, as_json)
    limits, states = model["limits"], model["states"]
    names, types = model["joint_names"], model["joint_types"]
    rows = ((name, types[i], *(limits[key][i] for key in _LIMITS)) for i, name in enumerate(names))
    title = f"{model['name']}: from {model['base_link']} to {model['tip_link']}"
    print_table(title, ("joint", "type", *_LIMITS), rows)
    if states:
        print_table("Named states", ("state", "joints"), states.items())
    print_notes(model["lint"])


@command
def scenes(
    connection: Connection,
    file: Annotated[
        str | None, typer.Argument(help="A scene file to show; stored scenes if left out.")
    ] = None,
) -> None:
    """List the stored scenes, or show the obstacles of a scene file."""
    if file is not None:
        _show_scene(file, connection.as_json)
        return
    with connect(connection) as backend:
        rows = backend.scenes()
    print_answer({"scenes": rows}, connection.as_json)
    print_table(
        "Scenes",
        ("name", "version", "hash"),
        ((row["name"], row["version"], row["hash"][:12]) for row in rows),
    )


def _show_scene(file: str, as_json: bool) -> None:
    from armwright_wire.scenes.scene import Scene  # noqa: PLC0415
    from service.translate import poses  # noqa: PLC0415
    from service.validation import validate_as  # noqa: PLC0415

    obstacles = poses.scene(validate_as(Scene, values.scene(file))).obstacles
    rows = [
        {
            "id": obstacle.id,
            "shape": type(obstacle.shape).__name__.lower(),
            "position": [float(value) for value in obstacle.T_world_obstacle[:3, 3]],
            "margin": obstacle.margin,
        }
        for obstacle in obstacles
    ]
    print_answer({"obstacles": rows}, as_json)
    columns = ("id", "shape", "position", "margin")
    print_table(file, columns, ([row[column] for column in columns] for row in rows))

"""The commands ``armwright robots`` and ``armwright scenes``."""

from typing import Annotated

import typer

from command_line import values
from command_line.backends.backend import connect
from command_line.output import print_json, print_line, print_table
from command_line.parameters import Connection, RobotSource, command

_LIMITS = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")


@command
def robots(
    connection: Connection,
    robot: Annotated[
        str | None, typer.Argument(help="A robot by name or file; all robots if left out.")
    ] = None,
    xacro: Annotated[
        list[str] | None, typer.Option(help="Argument of a .xacro file as name:=value.")
    ] = None,
) -> None:
    """List robots, or show joints, limits, named states and lint of one."""
    with connect(connection) as backend:
        if robot is not None:
            name = backend.robot_name(RobotSource(robot, xacro=xacro))
            _show_robot(backend.robot_model(name), connection.as_json)
            return
        rows = backend.robot_names()
    if connection.as_json:
        print_json({"robots": rows})
        return
    print_table(
        "Robots",
        ("name", "joints", "built in"),
        ((row["name"], row["joints"], row["built_in"]) for row in rows),
    )


def _show_robot(model: dict[str, object], as_json: bool) -> None:
    if as_json:
        print_json(model)
        return
    limits, states = model["limits"], model["states"]
    names, types = model["joint_names"], model["joint_types"]
    assert isinstance(limits, dict)
    assert isinstance(states, dict)
    assert isinstance(names, list)
    assert isinstance(types, list)
    rows = ((name, types[i], *(limits[key][i] for key in _LIMITS)) for i, name in enumerate(names))
    title = f"{model['name']}: from {model['base_link']} to {model['tip_link']}"
    print_table(title, ("joint", "type", *_LIMITS), rows)
    if states:
        print_table("Named states", ("state", "joints"), states.items())
    lint = model["lint"]
    assert isinstance(lint, list)
    for note in lint:
        print_line(f"note: {note}", "yellow")


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
    if connection.as_json:
        print_json({"scenes": rows})
        return
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
    if as_json:
        print_json({"obstacles": rows})
        return
    columns = ("id", "shape", "position", "margin")
    print_table(file, columns, ([row[column] for column in columns] for row in rows))

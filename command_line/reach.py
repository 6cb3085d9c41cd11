"""The command ``armwright reach``."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from command_line import values
from command_line.backend import connect
from command_line.endpoints import REACH
from command_line.output import print_json, print_line, print_table
from command_line.parameters import Connection, Margin, RobotSource, Scene, command
from command_line.robot_files import read_json


@command
def reach(
    connection: Connection,
    robot: RobotSource,
    request: Annotated[
        Path, typer.Argument(help='JSON file with {"poses": [...]} or {"box": ...}.')
    ],
    scene: Scene = None,
    margin: Margin = 0.0,
    timeout: Annotated[float | None, typer.Option(help="Deadline [s]; 10 if left out.")] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File of a mesh; beside the request if left out."),
    ] = None,
) -> None:
    """Say which poses an arm reaches in a scene, and how well."""
    body: dict[str, Any] = read_json(request) | {"margin": margin}
    body |= {} if scene is None else {"scene": values.scene(scene)}
    body |= {} if timeout is None else {"timeout": timeout}
    with connect(connection) as backend:
        name = backend.robot_name(robot)
        answer = backend.answer(REACH, name, body)
    if body.get("format") == "glb":
        file = request.with_suffix(".glb") if output is None else output
        file.write_bytes(answer)
        print_line(f"{file} has the mesh of what is reached", "bold")
        return
    if connection.as_json or body.get("format") == "svg":
        print_json(answer)
        return
    document = json.loads(answer)
    print_line(f"{document['reached']} of {document['count']} poses are reached", "bold")
    names = document["statuses"]
    if document["grid"] is not None:
        counts = ((name, document["status"].count(i)) for i, name in enumerate(names))
        print_table("Poses", ("status", "poses"), counts)
        return
    rows = zip(
        range(document["count"]),
        (names[status] for status in document["status"]),
        document["branches"],
        document["manipulability"],
        document["clearance"],
        strict=True,
    )
    columns = ("pose", "status", "branches", "manipulability", "clearance [m]")
    print_table("Poses", columns, rows)

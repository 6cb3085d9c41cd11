"""The commands ``armwright pose``, ``armwright jacobian`` and ``armwright equations``."""

import json
from typing import Annotated, Any, Literal

import typer

from command_line import values
from command_line.backends.backend import connect
from command_line.backends.endpoints import CONVERT_POSE, JACOBIAN
from command_line.commands.kinematics import Joints
from command_line.output import print_answer, print_line, print_table
from command_line.parameters import Connection, Mounted, RobotSource, command

Axes = Annotated[
    str | None, typer.Option(help="Rows that count, between commas: x, y, z, rx, ry, rz.")
]


@command
def pose(
    connection: Connection,
    value: Annotated[
        str,
        typer.Argument(
            metavar="POSE",
            help="x,y,z,roll,pitch,yaw or x,y,z,qx,qy,qz,qw [m, rad], or JSON of any form.",
        ),
    ],
    inverse: Annotated[bool, typer.Option("--inverse", help="Invert it first.")] = False,
) -> None:
    """Show a pose, and its rotation, in every form."""
    body = {"pose": values.pose("POSE", value), "inverse": inverse}
    with connect(connection) as backend:
        answer = backend.answer(CONVERT_POSE, None, body)
    print_answer(answer, connection.as_json)
    document = json.loads(answer)
    rows = [item for name, form in document["pose"].items() for item in _rows(name, form)]
    print_table("Pose", ("form", "value [m, rad]"), rows)
    for form in document["singular"]:
        print_line(f"{form.pop('form')} is singular here: {json.dumps(form)}")


@command
def jacobian(
    connection: Connection,
    robot: RobotSource,
    joints: Joints,
    mounted: Mounted,
    link: Annotated[str | None, typer.Option(help="The link; the tip if left out.")] = None,
    frame: Annotated[str | None, typer.Option(help="Frame of the rows; the root's.")] = None,
    axes: Axes = None,
    kind: Annotated[
        str, typer.Option(help="geometric, or analytic_zyz: rates of the ZYZ Euler angles.")
    ] = "geometric",
) -> None:
    """Show the Jacobian of a link, with its rank and singular values."""
    with connect(connection) as backend:
        name = backend.robot_name(robot)
        states = backend.robot_model(name)["states"]
        body: dict[str, Any] = {"joints": values.configuration("--joints", joints, states)}
        given = {"link": link, "frame": frame, "axes": values.words(axes), "kind": kind}
        body |= {field: value for field, value in given.items() if value is not None}
        answer = backend.answer(JACOBIAN, name, body | values.mounted(mounted))
    print_answer(answer, connection.as_json)
    document = json.loads(answer)
    rows = zip(values.words(axes) or values.AXES, document["jacobian"], strict=True)
    print_table(f"Jacobian in {document['frame']}", ("axis", "row"), rows)
    rest = ("rank", "singular_values", "manipulability")
    print_table("", ("", "value"), ((name, document[name]) for name in rest))


@command
def equations(
    connection: Connection,
    robot: RobotSource,
    notation: Annotated[
        Literal["latex", "text"], typer.Option("--format", help="latex or text.")
    ] = "text",
    axes: Axes = None,
) -> None:
    """Print kinematics and dynamics of a robot as formulas, as a page of Markdown."""
    with connect(connection) as backend:
        name = backend.robot_name(robot)
        answer = backend.equations(name, notation, values.words(axes) or [])
    print_answer(answer, connection.as_json)
    print_line(json.loads(answer)["document"])


def _rows(name: str, form: Any) -> list[tuple[str, Any]]:
    """Rows of a table for a vector, for each row of a matrix, or for each branch."""
    if not isinstance(form[0], list):
        return [(name, form)]
    return [(name if number == 0 else "", row) for number, row in enumerate(form)]

"""The commands ``armwright fk``, ``armwright ik`` and ``armwright reach``."""

import json
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from command_line import values
from command_line.backends.backend import connect
from command_line.backends.endpoints import FK, IK, REACH
from command_line.output import print_answer, print_json, print_line, print_table
from command_line.parameters import Cell, Connection, Mounted, RobotSource, command
from command_line.robot_files import read_json


@command
def reach(
    connection: Connection,
    robot: RobotSource,
    request: Annotated[
        Path, typer.Argument(help='JSON file with {"poses": [...]} or {"box": ...}.')
    ],
    cell: Cell,
    timeout: Annotated[float | None, typer.Option(help="Deadline [s]; 10 if left out.")] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File of a mesh; beside the request if left out."),
    ] = None,
) -> None:
    """Say which poses an arm reaches in a scene, and how well."""
    body: dict[str, Any] = read_json(request) | {"margin": cell.margin} | values.mounted(cell)
    body |= {} if cell.scene is None else {"scene": values.scene(cell.scene)}
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


Joints = Annotated[
    str, typer.Option("--joints", "-q", help="Numbers between commas [rad or m], or a named state.")
]


@command
def fk(
    connection: Connection,
    robot: RobotSource,
    joints: Joints,
    mounted: Mounted,
    link: Annotated[str | None, typer.Option(help="Only this link.")] = None,
) -> None:
    """Show the poses of a robot's links at a configuration."""
    with connect(connection) as backend:
        name = backend.robot_name(robot)
        states = backend.robot_model(name)["states"]
        body: dict[str, Any] = {"joints": values.configuration("--joints", joints, states)}
        body |= values.mounted(mounted)
        if link is not None:
            body["link"] = link
        answer = backend.answer(FK, name, body)
    print_answer(answer, connection.as_json)
    document = json.loads(answer)
    links = document["links"] if link is None else {link: document["pose"]}
    print_table(
        f"Poses in {document['frame']}",
        ("link", "position [m]", "quaternion x, y, z, w"),
        ((link, pose["position"], pose["quaternion_xyzw"]) for link, pose in links.items()),
    )


class Shown(NamedTuple):
    """Solutions that are shown."""

    most: Annotated[int, typer.Option("--count", help="Solutions shown at most.")] = 8
    all_solutions: Annotated[
        bool, typer.Option("--all", help="Also those that are rejected, with the reason.")
    ] = False


class Search(NamedTuple):
    """How solutions are looked for."""

    seed_joints: Annotated[str | None, typer.Option(help="Where nearest is counted from.")] = None
    method: Annotated[
        str | None,
        typer.Option(help="auto, analytic, numeric, gradient or constrained; auto if left out."),
    ] = None
    axes: Annotated[
        str | None,
        typer.Option(help="Axes of the pose's frame that count, between commas: x, y, rz."),
    ] = None


@command
def ik(
    connection: Connection,
    robot: RobotSource,
    pose: Annotated[
        str,
        typer.Option(help="x,y,z,roll,pitch,yaw or x,y,z,qx,qy,qz,qw [m, rad], JSON, or a file."),
    ],
    mounted: Mounted,
    shown: Shown,
    search: Search,
    link: Annotated[str | None, typer.Option(help="The link; the tip if left out.")] = None,
    scene: Annotated[str | None, typer.Option(help="A scene file, or a stored scene.")] = None,
) -> None:
    """Find the configurations that bring a link to a pose, best first."""
    with connect(connection) as backend:
        name = backend.robot_name(robot)
        given: dict[str, Any] = {
            "pose": values.pose("--pose", pose),
            "link": link,
            "scene": values.scene(scene),
            "method": search.method,
            "axes": values.words(search.axes),
        }
        body = {field: value for field, value in given.items() if value is not None}
        body |= values.mounted(mounted)
        if search.seed_joints is not None:
            states = backend.robot_model(name)["states"]
            body["seed_joints"] = values.configuration("--seed-joints", search.seed_joints, states)
        answer = backend.answer(
            IK, name, body | {"all_solutions": shown.all_solutions, "max_solutions": shown.most}
        )
    print_answer(answer, connection.as_json)
    rows = (
        (i, row["joints"], row["branch"], row["collision_free"], row["rejected_because"])
        for i, row in enumerate(json.loads(answer)["solutions"])
    )
    columns = ("", "joints [rad or m]", "branch", "collision-free", "rejected because")
    print_table("Solutions, best first", columns, rows)

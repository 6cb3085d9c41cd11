"""The commands ``armwright fk`` and ``armwright ik``."""

import json
from typing import Annotated, Any

import typer

from command_line import values
from command_line.backend import connect
from command_line.endpoints import FK, IK
from command_line.output import print_json, print_table
from command_line.parameters import Connection, RobotSource, command

Joints = Annotated[
    str, typer.Option("--joints", "-q", help="Numbers between commas [rad or m], or a named state.")
]


@command
def fk(
    connection: Connection,
    robot: RobotSource,
    joints: Joints,
    link: Annotated[str | None, typer.Option(help="Only this link.")] = None,
) -> None:
    """Show the poses of a robot's links at a configuration."""
    with connect(connection) as backend:
        name = backend.robot_name(robot)
        states = backend.robot_model(name)["states"]
        body: dict[str, Any] = {"joints": values.configuration("--joints", joints, states)}
        if link is not None:
            body["link"] = link
        answer = backend.answer(FK, name, body)
    if connection.as_json:
        print_json(answer)
        return
    document = json.loads(answer)
    links = document["links"] if link is None else {link: document["pose"]}
    print_table(
        f"Poses in {document['frame']}",
        ("link", "position [m]", "quaternion x, y, z, w"),
        ((link, pose["position"], pose["quaternion_xyzw"]) for link, pose in links.items()),
    )


@command
def ik(
    connection: Connection,
    robot: RobotSource,
    pose: Annotated[
        str,
        typer.Option(help="x,y,z,roll,pitch,yaw or x,y,z,qx,qy,qz,qw [m, rad], JSON, or a file."),
    ],
    link: Annotated[str | None, typer.Option(help="The link; the tip if left out.")] = None,
    seed_joints: Annotated[str | None, typer.Option(help="Where nearest is counted from.")] = None,
    scene: Annotated[str | None, typer.Option(help="A scene file, or a stored scene.")] = None,
    count: Annotated[int, typer.Option(help="Solutions shown at most.")] = 8,
    all_solutions: Annotated[
        bool, typer.Option("--all", help="Also those that are rejected, with the reason.")
    ] = False,
) -> None:
    """Find the configurations that bring a link to a pose, best first."""
    with connect(connection) as backend:
        name = backend.robot_name(robot)
        given: dict[str, Any] = {
            "pose": values.pose("--pose", pose),
            "link": link,
            "scene": values.scene(scene),
        }
        body = {field: value for field, value in given.items() if value is not None}
        if seed_joints is not None:
            states = backend.robot_model(name)["states"]
            body["seed_joints"] = values.configuration("--seed-joints", seed_joints, states)
        answer = backend.answer(
            IK, name, body | {"all_solutions": all_solutions, "max_solutions": count}
        )
    if connection.as_json:
        print_json(answer)
        return
    rows = (
        (i, row["joints"], row["branch"], row["collision_free"], row["rejected_because"])
        for i, row in enumerate(json.loads(answer)["solutions"])
    )
    columns = ("", "joints [rad or m]", "branch", "collision-free", "rejected because")
    print_table("Solutions, best first", columns, rows)

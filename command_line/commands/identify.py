"""The commands ``armwright identify`` and ``armwright fit``, and files of recorded motions."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from command_line import values
from command_line.backends.backend import connect
from command_line.backends.endpoints import FIT, IDENTIFY
from command_line.commands.motions import ask, show_certificate
from command_line.output import print_line, print_table
from command_line.parameters import Connection, Mounted, Request, RobotSource, command
from command_line.problems import invalid_value
from command_line.robot_files import read_json

#: Kinds of columns of a table, before the name of a joint, and the fields of a log that they are.
_COLUMNS = {
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "torque": "torques",
    "effort": "torques",
    "current": "currents",
}
#: Fields of the points of a JointTrajectory, and the fields of a log that they are.
_POINTS = {"positions": "positions", "velocities": "velocities", "effort": "torques"}
_HINT = (
    "Give a CSV with the columns time and position.JOINT, torque.JOINT and so on, "
    "a trajectory_msgs/JointTrajectory as JSON, or a log as the API has it."
)


def read_log(path: Path, joints: Sequence[str]) -> dict[str, Any]:
    """The log of a file, its columns in the order of a robot's joints.

    Args:
        path: A CSV or JSON file.
        joints: Names of the robot's joints.

    Raises:
        ProblemError: The file is not readable, or holds no log of these joints.
    """
    if path.suffix.lower() == ".csv":
        return _table(path, joints)
    document = read_json(path)
    return _message(path, document, joints) if "points" in document else document


def _table(path: Path, joints: Sequence[str]) -> dict[str, Any]:
    try:
        lines = [line for line in path.read_text("utf-8").splitlines() if line[:1] != "#"]
        header, *rows = [row for row in csv.reader(lines) if row]
        columns = dict(
            zip(header, zip(*(map(float, row) for row in rows), strict=True), strict=True)
        )
    except (OSError, ValueError) as error:
        raise invalid_value(str(path), f"it is no table: {error}", _HINT) from None
    log: dict[str, Any] = {"times": list(columns["time"])} if "time" in columns else {}
    for kind, field in _COLUMNS.items():
        names = [f"{kind}.{joint}" for joint in joints]
        found = [name for name in names if name in columns]
        if found and found != names:
            missing = ", ".join(name for name in names if name not in columns)
            raise invalid_value(str(path), f"columns are missing: {missing}", _HINT)
        if found:
            log[field] = [list(row) for row in zip(*(columns[name] for name in names), strict=True)]
    if "positions" not in log:
        raise invalid_value(str(path), f"there are no columns position.{joints[0]}, ...", _HINT)
    return log


def _message(path: Path, document: dict[str, Any], joints: Sequence[str]) -> dict[str, Any]:
    names, points = document.get("joint_names", list(joints)), document["points"]
    if not set(joints) <= set(names):
        raise invalid_value(str(path), f"its joints are {', '.join(names)}", _HINT)
    order = [names.index(joint) for joint in joints]
    stamps = [point["time_from_start"] for point in points]
    log = {"times": [stamp["sec"] + 1e-9 * stamp["nanosec"] for stamp in stamps]}
    for given, field in _POINTS.items():
        if all(point.get(given) for point in points):
            log[field] = [[point[given][i] for i in order] for point in points]
    return log


@command
def identify(
    connection: Connection,
    robot: RobotSource,
    logs: Annotated[list[Path], typer.Argument(help="CSV or JSON files of motions and torques.")],
    request: Request,
    mounted: Mounted,
    payload: Annotated[bool, typer.Option(help="Find the load that the robot carries.")] = False,
    link: Annotated[
        str | None, typer.Option(help="The link that carries it; the tip if left out.")
    ] = None,
    cutoff: Annotated[float | None, typer.Option(help="Cutoff of the filter [Hz].")] = None,
) -> None:
    """Find inertias and frictions of a robot, or its load, from logs."""
    with connect(connection) as backend:
        joints = backend.robot_model(backend.robot_name(robot))["joint_names"]
    body: dict[str, Any] = values.mounted(mounted) | {
        "logs": [read_log(path, joints) for path in logs],
        "find": "payload" if payload else "robot",
        "link": link,
        "cutoff": cutoff,
    }
    answer = json.loads(ask(connection, IDENTIFY, robot, request, body))
    if connection.as_json:
        return
    names = ("name", "value", "standard_error", "consistent", "unit")
    rows = (tuple(each[name] for name in names) for each in answer["parameters"])
    print_table("Parameters", ("parameter", "value", "error", "of bodies", "unit"), rows)
    columns = ("joint", "torque", "residual", "consistent_residual")
    rows = (tuple(each[name] for name in columns) for each in answer["joints"])
    print_table("Torques [N m or N]", ("joint", "torque", "residual", "of bodies"), rows)
    for line in answer["not_excited"]:
        print_line(f"not excited: {line}", "yellow")
    for note in answer["notes"]:
        print_line(f"note: {note}", "yellow")
    if answer["payload"] is not None:
        print_line(f"payload {json.dumps(answer['payload'])}")


@command
def fit(
    connection: Connection,
    robot: RobotSource,
    record: Annotated[Path, typer.Argument(help="CSV or JSON file of a recorded motion.")],
    tolerance: Annotated[float, typer.Option(help="How far any joint may be off [rad or m].")],
    request: Request,
    mounted: Mounted,
    rest: Annotated[bool, typer.Option(help="Begin and end without velocity.")] = False,
) -> None:
    """Fit few polynomials to a recorded motion, and prove them."""
    with connect(connection) as backend:
        log = read_log(record, backend.robot_model(backend.robot_name(robot))["joint_names"])
    samples = {"time": log.get("times"), "position": log.get("positions")}
    body: dict[str, Any] = values.mounted(mounted) | {
        "samples": samples,
        "tolerance": tolerance,
        "rest": rest,
    }
    answer = json.loads(ask(connection, FIT, robot, request, body))
    if connection.as_json:
        return
    trajectory = answer["trajectory"]
    print_line(f"{len(trajectory['segments'])} polynomials of {trajectory['duration']:.4f} s")
    print_line(f"at most {answer['deviation']:.3g} rad or m from the record at every instant")
    show_certificate(answer["certificate"])

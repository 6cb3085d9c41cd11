"""Commands that learn from recordings: ``identify``, ``excite``, ``calibrate`` and ``fit``."""

import json
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from command_line import values
from command_line.backends.endpoints import CALIBRATE, EXCITE, FIT, IDENTIFY
from command_line.commands.motions import Timed, ask, robot_model, show_certificate
from command_line.output import print_line, print_notes, print_table
from command_line.parameters import (
    Cell,
    Connection,
    Mounted,
    Recorded,
    Request,
    RobotSource,
    command,
)
from command_line.problems import invalid_value
from command_line.robot_files import described, read_json

Link = Annotated[str | None, typer.Option(help="The link that is meant; the tip if left out.")]


class Sought(NamedTuple):
    """What is to be found from logs."""

    payload: Annotated[bool, typer.Option(help="Find the load that the robot carries.")] = False
    link: Link = None
    cutoff: Annotated[float | None, typer.Option(help="Cutoff of the filter [Hz].")] = None
    gains: Annotated[
        str | None, typer.Option(help="Torque of each joint for one ampere, between commas.")
    ] = None


class Measurements(NamedTuple):
    """What was measured, and what of it is not known."""

    tip: Annotated[str | None, typer.Option(help="Topic of measurements in a rosbag.")] = None
    anchor: Annotated[str | None, typer.Option(help="Point that distances are from [m].")] = None
    unknown: Annotated[
        str | None, typer.Option(help="frame, tip or both: where those stand is sought too.")
    ] = None
    link: Link = None


class Kept(NamedTuple):
    """Parts of a recorded motion that are not kept."""

    rest: Annotated[bool, typer.Option(help="Begin and end without velocity.")] = False
    retime: Annotated[
        bool, typer.Option(help="Keep the geometry alone, timed anew by --method and --scaling.")
    ] = False


@command
def identify(
    connection: Connection,
    robot: RobotSource,
    logs: Annotated[
        list[Path], typer.Argument(help="Motions with torques: CSV, JSON, YAML, MCAP or rosbags.")
    ],
    request: Request,
    mounted: Mounted,
    recorded: Recorded,
    sought: Sought,
) -> None:
    """Find inertias and frictions of a robot, or its load, from logs."""
    model, notes = robot_model(connection, robot), list[str]()
    gains = None if sought.gains is None else values.read_value("--gains", sought.gains)
    bodies: list[dict[str, Any]] = []
    for path in logs:
        document = read_json(path) if path.suffix == ".json" else {}
        if "positions" not in document:
            found = values.recording(path, model, recorded)
            notes += found.notes
            document = described(found.log, gains)
        bodies.append(document)
    body: dict[str, Any] = values.mounted(mounted) | {
        "logs": bodies,
        "find": "payload" if sought.payload else "robot",
        "link": sought.link,
        "cutoff": sought.cutoff,
    }
    answer = json.loads(ask(connection, IDENTIFY, robot, request, body))
    names = ("name", "value", "standard_error", "consistent", "unit")
    rows = (tuple(each[name] for name in names) for each in answer["parameters"])
    print_table("Parameters", ("parameter", "value", "error", "of bodies", "unit"), rows)
    columns = ("joint", "torque", "residual", "consistent_residual")
    rows = (tuple(each[name] for name in columns) for each in answer["joints"])
    print_table("Torques [N m or N]", ("joint", "torque", "residual", "of bodies"), rows)
    for line in answer["not_excited"]:
        print_line(f"not excited: {line}", "yellow")
    print_notes([*notes, *answer["notes"]])
    if answer["payload"] is not None:
        print_line(f"payload {json.dumps(answer['payload'])}")


@command
def excite(
    connection: Connection,
    robot: RobotSource,
    request: Request,
    cell: Cell,
    start: Annotated[
        str | None, typer.Option(help="Where it begins and ends; the middle of the limits.")
    ] = None,
    period: Annotated[float | None, typer.Option(help="Duration of the motion [s].")] = None,
    evaluations: Annotated[int | None, typer.Option(help="Motions that are tried.")] = None,
) -> None:
    """Find a proved motion from whose logs a robot is identified well."""
    states = robot_model(connection, robot)["states"]
    body = values.cell(cell) | {
        "start": None if start is None else values.configuration("--start", start, states),
        "period": period,
        "evaluations": evaluations,
    }
    answer = json.loads(ask(connection, EXCITE, robot, request, body))
    print_line(f"duration {answer['trajectory']['duration']:.4f} s")
    count = len(answer["base_parameters"])
    print_line(f"{count} parameters, condition number {answer['condition']:.3g}")
    show_certificate(answer["certificate"])
    print_notes(answer["notes"])


@command
def calibrate(
    connection: Connection,
    robot: RobotSource,
    record: Annotated[
        Path, typer.Argument(help="Configurations with x, y, z, a pose or distance of the tip.")
    ],
    request: Request,
    mounted: Mounted,
    recorded: Recorded,
    measured: Measurements,
) -> None:
    """Find the frames of a robot's joints as they were made, from measurements of its tip."""
    found = values.recording(record, robot_model(connection, robot), recorded, measured.tip)
    body: dict[str, Any] = values.mounted(mounted) | {
        "joints": found.positions,
        **found.tip,
        "anchor": measured.anchor and values.read_value("--anchor", measured.anchor),
        "unknown": values.words(measured.unknown),
        "link": measured.link,
    }
    answer = json.loads(ask(connection, CALIBRATE, robot, request, body))
    names = ("joint", "parameter", "value", "standard_error")
    rows = (tuple(each[name] for name in names)
            for each in answer["corrections"] if each["determined"])  # fmt: skip
    print_table("Corrections [m or rad]", ("joint", "of", "value", "error"), rows)
    margins = ((each["joint"], each["calibrated"], each["described"]) for each in answer["margins"])
    print_table("Margins [m]", ("joint", "calibrated", "as described"), margins)
    errors = (answer["error_before"], answer["error_after"])
    print_line(f"errors of {errors[0]:.3g} m before, {errors[1]:.3g} m after")
    print_notes([*found.notes, *answer.get("notes", ())])


@command
def fit(
    connection: Connection,
    robot: RobotSource,
    record: Annotated[
        Path, typer.Argument(help="Recorded motion: CSV, JSON, YAML, MCAP or rosbag.")
    ],
    request: Request,
    mounted: Mounted,
    recorded: Recorded,
    timed: Timed,
    kept: Kept,
) -> None:
    """Fit few polynomials to a recorded motion or its geometry, and prove them."""
    if timed.tolerance is None:
        raise invalid_value("--tolerance", "none is given", "Give 0.001, for a milliradian.")
    if not kept.retime and timed != Timed(tolerance=timed.tolerance):
        raise invalid_value("--method", "with --scaling it times a record anew", "Give --retime.")
    found = values.recording(record, robot_model(connection, robot), recorded)
    samples = {"time": found.times, "position": found.positions}
    body: dict[str, Any] = values.mounted(mounted) | {
        "samples": samples,
        "tolerance": timed.tolerance,
        "rest": kept.rest,
        "retime": timed.timing if kept.retime else None,
    }
    answer = json.loads(ask(connection, FIT, robot, request, body))
    trajectory = answer["trajectory"]
    print_line(f"{len(trajectory['segments'])} polynomials of {trajectory['duration']:.4f} s")
    print_line(f"at most {answer['deviation']:.3g} rad or m from the record at every instant")
    show_certificate(answer["certificate"])
    print_notes([*found.notes, *answer["notes"]])

"""The commands that plan, check, prove, time, simulate and convert motions."""

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from command_line import values
from command_line.backends.backend import connect
from command_line.backends.endpoints import (
    CHECK,
    CONVERT,
    PLAN,
    RETIME,
    SIMULATE,
    VALIDATE,
    Endpoint,
)
from command_line.commands.kinematics import Joints
from command_line.output import (
    print_answer,
    print_json,
    print_line,
    print_notes,
    print_table,
    save,
    word,
)
from command_line.parameters import (
    Cell,
    Connection,
    Mounted,
    Recorded,
    Request,
    RobotSource,
    Scene,
    command,
)
from command_line.problems import negative
from command_line.robot_files import STANDARD_INPUT, read_json
from service.viewer.words import against, allowed_sentences, stops_sentences

#: Poles of the error dynamics at 20 rad/s, critically damped: a tenth of a second to settle.
_CONTROLLER = '{"type": "computed_torque", "natural_frequency": 20.0, "damping": 1.0}'

Motion = Annotated[
    Path, typer.Argument(help="JSON file of a trajectory, or of an answer that holds one.")
]
Stops = Annotated[
    str | None, typer.Option(help="Prove stops at every instant: path, joints or both.")
]


def ask(
    connection: Connection,
    endpoint: Endpoint,
    robot: RobotSource | None,
    request: Request,
    body: Mapping[str, Any],
    file: Path | None = None,
    whole: Path | None = None,
) -> bytes:
    """The answer to a request, printed as JSON or written to a file where that is asked for.

    Args:
        connection: Address and key of a service, or none for this process.
        endpoint: Endpoint of the request.
        robot: The robot, if there is one.
        request: Deadline, further fields and the file to write.
        body: Fields of the request; those that are None are left out.
        file: Fields that all others override, a JSON object.
        whole: File for the request with its answer; None for none.
    """
    further = {} if file is None else read_json(file)
    further |= {} if request.fields is None else read_json(request.fields)
    given = {**body, "timeout": request.timeout}
    fields = further | {name: value for name, value in given.items() if value is not None}
    with connect(connection) as backend:
        name = None if robot is None else backend.robot_name(robot)
        if name is not None and "{robot}" not in endpoint.path:
            asked = fields["plan"]["request"] if "plan" in fields else fields
            asked["robot"] = name
        answer = backend.answer(endpoint, name, fields)
    if request.output is not None:
        save(request.output, answer)
    if whole is not None:
        kept = {"operation": f"POST {endpoint.path}", "request": fields}
        save(whole, json.dumps(kept | {"answer": json.loads(answer)}).encode())
    print_answer(answer, connection.as_json)
    return answer


def robot_model(connection: Connection, robot: RobotSource) -> Mapping[str, Any]:
    """The model of a robot, as the API answers it.

    Args:
        connection: Address and key of a service, or none for this process.
        robot: The robot.
    """
    with connect(connection) as backend:
        return backend.robot_model(backend.robot_name(robot))


class Way(NamedTuple):
    """Planner of a motion, and what holds along it."""

    planner: Annotated[str, typer.Option(help="As the API names them.")] = "auto"
    stops: Stops = None
    path_tolerance: Annotated[
        float | None, typer.Option(help="How far any joint may be off the plan's path [rad or m].")
    ] = None


@command
def plan(
    connection: Connection,
    robot: RobotSource,
    start: Annotated[str, typer.Option(help="Joints between commas, or a named state.")],
    goal: Annotated[
        str, typer.Option(help="Joints, a named state, a pose as JSON, or the API's own JSON.")
    ],
    request: Request,
    cell: Cell,
    way: Way,
) -> None:
    """Plan a timed motion that is proved free of collision and inside all limits."""
    body = values.cell(cell) | {
        "start": values.goal("--start", start),
        "goal": values.goal("--goal", goal),
        "planner": way.planner,
        "stops": way.stops,
        "path": None if way.path_tolerance is None else {"tolerance": way.path_tolerance},
    }
    answer = json.loads(ask(connection, PLAN, robot, request, body))
    print_table(
        f"Plan found by {answer['planner']}",
        ("stage", "outcome", "time [ms]"),
        ((stage["name"], stage["outcome"], stage["milliseconds"]) for stage in answer["stages"]),
    )
    print_line(f"duration {answer['trajectory']['duration']:.4f} s")
    show_certificate(answer["certificate"])
    if way.path_tolerance is not None:
        near, count = answer["certificate"]["path"]["deviation"], len(answer["path"]["joints"])
        print_line(f"at most {near:.3g} rad or m from the path of {count} points at every instant")
    print_notes(answer["notes"])


@command
def check(
    connection: Connection,
    robot: RobotSource,
    joints: Joints,
    request: Request,
    cell: Cell,
) -> None:
    """Check one configuration for limits and collisions; exit with 1 where it is not valid."""
    states = robot_model(connection, robot)["states"]
    body = values.cell(cell) | {"joints": values.configuration("--joints", joints, states)}
    answer = json.loads(ask(connection, CHECK, robot, request, body))
    pair = " and ".join(answer["clearance_pair"] or ("nothing",))
    print_line("valid" if answer["valid"] else "not valid", "bold")
    print_line(f"clearance {word(answer['clearance'])} m, between {pair}")
    rows = [("collision", *item["pair"], item["depth"]) for item in answer["collisions"]]
    rows += [
        ("limit", item["joint"], f"limit {word(item['limit'])}", item["value"])
        for item in answer["limit_violations"]
    ]
    for sentence in allowed_sentences(answer["allowed_collisions"]):
        print_line(sentence)
    if rows:
        print_table("Violations", ("kind", "of", "with", "depth [m] or value"), rows)
    if not answer["valid"]:
        raise negative()


@command
def validate(
    connection: Connection,
    robot: RobotSource,
    motion: Motion,
    request: Request,
    cell: Cell,
    stops: Stops = None,
) -> None:
    """Prove a motion, and perhaps its stops, for every instant; exit with 1 where it is not."""
    body = values.cell(cell) | {
        "trajectory": values.motion(motion),
        "stops": stops,
    }
    certificate = json.loads(ask(connection, VALIDATE, robot, request, body))
    show_certificate(certificate)
    if not certificate["verified"] or not (certificate.get("stops") or {"proved": True})["proved"]:
        raise negative()


@command
def witness(
    connection: Connection,
    robot: RobotSource,
    motion: Motion,
    request: Request,
    cell: Cell,
) -> None:
    """Prove a motion and write the witness, for others to check; exit with 1 where not proved."""
    body = values.cell(cell) | {
        "trajectory": values.motion(motion),
        "witness": True,
    }
    quiet = connection._replace(as_json=False)
    certificate = json.loads(ask(quiet, VALIDATE, robot, request._replace(output=None), body))
    told = certificate["witness"]
    if request.output is not None:
        save(request.output, base64.b64decode(told["compact"]))
    if connection.as_json or request.output is None:
        print_json(json.dumps(told).encode())
    else:
        show_certificate(certificate)
        for row in told["unwitnessed"]:
            names = " and ".join(row.get("names", []))
            print_line(f"not witnessed: {row['what']} ({row['count']}) {names}".rstrip(), "yellow")
    if not certificate["verified"]:
        raise negative()


def show_certificate(certificate: dict[str, Any]) -> None:
    """Show what was proved of a motion, and the first thing that is wrong."""
    verified = certificate["verified"]
    print_line("proved" if verified else "not proved", "bold green" if verified else "bold red")
    print_line(against(certificate))
    clearance = certificate["min_clearance"]
    if clearance is not None:
        pair = " and ".join(certificate["clearance_pair"] or ())
        print_line(f"clearance at least {clearance:.4f} m at every instant, between {pair}")
    for reason in certificate["proved"]["reasons"]:
        print_line(f"not proved: {reason}", "yellow")
    for sentence in allowed_sentences(certificate["allowed_collisions"]):
        print_line(sentence)
    for sentence in stops_sentences(certificate):
        print_line(sentence)
    violation = certificate["violation"]
    if violation is not None:
        rows = ((name, json.dumps(value)) for name, value in violation.items())
        print_table("First violation", ("field", "value"), rows)


class Timed(NamedTuple):
    """How a path is timed."""

    method: Annotated[
        str | None, typer.Option(help="jerk_limited, toppra or spline; left out: bounded jerk.")
    ] = None
    scaling: Annotated[
        float, typer.Option(help="Share of the velocity limits that is used.", min=0.001, max=1.0)
    ] = 1.0
    tolerance: Annotated[
        float | None, typer.Option(help="How far any joint may be off the path [rad or m].")
    ] = None

    @property
    def timing(self) -> dict[str, Any]:
        """Options of timing, as the API names them."""
        return {"method": self.method, "velocity_scaling": self.scaling}


@command
def retime(
    connection: Connection,
    robot: RobotSource,
    path: Annotated[
        Path, typer.Argument(help='JSON with {"joints": [[...], ...]}, a plan, or a recording.')
    ],
    request: Request,
    mounted: Mounted,
    recorded: Recorded,
    timed: Timed,
    stops: Annotated[
        str | None, typer.Option(help="path: bound the longest stop along the path too.")
    ] = None,
) -> None:
    """Time a path of waypoints within the robot's limits; collisions are not looked at."""
    is_json = path.suffix == ".json" or str(path) == STANDARD_INPUT
    document = values.answer_of(read_json(path)) if is_json else {}
    waypoints = {"joints": document["path"]["joints"]} if "path" in document else document
    notes: Sequence[str] = ()
    if "joints" not in waypoints:
        values.refuse_parts(path, document)
        found = values.recording(path, robot_model(connection, robot), recorded)
        waypoints, notes = {"joints": found.positions}, found.notes
    if timed.tolerance is not None:
        waypoints = waypoints | {"tolerance": timed.tolerance}
    body = values.mounted(mounted) | {"path": waypoints, "timing": timed.timing, "stops": stops}
    answer = json.loads(ask(connection, RETIME, robot, request, body))
    print_line(f"duration {answer['trajectory']['duration']:.4f} s")
    show_certificate(answer["certificate"])
    print_table("Largest values of each joint", ("of", "joints"), answer["peaks"].items())
    print_notes([*notes, *answer["notes"]])


@command
def simulate(
    connection: Connection,
    robot: RobotSource,
    motion: Motion,
    request: Request,
    mounted: Mounted,
    scene: Scene = None,
    controller: Annotated[
        str, typer.Option(help="Controller with its gains, JSON or a file.")
    ] = _CONTROLLER,
) -> None:
    """Follow a motion with a controller; with a scene, say what tracking leaves of clearance."""
    value = values.read_value("--controller", controller)
    trajectory = values.motion(motion)
    body = values.mounted(mounted) | {
        "trajectory": trajectory,
        "controller": {"type": value} if isinstance(value, str) else value,
        "scene": values.scene(scene),
    }
    answer = json.loads(ask(connection, SIMULATE, robot, request, body))
    print_line(f"{answer['outcome']}: {answer['advice']}", "bold")
    print_line(f"largest tracking error {answer['max_tracking_error']:.3g} rad or m")
    errors = answer["max_joint_errors"]
    names = trajectory.get("joint_names") or range(len(errors))
    rows = ((name, f"{error:.3g}") for name, error in zip(names, errors, strict=True))
    print_table("Largest tracking errors", ("joint", "error [rad or m]"), rows)
    print_notes(answer["notes"])


@command
def convert(
    connection: Connection,
    motion: Motion,
    request: Request,
    form: Annotated[
        str, typer.Option("--format", help="joint_trajectory (ROS, JSON) or csv.")
    ] = "joint_trajectory",
    sample_period: Annotated[float, typer.Option(help="Time between rows [s].")] = 0.01,
) -> None:
    """Convert a motion to trajectory_msgs/JointTrajectory or CSV, on standard output."""
    body = {
        "trajectory": values.motion(motion),
        "format": form,
        "sample_period": sample_period,
    }
    answer = ask(connection, CONVERT, None, request, body)
    if request.output is None and not connection.as_json:
        print_json(answer)

"""The command ``armwright bench``: how long requests take on this machine or at a service."""

import json
import statistics
import time
from typing import Annotated, Any, NamedTuple

import typer

from command_line.backends.backend import Backend, connect
from command_line.backends.endpoints import CHECK, FK, IK, PLAN, Endpoint
from command_line.output import print_answer, print_table
from command_line.parameters import Connection, RobotSource, command

#: Robots that are measured if none is named.
_ROBOTS = ("panda", "ur5e", "iiwa14")
#: Part of the way from the middle of each joint's range to its end that the planned motion goes.
_SHARE = 0.3
#: Range of a joint without limits, to both sides [rad].
_FREE = 3.14159


class Row(NamedTuple):
    """Times of one request.

    Args:
        robot: Name of the robot.
        request: The endpoint.
        median: Median time of all repetitions but the first [ms].
        longest: Longest time of these repetitions [ms].
        first: The first one, which may load what the others find [ms].
    """

    robot: str
    request: str
    median: float
    longest: float
    first: float


@command
def bench(
    connection: Connection,
    robots: Annotated[
        list[str] | None, typer.Argument(help="Robots, as in `plan`; three built-in ones if none.")
    ] = None,
    repeats: Annotated[int, typer.Option(help="Repetitions of each.", min=2, max=1000)] = 20,
) -> None:
    """Measure how long kinematics, checks and certified plans take."""
    with connect(connection) as backend:
        rows = [row for name in robots or _ROBOTS for row in _of_robot(backend, name, repeats)]
    print_answer([row._asdict() for row in rows], connection.as_json)
    columns = ("robot", "request", "median [ms]", "longest [ms]", "first [ms]")
    print_table(f"{repeats} repetitions", columns, rows)


def _of_robot(backend: Backend, source: str, repeats: int) -> list[Row]:
    name = backend.robot_name(RobotSource(source))
    limits = backend.robot_model(name)["limits"]
    middle, aside = _ends(limits["lower"], limits["upper"])
    found = json.loads(backend.answer(FK, name, {"joints": aside}))["pose"]
    pose = {key: found[key] for key in ("position", "quaternion_xyzw")}
    requests: list[tuple[str, Endpoint, dict[str, Any]]] = [
        ("fk", FK, {"joints": aside}),
        ("ik", IK, {"pose": pose, "seed_joints": middle}),
        ("check", CHECK, {"robot": name, "joints": aside}),
        ("plan", PLAN, {"robot": name, "start": {"joints": middle}, "goal": {"joints": aside}}),
    ]
    return [
        _measure(backend, name, label, endpoint, body, repeats)
        for label, endpoint, body in requests
    ]


def _ends(lower: list[float | None], upper: list[float | None]) -> tuple[list[float], list[float]]:
    """The middle of the joints' ranges, and a configuration aside of it."""
    pairs = [
        (-_FREE if low is None else low, _FREE if high is None else high)
        for low, high in zip(lower, upper, strict=True)
    ]
    middle = [0.5 * (low + high) for low, high in pairs]
    return middle, [0.5 * (low + high) + 0.5 * _SHARE * (high - low) for low, high in pairs]


def _measure(
    backend: Backend, name: str, label: str, endpoint: Endpoint, body: dict[str, Any], repeats: int
) -> Row:
    times = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        backend.answer(endpoint, name, body)
        times.append(1000.0 * (time.perf_counter() - began))
    first, *rest = times
    return Row(name, label, statistics.median(rest), max(rest), first)

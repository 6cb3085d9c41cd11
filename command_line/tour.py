"""The command ``armwright tour``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from command_line import values
from command_line.endpoints import TOUR
from command_line.output import print_line, print_premises, print_table
from command_line.parameters import Connection, Margin, Request, RobotSource, Scene, command
from command_line.request_file import FileRequest


@command
def tour(
    connection: Connection,
    robot: RobotSource,
    goals: Annotated[
        Path, typer.Argument(help='JSON file with {"goals": [...]} and further fields of a tour.')
    ],
    request: Request,
    scene: Scene = None,
    margin: Margin = 0.0,
    start: Annotated[str | None, typer.Option(help="Joints between commas, or a state.")] = None,
    end: Annotated[str | None, typer.Option(help='"any", "start", joints or a state.')] = None,
) -> None:
    """Visit many goals in the order that takes the least time, every leg proved."""
    given: dict[str, Any] = {
        "scene": None if scene is None else values.scene(scene),
        "margin": margin or None,
        "start": None if start is None else values.goal("--start", start),
        "end": end if end in {None, "any", "start"} else values.goal("--end", str(end)),
        "timeout": request.timeout,
    }
    answer = FileRequest(TOUR, goals, given).answer(connection, robot, request)
    if answer is not None:
        _show(answer)


def _show(tour: dict[str, Any]) -> None:
    """Print the visits, the time and what is left out."""
    count = len(tour["visits"])
    print_line(f"{count} goals in {tour['time']:.3f} s, every leg proved", "bold")
    print_premises("leg", [leg["certificate"] for leg in tour["legs"]])
    if tour["lower_bound"] is not None:
        print_line(f"no tour takes less than {tour['lower_bound']:.3f} s")
    rows = ((visit["id"], visit["arrival"], visit["departure"]) for visit in tour["visits"])
    print_table("Visits", ("goal", "arrival [s]", "departure [s]"), rows)
    if tour["unvisited"]:
        rows = ((one["id"], one["code"], one["message"]) for one in tour["unvisited"])
        print_table("Left out", ("goal", "code", "reason"), rows)
    for note in tour["notes"]:
        print_line(f"note: {note}", "yellow")

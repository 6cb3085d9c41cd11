"""The commands ``armwright task`` and ``armwright tour``."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from command_line import values
from command_line.backends.endpoints import TASK, TOUR
from command_line.commands.motions import ask
from command_line.output import print_line, print_notes, print_premises, print_table
from command_line.parameters import Cell, Connection, Request, RobotSource, command
from service.viewer.words import allowed_sentences

Whole = Annotated[
    Path | None,
    typer.Option(
        "--whole", help="Write the request with its answer to this file, for view and export."
    ),
]


@command
def tour(
    connection: Connection,
    robot: RobotSource,
    goals: Annotated[
        Path,
        typer.Argument(help='JSON or YAML file with {"goals": [...]} and more of a tour.'),
    ],
    request: Request,
    cell: Cell,
    whole: Whole = None,
    start: Annotated[str | None, typer.Option(help="Joints between commas, or a state.")] = None,
    end: Annotated[str | None, typer.Option(help='"any", "start", joints or a state.')] = None,
) -> None:
    """Visit many goals in the order that takes the least time, every leg proved."""
    given: dict[str, Any] = values.mounted(cell) | {
        "scene": values.scene(cell.scene),
        "margin": cell.margin or None,
        "start": None if start is None else values.goal("--start", start),
        "end": end if end in {None, "any", "start"} else values.goal("--end", str(end)),
    }
    tour = json.loads(ask(connection, TOUR, robot, request, given, goals, whole))
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
    print_notes(tour["notes"])


@command
def task(
    connection: Connection,
    robot: RobotSource,
    stages: Annotated[
        Path, typer.Argument(help='JSON or YAML file with {"stages": [...]} and more of a task.')
    ],
    request: Request,
    cell: Cell,
    whole: Whole = None,
    start: Annotated[str | None, typer.Option(help="Joints between commas, or a state.")] = None,
    improve: Annotated[
        float | None, typer.Option(help="Time to look for a shorter answer [s].")
    ] = None,
) -> None:
    """Plan the stages of a task as one: grasps, places and motions, every stage proved."""
    given: dict[str, Any] = values.mounted(cell) | {
        "scene": values.scene(cell.scene),
        "margin": cell.margin or None,
        "start": None if start is None else values.goal("--start", start),
        "improve": improve,
    }
    planned = json.loads(ask(connection, TASK, robot, request, given, stages, whole))
    count = len(planned["stages"])
    word = "stage" if count == 1 else "stages"
    print_line(f"{count} {word} in {planned['duration']:.3f} s, every one proved", "bold")
    rows = [_row(stage) for stage in planned["stages"]]
    columns = ("stage", "begins [s]", "lasts [s]", "choice", "holds", "clearance [m]")
    print_table("Stages", columns, rows)
    print_premises("stage", [stage["certificate"] for stage in planned["stages"]])
    tried = sum(trial["outcome"] != "open" for trial in planned["trials"])
    told = len(planned["trials"]) + planned["trials_omitted"]
    print_line(f"{tried} of {told} alternatives decided")
    for sentence in allowed_sentences(_deepest(planned["stages"])):
        print_line(sentence)
    failure = planned["failure"]
    if failure is not None:
        print_line(f"stage {failure['index']} and what follows it: {failure['message']}", "yellow")


def _deepest(stages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Pairs that were not kept apart in some stage, each where it is the deepest."""
    found: dict[tuple[str, ...], dict[str, Any]] = {}
    for item in (one for stage in stages for one in stage["certificate"]["allowed_collisions"]):
        known = found.setdefault(tuple(item["pair"]), item)
        if (item["overlap"] or 0.0) > (known["overlap"] or 0.0):
            found[tuple(item["pair"])] = item
    return list(found.values())


def _row(stage: dict[str, Any]) -> tuple[object, ...]:
    held = ", ".join(item["id"] for item in stage["after"]["attached"])
    name = stage["kind"] if stage["name"] is None else f"{stage['kind']} {stage['name']}"
    choice = "" if stage["choice"] is None else stage["choice"]
    clearance = stage["certificate"]["min_clearance"]
    shown = "" if clearance is None else clearance
    return name, stage["begins"], stage["trajectory"]["duration"], choice, held, shown

"""What a plan costs beyond planning in two states of the code, round by round in turns.

    python -m benchmarks.overhead_turns ../before . [--scenes none moveit] [--rounds 30]

Each state has a server with one worker and a client of its own, and does a round of
`benchmarks.overhead` while the others wait: what else the machine does hits all alike. Columns are
those of that benchmark, as medians over all rounds.
"""

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

#: Rounds in which caches fill.
_FIRST = 2
_COLUMNS = ("in process", "difference", "less stages", "client", "server", "worker")


def side(kind: str) -> None:
    """One state: a round for each line of the input, as JSON."""
    # Of the state whose folder stands in PYTHONPATH, which may be an older one.
    from armwright.robot import load_robot  # noqa: PLC0415
    from armwright_client import Client  # noqa: PLC0415
    from benchmarks import machines, overhead  # noqa: PLC0415

    robot = load_robot("panda")
    environment = {"ARMWRIGHT_WORKERS": "1"}
    with machines.local_server(environment) as (pid, url), Client(url) as client:
        machines.wait_until_idle(pid)
        client.scenes.replace("boxes", overhead.scene_body("boxes"))
        moves, body = overhead.motions(robot), overhead.bodies(kind)
        cells = overhead.cells(kind)
        print("ready", flush=True)
        for _ in sys.stdin:
            problems = [overhead._problem(robot, next(cells), *ends) for ends in moves]
            inside = [overhead.spent_inside(problem) for problem in problems]
            requests = [(start.tolist(), goal.tolist(), body()) for start, goal in moves]
            before = machines.processor_times(pid)
            outside = [overhead.spent_outside(client, *request) for request in requests]
            spent = machines.processor_times(pid).since(before)
            told = {
                "inside": [one.clock for one in inside],
                "outside": [one.clock for one in outside],
                "stages": [one.stages for one in outside],
                "client": sum(one.processor for one in outside) / len(moves),
                "server": spent.own / len(moves),
                "worker": (spent.below - sum(one.processor for one in inside)) / len(moves),
            }
            print(json.dumps(told), flush=True)


def medians(rows: list[dict[str, Any]]) -> list[float]:
    """The columns of a state [ms]."""

    def over_rounds(value: Callable[[dict[str, Any]], float]) -> float:
        return 1e3 * statistics.median(map(value, rows))

    # Motion by motion: they take different times.
    by_motion = [
        over_rounds(lambda row: row["outside"][k]) - over_rounds(lambda row: row["inside"][k])  # noqa: B023
        for k in range(len(rows[0]["inside"]))
    ]
    rest = [o - s for row in rows for o, s in zip(row["outside"], row["stages"], strict=True)]
    return [
        over_rounds(lambda row: statistics.median(row["inside"])),
        statistics.median(by_motion),
        1e3 * statistics.median(rest),
        *(over_rounds(lambda row: row[name]) for name in ("client", "server", "worker")),  # noqa: B023
    ]


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="*", default=[Path()])
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--scenes", nargs="+", default=["none", "stored", "inline", "moveit"])
    parser.add_argument("--side", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.side is not None:
        side(asked.side)
        return
    # An older state has no such module: only this one needs it.
    from benchmarks.turns import State  # noqa: PLC0415

    print(f"{'[ms]':36}" + "".join(f"  {name}" for name in _COLUMNS))
    for kind in asked.scenes:
        sides = [State(folder, __file__, "--side", kind) for folder in asked.folders]
        time.sleep(1.0)
        rows: list[list[dict[str, Any]]] = [[] for _ in sides]
        for number in range(asked.rounds + _FIRST):
            order = list(zip(rows, sides, strict=True))
            for row, state in order if number % 2 else reversed(order):
                row.append(state.ask("go"))
        for folder, row, state in zip(asked.folders, rows, sides, strict=True):
            state.end()
            told = zip(_COLUMNS, medians(row[_FIRST:]), strict=True)
            columns = "".join(f"{value:{len(name) + 2}.2f}" for name, value in told)
            print(f"{kind:13} {str(folder)[-21:]:22}{columns}", flush=True)


if __name__ == "__main__":
    main()

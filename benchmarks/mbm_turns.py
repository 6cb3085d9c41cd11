"""MotionBenchMaker problems of the Panda in two states of the code, problem by problem in turns.

    python -m benchmarks.mbm_turns ../data/mbm/panda ../before . [--every 7] [--rounds 3]
    python -m benchmarks.mbm_turns ../data/mbm/panda . . --pythons .venv/bin/python /usr/bin/python3

Each state plans each problem in a process of its own while the other waits. Times are processor
times of that process: of the path, of the whole call of ``plan``, and of the stages. The first
columns are over all rounds, as somebody meets them; those of minima take the least of the rounds of
each problem. Ratios of a state to the first one carry over to other machines. With ``--pythons``
each state has an interpreter of its own: builds of Python differ in speed.
"""

import argparse
import json
import os
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np


class State:
    """A state of the code, with its folder in ``PYTHONPATH``, which does what it is asked.

    The script prints ``ready``, then a line of JSON for each line that it reads.

    Args:
        folder: Of the state.
        script: What runs there; the modules that it imports are those of the state.
        arguments: Of the script.
        python: Another interpreter of this version, which takes the packages of this one.

    Raises:
        SystemExit: The script did not start there.
    """

    def __init__(
        self, folder: Path, script: str, *arguments: str, python: str = sys.executable
    ) -> None:
        self.folder = folder.resolve()
        # Packages may have added folders of their own to the path.
        packages = [path for path in sys.path if path.startswith(sysconfig.get_path("purelib"))]
        paths = os.pathsep.join((str(self.folder), str(self.folder / "client"), *packages))
        self._process = subprocess.Popen(
            [python, "-P", str(Path(script).resolve()), *arguments],
            cwd=self.folder, env=os.environ | {"PYTHONPATH": paths},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        if self._read() != "ready":
            self.end()
            raise SystemExit(f"{folder} did not start")

    def ask(self, line: str) -> Any:
        """Have a turn, and give what it told."""
        assert self._process.stdin is not None
        print(line, file=self._process.stdin, flush=True)
        told = self._read()
        if not told:
            raise SystemExit(f"{self.folder} ended in the midst of its work")
        return json.loads(told)

    def end(self) -> None:
        """Let it end."""
        self._process.communicate()

    def _read(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()


#: A turn of a state: what it told of one problem.
Turn = dict[str, Any]


def side(problems: Path, every: int) -> None:
    """One state: a plan for each number of a problem in the input, as JSON."""
    # Of the state whose folder stands in PYTHONPATH, which may be an older one.
    from benchmarks.mbm import AFTERWARDS  # noqa: PLC0415
    from benchmarks.mbm_problems import cases, panda  # noqa: PLC0415
    from planning.options import Options  # noqa: PLC0415
    from planning.pipeline.pipeline import plan  # noqa: PLC0415
    from planning.result import Plan  # noqa: PLC0415

    robot = panda(problems.parent.parent / "panda")
    chosen = list(cases(problems, robot.chain.joint_names, every))
    plan(chosen[0].problem(robot, 0.0), Options())
    print("ready", flush=True)
    for line in sys.stdin:
        if line.strip() == "count":
            print(len(chosen), flush=True)
            continue
        problem = chosen[int(line)].problem(robot, 0.0)
        began = time.thread_time()
        answer = plan(problem, Options())
        told: Turn = {"whole": 1e3 * (time.thread_time() - began), "stages": {}}
        if isinstance(answer, Plan):
            told["duration"] = answer.trajectory.duration
            for stage in answer.stages:
                spent = told["stages"].get(stage.name, 0.0)
                told["stages"][stage.name] = spent + stage.processor_milliseconds
        before = [spent for name, spent in told["stages"].items() if name not in AFTERWARDS]
        told["path"] = sum(before)
        print(json.dumps(told), flush=True)


def report(folders: list[Path], turns: list[list[list[Turn]]]) -> None:
    """Print a row for each state, the ratios to the first one, and what stages take.

    Args:
        folders: Of the states.
        turns: For each state, problem and round.
    """
    both = [k for k in range(len(turns[0])) if all("duration" in state[k][0] for state in turns)]
    print(f"{'processor time [ms]':24}{'solved':>8}" + "".join(
        f"{name:>16}" for name in ("path p50, p95", "whole p50, p95", "minima: path", "whole")
    ) + f"{'motion [s]':>12}")  # fmt: skip
    rows = [_figures(state, both) for state in turns]
    for folder, state, row in zip(folders, turns, rows, strict=True):
        solved = sum("duration" in rounds[0] for rounds in state)
        motion = np.mean([state[k][0]["duration"] for k in both])
        pairs = "".join(f"{a:8.2f}{b:8.2f}" for a, b in row)
        print(f"{str(folder.resolve())[-22:]:24}{solved:8d}{pairs}{motion:12.3f}")
    for row in rows[1:]:
        ratios = np.array(row) / np.array(rows[0])
        print(f"{'ratio':32}" + "".join(f"{a:8.2f}{b:8.2f}" for a, b in ratios))
    for folder, state in zip(folders, turns, strict=True):
        names = sorted({name for rounds in state for turn in rounds for name in turn["stages"]})
        medians = {
            name: round(float(np.median([_least(state[k], _stage(name)) for k in both])), 2)
            for name in names
        }
        print(str(folder), medians)


def _figures(state: list[list[Turn]], both: list[int]) -> list[tuple[float, float]]:
    """Median and 95th percentile of path and whole, over all rounds and of minima."""
    parts = (_part("path"), _part("whole"))
    rounds = [[part(turn) for k in both for turn in state[k]] for part in parts]
    minima = [[_least(state[k], part) for k in both] for part in parts]
    return [
        (float(np.median(values)), float(np.percentile(values, 95)))
        for values in (*rounds, *minima)
    ]


def _part(name: str) -> Callable[[Turn], float]:
    return lambda turn: float(turn[name])


def _stage(name: str) -> Callable[[Turn], float]:
    return lambda turn: float(turn["stages"].get(name, 0.0))


def _least(rounds: list[Turn], value: Callable[[Turn], float]) -> float:
    return min(map(value, rounds))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("folders", type=Path, nargs="*", default=[Path()])
    parser.add_argument("--every", type=int, default=7, help="take every n-th problem of a kind")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--pythons", nargs="+", help="interpreters, one for each folder")
    parser.add_argument("--side", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.side:
        side(asked.problems, asked.every)
        return
    arguments = (str(asked.problems.resolve()), "--side", "--every", str(asked.every))
    pythons = asked.pythons or [sys.executable] * len(asked.folders)
    states = [
        State(folder, __file__, *arguments, python=python)
        for folder, python in zip(asked.folders, pythons, strict=True)
    ]
    count = min(state.ask("count") for state in states)
    turns: list[list[list[Turn]]] = [[[] for _ in range(count)] for _ in states]
    for number in range(asked.rounds):
        for problem in range(count):
            order = list(zip(turns, states, strict=True))
            for told, state in order if (number + problem) % 2 else reversed(order):
                told[problem].append(state.ask(str(problem)))
    for state in states:
        state.end()
    report(asked.folders, turns)


if __name__ == "__main__":
    main()

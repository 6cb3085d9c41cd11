r"""Other planners beside Armwright, on the same problems in one run.

    python -m benchmarks.peers ../data/mbm/panda [--every 20] [--timeout 20] \
        [--mplib PYTHON] [--roboplan PYTHON]

OMPL as it is mostly used from Python: RRT-Connect with its defaults, a state checker in Python
(pinocchio and python-fcl), and OMPL's own simplification. MPLib and RoboPlan in environments of
their own (``mplib_peer.py`` and ``roboplan_peer.py`` beside this module): RRT-Connect and shortcuts
in C++. Their paths are checked densely by ``benchmarks.judges.recheck``; times are processor times.
"""

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from ompl import base, geometric, util

from benchmarks.judges.recheck import STEP, Recheck, Scenery
from benchmarks.mbm_problems import Case, cases, panda
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.robots.robot_geometry import RobotGeometry
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.result import Plan
from planning.sampling.search import joint_space, state_of

#: OMPL's own limit for simplifying a path [s].
_SIMPLIFY = 1.0
Answer = tuple[float, Array | None]


def peer(case: Case, chain: Chain, recheck: Recheck, truth: Scenery, timeout: float) -> Answer:
    """Processor time [ms] and simplified path of OMPL with a checker in Python."""
    began = time.process_time()
    util.RNG.setSeed(1)
    space = joint_space(chain, [case.start, case.goal])
    setup: Any = geometric.SimpleSetup(base.SpaceInformation(space))
    setup.setStateValidityChecker(
        lambda state: recheck.collision(np.array(state[0 : chain.n]), truth) is None
    )
    setup.setStartAndGoalStates(state_of(space, case.start), state_of(space, case.goal))
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    setup.solve(base.timedPlannerTerminationCondition(timeout))
    path = None
    if setup.haveExactSolutionPath():
        setup.simplifySolution(_SIMPLIFY)
        states = setup.getSolutionPath().getStates()
        path = np.array([state[0 : chain.n] for state in states])
    return 1e3 * (time.process_time() - began), path


def clean(path: Array, recheck: Recheck, truth: Scenery) -> bool:
    """Whether a polyline is free wherever it is looked at, every milliradian."""
    for a, b in pairwise(path):
        count = max(2, int(np.ceil(np.abs(b - a).max() / STEP)) + 1)
        for share in np.linspace(0.0, 1.0, count):
            if recheck.collision(a + share * (b - a), truth) is not None:
                return False
    return True


def ours(case: Case, robot: RobotGeometry, timeout: float) -> Answer:
    """Processor time [ms] of the whole plan, timed and proved, and its path."""
    began = time.process_time()
    found = plan(case.problem(robot, 0.0), Options(timeout=timeout))
    spent = 1e3 * (time.process_time() - began)
    return spent, found.path.waypoints if isinstance(found, Plan) else None


def in_own_environment(
    script: str, interpreter: Path, folder: Path, tasks: Sequence[Case], timeout: float
) -> list[Answer]:
    """What a planner answers whose script beside this one runs in an environment of its own."""
    entries = [
        {"scene": case.text, "start": case.start.tolist(), "goal": case.goal.tolist()}
        for case in tasks
    ]
    with tempfile.TemporaryDirectory() as work:
        problems, answers = Path(work, "problems.json"), Path(work, "answers.json")
        problems.write_text(json.dumps({"timeout": timeout, "cases": entries}))
        own = Path(__file__).with_name(script)
        command = [str(interpreter), str(own), str(problems), str(folder), str(answers)]
        subprocess.run(command, check=True)
        rows = json.loads(answers.read_text())
    return [(row["ms"], np.array(row["path"]) if row["path"] else None) for row in rows]


def table(names: Sequence[str], rows: Sequence[Sequence[tuple[float, float, bool]]]) -> None:
    """Print what each planner did: times and lengths of what it solved."""
    print(f"{'':18} solved  ms median     p95  length median  clean")
    for name, found in zip(names, rows, strict=True):
        times, lengths = [row[0] for row in found], [row[1] for row in found]
        print(
            f"{name:18} {len(found):6d} {np.median(times):10.1f} {np.percentile(times, 95):7.1f}"
            f" {np.median(lengths):14.2f} {sum(row[2] for row in found):6d}"
        )


def main() -> None:
    """Run the comparison from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--every", type=int, default=20)
    parser.add_argument("--timeout", type=float, default=20.0)
    parser.add_argument("--mplib", type=Path, help="the Python in which MPLib is installed")
    parser.add_argument("--roboplan", type=Path, help="the Python in which RoboPlan is installed")
    asked = parser.parse_args()
    folder = asked.problems.parent.parent / "panda"
    robot, recheck = panda(folder), Recheck(folder)
    tasks, truths = [], []
    for case in cases(asked.problems, robot.chain.joint_names, asked.every):
        truth = recheck.scene(case.text)
        # Only problems whose ends are free for the judge too.
        if not recheck.collision(case.start, truth) and not recheck.collision(case.goal, truth):
            tasks.append(case)
            truths.append(truth)
    plan(tasks[0].problem(robot, 0.0), Options(timeout=60.0))
    answers = {
        "armwright": [ours(case, robot, asked.timeout) for case in tasks],
        "ompl, python-fcl": [
            peer(case, robot.chain, recheck, truth, asked.timeout)
            for case, truth in zip(tasks, truths, strict=True)
        ],
    }
    for name, interpreter in (("mplib", asked.mplib), ("roboplan", asked.roboplan)):
        if interpreter is not None:
            answers[name] = in_own_environment(
                f"{name}_peer.py", interpreter, folder, tasks, asked.timeout
            )
    rows = [
        [
            (spent, float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()), judged)
            for (spent, path), truth in zip(found, truths, strict=True)
            if path is not None
            for judged in [clean(path, recheck, truth)]
        ]
        for found in answers.values()
    ]
    print(f"{len(tasks)} problems")
    table(list(answers), rows)


if __name__ == "__main__":
    main()

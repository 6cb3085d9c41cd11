"""OMPL as it is mostly used from Python, beside Armwright, on the same problems in one run.

    python -m benchmarks.peers ../data/mbm/panda [--every 20] [--timeout 20]

The peer is RRT-Connect with its defaults, a state checker in Python (pinocchio and python-fcl), and
OMPL's own simplification. What both return is looked at densely by ``benchmarks.recheck``; times
are the processor's.
"""

import argparse
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from ompl import base, geometric, util

from benchmarks.mbm_problems import Case, cases, panda
from benchmarks.recheck import STEP, Recheck, Scenery
from kinematics.chain import Array, Chain
from planning.options import Options
from planning.pipeline import plan
from planning.result import Plan
from planning.sampling.space import joint_space, state_of

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


def main() -> None:
    """Run the comparison from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--every", type=int, default=20)
    parser.add_argument("--timeout", type=float, default=20.0)
    asked = parser.parse_args()
    folder = asked.problems.parent.parent / "panda"
    robot, recheck = panda(folder), Recheck(folder)
    tallies: dict[str, list[tuple[float, float, bool]]] = {"armwright": [], "ompl, python-fcl": []}
    tried = 0
    for case in cases(asked.problems, robot.chain.joint_names, asked.every):
        truth = recheck.scene(case.text)
        if recheck.collision(case.start, truth) or recheck.collision(case.goal, truth):
            continue
        if tried == 0:
            plan(case.problem(robot, 0.0), Options(timeout=60.0))
        tried += 1
        began = time.process_time()
        found = plan(case.problem(robot, 0.0), Options(timeout=asked.timeout))
        spent = 1e3 * (time.process_time() - began)
        ours = found.path.waypoints if isinstance(found, Plan) else None
        answers = (spent, ours), peer(case, robot.chain, recheck, truth, asked.timeout)
        for (milliseconds, path), rows in zip(answers, tallies.values(), strict=True):
            if path is not None:
                length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
                rows.append((milliseconds, length, clean(path, recheck, truth)))
    print(f"{'of ' + str(tried):18} solved  ms median     p95  length median  clean")
    for name, rows in tallies.items():
        times, lengths = [row[0] for row in rows], [row[1] for row in rows]
        print(
            f"{name:18} {len(rows):6d} {np.median(times):10.1f} {np.percentile(times, 95):7.1f}"
            f" {np.median(lengths):14.2f} {sum(row[2] for row in rows):6d}"
        )


if __name__ == "__main__":
    main()

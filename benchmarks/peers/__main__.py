r"""Other planners beside Armwright, on the same problems in one run.

    python -m benchmarks.peers ../data/mbm/panda [--every 20] [--timeout 20] \
        [--mplib PYTHON] [--roboplan PYTHON] [--sscbirrt PYTHON]

OMPL as it is mostly used from Python: RRT-Connect with its defaults, a state checker in Python
(pinocchio and python-fcl), and OMPL's own simplification. MPLib and RoboPlan in environments of
their own (``mplib_peer.py`` and ``roboplan_peer.py`` beside this module): RRT-Connect and shortcuts
in C++. Their paths are checked densely by ``benchmarks.judges.recheck``; times are processor times.
Motions are compared too, of which only ours and sscbirrt's are checked in place of their paths:
it shortens them in time. Others bound no jerk and prefer no clearance; neither do ours "alike" and
"refined", which optimises the former.
"""

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ompl import base, geometric, util

from benchmarks.judges.recheck import STEP, Recheck, Scenery
from benchmarks.mbm_problems import ACCELERATION, Case, cases, panda
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.robots.robot_geometry import RobotGeometry
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.result import Plan
from planning.sampling.search import joint_space, state_of
from planning.timing.options import TimingOptions
from planning.values.optimize_options import RefineOptions
from planning.values.preferences import PreferredClearance

#: OMPL's own limit for simplifying a path [s].
_SIMPLIFY = 1.0


class Answer(NamedTuple):
    """Processor time [ms], path, duration [s], breaks and coefficients of the motion if known."""

    spent: float
    path: Array | None
    duration: float = np.nan
    motion: tuple[Array, Array] | None = None


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
    return Answer(1e3 * (time.process_time() - began), path)


def clean(path: Array, recheck: Recheck, truth: Scenery) -> bool:
    """Whether a polyline is free wherever it is looked at, every milliradian."""
    for a, b in pairwise(path):
        count = max(2, int(np.ceil(np.abs(b - a).max() / STEP)) + 1)
        for share in np.linspace(0.0, 1.0, count):
            if recheck.collision(a + share * (b - a), truth) is not None:
                return False
    return True


def ours(case: Case, robot: RobotGeometry, options: Options) -> Answer:
    """Processor time [ms] of the whole plan, timed and proved, its path and motion."""
    began = time.process_time()
    found = plan(case.problem(robot, 0.0), options)
    spent = 1e3 * (time.process_time() - began)
    if not isinstance(found, Plan):
        return Answer(spent, None)
    motion = found.trajectory
    known = motion.breaks, motion.coefficients
    return Answer(spent, found.path.waypoints, motion.duration, known)


def in_own_environment(
    script: str, interpreter: Path, folder: Path, tasks: Sequence[Case], limits: dict[str, Any]
) -> list[Answer]:
    """What a planner answers whose script beside this one runs in an environment of its own."""
    entries = [
        {"scene": case.text, "start": case.start.tolist(), "goal": case.goal.tolist()}
        for case in tasks
    ]
    with tempfile.TemporaryDirectory() as work:
        problems, answers = Path(work, "problems.json"), Path(work, "answers.json")
        problems.write_text(json.dumps(limits | {"cases": entries}))
        own = Path(__file__).with_name(script)
        command = [str(interpreter), str(own), str(problems), str(folder), str(answers)]
        subprocess.run(command, check=True)
        rows = json.loads(answers.read_text())
    return [
        Answer(
            row["ms"],
            np.array(row["path"]) if row["path"] else None,
            row.get("duration", np.nan),
            (np.array(row["breaks"]), np.array(row["coefficients"])) if "breaks" in row else None,
        )
        for row in rows
    ]


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
    parser.add_argument("--sscbirrt", type=Path, help="the Python in which sscbirrt is installed")
    asked = parser.parse_args()
    folder = asked.problems.parent.parent / "panda"
    robot, recheck = panda(folder), Recheck(folder, ACCELERATION)
    tasks, truths = [], []
    for case in cases(asked.problems, robot.chain.joint_names, asked.every):
        truth = recheck.scene(case.text)
        # Only problems whose ends are free for the judge too.
        if not recheck.collision(case.start, truth) and not recheck.collision(case.goal, truth):
            tasks.append(case)
            truths.append(truth)
    plan(tasks[0].problem(robot, 0.0), Options(timeout=60.0))
    timeout = asked.timeout
    alike = Options(
        timeout=timeout, timing=TimingOptions("toppra"), clearance=PreferredClearance(0.0)
    )
    answers = {
        "armwright": [ours(case, robot, Options(timeout=timeout)) for case in tasks],
        "armwright, alike": [ours(case, robot, alike) for case in tasks],
        "armwright, refined": [
            ours(case, robot, replace(alike, refine=RefineOptions())) for case in tasks
        ],
        "ompl, python-fcl": [
            peer(case, robot.chain, recheck, truth, timeout)
            for case, truth in zip(tasks, truths, strict=True)
        ],
    }
    limits = {"velocity": robot.chain.limits.velocity.tolist(), "acceleration": ACCELERATION}
    for name in ("mplib", "roboplan", "sscbirrt"):
        interpreter = getattr(asked, name)
        if interpreter is not None:
            answers[name] = in_own_environment(
                f"{name}_peer.py", interpreter, folder, tasks, limits | {"timeout": timeout}
            )
    judged = {
        name: [
            found.path is not None and _is_clean(found, recheck, truth)
            for found, truth in zip(rows, truths, strict=True)
        ]
        for name, rows in answers.items()
    }
    rows = [
        [
            (found.spent, float(np.linalg.norm(np.diff(found.path, axis=0), axis=1).sum()), good)
            for found, good in zip(answers[name], judged[name], strict=True)
            if found.path is not None
        ]
        for name in answers
    ]
    print(f"{len(tasks)} problems")
    table(list(answers), rows)
    for name in [name for name in answers if name.startswith("armwright")]:
        for other in [other for other in ("mplib", "roboplan", "sscbirrt") if other in answers]:
            compare_motions(f"{other} beside {name}", answers[name], answers[other], judged[other])


def _is_clean(found: Answer, recheck: Recheck, truth: Scenery) -> bool:
    """Whether the motion is free and within its limits, or the path free where there is none."""
    if found.motion is None:
        assert found.path is not None
        return clean(found.path, recheck, truth)
    return recheck.motion(*found.motion, truth).clean


def compare_motions(
    name: str, own: Sequence[Answer], theirs: Sequence[Answer], good: Sequence[bool]
) -> None:
    """Print how much longer a peer's motions are, all of them and those that are clean."""
    ratios = np.array([b.duration / a.duration for a, b in zip(own, theirs, strict=True)])
    among = np.array(good) & np.isfinite(ratios)
    print(
        f"{name}: {np.nanmedian(ratios):.3f} times as long (median); ours are not longer in "
        f"{(ratios >= 1.0).sum()} of {np.isfinite(ratios).sum()}, in "
        f"{(ratios[among] >= 1.0).sum()} of {among.sum()} where theirs are clean"
    )


if __name__ == "__main__":
    main()

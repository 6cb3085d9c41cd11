"""Witnesses: what they cost, how large they are, and whether both checkers accept every one.

    python -m benchmarks.planning.witness --panda ../data/mbm/panda [--ur5 ../data/vamp/ur5]
        [--fetch ../data/vamp/fetch] [--every 5] [--seams 15] [--tasks 5] [--mutations 2000]

Problems of MotionBenchMaker (those of UR5 and Fetch lie in KavrakiLab/vamp, ``problems.tar.bz2``
unpacked beside the URDF), seams of ``benchmarks.planning.seams``, and with ``--tasks`` tasks of a
service in this process. Each motion is planned, its witness made and packed, and checked by both
checkers; times are processor time of this process, of the checker in C of its whole process.

``--mutations`` changes that many of these witnesses, each in a way of ``tests.planning.witness``,
and asks both checkers. Balls are the oracle: a change that they accept is harmless, as where other
facts cover what one did. What C accepts and balls don't is printed, and must not be.
``--share 3/20`` takes the third of twenty parts of everything, for long runs in pieces.
"""

import argparse
import base64
import copy
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armwright.robot import load_robot
from benchmarks.mbm_problems import cases, panda
from benchmarks.planning import seams
from obstacles.robots.robot_geometry import RobotGeometry
from planning.options import CartesianOptions, Options
from planning.pipeline.pipeline import plan
from planning.problem import Problem
from planning.result import Plan
from planning.witness.witness import witness
from tests.course.in_process import service_in_process
from tests.planning.witness.problems import ROOT, checker, compact, rejected
from tests.planning.witness.test_witness import MUTATIONS
from tests.service.test_tasks import TASK

#: Where chains end, and what URDFs give no accelerations for [rad/s^2 or m/s^2].
TIPS, ACCELERATION = {"ur5": "ee_link", "fetch": "gripper_link"}, 8.0
#: Arms of tasks; all but the first hold by a suction cup.
ARMS = ("panda", "ur5e", "kr6_sixx")
#: Documents that are changed.
MOST_CHANGED = 60


class Case(NamedTuple):
    """A motion to be witnessed: a problem, and how it is planned."""

    name: str
    problem: Problem
    options: Options


@dataclass
class Table:
    """Rows of one set.

    Args:
        name: Name of the set.
        rows: Planning [ms], witness [ms], size [byte], facts, checker in C [ms], balls [s].
        verdicts: Exit code of the checker in C, and that of balls, of each witness.
        left: What was not witnessed.
        tasks: Robots of tasks, and how these ended.
    """

    name: str
    rows: list[tuple[float, ...]] = field(default_factory=list)
    verdicts: Counter[tuple[int, int]] = field(default_factory=Counter)
    left: Counter[str] = field(default_factory=Counter)
    tasks: Counter[tuple[str, str]] = field(default_factory=Counter)

    def show(self) -> None:
        """Print it."""
        if self.tasks:
            print(f"{self.name}: {dict(self.tasks)}")
        if not self.rows:
            return
        taken = np.array(self.rows)
        print(f"{self.name}: {len(taken)} witnesses, (C, balls) {dict(self.verdicts)}")
        if self.left:
            print(f"  not witnessed: {dict(self.left)}")
        names = ["plan [ms]", "witness [ms]", "size [kB]", "facts", "C [ms]", "balls [s]"]
        for name, column in zip(names, taken.T, strict=True):
            scale = 1e3 if "kB" in name else 1.0
            middle, high = np.quantile(column, [0.5, 0.95]) / scale
            print(
                f"  {name:13} median {middle:8.2f}  p95 {high:8.2f}  max {max(column) / scale:.2f}"
            )
        known = taken[:, 0] > 0.0
        if known.any():
            print(f"  witness / plan: median {np.median(taken[known, 1] / taken[known, 0]):.3f}")


class Checkers:
    """Both checkers."""

    def __init__(self) -> None:
        folder = Path(tempfile.mkdtemp())
        self.program, self.file = folder / "armwright-check", folder / "witness"
        words = (sys.executable, "-m", "ziglang", "cc", "-O2", "-ffp-contract=off", "-o")
        source = ROOT / "checkers/c/armwright_check.c"
        subprocess.run((*words, self.program, source, "-lm"), check=True)

    def in_c(self, content: bytes) -> tuple[int, float]:
        """The exit code, and the processor time of the process [ms]."""
        self.file.write_bytes(content)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        code = subprocess.run((self.program, self.file), capture_output=True, check=False)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return code.returncode, 1e3 * spent

    @staticmethod
    def on_balls(content: bytes) -> tuple[int, float]:
        """The verdict as an exit code, and the processor time [s]."""
        began = time.process_time()
        try:
            code = 2 if checker().check(checker().read(content)).unwitnessed else 0
        except checker().Rejected:
            code = 1
        return code, time.process_time() - began

    def look(self, table: Table, content: bytes, spent: tuple[float, float], facts: int) -> None:
        """Have both check a witness, and note what they say."""
        (code, milliseconds), (other, seconds) = self.in_c(content), self.on_balls(content)
        table.verdicts[code, other] += 1
        table.rows.append((*spent, len(content), facts, milliseconds, seconds))


def other_arm(name: str, folder: Path) -> RobotGeometry:
    """A UR5 or a Fetch as it lies in the folder."""
    limits, semantics = {"*": {"acceleration": ACCELERATION}}, folder / f"{name}.srdf"
    urdf = folder / f"{name}.urdf"
    return load_robot(urdf, srdf=semantics, tip_link=TIPS[name], joint_limits=limits)


def problems(robot: RobotGeometry, folder: Path, every: int) -> Iterator[Case]:
    """Problems of MotionBenchMaker."""
    for case in cases(folder, robot.chain.joint_names, every):
        yield Case(case.name, case.problem(robot, 0.0), Options())


def seam_problems(count: int) -> Iterator[Case]:
    """Seams of all arms of that benchmark."""
    for name in seams.STARTS:
        for problem, asked in seams.problems(name, seams.load(name), count):
            options = Options(planner="cartesian", cartesian=CartesianOptions(seam=asked))
            yield Case(name, problem, options)


def measure(table: Table, chosen: Iterator[Case], checkers: Checkers, kept: list[bytes]) -> None:
    """Plan, witness and check."""
    warm = False
    for case in chosen:
        if not warm:
            plan(case.problem, case.options)
        began = time.process_time()
        answer = plan(case.problem, case.options)
        planned = time.process_time() - began
        if not isinstance(answer, Plan):
            continue
        seam = {"tool_motions": 1} if case.options.planner == "cartesian" else None
        if not warm:
            compact(witness(answer.trajectory, case.problem.robot, case.problem.scene).fields)
        warm, began = True, time.process_time()
        found = witness(
            answer.trajectory, case.problem.robot, case.problem.scene,
            constraints=case.problem.constraints, untold=seam,
        )  # fmt: skip
        content = found.compact
        spent = 1e3 * planned, 1e3 * (time.process_time() - began)
        kept.append(content)
        table.left.update(row["what"] for row in found.document["unwitnessed"])
        checkers.look(table, content, spent, len(found.fields["facts"]["plane"]))


def tasks(count: int) -> Iterator[dict[str, Any]]:
    """Tasks of picking and placing, by fingers and by a suction cup, crates in other places."""
    random = np.random.default_rng(5)
    for k in range(count):
        body = copy.deepcopy(TASK) | {"witness": True}
        table, crate = body["scene"]["obstacles"]
        crate["pose"]["position"][0] += random.uniform(-0.05, 0.05)
        crate["pose"]["position"][1] += random.uniform(-0.08, 0.08)
        if (name := ARMS[k % len(ARMS)]) != "panda":
            body |= {"robot": name, "tool": "suction_cup", "start": {"joints": seams.STARTS[name]}}
            stages = [stage for stage in body["stages"] if stage["kind"] not in ("open", "close")]
            body["stages"] = stages
            stages[2]["region"]["pose"]["position"][2] = 0.05
            stages[2]["touch_links"] = ["suction_cup"]
            stages[-1]["goal"] = body["start"]
            table["pose"]["position"][0] = 0.7
        yield body


def measure_tasks(
    table: Table, chosen: Iterator[dict[str, Any]], checkers: Checkers, kept: list[bytes]
) -> None:
    """Plan tasks in the service, and check the witness of each stage."""
    with tempfile.TemporaryDirectory() as folder, service_in_process(Path(folder)) as client:
        for body in chosen:
            told = client.post("/v1/tasks", json=body, timeout=120.0).json()
            table.tasks[body["robot"], str(told.get("status"))] += 1
            for stage in told.get("stages", []):
                found = stage["certificate"]["witness"]
                content = base64.b64decode(found["compact"])
                table.left.update(row["what"] for row in found["unwitnessed"])
                facts = len(checker().read(content)["facts"]["plane"])
                kept.append(content)
                checkers.look(table, content, (0.0, 0.0), facts)


def mutate(kept: list[bytes], count: int, checkers: Checkers, seed: int) -> None:
    """Change witnesses, and compare what both checkers say."""
    random = np.random.default_rng(seed)
    documents = [checker().read(content) for content in kept[:: -(-len(kept) // MOST_CHANGED)]]
    verdicts = Counter[tuple[str, bool, bool]]()
    for k in range(count):
        document, change = documents[k // 12 % len(documents)], MUTATIONS[k % len(MUTATIONS)]
        mutant = copy.deepcopy(document)
        try:
            change(mutant, random)
        except (IndexError, ValueError):  # no cell is short enough, say
            continue
        in_c, on_balls = checkers.in_c(compact(mutant))[0] != 1, rejected(mutant) is None
        verdicts[change.__name__, in_c, on_balls] += 1
        if in_c and not on_balls:
            print(f"ACCEPTED BY C ALONE: {change.__name__} of document {k % len(documents)}")
    print(f"mutations (accepted by C, by balls) of {len(documents)}:")
    for (name, in_c, on_balls), number in sorted(verdicts.items()):
        print(f"  mutation {name} {in_c} {on_balls} {number}")


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description="Witnesses and their checkers.")
    for name in ("panda", "ur5", "fetch"):
        parser.add_argument(f"--{name}", type=Path)
    parser.add_argument("--every", type=int, default=5)
    parser.add_argument("--seams", type=int, default=0, help="of each arm")
    parser.add_argument("--tasks", type=int, default=0)
    parser.add_argument("--mutations", type=int, default=0)
    parser.add_argument("--share", default="1/1")
    chosen = parser.parse_args()
    part, parts = map(int, chosen.share.split("/"))
    checkers, kept = Checkers(), list[bytes]()

    def shared(found: Iterator[Case]) -> Iterator[Case]:
        return (case for k, case in enumerate(found) if k % parts == part - 1)

    def run(name: str, found: Iterator[Case]) -> None:
        table = Table(name)
        measure(table, shared(found), checkers, kept)
        table.show()

    if chosen.panda is not None:
        robot = panda(chosen.panda.parents[1] / "panda")
        run("panda", problems(robot, chosen.panda, chosen.every))
    for name in ("ur5", "fetch"):
        folder = getattr(chosen, name)
        if folder is not None:
            arm = other_arm(name, folder)
            run(name, problems(arm, folder / "problems", chosen.every))
    if chosen.seams:
        run("seams", seam_problems(chosen.seams))
    if chosen.tasks:
        table = Table("tasks")
        wanted = (body for k, body in enumerate(tasks(chosen.tasks)) if k % parts == part - 1)
        measure_tasks(table, wanted, checkers, kept)
        table.show()
    if chosen.mutations and kept:
        mutate(kept, chosen.mutations // parts, checkers, part)


if __name__ == "__main__":
    main()

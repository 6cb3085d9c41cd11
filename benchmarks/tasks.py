"""Pick and place with 18 grasps and 12 places in MotionBenchMaker's scenes.

    python -m benchmarks.tasks ../data/mbm/panda [--robots panda ur5] [--count 100] [--kinds cage]

Each task is solvable by construction: OMPL and FCL (``task_sampling``) found motions for one of its
grasps and one of its places, and an independent dense check (pinocchio and Coal, the held object
included) finds them clean. Told are the share that is solved, the time to the first proved answer,
and how many answers the dense check finds colliding. With ``--peer`` the same for what found the
witnesses, with all grasps and places before it.
"""

import argparse
import json
import time
from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.example_arms import ARMS, package
from benchmarks.task_check import DenseCheck
from benchmarks.task_export import export
from benchmarks.task_problems import KINDS, Arm, TaskProblem, arm, hand_mesh, problems
from benchmarks.task_sampling import SampledTask
from planning.sequence.options import TaskOptions
from planning.sequence.result import SequenceFailure, SequencePlan
from planning.sequence.search import plan_task
from planning.sequence.task import Task

#: Longest time for one task, and processor time for a witness of one grasp and one place [s].
TIMEOUT = 10.0
WITNESS_TIMEOUT = 3.0


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problems", type=Path, help="MotionBenchMaker's problems for the Panda")
    parser.add_argument("--robots", nargs="+", default=["panda", "ur5"])
    parser.add_argument("--count", type=int, default=100, help="tasks for each robot")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), help="of scenes")
    parser.add_argument("--improve", type=float, default=0.0, help="after the first answer [s]")
    parser.add_argument("--witnesses", type=Path, help="file that keeps which places have one")
    parser.add_argument("--peer", action="store_true", help="measure OMPL with FCL beside it")
    parser.add_argument("--export", type=Path, help="write a UR5's tasks for peers, no more")
    chosen = parser.parse_args()
    folder = chosen.problems.parents[1] / "panda"
    for name in chosen.robots:
        used, check = arm(name, folder), _checker(name, folder)
        known = _Known(chosen.witnesses, name)
        found = problems(
            used, (chosen.problems, folder), chosen.count, chosen.kinds, _Witness(check), known
        )
        tasks = list(found)
        _tell(used, tasks, known)
        if chosen.export is not None:
            export(chosen.export, used, tasks, folder)
            continue
        _measure(used, tasks, check, chosen.improve)
        if chosen.peer:
            _measure_peer(used, tasks, check)


def _tell(used: Arm, tasks: list[TaskProblem], known: "_Known") -> None:
    """How many tasks and scenes without one there are of each kind."""
    made = Counter(problem.name.split("/")[0] for problem in tasks)
    without = Counter(name.split("/")[0] for name, row in known.items() if row is None)
    for kind in sorted(made | without):
        print(f"{used.name}: {made[kind]} tasks in {kind}, {without[kind]} scenes gave none")


class _Known(dict[str, int | None]):
    """Witnesses of an arm, kept in a file."""

    def __init__(self, path: Path | None, name: str) -> None:
        self._path = None if path is None else path.with_name(f"{name}-{path.name}")
        if self._path is not None and self._path.exists():
            super().update(json.loads(self._path.read_text()))

    def __setitem__(self, name: str, attempt: int | None) -> None:
        super().__setitem__(name, attempt)
        if self._path is not None:
            self._path.write_text(json.dumps(dict(self)))


class _Witness:
    """Finds motions of a task with OMPL and FCL that the dense check finds clean."""

    def __init__(self, check: DenseCheck) -> None:
        self._check = check

    def __call__(self, task: Task, text: str) -> bool:
        legs = SampledTask(task, 0, WITNESS_TIMEOUT).solve()
        names = task.world.robot.chain.joint_names
        return legs is not None and not any(
            self._check.first_collision(text, leg, names) for leg in legs
        )


def _measure_peer(used: Arm, tasks: list[TaskProblem], check: DenseCheck) -> None:
    seconds, solved, unclean = [], 0, 0
    names = used.robot.chain.joint_names
    for problem in tasks:
        began = time.process_time()
        legs = SampledTask(problem.task, 1, TIMEOUT).solve()
        if legs is None:
            continue
        solved += 1
        seconds.append(time.process_time() - began)
        hits = (check.first_collision(problem.text, leg, names) for leg in legs)
        unclean += any(hit is not None for hit in hits)
    median = f"{1e3 * np.median(seconds):.0f} ms" if seconds else "none"
    print(
        f"{used.name}, OMPL with FCL, untimed and unproved: {solved} of {len(tasks)} solved within "
        f"{TIMEOUT:g} s of it, first answer's processor time {median} (median); {unclean} unclean"
    )


def _checker(name: str, folder: Path) -> DenseCheck:
    if name == "panda":
        return DenseCheck(folder / "panda.urdf", folder, folder / "panda.srdf")
    ur5 = ARMS["ur5"]
    assert ur5.srdf is not None
    return DenseCheck(
        package() / ur5.urdf, package().parents[1], package() / ur5.srdf,
        (hand_mesh(folder), "tool0", -np.pi / 4.0),
    )  # fmt: skip


def _measure(used: Arm, tasks: list[TaskProblem], check: DenseCheck, improve: float) -> None:
    if not tasks:
        print(f"{used.name}: no tasks")
        return
    plan_task(tasks[0].task, TaskOptions(TIMEOUT))
    seconds, processor, solved, unclean = [], [], 0, 0
    shorter: list[float] = []
    for problem in tasks:
        began, computed = time.perf_counter(), time.process_time()
        answer = plan_task(problem.task, TaskOptions(TIMEOUT, improve))
        if isinstance(answer, SequenceFailure):
            print(f"{used.name} {problem.name}: {answer.code} {answer.message}")
            continue
        solved += 1
        seconds.append(1e-3 * answer.improvements[0].milliseconds)
        processor.append(time.process_time() - computed)
        shorter.append(answer.duration / answer.improvements[0].duration)
        assert time.perf_counter() >= began
        unclean += _is_unclean(used, problem, answer, check)
    quartiles = 1e3 * np.percentile(seconds, [50, 90, 100])
    print(
        f"{used.name}: {solved} of {len(tasks)} solved, first proved answer after "
        f"{quartiles[0]:.0f} ms (median), {quartiles[1]:.0f} ms (90 %), {quartiles[2]:.0f} ms at "
        f"most; processor time {1e3 * np.median(processor):.0f} ms (median); {unclean} unclean; "
        f"improved to {np.mean(shorter):.3f} of the first duration"
    )


def _is_unclean(used: Arm, problem: TaskProblem, answer: SequencePlan, check: DenseCheck) -> bool:
    """Whether the dense check finds something; told with stage, pair and time."""
    for stage in answer.stages:
        hit = check.first_collision(problem.text, stage, used.robot.chain.joint_names)
        if hit is not None:
            print(f"{used.name} {problem.name}: stage {stage.index} ({stage.kind}) {hit}")
            return True
    return False


if __name__ == "__main__":
    main()

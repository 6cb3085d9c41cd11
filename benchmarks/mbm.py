"""MotionBenchMaker problems for the Panda: how many are solved, how fast, how short, and clean?

    python -m benchmarks.mbm ../data/mbm/panda [--seeds 0 1 2] [--margins 0 0.002] [--every 1]

Reads ``sceneNNNN.yaml`` and ``requestNNNN.yaml`` of every kind of scene below the folder, and the
robot (``panda.urdf``, ``panda.srdf``, ``meshes/``) from ``../../panda`` beside it. Plans joint to
joint in this process and has every trajectory checked by ``benchmarks.judges.recheck``, which
shares no code with the planner. "path" is all that comes before timing, every edge proved; "whole"
is a call of ``plan``. Both are given by the clock and as processor time of this process, which
other programs on the machine disturb less.
"""

import argparse
import itertools
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.judges.recheck import Recheck
from benchmarks.mbm_problems import ACCELERATION, Case, cases, panda
from obstacles.robots.robot_geometry import RobotGeometry
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.result import Failure, Plan
from planning.values.preferences import DEFAULT_PREFERRED, PreferredClearance

#: Stages after the path is found.
AFTERWARDS = {"timing", "certificate"}


@dataclass
class Record:
    """What came of one problem; times by the clock and of computing [ms].

    Args:
        case: The problem.
        failure: What was answered instead of a plan.
        whole: Of the whole call.
        path: Of all stages up to the shortened path.
        stages: Computing time by stage.
        planner: Who found the path.
        length: Of the path [rad].
        duration: Of the motion [s].
        unclean: What an independent look found wrong.
    """

    case: Case
    failure: Failure | None = None
    whole: tuple[float, float] = (np.nan, np.nan)
    path: tuple[float, float] = (np.nan, np.nan)
    stages: dict[str, float] = field(default_factory=dict)
    planner: str = ""
    length: float = np.nan
    duration: float = np.nan
    unclean: str = ""


def run(
    chosen: Iterable[Case], robot: RobotGeometry, recheck: Recheck, options: Options, margin: float
) -> list[Record]:
    """Plan and re-check every problem whose start and goal are free."""
    records: list[Record] = []
    for case in chosen:
        truth = recheck.scene(case.text)
        if recheck.collision(case.start, truth) or recheck.collision(case.goal, truth):
            continue
        if not records:
            plan(case.problem(robot, margin), options)
        record = _solve(case, robot, recheck, options, margin)
        if record.failure is not None:
            print(f"  {case.name}: {record.failure.code} {record.failure.message}", flush=True)
        if record.unclean:
            print(f"  {case.name}: UNCLEAN {record.unclean}", flush=True)
        records.append(record)
    return records


def _solve(
    case: Case, robot: RobotGeometry, recheck: Recheck, options: Options, margin: float
) -> Record:
    record = Record(case)
    problem = case.problem(robot, margin)
    began, computed = time.perf_counter(), time.process_time()
    answer = plan(problem, options)
    took, computed = time.perf_counter() - began, time.process_time() - computed
    record.whole = 1e3 * took, 1e3 * computed
    if isinstance(answer, Failure):
        record.failure = answer
        return record
    _read(record, answer)
    trajectory, truth = answer.trajectory, recheck.scene(case.text)
    found = recheck.motion(trajectory.breaks, trajectory.coefficients, truth)
    if not found.clean:
        record.unclean = str(found)
    return record


def _read(record: Record, answer: Plan) -> None:
    for stage in answer.stages:
        spent = record.stages.get(stage.name, 0.0)
        record.stages[stage.name] = spent + stage.processor_milliseconds
    before = [stage for stage in answer.stages if stage.name not in AFTERWARDS]
    record.path = (
        sum(stage.milliseconds for stage in before),
        sum(stage.processor_milliseconds for stage in before),
    )
    record.planner, record.length = answer.planner, answer.path.length
    record.duration = answer.trajectory.duration


def report(records: list[Record]) -> None:
    """Print one row a kind, one for all, and what the stages take."""
    print(
        "kind                     valid solved unclean |    path ms: p50   p95    max  (computing)"
        " |   whole ms: p50   p95    max  (computing) |   length  p95 | motion s"
    )
    kinds = sorted({record.case.kind for record in records})
    for kind in [*kinds, "all"]:
        _row(kind, [r for r in records if kind in ("all", r.case.kind)])
    solved = [record for record in records if record.failure is None]
    names = sorted({name for record in solved for name in record.stages})
    for name in names:
        times = [record.stages[name] for record in solved if name in record.stages]
        print(f"  {name:16} in {len(times):4d}, computing ms: {_spread(times)}")
    print("  won by", dict(sorted(Counter(record.planner for record in solved).items())))


def _row(kind: str, records: list[Record]) -> None:
    solved = [record for record in records if record.failure is None]
    unclean = sum(bool(record.unclean) for record in solved)
    columns = [
        _spread([getattr(r, what)[k] for r in solved]) for what in ("path", "whole") for k in (0, 1)
    ]
    lengths = [record.length for record in solved] or [np.nan]
    motion = np.median([record.duration for record in solved] or [np.nan])
    print(
        f"{kind:24} {len(records):5d} {len(solved):6d} {unclean:7d}"
        f" | {columns[0]} ({columns[1]}) | {columns[2]} ({columns[3]})"
        f" | {np.mean(lengths):6.2f} {np.percentile(lengths, 95):6.2f} | {motion:5.2f}"
    )


def _spread(values: Sequence[float]) -> str:
    if not len(values):
        return "    -     -      -"
    p50, p95, most = np.percentile(values, [50, 95, 100])
    return f"{p50:6.1f} {p95:6.1f} {most:7.1f}"


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--margins", type=float, nargs="+", default=[0.0], help="[m]")
    parser.add_argument("--preferred", type=float, default=DEFAULT_PREFERRED, help="[m]")
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem of a kind")
    parser.add_argument("--timeout", type=float, default=5.0, help="[s]")
    asked = parser.parse_args()
    robot_folder = asked.problems.parent.parent / "panda"
    robot = panda(robot_folder)
    chosen = list(cases(asked.problems, robot.chain.joint_names, asked.every))
    recheck = Recheck(robot_folder, ACCELERATION)
    for margin, seed in itertools.product(asked.margins, asked.seeds):
        print(f"margin {1e3 * margin:g} mm, seed {seed}", flush=True)
        options = Options(
            timeout=asked.timeout, seed=seed, clearance=PreferredClearance(asked.preferred)
        )
        report(run(chosen, robot, recheck, options, margin))


if __name__ == "__main__":
    main()

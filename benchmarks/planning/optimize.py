"""What optimisation gains on MotionBenchMaker problems, and what it costs.

    python -m benchmarks.planning.optimize ../data/mbm/panda [--every 1] [--method toppra]
        [--objective time] [--payload 3] [--solver piqp]

Plans every problem by the ladder (RRT-Connect of OMPL, shortcuts, timing along the path) and by the
planner "optimize", and has every optimised motion checked by ``benchmarks.judges.recheck``. With a
payload torques are limited, and pinocchio looks at them every millisecond. Times are of the
processor.
"""

import argparse
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio

from benchmarks.judges.recheck import Recheck
from benchmarks.mbm_problems import ACCELERATION, JERK, Case, cases, panda
from dynamics.model.payload import with_payload
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from planning.optimize.objective import value
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.result import Failure, Plan
from planning.timing.options import Payload, TimingOptions
from planning.values.optimize_options import OBJECTIVES, SOLVERS, Objective


@dataclass(frozen=True)
class Record:
    """One problem, planned twice.

    Args:
        case: The problem.
        before: Duration of the ladder's motion [s].
        after: Of the optimised one [s].
        planner: That had the last word.
        worth: Of the objective after, as a share of what it was before (0 where it was infinite).
        refining: Time of optimising [ms].
        proving: Time of the proof of what came of it [ms].
        unclean: What the re-check found.
    """

    case: Case
    before: float
    after: float
    planner: str
    worth: float
    refining: float
    proving: float
    unclean: str


def solve(
    case: Case, robot: RobotGeometry, recheck: Recheck, known: Options, better: Options, load: float
) -> Record | None:
    """Plan both ways and look again; None where there is no plan to improve."""
    problem, truth = case.problem(robot, 0.0), recheck.scene(case.text)
    first = plan(problem, known)
    if isinstance(first, Failure):
        print(f"  {case.name}: {first.code} {first.message}", flush=True)
        return None
    second = plan(problem, better)
    if isinstance(second, Failure):
        print(f"  {case.name}: LOST {second.code} {second.message}", flush=True)
        return None
    motion = second.trajectory
    found, over = recheck.motion(motion.breaks, motion.coefficients, truth), 0.0
    if known.timing.torque_limits:
        over = _torque_ratio(recheck, robot, motion, load)
    weights: dict[Objective, float] = {better.planner_options["objective"]: 1.0}
    carrier = with_payload(robot.chain, load) if load else robot.chain
    after, before = (value(answer.trajectory, weights, carrier) for answer in (second, first))
    dirty = not found.clean or over > 1.0 + 1e-9
    return Record(
        case,
        first.trajectory.duration,
        motion.duration,
        second.planner,
        after / before if np.isfinite(before) else 0.0,
        _stage_time(second, "optimize"),
        _stage_time(second, "certificate"),
        f"{found}, torques {over}" if dirty else "",
    )


def _torque_ratio(recheck: Recheck, robot: RobotGeometry, motion: Trajectory, load: float) -> float:
    """The largest torque by pinocchio with a load at the tip, as a share of its limit."""
    model = recheck.model.copy()
    if load:
        tip = model.frames[model.getFrameId(robot.chain.tip_link)]
        held = pinocchio.Inertia(load, np.zeros(3), np.zeros((3, 3)))
        model.appendBodyToJoint(tip.parentJoint, held, tip.placement)
    data, limits = model.createData(), np.asarray(robot.chain.limits.effort)
    times = np.linspace(0.0, motion.duration, int(motion.duration * 1e3) + 2)
    states = [motion.sample(times, order) for order in range(3)]
    torques = [pinocchio.rnea(model, data, *state) for state in zip(*states, strict=True)]
    return float((np.abs(torques) / limits).max())


def _stage_time(answer: Plan, name: str) -> float:
    return sum(s.processor_milliseconds for s in answer.stages if s.name == name)


def report(records: list[Record]) -> None:
    """Print a row a kind of scene, and one for all."""
    kinds = sorted({record.case.kind for record in records})
    print("kind                       n  ratio of durations p10  median   p90  of objectives p10"
          "  median   p90  unclean  optimise ms median   p90  proof ms median   p90")  # fmt: skip
    for kind in [*kinds, "all"]:
        own = [record for record in records if kind in ("all", record.case.kind)]
        ratios = np.array([record.after / record.before for record in own])
        refining = [record.refining for record in own]
        proving = [record.proving for record in own]
        low, middle, high = np.percentile(ratios, [10, 50, 90])
        best, usual, least = np.percentile([record.worth for record in own], [10, 50, 90])
        print(
            f"{kind:24}{len(own):4}{low:24.3f}{middle:8.3f}{high:6.3f}"
            f"{best:19.3f}{usual:8.3f}{least:6.3f}"
            f"{sum(bool(record.unclean) for record in own):9}"
            f"{np.median(refining):21.0f}{np.percentile(refining, 90):6.0f}"
            f"{np.median(proving):17.0f}{np.percentile(proving, 90):6.0f}"
        )
    print(dict(Counter(record.planner for record in records)))
    for record in records:
        if record.unclean:
            print(f"  {record.case.name}: {record.unclean}")


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem of a kind")
    parser.add_argument("--method", default="toppra")
    parser.add_argument("--objective", choices=OBJECTIVES, default="time")
    parser.add_argument("--payload", type=float, default=0.0, help="at the tip [kg]")
    parser.add_argument("--solver", choices=SOLVERS, default="piqp")
    asked = parser.parse_args()
    folder = asked.problems.parent.parent / "panda"
    robot, recheck = panda(folder), Recheck(folder, ACCELERATION)
    load = Payload(asked.payload) if asked.payload else None
    timing = TimingOptions(asked.method, torque_limits=load is not None, payload=load)
    limits = {"jerk": np.array(JERK)}
    known = Options(timing=timing, limits=limits, timeout=60.0)
    options = {"objective": asked.objective, "solver": asked.solver}
    better = Options("optimize", options, timing=timing, limits=limits, timeout=60.0)
    records: list[Record] = []
    for case in cases(asked.problems, robot.chain.joint_names, asked.every):
        if not records:
            plan(case.problem(robot, 0.0), better)
        record = solve(case, robot, recheck, known, better, asked.payload)
        records += [] if record is None else [record]
    report(records)


if __name__ == "__main__":
    main()

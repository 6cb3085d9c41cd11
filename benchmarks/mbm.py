"""MotionBenchMaker problems for the Panda: how many are solved, how fast, and are they clean?

    python -m benchmarks.mbm ../data/mbm/panda [--seed 0] [--margin 0] [--every 1]

Reads ``sceneNNNN.yaml`` and ``requestNNNN.yaml`` of every kind of scene below the folder, and the
robot (``panda.urdf``, ``panda.srdf``, ``meshes/``) from ``../../panda`` beside it. Plans joint to
joint in this process and has every trajectory looked at by ``benchmarks.recheck``, which shares no
code with the planner.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from benchmarks.recheck import Recheck, Scenery
from kinematics.serial import serial_chain
from kinematics.srdf import parse_srdf
from kinematics.urdf import parse_urdf
from obstacles.moveit import scene_from_moveit
from obstacles.robot_geometry import RobotGeometry, robot_geometry
from planning.options import Options
from planning.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Failure, Plan

#: The URDF gives no accelerations: those of the manufacturer's data sheet [rad/s^2].
ACCELERATION = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
Joints = dict[str, float]
PLANNING_STAGES = {"preflight", "straight_line", "potential_field", "rrt_connect", "shortcut"}


@dataclass
class Tally:
    """What came of the problems of one kind."""

    valid: int = 0
    solved: int = 0
    refused: int = 0
    unclean: int = 0
    over_limit: int = 0
    planning: list[float] = field(default_factory=list)
    whole: list[float] = field(default_factory=list)
    durations: list[float] = field(default_factory=list)
    winners: dict[str, int] = field(default_factory=dict)


def panda(folder: Path) -> RobotGeometry:
    """The robot as it lies in the folder, with the data sheet's accelerations."""
    description = parse_urdf((folder / "panda.urdf").read_text())
    semantics = parse_srdf((folder / "panda.srdf").read_text())
    names = [f"panda_joint{i}" for i in range(1, 8)]
    extra = {name: {"acceleration": a} for name, a in zip(names, ACCELERATION, strict=True)}
    chain = serial_chain(description, semantics=semantics, joint_limits=extra)
    meshes = {
        f"package://{path.relative_to(folder)}": path.read_bytes()
        for path in sorted((folder / "meshes").rglob("*.obj"))
    }
    return robot_geometry(chain, description, meshes, semantics)


def problems(
    folder: Path, every: int
) -> Iterator[tuple[str, str, dict[str, float], dict[str, float]]]:
    """Kind, scene text, start and goal of every problem, as joint name to value."""
    for kind in sorted(path for path in folder.iterdir() if path.is_dir()):
        for scene in sorted(kind.glob("scene*.yaml"))[::every]:
            request = yaml.safe_load((kind / scene.name.replace("scene", "request")).read_text())
            state = request["start_state"]["joint_state"]
            start = dict(zip(state["name"], state["position"], strict=True))
            goals = request["goal_constraints"][0]["joint_constraints"]
            goal = {entry["joint_name"]: entry["position"] for entry in goals}
            yield f"{kind.name}/{scene.stem}", scene.read_text(), start, goal


def run(folder: Path, seed: int, margin: float, every: int, timeout: float) -> dict[str, Tally]:
    """Plan and re-check every problem; one tally a kind."""
    robot_folder = folder.parent.parent / "panda"
    robot, recheck = panda(robot_folder), Recheck(robot_folder)
    names = robot.chain.joint_names
    tallies: dict[str, Tally] = {}
    warm = True
    for name, text, start_at, goal_at in problems(folder, every):
        tally = tallies.setdefault(name.split("/")[0], Tally())
        start, goal = (np.array([at[j] for j in names]) for at in (start_at, goal_at))
        truth = recheck.scene(text)
        if recheck.collision(start, truth) or recheck.collision(goal, truth):
            continue
        tally.valid += 1
        scene = scene_from_moveit(text)
        problem = Problem(robot, scene, start, (JointGoal(goal),), margin=margin)
        options = Options(timeout=timeout, seed=seed)
        if warm:
            plan(problem, options)
            warm = False
        began = time.perf_counter()
        answer = plan(problem, options)
        whole = 1e3 * (time.perf_counter() - began)
        if isinstance(answer, Failure):
            tally.refused += answer.stage == "certificate"
            print(f"  {name}: {answer.code} {answer.message}", flush=True)
            continue
        _count(tally, name, answer, whole, recheck, truth)
    return tallies


def _count(
    tally: Tally, name: str, answer: Plan, whole: float, recheck: Recheck, truth: Scenery
) -> None:
    tally.solved += 1
    tally.whole.append(whole)
    spent = [s.milliseconds for s in answer.stages if s.name in PLANNING_STAGES]
    tally.planning.append(sum(spent))
    tally.durations.append(answer.trajectory.duration)
    tally.winners[answer.planner] = tally.winners.get(answer.planner, 0) + 1
    trajectory = answer.trajectory
    acceleration = np.array(ACCELERATION)
    found = recheck.motion(trajectory.breaks, trajectory.coefficients, acceleration, truth)
    tally.unclean += found.colliding is not None
    tally.over_limit += found.limit_ratio > 1.0 + 1e-9
    if found.colliding or found.limit_ratio > 1.0 + 1e-9:
        print(f"  {name}: UNCLEAN {found}", flush=True)


def report(tallies: dict[str, Tally]) -> None:
    """Print one row a kind, and one for all."""
    total = Tally()
    for tally in tallies.values():
        for name in ("valid", "solved", "refused", "unclean", "over_limit"):
            setattr(total, name, getattr(total, name) + getattr(tally, name))
        for name in ("planning", "whole", "durations"):
            getattr(total, name).extend(getattr(tally, name))
        for winner, count in tally.winners.items():
            total.winners[winner] = total.winners.get(winner, 0) + count
    head = "kind                     valid solved refused unclean over | plan ms med   p95 |"
    print(head + " whole ms med   p95    max | motion s | won by")
    for kind, tally in [*tallies.items(), ("all", total)]:
        planning, whole = np.array(tally.planning or [np.nan]), np.array(tally.whole or [np.nan])
        winners = ", ".join(f"{name} {count}" for name, count in sorted(tally.winners.items()))
        print(
            f"{kind:24} {tally.valid:5d} {tally.solved:6d} {tally.refused:7d} {tally.unclean:7d}"
            f" {tally.over_limit:4d}"
            f" | {np.median(planning):10.1f} {np.percentile(planning, 95):6.1f}"
            f" | {np.median(whole):11.1f} {np.percentile(whole, 95):6.1f} {whole.max():7.1f}"
            f" | {np.median(tally.durations or [np.nan]):8.2f} | {winners}"
        )


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--margin", type=float, default=0.0)
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem of a kind")
    parser.add_argument("--timeout", type=float, default=5.0)
    asked = parser.parse_args()
    report(run(asked.problems, asked.seed, asked.margin, asked.every, asked.timeout))


if __name__ == "__main__":
    main()

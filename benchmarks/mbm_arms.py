"""MotionBenchMaker's own problems of a UR5 and a Fetch: ``python -m benchmarks.mbm_arms FOLDER``.

    python -m benchmarks.mbm_arms vamp/resources [--robots ur5 fetch] [--every 7] [--edges]

The folder is ``resources`` of github.com/KavrakiLab/vamp, commit f067ade, with each robot's
``problems.tar.bz2`` unpacked where it lies. The UR5 stands on a mount and carries a gripper; the
Fetch has eight joints, of which one slides, and begins folded up. Descriptions, semantics, meshes
and scenes are read as they lie; accelerations are ten times the speeds. Starts and goals that are
beyond a limit by its rounding are put to it. Told are processor times of whole plans; with
``--edges`` the edges that trees look at on the way to any path, in three seeds.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.mbm_problems import Case, case_of
from benchmarks.mesh_plans import SLOW, note_stages
from kinematics.serial_chain import serial_chain
from kinematics.srdf import parse_srdf
from kinematics.urdf import parse_urdf
from obstacles.moveit import scene_from_moveit
from obstacles.robot_geometry import RobotGeometry, robot_geometry
from planning.deadline import Deadline
from planning.options import Options
from planning.pipeline import plan
from planning.preflight.preflight import preflight
from planning.problem import JointGoal, Problem
from planning.ready import Ready
from planning.result import Failure
from planning.search.rrt_connect import rrt_connect

#: Where the chain of each robot ends; None where its SRDF says so.
TIPS = {"ur5": None, "fetch": "gripper_link"}
#: Edges after which trees are given up.
_MAX_EDGES = 100_000
_SEEDS = 3


def load(folder: Path, tip: str | None) -> RobotGeometry:
    """The robot of a folder."""
    description = parse_urdf((folder / f"{folder.name}.urdf").read_text())
    semantics = parse_srdf((folder / f"{folder.name}.srdf").read_text())
    bare = serial_chain(description, tip_link=tip, semantics=semantics)
    speeds = zip(bare.joint_names, bare.limits.velocity, strict=True)
    extra = {name: {"acceleration": 10.0 * float(speed)} for name, speed in speeds}
    chain = serial_chain(description, tip_link=tip, semantics=semantics, joint_limits=extra)
    meshes = {}
    for path in (folder / "meshes").rglob("*"):
        if path.suffix.lower() in {".stl", ".dae", ".obj"}:
            name = str(path.relative_to(folder))
            meshes[name] = meshes[f"package://{name}"] = path.read_bytes()
    return robot_geometry(chain, description, meshes, semantics)


def problems(folder: Path, robot: RobotGeometry, every: int) -> Iterator[tuple[Case, Problem]]:
    """Every n-th problem of every kind of a robot's folder."""
    names, limits = robot.chain.joint_names, robot.chain.limits
    for scene in sorted((folder / "problems").glob("*/scene*.yaml"))[::every]:
        case = case_of(scene, names)
        start, goal = (np.clip(q, limits.lower, limits.upper) for q in (case.start, case.goal))
        yield case, Problem(robot, scene_from_moveit(case.text), start, (JointGoal(goal),))


def tell_plans(folder: Path, robot: RobotGeometry, every: int) -> None:
    """Plan, and tell what whole plans and their stages take."""
    times: list[float] = []
    motions: list[float] = []
    stages: dict[str, list[float]] = {}
    for case, problem in problems(folder, robot, every):
        if not times:
            plan(problem, Options())
        began = time.process_time()
        answer = plan(problem, Options())
        spent = 1e3 * (time.process_time() - began)
        if isinstance(answer, Failure):
            print(f"  {case.name}: {answer.code} {answer.message}")
            if answer.code in {"START_IN_COLLISION", "GOAL_IN_COLLISION"}:
                continue
        else:
            note_stages(stages, answer)
            motions.append(answer.trajectory.duration)
        if spent > SLOW:
            print(f"  {case.name}: {spent:.0f} ms")
        times.append(spent)
    print(f"{folder.name}: {len(motions)} of {len(times)} solved, motions {np.mean(motions):.2f} s")
    for name, values in {"whole": times, **stages}.items():
        middle, most, worst = np.percentile(values, [50, 95, 100])
        print(f"    {name:16} {middle:8.1f} {most:8.1f} {worst:8.1f} ms in {len(values)}")


def tell_edges(folder: Path, robot: RobotGeometry, every: int) -> None:
    """Grow trees in the exact robot with no clearance preferred, and tell their edges."""
    edges: list[int] = []
    times: list[float] = []
    failed = 0
    for _, problem in problems(folder, robot, every):
        ready = preflight(problem, 0)
        if not isinstance(ready, Ready):
            continue
        for seed in range(_SEEDS):
            began, until = time.thread_time(), Deadline.after(60.0)
            ends = ready.checkers[-1], ready.start, ready.goals
            found = rrt_connect(*ends, seed, until, _MAX_EDGES, proves=False)
            times.append(1e3 * (time.thread_time() - began))
            edges.append(found.edges)
            failed += found.waypoints is None
    middle, most, worst = np.percentile(edges, [50, 95, 100])
    print(
        f"{folder.name}: edges mean {np.mean(edges):.0f}, median {middle:.0f}, 95 % {most:.0f}, "
        f"most {worst:.0f}; {failed} of {len(edges)} find no path; "
        f"ms mean {np.mean(times):.1f}, 95 % {np.percentile(times, 95):.1f}"
    )


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robots", nargs="+", default=list(TIPS), choices=list(TIPS))
    parser.add_argument("--every", type=int, default=7, help="take every n-th problem")
    parser.add_argument("--edges", action="store_true", help="edges of trees, not whole plans")
    asked = parser.parse_args()
    for name in asked.robots:
        folder = asked.folder / name
        tell = tell_edges if asked.edges else tell_plans
        tell(folder, load(folder, TIPS[name]), asked.every)


if __name__ == "__main__":
    main()

"""Plans of arms with real meshes in MotionBenchMaker's scenes: ``python -m benchmarks.mesh_plans``.

    python -m benchmarks.mesh_plans ../data/mbm/panda [--robots ur5 ur10] [--every 5]

The tools of arms of example-robot-data are asked to go where the Panda's hand does in the problems
of that folder, from and to configurations that inverse kinematics find and that are free by their
triangles; where there are none, random ones are taken. Where no plan is found, OMPL looks for a way
(``benchmarks.mesh_ways``): a problem that it finds none for either is told by name, not counted.
Every trajectory is looked at every two milliradians by ``benchmarks.triangles``, FCL on the very
triangles moved by pinocchio. Told are the processor times of whole plans and of their stages:
median, 95 % and the most.
"""

import argparse
import itertools
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.example_arms import ARMS
from benchmarks.mbm_problems import Case, cases, panda, scene_at_root
from benchmarks.mesh_ways import has_way
from benchmarks.triangles import Body, Triangles, scenery
from kinematics.forward import link_poses
from kinematics.ik import numeric
from kinematics.pose import from_rpy, transform
from kinematics.trajectory import Trajectory
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry
from planning.options import Options
from planning.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Failure, Plan

Array = NDArray[np.float64]

#: Largest joint change between two looks [rad].
STEP = 2e-3
#: How far the tool is put beyond the end of the Panda's chain, as deep as there is room [m], and
#: how it is turned about its axis [rad].
BEYOND = (0.1, 0.05, 0.0, -0.05, -0.1, -0.15)
ROLLS = (0.0, np.pi / 2.0)
_TRIES = 2000
#: A plan that takes longer is told by name [ms].
SLOW = 500.0


def start_and_goal(
    case: Case, hand: RobotGeometry, robot: RobotGeometry, truth: Triangles, bodies: list[Body]
) -> tuple[Array, Array, bool] | None:
    """A free start and goal where the Panda's hand is, and whether inverse kinematics found both.

    None where even random ones all collide.
    """
    ends, random, found = [], np.random.default_rng(0), True
    for q in (case.start, case.goal):
        (pose,) = link_poses(hand.chain, q, [hand.chain.tip_link])
        free = _at(pose, robot, truth, bodies)
        if not free:
            found, free = False, _random(robot, truth, bodies, random)
        if not free:
            return None
        ends.append(np.array(free[0]))
    return ends[0], ends[1], found


def _at(pose: Array, robot: RobotGeometry, truth: Triangles, bodies: list[Body]) -> list[Array]:
    """Free configurations with the tool about where a pose is, the deepest that there are."""
    for beyond, roll in itertools.product(BEYOND, ROLLS):
        wanted = pose @ transform(from_rpy([0.0, 0.0, roll]), [0.0, 0.0, beyond])
        result = numeric.solve(robot.chain, wanted, numeric.SearchOptions(starts=64), solutions=16)
        states = [solution.joints for solution in result.solutions]
        free = [q for q in states if truth.collision(q, bodies) is None]
        if free:
            return free
    return []


def _random(
    robot: RobotGeometry, truth: Triangles, bodies: list[Body], random: np.random.Generator
) -> list[Array]:
    low, high = robot.chain.sampling_bounds()
    for _ in range(_TRIES):
        q = random.uniform(np.maximum(low, -np.pi), np.minimum(high, np.pi))
        if truth.collision(q, bodies) is None:
            return [q]
    return []


def samples(trajectory: Trajectory) -> Iterator[Array]:
    """Configurations along a motion, no joint moving by more than ``STEP`` from one to the next."""
    for k, length in enumerate(np.diff(trajectory.breaks)):
        c = trajectory.coefficients[k].T
        powers = np.arange(len(c))
        fastest = (np.abs(c[1:] * powers[1:, None]) * (length ** powers[:-1])[:, None]).sum(axis=0)
        count = max(2, int(np.ceil(float(fastest.max()) * length / STEP)) + 1)
        t = np.linspace(0.0, length, count)
        yield from t[:, None] ** powers @ c


def unclean(
    trajectory: Trajectory, truth: Triangles, bodies: list[Body]
) -> tuple[tuple[str, str] | None, int]:
    """Who touches whom on a motion, and how many configurations were looked at."""
    looked, last = 0, np.full(trajectory.n, np.inf)
    for q in samples(trajectory):
        if np.abs(q - last).max() < 0.5 * STEP:
            continue
        last, looked = q, looked + 1
        found = truth.collision(q, bodies)
        if found is not None:
            return found, looked
    return None, looked


def run(name: str, folder: Path, every: int, timeout: float) -> None:
    """Plan for one arm, look at every motion, and tell."""
    hand, arm = panda(folder.parent.parent / "panda"), ARMS[name]
    robot = arm.geometry({"acceleration": 10.0})
    truth = Triangles(arm, robot)
    times: list[float] = []
    stages: dict[str, list[float]] = {}
    count = reached = solved = wrong = looked = open_ones = 0
    least = np.inf
    for case in cases(folder, hand.chain.joint_names, every):
        scene = scene_at_root(case.text)
        bodies = scenery(scene)
        ends = start_and_goal(case, hand, robot, truth, bodies)
        if ends is None:
            continue
        start, goal, by_pose = ends
        problem = Problem(robot, scene, start, (JointGoal(goal),))
        if not times:
            plan(problem, Options(timeout=timeout))
        count, reached = count + 1, reached + by_pose
        began = time.process_time()
        answer = plan(problem, Options(timeout=timeout))
        milliseconds = 1e3 * (time.process_time() - began)
        if isinstance(answer, Failure):
            known = has_way(Checker.of(robot, scene), (start, goal), truth, bodies)
            told = "OMPL finds a way" if known else "nor does OMPL find a way, not counted"
            print(f"  {case.name}: {answer.code} {answer.message}; {told}", flush=True)
            if not known:
                count, reached, open_ones = count - 1, reached - by_pose, open_ones + 1
                continue
        times.append(milliseconds)
        if isinstance(answer, Failure):
            continue
        note_stages(stages, answer)
        solved += 1
        least = min(least, answer.certificate.min_clearance)
        pair, seen = unclean(answer.trajectory, truth, bodies)
        looked += seen
        if pair is not None:
            wrong += 1
            print(f"  {case.name}: UNCLEAN {pair}", flush=True)
        if times[-1] > SLOW:
            print(f"  {case.name}: {times[-1]:.0f} ms", flush=True)
    middle, most, worst = np.percentile(times, [50, 95, 100])
    print(f"{name}: {solved} of {count} solved ({reached} between poses of the Panda's hand)")
    print(f"  {open_ones} more that no way is known for")
    print(f"  {wrong} unclean, {looked} configurations looked at")
    print(f"  least clearance {1e3 * least:.3g} mm")
    print(f"  computing ms: median {middle:.1f}, 95 % {most:.1f}, most {worst:.0f}", flush=True)
    for stage, spent in sorted(stages.items()):
        middle, most, worst = np.percentile(spent, [50, 95, 100])
        print(f"    {stage:16} {middle:8.1f} {most:8.1f} {worst:8.1f} in {len(spent)}", flush=True)


def note_stages(stages: dict[str, list[float]], answer: Plan) -> None:
    """Append what the stages of a plan took [ms], each by its name."""
    spent: dict[str, float] = {}
    for stage in answer.stages:
        spent[stage.name] = spent.get(stage.name, 0.0) + stage.processor_milliseconds
    for name, milliseconds in spent.items():
        stages.setdefault(name, []).append(milliseconds)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--robots", nargs="+", default=["ur5", "ur10"], choices=list(ARMS))
    parser.add_argument("--every", type=int, default=5, help="take every n-th problem of a kind")
    parser.add_argument("--timeout", type=float, default=5.0, help="[s]")
    given = parser.parse_args()
    for name in given.robots:
        run(name, given.problems, given.every, given.timeout)


if __name__ == "__main__":
    main()

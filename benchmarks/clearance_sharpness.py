"""How near the clearance that a certificate proves is to the true one, and what the proof takes.

    python -m benchmarks.clearance_sharpness ../data/mbm/panda [--every 5] [--samples 400]
    python -m benchmarks.clearance_sharpness --random 100

Plans MotionBenchMaker's problems, or built-in arms between random boxes, proves each motion again a
few times, and holds ``min_clearance`` and ``min_obstacle_clearance`` against the least exact
distance at evenly spaced times. What is sampled is at least the true clearance, so the ratios told
are at most the true ones.
"""

import argparse
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from armwright.robot import load_robot
from benchmarks.mbm_problems import cases, panda
from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.trajectory import Trajectory
from obstacles.checker import Checker
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Box
from planning.options import Options
from planning.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.proof.certificate import certify
from planning.result import Plan

#: Proofs of one motion; the least time counts.
REPEATS = 5
#: Distances beyond this are not looked for [m].
WITHIN = 0.3
#: Clearances below this are to be told sharply [m].
NEAR = 0.2
#: Built-in arms of the random problems.
ROBOTS = ("panda", "ur5e")
#: Obstacles of a random problem.
BOXES = 5
#: Share of the joints' ranges that random ends are drawn from.
END_SHARE = 0.6


def sampled_clearance(checker: Checker, motion: Trajectory, count: int) -> tuple[float, float]:
    """Least distance from obstacles and among own links at evenly spaced times [m].

    Args:
        checker: The robot in its scene.
        motion: The motion.
        count: Number of times.
    """
    obstacle = own = np.inf
    first_own = len(checker.model.links) * len(checker.model.arrays.scene)
    for t in np.linspace(0.0, motion.duration, count):
        q = motion.sample(np.array([t]))[0]
        near = checker.gradient(q, WITHIN)
        distances: Array = near.distances
        of_own = near.pairs >= first_own
        obstacle = min(obstacle, distances[~of_own].min(initial=np.inf))
        own = min(own, distances[of_own].min(initial=np.inf))
    return float(obstacle), float(own)


def measure(problem: Problem, motion: Trajectory, count: int) -> Array:
    """Proved and sampled clearance [m] of all and of obstacles, time of the proof [ms], cells."""
    best = np.inf
    for _ in range(REPEATS):
        began = time.process_time()
        certificate = certify(motion, problem.robot, problem.scene)
        best = min(best, 1e3 * (time.process_time() - began))
    obstacle, own = sampled_clearance(Checker.of(problem.robot, problem.scene), motion, count)
    return np.array([
        certificate.min_clearance, min(obstacle, own),
        certificate.min_obstacle_clearance, obstacle, best, certificate.cells,
    ])  # fmt: skip


def random_problems(count: int, seed: int = 0) -> Iterator[Problem]:
    """Motions of built-in arms between random configurations among five random boxes.

    Args:
        count: Number of problems, those whose ends collide left out.
        seed: Of the random generator.
    """
    random = np.random.default_rng(seed)
    robots = [load_robot(name) for name in ROBOTS]
    while count > 0:
        robot = robots[count % len(robots)]
        limits = robot.chain.limits
        ends = random.uniform(limits.lower, limits.upper, (2, robot.chain.n)) * END_SHARE
        boxes = []
        for i in range(BOXES):
            angle, radius = random.uniform(-np.pi, np.pi), random.uniform(0.4, 1.2)
            at = [radius * np.cos(angle), radius * np.sin(angle), random.uniform(0.1, 1.0)]
            size = random.uniform(0.05, 0.25, 3)
            boxes.append(Obstacle(f"box{i}", Box(size), transform(None, at)))
        scene = Scene(tuple(boxes))
        checker = Checker.of(robot, scene)
        if checker.valid(ends[0]) and checker.valid(ends[1]):
            count -= 1
            yield Problem(robot, scene, ends[0], (JointGoal(ends[1]),))


def main() -> None:
    """Print quantiles of the ratios and of the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path, nargs="?")
    parser.add_argument("--every", type=int, default=5)
    parser.add_argument("--random", type=int, default=0)
    parser.add_argument("--samples", type=int, default=400)
    arguments = parser.parse_args()
    problems: Iterable[Problem] = random_problems(arguments.random)
    if arguments.problems is not None:
        robot = panda(arguments.problems.resolve().parents[1] / "panda")
        chosen = cases(arguments.problems, robot.chain.joint_names, arguments.every)
        problems = (case.problem(robot, 0.0) for case in chosen)
    rows = []
    for problem in problems:
        answer = plan(problem, Options(timeout=30.0))
        if isinstance(answer, Plan):
            rows.append(measure(problem, answer.trajectory, arguments.samples))
    figures = np.array(rows)
    print(f"{len(figures)} motions")
    for name, column in (("all", 0), ("obstacles", 2)):
        proved, sampled = figures[:, column], figures[:, column + 1]
        near = (sampled > 0.0) & (sampled < NEAR)
        p10, p50 = np.quantile(proved[near] / sampled[near], (0.1, 0.5))
        print(f"min_clearance / sampled, {name}, below {NEAR:g} m ({near.sum()}): "
              f"p10 {p10:.2f}, median {p50:.2f}")  # fmt: skip
    for name, column in (("proof, computing time [ms]", 4), ("intervals", 5)):
        p50, p95 = np.quantile(figures[:, column], (0.5, 0.95))
        print(f"{name}: median {p50:.2f}, p95 {p95:.2f}, mean {figures[:, column].mean():.2f}")


if __name__ == "__main__":
    main()

"""Cost of meshes that are not convex beside their hulls: ``python -m benchmarks.mesh_costs``.

    python -m benchmarks.mesh_costs --robots ur5 ur10 xarm7 kinova

Arms of example-robot-data plan in scenes of our own, once with their links as they are and once
with the convex hull of every link, between configurations that are free for both. Told are the
processor times of states, edges, proofs, of the potential field and of plans with their stages:
medians with hulls and with meshes, their ratio, and that of the sums.
"""

import argparse
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.example_arms import ARMS
from benchmarks.mesh_descriptions import Array, fastest
from benchmarks.mesh_plans import note_stages
from benchmarks.mesh_scenes import own_scenes
from benchmarks.meshes import reach
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry, hulled
from obstacles.scene import Scene
from planning.options import Options
from planning.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan

#: Free configurations of each scene: every two of them are a problem.
STATES, TRIES = 16, 4000
#: Length of an edge [rad].
LENGTH = 0.5


def free_states(checkers: list[Checker], random: np.random.Generator) -> Array:
    """Random configurations that are free for all checkers, shape (k, n)."""
    low, high = checkers[0].model.chain.sampling_bounds()
    drawn = random.uniform(np.maximum(low, -np.pi), np.minimum(high, np.pi), (TRIES, len(low)))
    for checker in checkers:
        drawn = drawn[checker.each_valid(drawn)]
    return drawn[:STATES]


def plan_times(problem: Problem, planner: str) -> Iterator[tuple[str, list[float]]]:
    """Processor time of a plan and of its stages [ms]; nothing where none is found."""
    options = Options(planner=planner)
    plan(problem, options)
    began = time.process_time()
    answer = plan(problem, options)
    whole = 1e3 * (time.process_time() - began)
    if not isinstance(answer, Plan):
        return
    stages: dict[str, list[float]] = {}
    note_stages(stages, answer)
    if planner == "auto":
        yield "plan", [whole]
        yield from stages.items()
    else:
        yield planner, stages[planner]


def measure(robots: list[RobotGeometry], scenes: list[Scene]) -> list[dict[str, list[float]]]:
    """Times of each robot [ms], by what they are of; plans count that both robots have."""
    random = np.random.default_rng(0)
    told: list[dict[str, list[float]]] = [{} for _ in robots]
    for scene in scenes:
        checkers = [Checker.of(robot, scene) for robot in robots]
        states = free_states(checkers, random)
        steps = random.normal(size=states.shape)
        limits = robots[0].chain.limits
        ends = states + LENGTH * steps / np.linalg.norm(steps, axis=1)[:, None]
        ends = np.clip(ends, limits.lower, limits.upper)
        for own, checker in zip(told, checkers, strict=True):
            spent = fastest(checker, states, ends)
            for name, seconds in zip(("state", "edge"), spent, strict=True):
                own.setdefault(name, []).append(1e3 * seconds / max(len(states), 1))
        for a, b in zip(states[::2], states[1::2], strict=False):
            for planner in ("auto", "potential_field"):
                problems = [Problem(robot, scene, a, (JointGoal(b),)) for robot in robots]
                both = [dict(plan_times(problem, planner)) for problem in problems]
                for own, times, other in zip(told, both, both[::-1], strict=True):
                    for name in times.keys() & other.keys():
                        own.setdefault(name, []).extend(times[name])
    return told


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=8)
    parser.add_argument("--robots", nargs="+", default=["ur5"], choices=list(ARMS))
    given = parser.parse_args()
    for name in given.robots:
        robot = ARMS[name].geometry({"acceleration": 10.0})
        scenes = list(own_scenes(given.scenes, reach(robot)))
        hulls, meshes = measure([hulled(robot), robot], scenes)
        print(f"{name}: ms with hulls, with meshes, ratio of medians, of sums")
        for what, times in sorted(hulls.items()):
            a, b = np.median(times), np.median(meshes[what])
            sums = np.sum(meshes[what]) / np.sum(times)
            print(f"  {what:16} {a:9.4f} {b:9.4f} {b / a:6.2f} {sums:6.2f}  in {len(times)}")


if __name__ == "__main__":
    main()

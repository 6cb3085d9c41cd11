"""What a look at the scene costs as it grows: obstacles 10 to 1,000, clouds of 1,000 to 100,000.

    python -m benchmarks.planning.scale

The built-in Panda among random boxes, cylinders and balls, and among points on the walls of a room
with a table. Times are processor time: the model of a scene seen for the first time and again; a
configuration and a motion of half a radian in a loop inside a kernel; the clearance from Python;
proved plans between random free configurations, for a scene not seen before and again.
"""

import argparse
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np

from armwright.robot import load_robot
from benchmarks.verdict import certify_all, cheapest, verdicts_on
from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import FREE
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Cylinder, PointCloud, Sphere
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan

_STATES = 400
#: Plans between random free configurations for each scene, and the time each may take [s].
_PLANS, _PATIENCE = 8, 20.0


def clutter(random: np.random.Generator, count: int) -> Scene:
    """Solids around the arm, the smaller the more of them there are: all take the same room."""
    scale = (10.0 / count) ** (1.0 / 3.0)
    shapes = (
        Box(np.full(3, 0.15 * scale)),
        Cylinder(0.08 * scale, 0.2 * scale),
        Sphere(0.1 * scale),
    )
    obstacles = []
    for k in range(count):
        place = random.uniform(-1.0, 1.0, 3)
        place[:2] += 0.35 * np.sign(place[:2])
        obstacles.append(Obstacle(f"o{k}", shapes[k % 3], transform(None, place)))
    return Scene(tuple(obstacles))


def room(random: np.random.Generator, count: int) -> Scene:
    """Points on a floor, three walls and a table top, as a depth camera sees them."""
    points = random.uniform([-1.2, -1.2, -0.4], [1.2, 1.2, 1.4], (count, 3))
    face = random.integers(0, 5, count)
    points[face == 0, 2] = -0.4
    points[face == 1, 0] = -1.2
    points[face == 2, 1] = -1.2
    points[face == 3, 1] = 1.2
    table = face == 4
    points[table] = random.uniform([0.35, -0.6, 0.1], [0.9, 0.6, 0.101], (int(table.sum()), 3))
    return Scene((Obstacle("cloud", PointCloud(points, 0.01)),))


def measure(robot: RobotGeometry, scene: Scene, random: np.random.Generator) -> str:
    """One row of the table."""
    began = time.process_time()
    checker = Checker.of(robot, scene)
    model = checker.model.arrays
    prepared = time.process_time() - began
    began = time.process_time()
    assert Checker.of(robot, scene, 0.01).model.arrays is not model
    again = time.process_time() - began
    lower, upper = robot.chain.sampling_bounds()
    states = random.uniform(lower, upper, (_STATES, robot.chain.n))
    steps = random.normal(size=states.shape)
    steps *= 0.5 / np.linalg.norm(steps, axis=1, keepdims=True)
    verdicts = np.empty(_STATES)
    certify_all(model, states, steps, verdicts)
    edge = cheapest(lambda: certify_all(model, states, steps, verdicts))
    free_edges = float((verdicts == FREE).mean())
    state = cheapest(lambda: verdicts_on(model, states, 0.0, verdicts))
    free = states[verdicts == FREE][:100]
    clearance = cheapest(lambda: [checker.clearance(q) for q in free]) / max(len(free), 1)
    return (
        f"{1e3 * prepared:9.1f} {1e3 * again:7.2f} | {1e6 * state / _STATES:8.2f}"
        f" {1e6 * edge / _STATES:8.2f} {1e6 * clearance:9.1f} |"
        f" {np.mean(verdicts == FREE):6.0%} {free_edges:6.0%} | {plan_times(robot, scene, free)}"
    )


def plan_times(robot: RobotGeometry, scene: Scene, free: Array) -> str:
    """Medians of proved plans between free configurations: for the first time, again, how many."""
    firsts: list[float] = []
    agains: list[float] = []
    for start, goal in pairwise(free[: _PLANS + 1]):
        problem = Problem(robot, scene, start, (JointGoal(goal),))
        for spent in (firsts, agains):
            if spent is firsts:
                # Moved by a micrometre it is none of those whose models are kept.
                problem = replace(problem, scene=_move_scene(scene, 1e-6 * (1 + len(firsts))))
            began = time.process_time()
            found = plan(problem, Options(timeout=_PATIENCE))
            if isinstance(found, Plan):
                spent.append(time.process_time() - began)
    return f"{1e3 * np.median(firsts):8.0f} {1e3 * np.median(agains):8.0f} {len(agains):4d}"


def _move_scene(scene: Scene, by: float) -> Scene:
    T = transform(np.eye(3), [by, 0.0, 0.0])
    return Scene(
        tuple(replace(o, T_world_obstacle=T @ o.T_world_obstacle) for o in scene.obstacles)
    )


def main() -> None:
    """Print a row for each size."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--obstacles", type=int, nargs="*", default=[10, 30, 100, 300, 1000])
    parser.add_argument(
        "--points", type=int, nargs="*", default=[1_000, 3_000, 10_000, 30_000, 100_000]
    )
    sizes = parser.parse_args()
    robot = load_robot("panda")
    Checker.of(robot, Scene())
    measure(robot, clutter(np.random.default_rng(0), 3), np.random.default_rng(0))
    head = (
        "model ms   again | state us  edge us clear. us | free st. edges | plan ms    again   of 8"
    )
    print(f"{'obstacles':>9} {head}")
    for count in sizes.obstacles:
        scene = clutter(np.random.default_rng(1), count)
        print(f"{count:9d} {measure(robot, scene, np.random.default_rng(2))}", flush=True)
    print(f"{'points':>9} {head}")
    for count in sizes.points:
        scene = room(np.random.default_rng(1), count)
        print(f"{count:9d} {measure(robot, scene, np.random.default_rng(2))}", flush=True)


if __name__ == "__main__":
    main()

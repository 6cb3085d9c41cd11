"""The collision verdict: is it ever wrong, and what do a state and an edge cost?

    python -m benchmarks.verdict [--states 100000] [--problems ../data/mbm/panda]

Random states of every built-in robot among random solids of every kind (and with --problems of a
Panda with meshes in MotionBenchMaker scenes) are judged by the kernel and by python-fcl
(``benchmarks.fcl_judge``). A difference counts as wrong where the distance is farther than a
micrometre from 0. Times are processor time in a loop inside a kernel, and from Python.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.fcl_judge import FclJudge
from benchmarks.mbm_problems import cases
from benchmarks.mbm_problems import panda as mesh_panda
from benchmarks.scale import certify_all, cheapest
from kinematics.chain import Array
from kinematics.pose import from_axis_angle, transform
from kinematics.robots import builtin_names, builtin_srdf, builtin_urdf
from kinematics.serial import serial_chain
from kinematics.srdf import parse_srdf
from kinematics.urdf import parse_urdf
from obstacles.checker import Checker
from obstacles.motion import COLLIDING, FREE
from obstacles.moveit import scene_from_moveit
from obstacles.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Box, Capsule, Cone, Convex, Cylinder, HalfSpace, PointCloud, Sphere

#: Distances this near to 0 [m] are left to rounding.
BAND = 1e-6
_SCENES = 3
_EVERY = 12


def builtin(name: str) -> RobotGeometry:
    """A built-in robot."""
    description, semantics = parse_urdf(builtin_urdf(name)), parse_srdf(builtin_srdf(name))
    chain = serial_chain(description, semantics=semantics)
    return robot_geometry(chain, description, {}, semantics)


def clutter(random: np.random.Generator, reach: float) -> Scene:
    """Solids of every kind about as far away as an arm reaches, and a floor."""
    size = 0.2 * reach
    shapes = [
        Box(random.uniform(0.2, 2.0, 3) * size),
        Sphere(random.uniform(0.2, 0.8) * size),
        Cylinder(0.4 * size, 2.0 * size),
        Capsule(0.3 * size, size),
        Cone(0.6 * size, 2.0 * size),
        Convex(random.normal(size=(30, 3)) * 0.5 * size),
        PointCloud(random.normal(size=(40, 3)) * size, 0.1 * size),
    ]
    obstacles = [Obstacle("floor", HalfSpace(np.array([0.1, 0.0, 1.0]), -0.4 * reach))]
    for k, shape in enumerate(shapes):
        place = random.normal(size=3)
        place *= random.uniform(0.5, 1.0) * reach / np.linalg.norm(place)
        turn = from_axis_angle(random.normal(size=3), random.uniform(0.0, np.pi))
        obstacles.append(Obstacle(f"o{k}", shape, transform(turn, place)))
    return Scene(tuple(obstacles))


def pairs(problems: Path | None) -> Iterator[tuple[str, RobotGeometry, Scene]]:
    """Robots in scenes: three of our own for each built-in robot, and those of the problems."""
    random = np.random.default_rng(0)
    for name in builtin_names():
        robot = builtin(name)
        reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
        for k in range(_SCENES):
            yield f"{name} {k}", robot, clutter(random, reach)
    if problems is not None:
        arm = mesh_panda(problems.parent.parent / "panda")
        for case in cases(problems, arm.chain.joint_names, _EVERY):
            yield case.name, arm, scene_from_moveit(case.text)


def judge(checker: Checker, states: Array) -> Array:
    """The kernel's verdicts on states (k, n)."""
    verdicts = np.empty(len(states))
    certify_all(checker.model.arrays, states, 0.0 * states, verdicts)
    return verdicts


def wrong(checker: Checker, referee: FclJudge, states: Array, verdicts: Array) -> tuple[int, int]:
    """Verdicts on states (k, n) that FCL does not share, and those among them outside the band."""
    differ = beyond = 0
    for q, verdict in zip(states, verdicts, strict=True):
        if referee.collides(q) != (verdict == COLLIDING):
            differ += 1
            near = checker.gradient(q, BAND).distances
            beyond += not abs(near.min(initial=np.inf)) <= BAND
    return differ, beyond


def measure(
    checker: Checker, free: Array, random: np.random.Generator
) -> tuple[float, float, float]:
    """What a free state costs, an edge of half a radian from it, a state from Python [s]."""
    steps = random.normal(size=free.shape)
    steps *= 0.5 / np.linalg.norm(steps, axis=1, keepdims=True)
    room, model, k = np.empty(len(free)), checker.model.arrays, max(len(free), 1)
    return (
        cheapest(lambda: certify_all(model, free, 0.0 * free, room)) / k,
        cheapest(lambda: certify_all(model, free, steps, room)) / k,
        cheapest(lambda: [checker.valid(q) for q in free]) / k,
    )


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument("--problems", type=Path)
    asked = parser.parse_args()
    todo = list(pairs(asked.problems))
    each = -(-asked.states // len(todo))
    random = np.random.default_rng(1)
    print(f"{'robot and scene':36} states collide | state us  edge us  python us | differ wrong")
    total, differing, mistaken, times = 0, 0, 0, []
    for name, robot, scene in todo:
        checker, referee = Checker.of(robot, scene), FclJudge(robot, scene)
        lower, upper = robot.chain.sampling_bounds()
        states = random.uniform(lower, upper, (each, robot.chain.n))
        verdicts = judge(checker, states)
        differ, beyond = wrong(checker, referee, states, verdicts)
        spent = measure(checker, states[verdicts == FREE][:300], random)
        total, differing, mistaken = total + each, differing + differ, mistaken + beyond
        times.append(spent)
        print(
            f"{name:36} {each:6d} {np.mean(verdicts == COLLIDING):7.0%} |"
            f" {1e6 * spent[0]:8.2f} {1e6 * spent[1]:8.2f} {1e6 * spent[2]:10.2f}"
            f" | {differ:6d} {beyond:5d}",
            flush=True,
        )
    state, edge, called = np.median(times, axis=0)
    print(f"{total} states: {differing} differ from FCL, {mistaken} of them beyond {BAND:g} m")
    print(
        f"medians: {1e6 * state:.2f} us a free state, {1e6 * edge:.2f} us an edge of 0.5 rad from"
        f" it ({1.0 / edge:,.0f} a second), {1e6 * called:.2f} us a state from Python"
    )


if __name__ == "__main__":
    main()

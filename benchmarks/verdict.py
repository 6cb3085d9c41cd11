"""The collision verdict: is it ever wrong, and what do a state and an edge cost?

    python -m benchmarks.verdict [--states 100000] [--problems ../data/mbm/panda]

Random states of every built-in robot among random solids of every kind (and with --problems of a
Panda with meshes in MotionBenchMaker scenes) are judged by the kernel and by python-fcl
(``benchmarks.judges.fcl``). A difference counts as wrong where the distance is farther than a
micrometre from 0; so does a verdict of the walk over motions that differs. Times are processor
time in a loop inside a kernel, and from Python; "path" is a state on a path that the planner found
in the scene, "asked" the pairs of such a state that its brackets left to the exact test.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from armwright.robot import load_robot
from benchmarks.judges.fcl import FclJudge
from benchmarks.mbm_problems import cases, scene_at_root
from benchmarks.mbm_problems import panda as mesh_panda
from benchmarks.rounds import rounds
from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.pose import from_axis_angle, transform
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import COLLIDING, FREE, MAX_INTERVALS, Cubic, certify_in
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.state_check import verdict_in
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
    PointCloud,
    Sphere,
)
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan

#: Time for a path [s], and states that are looked at on it.
_BUDGET, _ALONG = 2.0, 300
#: Distances this near to 0 [m] are left to rounding.
BAND = 1e-6
_SCENES = 3
_REPEATS = 5
_EVERY = 12


@kernel
def certify_all(model: ModelArrays, starts: Array, steps: Array, verdicts: Array) -> None:
    """Verdict on the straight motion by ``steps`` (k, n) from each of ``starts`` (k, n)."""
    work, found, zero = workspace(model), np.empty(4), np.zeros(starts.shape[1])
    for k in range(starts.shape[0]):
        line = Cubic(starts[k], steps[k], zero, zero)
        verdicts[k] = certify_in(model, work, line, 0.0, MAX_INTERVALS, found)


@kernel
def verdicts_on(model: ModelArrays, states: Array, margin: float, verdicts: Array) -> int:
    """Write the verdicts on states (k, n); number of pairs that took the exact test."""
    work, asked, total = workspace(model), np.empty(1, dtype=np.int64), 0
    for k in range(states.shape[0]):
        verdicts[k] = verdict_in(model, work, states[k], margin, asked)
        total += asked[0]
    return total


def cheapest(task: Callable[[], object]) -> float:
    """Processor time of the cheapest of a few runs [s]."""
    return 1e-6 * float(rounds({"": task}, _REPEATS)[""].min())


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


def pairs(problems: Path | None) -> Iterator[tuple[str, RobotGeometry, Scene, Array | None]]:
    """Robots in scenes: three of our own for each built-in robot, and the problems' with ends."""
    random = np.random.default_rng(0)
    for name in builtin_names():
        robot = load_robot(name)
        reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
        for k in range(_SCENES):
            yield f"{name} {k}", robot, clutter(random, reach), None
    if problems is not None:
        arm = mesh_panda(problems.parent.parent / "panda")
        for case in cases(problems, arm.chain.joint_names, _EVERY):
            ends = np.array([case.start, case.goal])
            yield case.name, arm, scene_at_root(case.text), ends


def judge(checker: Checker, states: Array) -> Array:
    """The kernel's verdicts on states (k, n)."""
    verdicts = np.empty(len(states))
    verdicts_on(checker.model.arrays, states, checker.slack, verdicts)
    return verdicts


def edge_verdicts(checker: Checker, states: Array) -> Array:
    """The verdicts of the walk over motions, on motions that stay where they are."""
    verdicts = np.empty(len(states))
    certify_all(checker.model.arrays, states, 0.0 * states, verdicts)
    return verdicts


def wrong(checker: Checker, referee: FclJudge, states: Array, verdicts: Array) -> tuple[int, int]:
    """Verdicts on states (k, n) that FCL does not share, and those among them outside the band."""
    differ = beyond = 0
    for q, verdict, other in zip(states, verdicts, edge_verdicts(checker, states), strict=True):
        truth = referee.collides(q)
        if truth != (verdict == COLLIDING) or truth != (other == COLLIDING):
            differ += 1
            near = checker.gradient(q, BAND).distances
            beyond += not abs(near.min(initial=np.inf)) <= BAND
    return differ, beyond


def path_states(robot: RobotGeometry, scene: Scene, ends: Array) -> Array:
    """States along the first path that is found between rows of ``ends``, two by two, (k, n)."""
    for start, goal in zip(ends[::2], ends[1::2], strict=False):
        problem = Problem(robot, scene, start, (JointGoal(goal),), margin=0.0)
        answer = plan(problem, Options(timeout=_BUDGET))
        if isinstance(answer, Plan):
            path = answer.trajectory
            return path.sample(np.linspace(path.breaks[0], path.breaks[-1], _ALONG))
    return ends[:0]


def measure(checker: Checker, free: Array, path: Array, random: np.random.Generator) -> Array:
    """Cost of a free state, one on a path, pairs asked there, of an edge, of a call from Python."""
    steps = random.normal(size=free.shape)
    steps *= 0.5 / np.linalg.norm(steps, axis=1, keepdims=True)
    room, model, k = np.empty(len(free)), checker.model.arrays, max(len(free), 1)
    along, number = np.empty(len(path)), max(len(path), 1)
    return np.array([
        cheapest(lambda: verdicts_on(model, free, 0.0, room)) / k,
        cheapest(lambda: verdicts_on(model, path, 0.0, along)) / number,
        verdicts_on(model, path, 0.0, along) / number,
        cheapest(lambda: certify_all(model, free, steps, room)) / k,
        cheapest(lambda: [checker.valid(q) for q in free]) / k,
    ])  # fmt: skip


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument("--problems", type=Path)
    asked = parser.parse_args()
    todo = list(pairs(asked.problems))
    each = -(-asked.states // len(todo))
    random = np.random.default_rng(1)
    print(f"{'robot and scene':32} states collide | us: state   path (asked)  edge python | wrong")
    total, differing, mistaken, times = 0, 0, 0, []
    for name, robot, scene, ends in todo:
        checker, referee = Checker.of(robot, scene), FclJudge(robot, scene)
        lower, upper = robot.chain.sampling_bounds()
        states = random.uniform(lower, upper, (each, robot.chain.n))
        verdicts = judge(checker, states)
        differ, beyond = wrong(checker, referee, states, verdicts)
        free = states[verdicts == FREE]
        path = path_states(robot, scene, free[:20] if ends is None else ends)
        spent = measure(checker, free[:300], path, random)
        if not len(path):
            spent[1:3] = np.nan
        if not len(free):
            spent[:] = np.nan
        total, differing, mistaken = total + each, differing + differ, mistaken + beyond
        times.append(spent)
        state, along, asked, edge, called = spent * [1e6, 1e6, 1.0, 1e6, 1e6]
        print(
            f"{name:32} {each:6d} {np.mean(verdicts == COLLIDING):7.0%} | {state:9.2f} {along:6.2f}"
            f" ({asked:5.2f}) {edge:5.1f} {called:6.2f} | {beyond:5d}",
            flush=True,
        )
    state, along, asked, edge, called = np.nanmedian(times, axis=0) * [1e6, 1e6, 1.0, 1e6, 1e6]
    print(f"{total} states: {differing} differ from FCL, {mistaken} of them beyond {BAND:g} m")
    print(
        f"medians: {state:.2f} us a free state, {along:.2f} us a state on a path ({asked:.2f} exact"
        f" tests), {edge:.2f} us an edge of 0.5 rad ({1e6 / edge:,.0f} a second), {called:.2f} us a"
        " state from Python"
    )


if __name__ == "__main__":
    main()

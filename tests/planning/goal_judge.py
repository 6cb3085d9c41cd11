"""Judge of the configuration of a pose that a plan ends in.

The rule: no plan ends within 2 % of a joint's range from its limit where another configuration of
the pose is reached in at most 1.2 times its time. Poses are those of random free configurations;
every second one has a joint at its limit, every third problem has obstacles. Where a plan ends at
a limit, all other configurations that are found are planned to by themselves. They are found by
starts of the numeric method all over the joints' ranges, and by every copy by whole turns;
pinocchio's frames judge that they are configurations of the pose. Told is also the time of the
motion against the best of the configurations that straight motions reach soonest ("behind").
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from armwright.robot import load_robot
from benchmarks.problems.example_arms import ARMS
from benchmarks.problems.mesh_scenes import own_scenes
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Plan
from tests.planning.pinocchio_arm import PinocchioArm

#: The rule.
NEAR, LONGER = 0.02, 1.2
LIMITS = {"velocity": 2.0, "acceleration": 8.0, "jerk": 80.0}
#: Starts of the numeric method, configurations at most, and those that are planned to.
_STARTS, _MOST, PLANNED = 3000, 60, 12
#: What free configurations keep [m], and how far a pose may be from the one asked for [m or rad].
CLEAR, _OFF = 2e-3, 1e-4
_TURN = 2.0 * np.pi


def arm(name: str) -> RobotGeometry:
    """A built-in arm, or one of example-robot-data."""
    return load_robot(name) if name in builtin_names() else ARMS[name].geometry(LIMITS)


def limit_share(chain: Chain, q: Array) -> float:
    """Least distance from a limit as a share of the joint's range."""
    low, high = chain.limits.lower, chain.limits.upper
    shares = [
        min(q[j] - low[j], high[j] - q[j]) / (high[j] - low[j])
        for j in range(chain.n)
        if not chain.continuous[j] and np.isfinite(high[j] - low[j]) and high[j] > low[j]
    ]
    return min(shares, default=0.5)


def least_time(chain: Chain, start: Array, goal: Array) -> float:
    """No motion takes less: of each joint at its limits of velocity and acceleration alone."""
    times = []
    for d, v, a in zip(
        np.abs(goal - start), chain.limits.velocity, chain.limits.acceleration, strict=True
    ):
        times.append(d / v + v / a if d * a > v * v else 2.0 * np.sqrt(d / a))
    return float(max(times))


def configurations(chain: Chain, T: Array, start: Array, known: Array) -> list[Array]:
    """Configurations of a pose, with copies by whole turns, the nearest in time first."""
    options = numeric.SearchOptions(seed=77, starts=_STARTS)
    found = numeric.solve(chain, T, options, seed_joints=known, solutions=_MOST).solutions
    every: dict[bytes, Array] = {}
    for solution in found:
        values = [_copies(chain, start, solution.joints, j) for j in range(chain.n)]
        for copy in itertools.product(*values):
            q = np.array(copy)
            every.setdefault(np.round(q, 3).tobytes(), q)
    return sorted(every.values(), key=lambda q: least_time(chain, start, q))


def _copies(chain: Chain, start: Array, q: Array, j: int) -> list[float]:
    if chain.joint_types[j] != 0:
        return [q[j]]
    low, high = chain.limits.lower[j], chain.limits.upper[j]
    if chain.continuous[j] or not np.isfinite(high - low):
        return [q[j] + _TURN * np.round((start[j] - q[j]) / _TURN)]
    return [q[j] + _TURN * k for k in range(-2, 3) if low <= q[j] + _TURN * k <= high]


def problems(robot: RobotGeometry, count: int, seed: int) -> Iterator[tuple[Problem, Array]]:
    """Problems with a pose as their goal, and a configuration of it."""
    chain = robot.chain
    random = np.random.default_rng(seed)
    low, high = chain.sampling_bounds()
    reach = numeric.reach(chain)[1]
    scenes = list(own_scenes(count, min(reach, 1.2), seed))
    made = 0
    while made < count:
        scene = scenes[made] if made % 3 == 2 else Scene(())
        start, goal = random.uniform(low, high, (2, chain.n))
        bounded = [j for j in range(chain.n) if not chain.continuous[j]]
        if made % 2 and bounded:
            joint = int(random.choice(bounded))
            goal[joint] = high[joint] - NEAR * random.random() * (high[joint] - low[joint])
        checker = Checker.of(robot, scene)
        if min(checker.clearance(q)[0] for q in (start, goal)) < CLEAR:
            continue
        made += 1
        yield Problem(robot, scene, start, (PoseGoal(forward(chain, goal)),)), goal


@dataclass
class Tally:
    """What came of the problems of an arm.

    Args:
        planned: Plans.
        broken: Problems whose plan breaks the rule, and the time of a better one by that plan's.
        behind: Times of motions by those of the best other configuration that was planned to.
    """

    planned: int = 0
    broken: list[tuple[int, float]] = field(default_factory=list)
    behind: list[float] = field(default_factory=list)


def judge(robot: RobotGeometry, urdf: str, count: int, seed: int, timeout: float = 10.0) -> Tally:
    """Plan the problems of an arm, and to other configurations of their poses."""
    tally, frames = Tally(), PinocchioArm(urdf=urdf, chain=robot.chain)
    options = Options(timeout=timeout)
    for k, (problem, known) in enumerate(problems(robot, count, seed)):
        if not k:
            plan(problem, options)
        answer = plan(problem, options)
        if not isinstance(answer, Plan):
            continue
        tally.planned += 1
        last, took = answer.path.waypoints[-1], answer.trajectory.duration
        at_limit = limit_share(robot.chain, last) < NEAR
        most = PLANNED if at_limit else 1
        best = soonest(robot, problem.scene, frames, (problem.start, known, None), took, options,
                       most)  # fmt: skip
        if at_limit and best <= LONGER * took:
            tally.broken.append((k, round(best / took, 3)))
        if np.isfinite(best):
            tally.behind.append(took / best)
    return tally


def soonest(
    robot: RobotGeometry,
    scene: Scene,
    frames: PinocchioArm,
    places: tuple[Array, Array, Array | None],
    took: float,
    options: Options,
    most: int = PLANNED,
) -> float:
    """The least time of plans by configurations of a pose away from limits; infinite without any.

    Args:
        places: Configurations before, of the pose, and after it, if the arm goes on.
        took: Nothing is planned that takes longer than this by far [s].
        most: Configurations that are planned to at most.
    """
    (before, known, after), chain, times = places, robot.chain, [np.inf]
    checker, T = Checker.of(robot, scene), forward(chain, known)
    for q in configurations(chain, T, before, known):
        ways = [(before, q)] if after is None else [(before, q), (q, after)]
        longer = sum(least_time(chain, *way) for way in ways) > LONGER * took
        if longer or limit_share(chain, q) < NEAR or checker.clearance(q)[0] < CLEAR:
            continue
        if not most:
            break
        most -= 1
        if np.abs(frames.pose(q) - T).max() > _OFF:
            raise AssertionError("no configuration of the pose")
        motions = [plan(Problem(robot, scene, a, (JointGoal(b),)), options) for a, b in ways]
        if all(isinstance(motion, Plan) for motion in motions):
            times.append(sum(m.trajectory.duration for m in motions if isinstance(m, Plan)))
    return min(times)

"""Judge of the configurations that tasks and tours take.

The rule: the arm rests within 2 % of a joint's range from its limit at no pose of a task or tour
where another configuration of it makes the motions beside it at most 1.2 times as long, those
before and after it staying as they are. Poses are those of random free configurations of which
two of three have a joint at its limit; every third problem has obstacles. Where an answer rests at
a limit all configurations that are found apart (``goal_judge``) are planned to and from.
"""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.problems.mesh_scenes import own_scenes
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.numeric import numeric
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.problem import PoseGoal
from planning.sequence.result import SequencePlan, TaskOptions
from planning.sequence.search import plan_task
from planning.sequence.stage import Move
from planning.sequence.task import Task
from planning.sequence.world import World
from planning.tours.planner import plan_tour
from planning.tours.problem import TourGoal, TourOptions, TourProblem
from planning.tours.result import Tour
from planning.values.preferences import PreferredClearance
from tests.planning.goal_judge import (
    CLEAR,
    LONGER,
    NEAR,
    arm,
    limit_share,
    soonest,
)
from tests.planning.pinocchio_arm import PinocchioArm

#: Poses of one task or tour.
POSES = 3


@dataclass
class Rests:
    """Where an answer rests, and how long its motions take.

    Args:
        joints: From the start on, shape (k, n) [rad or m].
        times: Of the motions between them, shape (k - 1,) [s].
        known: A configuration of each pose, shape (k - 1, n).
    """

    joints: Array
    times: Array
    known: Array


@dataclass
class Tally:
    """What came of the problems of an arm.

    Args:
        solved: Answers.
        broken: Times of better motions by those of the answer.
    """

    solved: int = 0
    broken: list[float] = field(default_factory=list)


def judge(name: str, kind: str, count: int, seed: int) -> Tally:
    """Plan the tasks or tours of a built-in arm, and to other configurations of their poses."""
    robot, tally = arm(name), Tally()
    chain = robot.chain
    frames = PinocchioArm(name)
    random = np.random.default_rng(seed)
    scenes = list(own_scenes(count, min(numeric.reach(chain)[1], 1.2), seed))
    for k in range(count):
        scene = scenes[k] if k % 3 == 2 else Scene(())
        checker = Checker.of(robot, scene)
        start = _free(robot, checker, random, at_limit=False)
        known = [_free(robot, checker, random, at_limit=i != 1) for i in range(POSES)]
        answer = (_task if kind == "task" else _tour)(robot, scene, start, known)
        if answer is None:
            continue
        tally.solved += 1
        for i in range(1, len(answer.joints)):
            if limit_share(chain, answer.joints[i]) < NEAR:
                after = answer.joints[i + 1] if i + 1 < len(answer.joints) else None
                took = float(answer.times[i - 1 : i + 1].sum())
                places = answer.joints[i - 1], answer.known[i - 1], after
                best = soonest(robot, scene, frames, places, took, _options(kind))
                if best <= LONGER * took:
                    tally.broken.append(round(best / took, 3))
    return tally


def _free(
    robot: RobotGeometry, checker: Checker, random: np.random.Generator, *, at_limit: bool
) -> Array:
    chain = robot.chain
    low, high = chain.sampling_bounds()
    while True:
        q = random.uniform(low, high)
        if at_limit:
            joint = int(random.choice([j for j in range(chain.n) if not chain.continuous[j]]))
            q[joint] = high[joint] - NEAR * random.random() * (high[joint] - low[joint])
        if checker.clearance(q)[0] > CLEAR:
            return np.asarray(q)


def _task(robot: RobotGeometry, scene: Scene, start: Array, known: list[Array]) -> Rests | None:
    stages = tuple(Move((PoseGoal(forward(robot.chain, q)),)) for q in known)
    answer = plan_task(Task(World(robot, scene), start, stages), TaskOptions(30.0))
    if not isinstance(answer, SequencePlan):
        return None
    motions = [stage.trajectory for stage in answer.stages]
    joints = np.array([start, *(motion.end for motion in motions)])
    return Rests(joints, np.array([motion.duration for motion in motions]), np.array(known))


def _tour(robot: RobotGeometry, scene: Scene, start: Array, known: list[Array]) -> Rests | None:
    goals = tuple(
        TourGoal(str(i), (PoseGoal(forward(robot.chain, q)),)) for i, q in enumerate(known)
    )
    answer = plan_tour(TourProblem(robot, scene, goals, start), TourOptions(_options("tour")))
    if not isinstance(answer, Tour):
        return None
    joints = np.array([start, *(visit.joints for visit in answer.visits)])
    times = np.array([leg.trajectory.duration for leg in answer.legs])
    return Rests(joints, times, np.array([known[i] for i in answer.order]))


def _options(kind: str) -> Options:
    if kind == "task":
        return Options(timeout=30.0)
    return Options(timeout=30.0, clearance=PreferredClearance(0.0))

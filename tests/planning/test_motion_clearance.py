"""Whole motions keep the preferred clearance wherever there is room, by FCL's distances."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from tests.planning.roomy_scenes import KINDS, with_room
from tests.planning.scenes import builtin, planned_motion

#: The example of the README.
START = np.array([0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8])
GOAL = np.array([-0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8])
PREFERRED = 0.02
#: What FCL's distances are good for [m].
ACCURACY = 1e-5


def distances(
    robot: RobotGeometry, scene: Scene, motion: Trajectory, times: Array, most: float = 0.1
) -> Array:
    """Distance of the robot from obstacles at some instants by FCL, or ``most``, shape (k,)."""
    world = FclWorld(robot, scene)
    pairs = np.flatnonzero(world.pairs[:, 1] >= len(robot.pieces))
    found = np.full(len(times), most)
    for k, q in enumerate(motion.sample(times)):
        world.set_configuration(q)
        bounds = world.ball_bounds(*world.pairs[pairs].T)
        for number in np.argsort(bounds):
            if bounds[number] >= found[k]:
                break
            found[k] = min(found[k], world.distance(int(pairs[number])))
    return found


def nearest(problem: Problem, answer: object) -> float:
    """Least distance of a motion from obstacles, looked at every 3 ms, or ``PREFERRED`` [m]."""
    assert isinstance(answer, Plan)
    motion = answer.trajectory
    times = np.linspace(0.0, motion.duration, int(motion.duration / 3e-3))
    return float(distances(problem.robot, problem.scene, motion, times, PREFERRED).min())


@pytest.mark.parametrize("seed", range(6))
def test_a_post_with_room_beside_it_is_passed_at_the_preferred_distance(seed: int) -> None:
    random = np.random.default_rng(seed)
    place = (0.5, 0.0) if seed < 3 else random.uniform([0.45, -0.15], [0.65, 0.15])
    post = Obstacle("post", Box((0.1, 0.1, 1.0)), transform(None, (*place, 0.5)))
    problem = Problem(builtin("panda"), Scene((post,)), START, (JointGoal(GOAL),))
    answer = plan(problem, Options(seed=seed, timeout=60.0))
    assert nearest(problem, answer) >= PREFERRED - ACCURACY
    assert isinstance(answer, Plan)
    assert answer.clearance is not None
    assert answer.clearance.spans == ()


@pytest.mark.parametrize("arm", ["ur5e", "kr6_sixx", "iiwa14"])
@pytest.mark.parametrize("kind", list(KINDS))
def test_motions_in_scenes_with_room_keep_the_preferred_distance(arm: str, kind: str) -> None:
    random = np.random.default_rng([7, len(kind)])
    problem = with_room(builtin(arm), kind, PREFERRED, random)
    assert nearest(problem, plan(problem, Options(timeout=60.0))) >= PREFERRED - ACCURACY


def test_a_motion_to_a_near_goal_is_near_there_alone_and_says_so() -> None:
    # Beside the post at its goal, with the post in between.
    post = Obstacle("post", Box((0.1, 0.1, 1.0)), transform(None, (0.5, 0.0, 0.5)))
    robot, scene = builtin("panda"), Scene((post,))
    checker = Checker.of(robot, scene)
    ways = np.linspace(GOAL, START, 200)
    kept = checker.each_valid(ways)
    goal = ways[int(np.argmin(kept)) - 3]
    problem = Problem(robot, scene, START, (JointGoal(goal),))
    answer = planned_motion(problem, Options(timeout=60.0))
    report, motion = answer.clearance, answer.trajectory
    assert report is not None
    times = np.linspace(0.0, motion.duration, 800)
    truth = distances(robot, scene, motion, times)
    assert truth[-1] < PREFERRED
    (span,) = report.spans
    assert span.ends == motion.duration
    assert span.begins > 0.7 * motion.duration
    inside = times >= span.begins
    assert (truth[~inside] >= PREFERRED - ACCURACY).all()
    assert abs(span.distance - truth[inside].min()) < 1e-3
    assert span.pair[1] == "post"

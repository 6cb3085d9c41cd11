"""The same request is answered with the same bytes, here and in a process of its own."""

import hashlib
import subprocess
import sys

import numpy as np

from kinematics.arrays import Array
from planning.options import Options
from planning.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from tests.planning.scenes import HOME, builtin, pillar, shelf

#: No deadline may cut a stage short: that is the one thing that time may change [s].
_TIMEOUT = 60.0


def turned(angle: float) -> Array:
    goal = HOME.copy()
    goal[0] += angle
    return goal


def digests() -> list[str]:
    """Hashes of answers from the ladder's rungs: past a post, into a shelf, by a random tree."""
    robot = builtin("panda")
    into_shelf = np.array([0.0, 0.1, 0.0, -2.3, 0.0, 2.4, 0.785])
    problems = (
        (Problem(robot, pillar(), HOME, (JointGoal(turned(0.9)),)), "auto"),
        (Problem(robot, pillar(), HOME, (JointGoal(turned(0.9)),)), "rrt_connect"),
        (Problem(robot, shelf(), turned(1.4), (JointGoal(into_shelf),)), "auto"),
    )
    found = []
    for problem, planner in problems:
        answer = plan(problem, Options(planner=planner, timeout=_TIMEOUT, seed=3))
        told = hashlib.sha256(type(answer).__name__.encode())
        if isinstance(answer, Plan):
            motion, proof = answer.trajectory, answer.certificate
            told.update(answer.path.waypoints.tobytes())
            told.update(motion.breaks.tobytes() + motion.coefficients.tobytes())
            told.update(repr((answer.planner, proof.min_clearance, proof.cells)).encode())
        found.append(told.hexdigest())
    return found


def test_same_bytes_again_and_in_a_fresh_process() -> None:
    first = digests()
    assert digests() == first
    program = "from tests.planning.test_reproducible import digests; print(*digests())"
    fresh = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    assert fresh.stdout.split() == first

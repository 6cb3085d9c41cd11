"""The same request is answered with the same bytes, here and in a process of its own."""

import hashlib
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from kinematics.arrays import Array
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from planning.values import deadline
from planning.values.optimize_options import RefineOptions
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


def around_the_post() -> Problem:
    """A problem whose straight motion is not free."""
    post = pillar(angle=0.0, distance=0.4)
    return Problem(builtin("panda"), post, turned(-0.9), (JointGoal(turned(0.9)),))


def test_a_search_that_time_ended_is_not_deterministic(monkeypatch: pytest.MonkeyPatch) -> None:
    # Whatever else the machine does: the proof has its share of the time.
    monkeypatch.setattr(deadline, "time", SimpleNamespace(monotonic=time.process_time))
    problem = around_the_post()
    # A search for ever shorter paths ends with the deadline; one with a budget does not.
    endless = plan(problem, Options(planner="bit_star", timeout=0.5))
    counted = plan(
        problem,
        Options(planner="bit_star", timeout=_TIMEOUT, planner_options={"max_edges": 500}),
    )
    assert isinstance(endless, Plan)
    assert isinstance(counted, Plan)
    assert not endless.deterministic
    assert counted.deterministic


def test_an_optimisation_that_time_ended_is_not_deterministic() -> None:
    problem = around_the_post()
    refine = RefineOptions(rounds=1)
    counted = plan(problem, Options(timeout=_TIMEOUT, refine=refine))
    hurried = plan(problem, Options(timeout=0.06, refine=refine))
    assert isinstance(counted, Plan)
    assert counted.deterministic
    assert not isinstance(hurried, Plan) or not hurried.deterministic

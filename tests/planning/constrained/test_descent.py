"""Descents that end at a deadline, told by a clock of processor time."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from obstacles.collision.checker import Checker, collision_model
from obstacles.scenes.scene import Obstacle, Scene
from planning.constrained import descent
from planning.constrained.descent import Descents
from planning.constrained.ik import IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.orientation import ConeConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import SphereRegion
from planning.constraints.solvers.active_set import COURSE, FEASIBLE, OVER, STAGE, descend, go_on
from planning.constraints.solvers.active_set_program import (
    LEAST_GAIN,
    LEFT,
    linearise,
    make_goal,
    make_work,
    search_arrays,
)
from planning.values import deadline as deadlines
from planning.values.deadline import Deadline
from tests.obstacles.distance.triangles.test_distance import mesh
from tests.obstacles.meshes.test_decomposition import ring
from tests.planning.scenes import HOME, builtin, pillar

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
TIP = forward(CHAIN, HOME)
#: Upright in a ball beside a post, nearest to a posture that is elsewhere.
WANTED = ConstraintSet(
    CHAIN,
    (
        ConeConstraint(TIP[:3, :3].T @ [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], 0.1),
        PositionConstraint(SphereRegion(TIP[:3, 3], 0.05)),
    ),
)
MODEL = search_arrays(collision_model(ROBOT, pillar(0.45, 0.25)), 1e-6)
GOAL = make_goal(WANTED, HOME + 0.4, np.ones(7))


def starts(count: int) -> list[Array]:
    random = np.random.default_rng(0)
    return list(random.uniform(*CHAIN.sampling_bounds(), (count, 7)))


def test_few_steps_at_a_time_lead_where_one_descent_does() -> None:
    arrived = 0
    for start in starts(16):
        whole, found = start.copy(), np.empty(2)
        descend(MODEL, GOAL, whole, found)
        sliced = Descents(GOAL, Deadline.after(600.0)).descend(MODEL, start, LEAST_GAIN)
        arrived += found[0] <= FEASIBLE
        np.testing.assert_allclose(sliced, whole, atol=1e-4 if found[0] <= FEASIBLE else 0.5)
    assert arrived >= 3


@pytest.mark.parametrize("left", [1.0, 3.0, 7.0])
def test_a_step_that_is_cut_is_not_taken(left: float) -> None:
    """However few linearisations are allowed, violation and objective only ever fall."""
    for start in starts(4):
        work, q, course = make_work(MODEL, GOAL), start.copy(), np.zeros(COURSE)
        last = np.array([0.0, np.inf, np.inf])
        for _ in range(400):
            work.pace[LEFT] = left
            go_on(MODEL, GOAL, q, 2, work, course)
            assert work.pace[LEFT] >= -8.0
            _, _, violated = linearise(MODEL, GOAL, q, work)
            stage = min(course[STAGE], 1.0)
            inside = course[1] if stage else np.inf
            assert stage >= last[0]
            assert violated <= max(last[1], FEASIBLE**2 * 1e3)
            assert inside <= last[2]
            last = np.array([stage, violated, inside])
            if course[STAGE] == OVER:
                break


def test_a_step_that_was_cut_is_told() -> None:
    start = starts(1)[0]
    whole, cut = Deadline.after(600.0), Deadline.after(600.0)
    Descents(GOAL, whole).descend(MODEL, start, LEAST_GAIN)
    assert not whole.interruptions.occurred
    # As if one linearisation took all of the time: two are allowed.
    Descents(GOAL, cut, longest=600.0).descend(MODEL, start, LEAST_GAIN)
    assert cut.interruptions.occurred


def test_deadlines_are_kept_where_one_descent_takes_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Among rings of many triangles."""
    clock = SimpleNamespace(monotonic=time.process_time, thread_time=time.process_time)
    monkeypatch.setattr(deadlines, "time", clock)
    monkeypatch.setattr(descent, "time", clock)
    places = [forward(CHAIN, q) for q in starts(4)]
    rings = tuple(Obstacle(f"ring{k}", mesh(ring()), T) for k, T in enumerate(places))
    scene = Scene(rings)
    Checker.of(ROBOT, scene, 0.0)
    # Kernels are loaded and meshes packed before the clock counts.
    constrained_ik(ROBOT, WANTED, scene, IkOptions(most=2, deadline=Deadline.after(0.01)))
    for allowed in (0.002, 0.1):
        began = time.process_time()
        how = IkOptions(most=30, starts=100_000, deadline=Deadline.after(allowed))
        found = constrained_ik(ROBOT, WANTED, scene, how)
        taken = time.process_time() - began
        assert taken < allowed + 0.1
        assert found.starts >= 1
        for solution in found.solutions:
            assert WANTED.residuals(solution.joints).max() <= 1e-6
            assert Checker.of(ROBOT, scene, 0.0).valid(solution.joints)

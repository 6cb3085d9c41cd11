"""Exciting motions: certified, well conditioned, and good for what they are made for."""

from typing import Any

import numpy as np
import pytest

import armwright as aw
from dynamics.identification.identify import identify
from dynamics.identification.log import Log
from dynamics.parameters.base_parameters import base_parameters
from dynamics.parameters.regressor import regressor
from planning.excitation import Excitation, ExcitationOptions, excite
from planning.result import Failure
from planning.values.deadline import Deadline
from tests.dynamics.identification.logs import real_arm

READY = [0.3, -1.4, 1.5, -1.6, -1.5, 0.2]
POST = aw.Obstacle("post", aw.Box((0.2, 0.2, 1.0)), aw.pose([0.6, 0.1, 0.5]))


def found(
    name: str, scene: aw.Scene | None = None, start: Any = None, **options: Any
) -> Excitation:
    motion = excite(aw.load_robot(name), scene, start, ExcitationOptions(**options))
    assert isinstance(motion, Excitation), motion
    return motion


@pytest.mark.parametrize(("name", "start"), [("ur5e", READY), ("panda", None), ("scara", None)])
def test_a_motion_is_proved_periodic_and_at_rest_at_its_ends(name: str, start: Any) -> None:
    motion = found(name, None, start, evaluations=80, velocity_scaling=0.5)
    assert motion.certificate.verified
    assert motion.certificate.proved.collisions
    assert motion.certificate.limits["velocity"].worst_ratio <= 1.0
    ends = [0.0, motion.trajectory.duration]
    q = motion.trajectory.sample(ends)
    np.testing.assert_allclose(q[0], q[1], atol=1e-9)
    if start is not None:
        np.testing.assert_allclose(q[0], start, atol=1e-12)
    for derivative in (1, 2):
        np.testing.assert_allclose(motion.trajectory.sample(ends, derivative), 0.0, atol=1e-9)
    limit = aw.load_robot(name).chain.limits.velocity
    speed = np.abs(motion.trajectory.sample(np.linspace(0.0, ends[1], 500), 1))
    assert (speed <= 0.5 * limit + 1e-9).all()


def test_the_condition_number_is_that_of_the_base_regressor_and_falls_with_the_search() -> None:
    few, many = (found("ur5e", None, READY, evaluations=n, drives=()) for n in (1, 600))
    assert many.condition < 0.6 * few.condition
    chain = aw.load_robot("ur5e").chain
    base = base_parameters(chain)
    assert len(many.names) == base.count
    t = np.linspace(0.0, 10.0, 121)
    q, qd, qdd = (many.trajectory.sample(t, k) for k in range(3))
    Y = base.regressor(regressor(chain, q, qd, qdd, motors=False)) / chain.limits.effort[:, None]
    W = Y.reshape(-1, base.count)
    assert np.linalg.cond(W / np.linalg.norm(W, axis=0)) == pytest.approx(many.condition, rel=1e-3)


def test_logs_of_it_determine_all_parameters() -> None:
    robot = aw.load_robot("ur5e")
    motion = found("ur5e", None, READY, evaluations=100)
    truth = real_arm(robot.chain, 0)
    t = np.arange(0.0, 10.0, 0.01)
    q, qd, qdd = (motion.trajectory.sample(t, k) for k in range(3))
    noise = 0.1 * np.random.default_rng(0).standard_normal(q.shape)
    result = identify(robot.chain, Log(q, truth.torques(q, qd, qdd) + noise, t, qd, qdd))
    assert tuple(each.name for each in result.parameters) == motion.names
    assert not result.not_excited


def test_a_scene_is_kept_clear_of_and_the_same_seed_gives_the_same_motion() -> None:
    scene = aw.Scene([POST])
    a, b = (found("ur5e", scene, [1.8, *READY[1:]], evaluations=60, margin=0.02) for _ in range(2))
    assert a.certificate.min_obstacle_clearance >= 0.02
    assert a.trajectory == b.trajectory
    assert (
        a.trajectory != found("ur5e", scene, [1.8, *READY[1:]], evaluations=60, seed=1).trajectory
    )


def test_what_can_not_be_is_told() -> None:
    robot = aw.load_robot("ur5e")
    hit = aw.Scene([aw.Obstacle("wall", aw.Box((3.0, 3.0, 3.0)), np.eye(4))])
    refused = excite(robot, hit, READY)
    assert isinstance(refused, Failure)
    assert refused.code == "START_STATE_INVALID"
    short = Deadline.after(4.0)
    best = excite(robot, None, READY, ExcitationOptions(evaluations=100_000), deadline=short)
    assert isinstance(best, Excitation)
    late = excite(robot, None, READY, deadline=Deadline.after(0.0))
    assert isinstance(late, Failure)
    assert late.code == "PLANNING_FAILED"
    with pytest.raises(aw.ArmwrightError, match="harmonics"):
        ExcitationOptions(harmonics=2)

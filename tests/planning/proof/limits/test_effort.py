"""Bounds of torque and tool speed, against pinocchio at dense samples of whole motions."""

import numpy as np
import pytest

from dynamics.model.payload import with_payload
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory, stay
from planning.proof.limits.effort import effort_uses, tool_speed_use, torque_use
from planning.values.limits import EffortLimits
from tests.planning.pinocchio_arm import PinocchioArm

NAMES = ["panda", "ur5e", "kr6_sixx"]


def motion_of(chain: Chain, random: np.random.Generator) -> Trajectory:
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.05, 0.5, 4))])
    coefficients = random.uniform(-1.0, 1.0, (4, chain.n, 6))
    return Trajectory(chain.joint_names, breaks, coefficients)


@pytest.mark.parametrize("name", NAMES)
def test_bounds_lie_above_pinocchio_and_near_it(name: str) -> None:
    chain, arm, random = builtin_chain(name), PinocchioArm(name), np.random.default_rng(4)
    for _ in range(3):
        motion = motion_of(chain, random)
        # The pieces do not meet: each is looked at up to its end.
        times = np.concatenate(
            [
                np.linspace(a, b - 1e-12, 500)
                for a, b in zip(motion.breaks[:-1], motion.breaks[1:], strict=True)
            ]
        )
        v, a = (motion.sample(times, order) for order in (1, 2))
        effort = random.uniform(5.0, 100.0, chain.n)
        friction, motor = chain.viscous_friction * v, chain.motor_inertia * a
        ratios = np.abs(arm.torques(motion, times) + friction + motor) / effort
        use = torque_use(chain, motion, effort)
        assert ratios.max() <= use.ratio * (1.0 + 1e-9)
        assert use.ratio <= 1.005 * ratios.max()
        assert use.reached <= use.ratio
        assert use.joint == int(np.argmax(ratios.max(axis=0)))
        speeds = arm.tip_speeds(motion, times)
        bound = tool_speed_use(chain, motion, 0.5)
        assert speeds.max() / 0.5 <= bound.ratio * (1.0 + 1e-9)
        assert bound.ratio <= 1.005 * speeds.max() / 0.5


@pytest.mark.parametrize("share", [1.0 - 1e-6, 1.0 + 1e-6])
def test_a_millionth_decides(share: float) -> None:
    """A limit just above what a motion takes is kept, and one just below it is not."""
    chain, random = builtin_chain("ur5e"), np.random.default_rng(7)
    motion = motion_of(chain, random)
    free = torque_use(chain, motion, np.full(chain.n, 1e6))
    finest = torque_use(chain, motion, np.full(chain.n, 1e6 * free.ratio))
    # Bounds of limits that are just kept are as sharp as that needs.
    exact = 1e6 * free.ratio * finest.reached
    use = torque_use(chain, motion, np.full(chain.n, exact / share))
    assert (use.ratio <= 1.0 + 1e-9) is (share < 1.0)


def test_what_is_carried_counts() -> None:
    chain = builtin_chain("ur5e")
    loaded = with_payload(chain, 3.0, (0.0, 0.0, 0.1))
    q = np.array([0.0, -0.2, 0.3, 0.0, 0.0, 0.0])
    still = stay(chain.joint_names, q)
    effort = np.full(chain.n, 100.0)
    bare, heavy = (torque_use(robot, still, effort).ratio for robot in (chain, loaded))
    torques = PinocchioArm("ur5e").torque(q, 0.0 * q, 0.0 * q)
    assert bare == pytest.approx(np.abs(torques).max() / 100.0, rel=1e-6)
    assert heavy > bare + 0.05


def test_a_still_tool_has_no_speed_and_what_is_not_limited_is_not_told() -> None:
    chain = builtin_chain("panda")
    still = stay(chain.joint_names, np.zeros(7))
    uses = effort_uses(EffortLimits(chain, None, 0.3), still)
    assert set(uses) == {"tool_speed"}
    assert uses["tool_speed"].ratio <= 1e-6
    assert effort_uses(EffortLimits(chain), still) == {}

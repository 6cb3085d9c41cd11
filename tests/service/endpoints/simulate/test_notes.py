"""Notes on simulations: every limit, jump and missing proof is said, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.model.chain import Chain, Limits
from kinematics.trajectory.trajectory import Trajectory
from service.endpoints.simulate.notes import simulation_notes
from tests.dynamics.samples import planar_rr
from tests.tracking.samples import constant, smooth
from tracking.controllers.model_based import ComputedTorque, PdGravity
from tracking.simulation.simulation import SimulationOptions, simulate

FREE = SimulationOptions(saturate=False)


def arm() -> Chain:
    """A planar arm whose joints turn within 1 rad, at 2 rad/s at most."""
    chain = planar_rr()
    limits = Limits.unlimited(2)
    one = np.ones(2)
    return replace(chain, limits=replace(limits, lower=-one, upper=one, velocity=2.0 * one))


def notes(
    motion: Trajectory, start: list[float] | None = None, w: float = 20.0, kind: str = "model"
) -> list[str]:
    chain = arm()
    used = (
        ComputedTorque(chain, np.full(2, w**2), np.full(2, 0.4 * w))
        if kind == "model"
        else PdGravity(chain, np.full(2, 200.0), np.full(2, 40.0))
    )
    result = simulate(used, motion, FREE, initial_position=start)
    return simulation_notes(motion, chain, used, result, 5.0)


def test_a_motion_within_all_limits_has_no_notes() -> None:
    assert notes(smooth(arm(), np.zeros(2), np.array([0.5, -0.5]))) == []


def test_a_reference_beyond_its_limits_is_told_by_joint() -> None:
    told = notes(smooth(arm(), np.zeros(2), np.array([0.5, -1.5])))
    assert told[0] == "the reference leaves the position limits of joint(s) 'q2'"
    assert told[1] == "the reference exceeds the velocity limits of joint(s) 'q2'"
    assert "joint 'q2' passes a position limit on the way" in told[2]


def test_a_jump_of_the_reference_is_told_with_its_time() -> None:
    jumping = Trajectory(
        arm().joint_names, np.array([0.0, 0.3, 1.0]), np.array([[[0.0], [0.0]], [[0.0], [0.7]]])
    )
    told = notes(jumping, w=3.0)
    assert "the reference jumps in position by 0.7 at 5.3 s (joint 'q2')" in told


@pytest.mark.parametrize(("start", "is_told"), [(0.99, False), (1.2, True)])
def test_a_start_beyond_a_limit_is_told(start: float, is_told: bool) -> None:
    told = notes(constant(arm(), np.zeros(2)), [0.0, start], w=2.0)
    line = "the robot starts outside the position limits of joint(s) 'q2'"
    assert (line in told) is is_told


def test_a_joint_that_swings_past_its_limit_is_told() -> None:
    told = notes(constant(arm(), np.array([0.9, 0.0])), [0.5, 0.0])
    assert [line for line in told if "simulated joints have no stops" in line]
    assert [line for line in told if "times its velocity limit" in line]


@pytest.mark.parametrize("moves", [True, False])
def test_pd_control_has_no_proof_for_a_moving_reference(moves: bool) -> None:
    goal = np.full(2, 0.2 if moves else 0.0)
    told = notes(smooth(arm(), np.zeros(2), goal), kind="pd")
    assert any("for a constant reference only" in line for line in told) is moves

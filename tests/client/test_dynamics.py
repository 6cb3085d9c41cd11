"""Dynamics and closed loops through the client, against a real service and the domain."""

import numpy as np
import pytest

import armwright_client as ours
from armwright_client import Client
from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_payload
from dynamics.terms import coriolis_matrix, mass_matrix
from kinematics.robots import builtin_chain
from kinematics.velocity import holding_torques

pytestmark = pytest.mark.timeout(300)

READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
AWAY = (0.4, -0.6, 0.1, -2.2, 0.0, 1.7, 0.6)
RATES = (0.5, -0.4, 0.3, 0.2, -0.6, 0.1, 0.9)
PULL = (1.0, -2.0, 3.0, 0.1, 0.2, -0.3)


def test_equations_of_motion(client: Client) -> None:
    chain = builtin_chain("panda")
    found = client.robots.dynamics(
        "panda", READY, velocities=RATES, accelerations=RATES, wrench=PULL
    )
    np.testing.assert_allclose(found.mass_matrix, mass_matrix(chain, READY), rtol=1e-12)
    np.testing.assert_allclose(
        found.coriolis_matrix, coriolis_matrix(chain, READY, RATES), rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(
        found.torques, inverse_dynamics(chain, READY, RATES, RATES, np.array(PULL)), rtol=1e-11
    )
    load = ours.Payload(mass=2.0, center_of_mass=(0.0, 0.0, 0.1))
    heavy = client.robots.dynamics("panda", READY, payload=load, gravity=(0.0, 0.0, -1.62))
    expected = inverse_dynamics(
        with_payload(chain, 2.0, (0.0, 0.0, 0.1)), READY, [0.0] * 7, [0.0] * 7, None, [0, 0, -1.62]
    )
    np.testing.assert_allclose(heavy.torques, expected, rtol=1e-11, atol=1e-12)


def test_many_states_at_once(client: Client) -> None:
    chain = builtin_chain("panda")
    rows = [READY, AWAY] * 20
    found = client.robots.dynamics_batch("panda", rows, velocities=[RATES] * 40)
    np.testing.assert_allclose(found.mass_matrix, mass_matrix(chain, rows), rtol=1e-12)
    held = client.robots.wrench_batch("panda", rows, PULL)
    np.testing.assert_allclose(held.torques, holding_torques(chain, rows, PULL), atol=1e-12)
    one = client.robots.wrench("panda", READY, PULL, point=(0.0, 0.0, 0.1))
    np.testing.assert_allclose(
        one.torques, holding_torques(chain, READY, PULL, None, (0.0, 0.0, 0.1)), atol=1e-12
    )


def test_regressor(client: Client) -> None:
    found = client.robots.regressor("puma560", [0.3] * 6, [0.5] * 6, [-0.2] * 6)
    assert len(found.base_parameters) == 36
    Y, Yb = np.array(found.regressor), np.array(found.base_regressor)
    beta = np.array([parameter.value for parameter in found.base_parameters])
    expected = inverse_dynamics(builtin_chain("puma560"), [0.3] * 6, [0.5] * 6, [-0.2] * 6)
    np.testing.assert_allclose(Y @ found.parameters, expected, atol=1e-11)
    np.testing.assert_allclose(Yb @ beta, expected, atol=1e-10)
    columns = [parameter.column for parameter in found.base_parameters]
    np.testing.assert_array_equal(Y[:, columns], Yb)
    fewer = client.robots.regressor("planar_rr", [0.3] * 2, [0.5] * 2, [-0.2] * 2, known_zeros=True)
    assert [parameter.name for parameter in fewer.base_parameters] == [
        "Izz1 + m2", "mx1 + m2", "Izz2", "mx2",
    ]  # fmt: skip


def test_formulas(client: Client) -> None:
    found = client.robots.equations("planar_rr", "text")
    assert found.dynamics is not None
    assert found.dynamics.mass_matrix[1][1] == "m_2 * l_c2**2 + I_2"
    assert found.pose.position[0] == "l_1 * c_1 + l_2 * c_12"


def test_a_planned_motion_is_tracked_inside_its_tube(client: Client) -> None:
    post = ours.Obstacle(
        id="post",
        shape=ours.Box(size=(0.04, 0.04, 0.6)),
        pose=ours.Pose(position=(0.42, 0.32, 0.5)),
    )
    scene = ours.Scene(obstacles=[post])
    plan = client.plan("panda", READY, AWAY, scene=scene)
    perfect = {"type": "computed_torque", "natural_frequency": 40.0}
    found = client.simulate("panda", plan.trajectory, perfect, scene=scene)
    assert found.outcome == "completed"
    assert found.max_tracking_error < 1e-6
    assert found.tube is not None
    assert found.tube.clears
    assert found.tube.remaining_clearance is not None
    assert plan.certificate.min_clearance is not None
    # Not the same certificate: how tight its bound is hangs on where it had to look.
    assert found.tube.remaining_clearance > 0.0
    assert found.tube.reference_clearance == pytest.approx(
        found.tube.remaining_clearance + found.tube.displacement
    )
    # The tracked motion itself is certified too, and clears as much as its reference; both are
    # lower bounds, within a fifth of the truth.
    assert found.tube.tracked_clearance is not None
    assert found.tube.tracked_clearance == pytest.approx(found.tube.reference_clearance, rel=0.25)
    sloppy = client.simulate(
        "panda",
        plan.trajectory,
        {"type": "pd_gravity", "natural_frequency": 8.0},
        scene=scene,
        model_error={"mass_scale": 1.3},
    )
    assert sloppy.tube is not None
    assert not sloppy.tube.clears
    assert sloppy.tube.reason is not None
    assert "track better" in sloppy.tube.reason
    # The tube is safe, not tight.
    assert sloppy.tube.tracked_clearance is not None
    assert sloppy.tube.remaining_clearance is not None
    assert sloppy.tube.tracked_clearance > sloppy.tube.remaining_clearance


def test_every_controller_answers(client: Client) -> None:
    motion = ours.Trajectory(
        segments=[
            ours.Segment(
                t0=0.0,
                t1=1.0,
                coefficients=[[0, 0, 0, 10, -15, 6], [0.5, 0, 0, -10.0, 15.0, -6.0]],
            )
        ]
    )
    kinds = ("independent_joint", "computed_torque", "pd_gravity", "passivity", "adaptive")
    for kind in kinds:
        found = client.simulate(
            "planar_rr",
            motion,
            {"type": kind, "natural_frequency": 15.0},
            initial_state={"offset": [0.05, -0.05]},
            noise={"position": 1e-4, "velocity": 1e-3},
            disturbance={"torque": 0.1, "start": 0.2, "end": 0.4},
            control_period=0.002,
            sample_period=0.05,
            seed=3,
        )
        assert found.controller.type == kind
        assert len(found.time) == len(found.lyapunov) == len(found.torque) == 21
        assert found.tracking_error[0] == pytest.approx([-0.05, 0.05])
        assert (found.estimate is not None) == (kind == "adaptive")
    with pytest.raises(ours.ApiError, match="natural_frequency"):
        client.simulate("planar_rr", motion, {"type": "passivity"})

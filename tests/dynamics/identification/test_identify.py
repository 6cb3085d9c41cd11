"""Parameters found from logs of arms that pinocchio moves."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from dynamics.identification.consistent import pseudo_inertia
from dynamics.identification.identify import Identification, identify, identify_payload
from dynamics.identification.log import Log
from dynamics.identification.unknowns import DRIVES, Unknowns
from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_payload
from dynamics.parameters.regressor import standard_parameters
from kinematics.arrays import Array
from kinematics.errors import InvalidLinkName, InvalidOption
from kinematics.model.chain import Chain
from tests.dynamics.identification.logs import (
    ARMS,
    Truth,
    exciting,
    noisy_log,
    real_arm,
)
from tests.dynamics.samples import random_inertia


def chain_of(name: str) -> Chain:
    return aw.load_robot(name).chain


def true_values(truth: Truth) -> Array:
    """The base parameters of an arm as it is."""
    unknowns = Unknowns(truth.chain, tuple(DRIVES))
    Theta = unknowns.known()
    Theta[-truth.chain.n :] = truth.offset
    return np.asarray(unknowns.base.combination @ Theta)


def errors_of(found: Identification, truth: Truth) -> tuple[Array, Array]:
    """Errors in standard errors: of the least squares, and of the bodies."""
    beta = true_values(truth)
    rows = [(p.value, p.consistent, p.standard_error) for p in found.parameters]
    value, consistent, error = np.array(rows).T
    return (value - beta) / error, (consistent - beta) / error


def is_physical(chain: Chain) -> bool:
    bodies = standard_parameters(chain, motors=False).reshape(-1, 10)
    drives = (chain.motor_inertia, chain.viscous_friction, chain.coulomb_friction)
    return bool((np.linalg.eigvalsh(pseudo_inertia(bodies)) > 0.0).all() and np.min(drives) >= 0.0)


@pytest.mark.parametrize("motion", [{}, {"encoder": 2e-5, "period": 1e-3}])
def test_parameters_are_within_three_standard_errors(motion: dict[str, Any]) -> None:
    least, physical = [], []
    for seed, name in enumerate(ARMS):
        chain = chain_of(name)
        truth = real_arm(chain, seed)
        log = noisy_log(truth, seed, **motion)
        found = identify(chain, log)
        assert not found.not_excited
        z, consistent = errors_of(found, truth)
        least.append(z)
        physical.append(consistent)
        assert is_physical(found.robot)
        if not motion:  # else noise is filtered
            _, q, qd, qdd = exciting(chain, seed, 0.01)
            noise = np.sqrt(
                np.mean((np.asarray(log.torques) - truth.torques(q, qd, qdd)) ** 2, axis=0)
            )
            np.testing.assert_allclose(found.residuals, noise, rtol=0.02)
            np.testing.assert_allclose(found.consistent_residuals, noise, rtol=0.02)
        assert np.abs(found.offsets - truth.offset).max() < 0.2
    for z in (np.concatenate(least), np.concatenate(physical)):
        assert (np.abs(z) <= 3.0).mean() >= 0.99
        assert 0.7 < np.sqrt(np.mean(z**2)) < 1.2


def test_the_robot_that_is_found_predicts_the_torques_of_another_motion() -> None:
    chain = chain_of("ur5e")
    truth = real_arm(chain, 8)
    found = identify(chain, [noisy_log(truth, seed) for seed in (1, 2)])
    _, q, qd, qdd = exciting(chain, 77, 0.1)
    torques = truth.torques(q, qd, qdd)
    rest = inverse_dynamics(found.robot, q, qd, qdd) + found.offsets - torques
    before = inverse_dynamics(chain, q, qd, qdd) - torques
    assert np.sqrt(np.mean(rest**2)) < 0.02
    assert np.sqrt(np.mean(before**2)) > 1.0


def test_noise_that_differs_between_joints_is_weighed() -> None:
    chain = chain_of("ur5e")
    truth = real_arm(chain, 1)
    noise = np.array([2.0, 2.0, 0.5, 0.05, 0.05, 0.02])
    log = noisy_log(truth, 1, noise=noise)  # type: ignore[arg-type]
    found = identify(chain, log)
    z, _ = errors_of(found, truth)
    assert np.abs(z).max() < 4.0
    np.testing.assert_allclose(found.residuals, noise, rtol=0.06)


def test_currents_at_irregular_instants_of_a_log_are_interpolated() -> None:
    chain = chain_of("planar_rr")
    truth = real_arm(chain, 2)
    rng = np.random.default_rng(0)
    t, q, qd, qdd = exciting(chain, 3, 0.002)
    w = np.sort(t + rng.uniform(-2e-4, 2e-4, len(t)))
    moved = np.array([np.interp(w, t, column) for column in q.T]).T
    tau = np.array([np.interp(w, t, column) for column in truth.torques(q, qd, qdd).T]).T
    found = identify(chain, Log(moved, tau + 0.05 * rng.standard_normal(tau.shape), w), cutoff=8.0)
    z, _ = errors_of(found, truth)
    assert np.abs(z).max() < 5.0


def test_a_joint_that_does_not_move_is_told() -> None:
    chain = chain_of("ur5e")
    truth = real_arm(chain, 4)
    t, q, qd, qdd = exciting(chain, 5, 0.01)
    for rows, value in ((q, 0.3), (qd, 0.0), (qdd, 0.0)):
        rows[:, 5] = value
    rng = np.random.default_rng(0)
    tau = truth.torques(q, qd, qdd) + 0.1 * rng.standard_normal(q.shape)
    found = identify(chain, Log(q, tau, t, qd, qdd))
    told = [line for line in found.not_excited if "no row" in line]
    assert {line.partition(":")[0] for line in told} >= {"J6", "B6", "F6"}
    assert len(found.parameters) < 58
    assert is_physical(found.robot)
    rest = inverse_dynamics(found.robot, q, qd, qdd) + found.offsets - truth.torques(q, qd, qdd)
    assert np.sqrt(np.mean(rest**2)) < 0.05


def test_what_logs_do_not_determine_stays_as_it_is_believed() -> None:
    chain = chain_of("panda")
    rng = np.random.default_rng(3)
    q = rng.uniform(-1.0, 1.0, (40, 7))
    tau = inverse_dynamics(chain, q, 0.0 * q, 0.0 * q)
    found = identify(chain, Log(q, tau), drives=())
    assert any(line.startswith("Izz7") for line in found.not_excited)
    believed = standard_parameters(chain, motors=False)
    after = standard_parameters(found.robot, motors=False)
    np.testing.assert_allclose(after[60:], believed[60:], rtol=0.05, atol=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_a_load_is_found_from_a_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = chain_of("iiwa14")
    body = random_inertia(rng)
    loaded = with_payload(chain, body.mass, body.center_of_mass, body.tensor)
    log = noisy_log(Truth(loaded, rng.uniform(-0.3, 0.3, 7)), seed, noise=0.05)
    found = identify_payload(chain, log, offsets=True)
    assert found.load is not None
    assert abs(found.load.mass - body.mass) < 0.02
    np.testing.assert_allclose(found.load.center_of_mass, body.center_of_mass, atol=5e-3)
    np.testing.assert_allclose(found.load.tensor, body.tensor, atol=0.02)
    np.testing.assert_allclose(found.residuals, 0.05, rtol=0.06)


def test_a_load_at_rest_gives_mass_and_centre_and_says_that_its_inertia_is_not_excited() -> None:
    chain = chain_of("ur5e")
    rng = np.random.default_rng(1)
    q = rng.uniform(-2.0, 2.0, (8, 6))
    loaded = with_payload(chain, 2.0, [0.02, -0.01, 0.08])
    tau = inverse_dynamics(loaded, q, 0.0 * q, 0.0 * q) + 0.02 * rng.standard_normal(q.shape)
    found = identify_payload(chain, Log(q, tau))
    assert found.load is not None
    mass = next(p for p in found.parameters if p.name == "m")
    assert abs(mass.value - 2.0) < 3.0 * mass.standard_error < 0.2
    np.testing.assert_allclose(found.load.center_of_mass, [0.02, -0.01, 0.08], atol=0.01)
    assert sorted(line.partition(":")[0] for line in found.not_excited) == sorted(
        ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    )


def test_a_robot_without_inertias_is_identified() -> None:
    chain = chain_of("ur5e")
    truth = real_arm(chain, 6)
    bare = replace(chain, links=tuple(replace(link, inertia=None) for link in chain.links))
    found = identify(bare, noisy_log(truth, 6))
    assert sum("1 kg is believed in" in note for note in found.notes) == 6
    z, _ = errors_of(found, truth)
    assert (np.abs(z) <= 3.0).mean() >= 0.98
    assert is_physical(found.robot)


def test_torques_that_no_bodies_explain_are_told() -> None:
    chain = chain_of("planar_rr")
    t, q, qd, qdd = exciting(chain, 1, 0.01)
    rng = np.random.default_rng(0)
    tau = -inverse_dynamics(chain, q, qd, qdd) + 0.01 * rng.standard_normal(q.shape)
    found = identify(chain, Log(q, tau, t, qd, qdd), drives=())
    assert any("no bodies with positive densities" in note for note in found.notes)
    assert is_physical(found.robot)
    wave = inverse_dynamics(chain, q, qd, qdd) + 0.5 * np.sin(3.7 * t)[:, None]
    assert any("alike" in note for note in identify(chain, Log(q, wave, t, qd, qdd)).notes)


@pytest.mark.parametrize(
    ("log", "about"),
    [
        (Log(np.zeros((5, 2)), np.zeros((4, 2))), "5 positions and 4 torques"),
        (Log(np.zeros((2, 2)), np.zeros((2, 2))), "equations for"),
        (Log(np.zeros((9, 2)), np.zeros((9, 2)), 0.01), "9 instants"),
        (Log(np.zeros((90, 2)), np.zeros((90, 2)), -0.01), "ascending"),
        (Log(np.zeros((90, 2)), np.zeros((90, 2)), 0.001), "too short"),
        (Log(np.zeros((9, 2)), None), "no torques"),  # type: ignore[arg-type]
        (Log(np.full((9, 2), 90.0), np.zeros((9, 2))), "positions of joint joint_1 are as large"),
        (Log(np.zeros((9, 2)), np.full((9, 2), 1e5)), "torques of joint joint_1 are as large"),
    ],
)
def test_odd_logs_are_refused(log: Log, about: str) -> None:
    with pytest.raises(InvalidOption, match=about):
        identify(chain_of("planar_rr"), log)


def test_logs_in_units_that_do_not_go_together_or_with_gaps_are_refused() -> None:
    chain = chain_of("planar_rr")
    truth = real_arm(chain, 1)
    t, q, qd, qdd = exciting(chain, 1, 0.01)
    tau = truth.torques(q, qd, qdd)
    assert identify(chain, Log(q, tau, t, qd)).samples > 100
    for times, rates, words in (
        (1e3 * t, qd, "move 0.001 times as far"),
        (t, np.degrees(qd), "move 0.0175 times as far"),
        (np.where(t > 5.0, t + 0.2, t), None, "no instants from 5 to 5.21 s"),
        (np.where(t > 5.0, t + 0.2, t), qd, "no instants from 5 to 5.21 s"),
    ):
        with pytest.raises(InvalidOption, match=words):
            identify(chain, Log(q, tau, times, rates))


def test_a_load_hangs_on_a_link_that_moves() -> None:
    chain = chain_of("ur5e")
    log = Log(np.zeros((9, 6)), np.zeros((9, 6)))
    with pytest.raises(InvalidLinkName, match="no joint"):
        identify_payload(chain, log, link=chain.base_link)
    with pytest.raises(InvalidOption, match="Hz"):
        identify(chain, Log(np.zeros((900, 6)), np.zeros((900, 6)), 0.01), cutoff=60.0)
    with pytest.raises(InvalidOption, match="no logs"):
        identify(chain, [])

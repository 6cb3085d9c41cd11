"""The two gradient methods of the course notes, by what their theory says of them."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.forward import forward
from kinematics.ik.gradient import (
    COORDINATES,
    RULES,
    Coordinates,
    GradientOptions,
    Rule,
    follow,
)
from kinematics.ik.numeric.numeric import POSITION
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.pose import from_zyz, rotation_error, transform
from kinematics.robots import builtin_chain

START = np.array([0.3, -0.5, 0.2, -2.0, 0.3, 1.7, 0.4])
NEAR = START + np.array([0.2, -0.1, 0.1, 0.2, -0.2, 0.1, 0.1])


@pytest.mark.parametrize("coordinates", COORDINATES)
@pytest.mark.parametrize("gain", [0.5, 1.0, 4.0])
def test_the_flow_decays_exponentially_at_its_gain(coordinates: Coordinates, gain: float) -> None:
    chain = builtin_chain("panda")
    target = forward(chain, NEAR)
    options = GradientOptions("pseudo_inverse", coordinates, gain)
    trace = follow(chain, target, seed_joints=START, options=options)
    assert trace.converged
    # e_dot = -K e holds for each component: the distance is exp(-K t) of the first.
    expected = trace.position_error[0] * np.exp(-gain * trace.times)
    np.testing.assert_allclose(trace.position_error, expected, rtol=2e-3, atol=1e-9)
    # The path of the tip is the straight line to the target.
    points = forward(chain, trace.joints)[:, :3, 3]
    line = (target[:3, 3] - points[0]) / np.linalg.norm(target[:3, 3] - points[0])
    away = (points - points[0]) - np.outer((points - points[0]) @ line, line)
    assert np.abs(away).max() < 2e-3 * trace.position_error[0]
    reached = forward(chain, trace.solution.joints)
    assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) <= 1e-6
    assert np.linalg.norm(rotation_error(reached[:3, :3], target[:3, :3])) <= 1e-6


@pytest.mark.parametrize("coordinates", COORDINATES)
def test_the_descent_never_climbs(coordinates: Coordinates) -> None:
    chain = builtin_chain("panda")
    target = forward(chain, NEAR)
    options = GradientOptions("transpose", coordinates, steps=300)
    trace = follow(chain, target, seed_joints=START, options=options)
    assert trace.position_error[-1] < 0.1 * trace.position_error[0]
    if coordinates == "rotation_vector":
        total = np.hypot(trace.position_error, trace.orientation_error)
        assert (np.diff(total) < 1e-3 * total[0]).all()
        long = follow(
            chain, target, seed_joints=START, options=GradientOptions("transpose", coordinates)
        )
        assert long.converged
        assert len(long.times) > 4 * len(follow(chain, target, seed_joints=START).times)


def test_a_fixed_gain_of_the_descent_is_the_step_of_the_notes() -> None:
    chain = builtin_chain("planar_rr")
    q = np.array([0.4, 0.8])
    target = forward(chain, np.array([0.5, 0.9]))
    trace = follow(
        chain, target, seed_joints=q, options=GradientOptions("transpose", gain=0.05, steps=1)
    )
    step = 1e-6
    gradient = np.array([
        (energy(chain, target, q + d) - energy(chain, target, q - d)) / (2 * step)
        for d in step * np.eye(2)
    ])  # fmt: skip
    np.testing.assert_allclose(trace.joints[1], q - 0.05 * gradient, atol=1e-6)


def energy(chain: Chain, target: Array, q: Array) -> float:
    """U = |e|^2 / 2."""
    T = forward(chain, q)
    turn = rotation_error(T[:3, :3], target[:3, :3])
    return 0.5 * float(np.sum((target[:3, 3] - T[:3, 3]) ** 2) + turn @ turn)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("gain", [0.7, [[2.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 3.0]]])
def test_the_flow_is_the_solution_of_its_equation(rule: Rule, gain: Any) -> None:
    """Integrated by DOP853, with a Jacobian by finite differences."""
    chain = builtin_chain("puma560")
    q = np.array([0.3, -0.7, 0.4, 0.2, 0.6, -0.1])
    target = forward(chain, q + 0.25)
    options = GradientOptions(rule, gain=gain, axes=POSITION, form="flow", steps=60)
    trace = follow(chain, target, seed_joints=q, options=options, position_tolerance=1e-4)
    K = options.matrix
    np.testing.assert_array_equal(K, gain if np.ndim(gain) else gain * np.eye(3))

    def rate(_: float, x: Array) -> Array:
        J = np.array([
            (forward(chain, x + d)[:3, 3] - forward(chain, x - d)[:3, 3]) / 2e-5
            for d in 1e-5 * np.eye(6)
        ]).T  # fmt: skip
        e = K @ (target[:3, 3] - forward(chain, x)[:3, 3])
        return np.asarray(J.T @ e if rule == "transpose" else np.linalg.pinv(J) @ e)

    exact = solve_ivp(
        rate, (0.0, trace.times[-1]), q, method="DOP853", rtol=1e-10, atol=1e-12,
        t_eval=trace.times,
    )  # fmt: skip
    np.testing.assert_allclose(trace.joints, exact.y.T, atol=5e-6)
    errors = target[:3, 3] - forward(chain, trace.joints)[:, :3, 3]
    np.testing.assert_allclose(trace.errors, errors, atol=1e-14)
    np.testing.assert_allclose(trace.position_error, np.linalg.norm(errors, axis=1), atol=1e-14)


def test_some_axes_count_in_the_frame_of_the_target() -> None:
    """The tool comes onto the target's x axis: y and z of its frame vanish, x is what it was."""
    chain = builtin_chain("panda")
    target = forward(chain, NEAR)
    options = GradientOptions("pseudo_inverse", axes=("y", "z", "rz"))
    trace = follow(chain, target, seed_joints=START, options=options)
    assert trace.converged
    assert trace.errors.shape[1] == 3
    reached = forward(chain, trace.solution.joints)
    local = target[:3, :3].T @ (reached[:3, 3] - target[:3, 3])
    assert np.abs(local[1:]).max() <= 1e-6
    assert abs(local[0]) > 1e-2
    turn = target[:3, :3].T @ rotation_error(reached[:3, :3], target[:3, :3])
    assert abs(turn[2]) <= 1e-6
    assert np.abs(turn[:2]).max() > 1e-3


@pytest.mark.parametrize("gain", [1.0, 0.4])
def test_the_step_of_the_pseudo_inverse_is_that_of_newton(gain: float) -> None:
    chain = builtin_chain("puma560")
    q = np.array([0.3, -0.7, 0.4, 0.2, 0.6, -0.1])
    target = forward(chain, q + 0.1)
    options = GradientOptions("pseudo_inverse", gain=gain, form="step", steps=1)
    trace = follow(chain, target, seed_joints=q, options=options)
    step = np.linalg.solve(geometric(chain, q), gain * trace.errors[0])
    np.testing.assert_allclose(trace.joints[1], q + step, atol=1e-6)
    assert trace.times.tolist() == [0.0, 1.0]


def test_the_transpose_alone_solves_what_six_axes_do_not() -> None:
    """Position of a planar arm with two joints, from a step of the notes with a number gamma."""
    chain = builtin_chain("planar_rr")
    target = forward(chain, np.array([0.5, 0.9]))
    options = GradientOptions("transpose", gain=0.3, axes=("x", "y", "z"))
    trace = follow(chain, target, seed_joints=np.array([0.1, 0.4]), options=options)
    assert trace.converged
    np.testing.assert_allclose(trace.solution.joints, [0.5, 0.9], atol=1e-5)
    assert (np.diff(trace.position_error) < 0.0).all()


def test_out_of_reach_ends_at_its_steps() -> None:
    chain = builtin_chain("panda")
    trace = follow(chain, transform(None, [3.0, 0.0, 0.0]), options=GradientOptions(steps=50))
    assert not trace.converged
    assert len(trace.times) == 51
    assert np.isfinite(trace.joints).all()


def test_bad_input_is_named() -> None:
    chain = builtin_chain("panda")
    with pytest.raises(InvalidPose):
        follow(chain, np.eye(3))
    for bad in ({"rule": "newton"}, {"coordinates": "xyz"}, {"gain": 0.0}, {"steps": 0},
                {"form": "leap"}, {"axes": ()}, {"axes": ("w",)}, {"gain": np.eye(3)},
                {"gain": -np.eye(6)}, {"coordinates": "zyz", "axes": ("x", "rx")}):  # fmt: skip
        with pytest.raises(InvalidOption):
            GradientOptions(**bad)
    scara = builtin_chain("scara")
    with pytest.raises(InvalidOption, match="zyz"):
        follow(
            scara,
            transform(from_zyz([0.1, 0.2, 0.3]), [0.3, 0.1, 0.1]),
            options=GradientOptions(coordinates="zyz"),
        )


@pytest.mark.parametrize("rule", RULES)
def test_a_flow_with_a_duration_ends_there(rule: Rule) -> None:
    chain, duration = builtin_chain("ur5e"), 0.3
    start = np.array([0.2, -1.0, 1.2, -0.8, 0.5, 0.3])
    target = forward(chain, start + 0.3)

    def flow(_: float, q: Array) -> Array:
        T, J = forward(chain, q), geometric(chain, q)
        turn = rotation_error(T[:3, :3], target[:3, :3])
        e = 2.0 * np.concatenate([target[:3, 3] - T[:3, 3], turn])
        return np.asarray(J.T @ e if rule == "transpose" else np.linalg.solve(J, e))

    expected = solve_ivp(flow, (0.0, duration), start, rtol=1e-11, atol=1e-12).y[:, -1]
    options = GradientOptions(rule, gain=2.0, form="flow", duration=duration)
    trace = follow(chain, target, seed_joints=start, options=options)
    assert trace.times[-1] == duration
    assert not trace.converged
    np.testing.assert_allclose(trace.joints[-1], expected, atol=1e-7)


def test_a_flow_near_a_singular_start_is_not_damped() -> None:
    rows = tuple(DhRow("revolute", a) for a in (0.5, 0.4))
    chain = chain_from_dh("planar", DhTable("standard", rows))
    start, target = np.array([0.4, 2e-3]), forward(chain, [0.4, 0.01])
    turn = target[:2, :2].T

    def flow(_: float, q: Array) -> Array:
        e = turn @ (target[:2, 3] - forward(chain, q)[:2, 3])
        return np.asarray(np.linalg.solve(turn @ geometric(chain, q)[:2], e))

    expected = solve_ivp(flow, (0.0, 0.1), start, rtol=1e-11, atol=1e-13).y[:, -1]
    assert np.linalg.svd(geometric(chain, start)[:2])[1][-1] < 1e-3
    options = GradientOptions(axes=("x", "y"), form="flow", duration=0.1)
    trace = follow(chain, target, seed_joints=start, options=options)
    np.testing.assert_allclose(trace.joints[-1], expected, atol=1e-7)
    assert not trace.damped
    folded = follow(chain, target, seed_joints=[0.4, 0.0], options=options)
    assert folded.damped


@pytest.mark.parametrize("rule", RULES)
def test_a_stationary_start_is_told_at_once(rule: Rule) -> None:
    rows = tuple(DhRow("revolute", a) for a in (0.5, 0.4))
    chain = chain_from_dh("planar", DhTable("standard", rows))
    target = np.eye(4)
    target[0, 3] = 0.3  # on the line of the stretched arm: no joint moves the tip along it
    options = GradientOptions(rule, axes=POSITION)
    trace = follow(chain, target, seed_joints=[0.0, 0.0], options=options)
    assert trace.stationary
    assert len(trace.times) == 1
    assert not trace.converged


def test_durations_are_those_of_flows() -> None:
    for options in ({"rule": "transpose"}, {"steps": 5}, {"duration": -1.0}):
        with pytest.raises(InvalidOption, match="duration"):
            GradientOptions(**{"duration": 1.0, **options})  # type: ignore[arg-type]

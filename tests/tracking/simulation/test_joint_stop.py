"""Joint stops against the closed form of an impact and scipy with events."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotState
from kinematics.model.chain import Chain
from tests.tracking.samples import constant, slider
from tracking.controllers.controller import Controller, Reference
from tracking.controllers.model_based import PdGravity
from tracking.simulation.disturbance import (
    DISSIPATION,
    STIFFNESS,
    JointStops,
    add_stops,
    stop_arrays,
)
from tracking.simulation.simulation import SimulationOptions, simulate

MASS, STIFF, LOSS = 2.0, 5e4, 3.0
STOPS = JointStops(STIFF, LOSS)
OPTIONS = SimulationOptions(
    saturate=False, relative_tolerance=1e-12, absolute_tolerance=1e-13, stops=STOPS,
    sample_period=0.01, duration=1.0,
)  # fmt: skip


def railed(lower: float = -0.3, upper: float = 0.5) -> Chain:
    chain = slider(MASS)
    limits = replace(chain.limits, lower=np.array([lower]), upper=np.array([upper]))
    return replace(chain, limits=limits)


def rebound(v: float, c: float) -> float:
    """Speed after an impact: v / c - ln(1 + c v) / c^2 is the same before and after."""
    energy = c * v - np.log1p(c * v)
    return float(brentq(lambda x: -x - np.log1p(-x) - energy, 0.0, 1.0 - 1e-12)) / c


@dataclass(frozen=True, slots=True, eq=False)
class Idle(Controller):
    """No torque at all, in Python."""

    chain: Chain

    def torque(self, _t: float, _q: Array, _qd: Array, _reference: Reference, /) -> Array:
        return np.zeros(1)

    def lyapunov(
        self, q: Array, qd: Array, reference: Reference, robot: Chain | None = None
    ) -> float:
        return 0.0


def controller(chain: Chain, *, is_compiled: bool) -> Controller:
    return PdGravity(chain, np.array(1e-12), np.array(1e-12)) if is_compiled else Idle(chain)


@pytest.mark.parametrize("is_compiled", [True, False])
@pytest.mark.parametrize("v", [0.8, 2.0])
def test_an_impact_leaves_the_speed_of_the_closed_form(v: float, is_compiled: bool) -> None:
    chain = railed()
    result = simulate(
        controller(chain, is_compiled=is_compiled), constant(chain, np.zeros(1)), OPTIONS,
        initial_velocity=[v],
    )  # fmt: skip
    after = result.velocity[result.velocity[:, 0] < 0.0, 0]
    first = after[after > -v + 1e-6]
    assert -first[3] == pytest.approx(rebound(v, LOSS), rel=1e-8)
    # No deeper than a spring without loss would let it.
    assert result.position.max() < 0.5 + v * np.sqrt(MASS / STIFF)


def test_bounces_between_two_stops_are_those_of_scipy_with_events() -> None:
    lower, upper, v, loss = -0.3, 0.5, 3.0, 0.1
    chain = railed(lower, upper)
    options = replace(OPTIONS, stops=JointStops(STIFF, loss))
    result = simulate(
        controller(chain, is_compiled=True), constant(chain, np.zeros(1)), options,
        initial_velocity=[v],
    )  # fmt: skip

    def slope(_t: float, x: Any) -> list[float]:
        over, under = max(x[0] - upper, 0.0), max(lower - x[0], 0.0)
        push = -STIFF * over * max(0.0, 1.0 + loss * x[1])
        push += STIFF * under * max(0.0, 1.0 - loss * x[1])
        return [x[1], push / MASS]

    events: list[Any] = [lambda _t, x: x[0] - upper, lambda _t, x: x[0] - lower]
    for event in events:
        setattr(event, "terminal", True)  # noqa: B010  scipy's way to say so
    t, x, times = 0.0, np.array([0.0, v]), result.times
    exact = np.zeros((len(times), 2))
    contacts = 0
    while t < times[-1]:
        part = solve_ivp(slope, (t, times[-1]), x, "DOP853", rtol=1e-13, atol=1e-14,
                         events=events, dense_output=True)  # fmt: skip
        dense: Any = part.sol
        inside = (times >= t) & (times <= part.t[-1])
        exact[inside] = np.asarray(dense(times[inside])).T
        contacts += part.status
        t, x = float(part.t[-1]), part.y[:, -1]
        # Past the surface by a rounding error, so that the same event is not found again.
        x = x + np.sign(x[1]) * np.array([1e-13, 0.0])
    assert contacts >= 4
    np.testing.assert_allclose(result.position[:, 0], exact[:, 0], atol=1e-8)


def test_a_stop_carries_what_presses_against_it_and_never_pulls() -> None:
    chain = railed()
    result = simulate(
        PdGravity(chain, np.array(100.0), np.array(40.0)),
        constant(chain, np.array([1.5])),
        replace(OPTIONS, duration=6.0, sample_period=0.1),
        initial_position=[0.0],
    )
    # k_p (1.5 - q) = k (q - 0.5)
    assert result.position[-1, 0] == pytest.approx((150.0 + 0.5 * STIFF) / (STIFF + 100.0))
    torque = np.zeros(1)
    add_stops(stop_arrays(chain, STOPS), np.array([0.51]), np.array([-5.0]), torque)
    assert torque[0] == 0.0
    add_stops(stop_arrays(chain, STOPS), np.array([-0.31]), np.array([0.1]), torque)
    assert torque[0] == pytest.approx(STIFF * 0.01 * 0.7)


def test_without_stops_limits_are_passed() -> None:
    chain = railed()
    free = simulate(
        controller(chain, is_compiled=True), constant(chain, np.zeros(1)),
        replace(OPTIONS, stops=None), initial_velocity=[2.0],
    )  # fmt: skip
    assert free.position[-1, 0] == pytest.approx(2.0)
    # Joints without limits have no stops.
    open_ended = slider(MASS)
    free = simulate(
        controller(open_ended, is_compiled=True), constant(open_ended, np.zeros(1)), OPTIONS,
        initial_velocity=[2.0],
    )  # fmt: skip
    assert free.position[-1, 0] == pytest.approx(2.0)


def test_stops_out_of_range_are_refused() -> None:
    with pytest.raises(InvalidOption, match="stiffness"):
        JointStops(stiffness=0.0)
    with pytest.raises(InvalidOption, match="dissipation"):
        JointStops(dissipation=-1.0)
    assert JointStops() == JointStops(STIFFNESS, DISSIPATION)


def test_starts_inside_a_stop_and_beyond_every_robot_s_are_refused() -> None:
    chain = railed()
    used, motion = controller(chain, is_compiled=True), constant(chain, np.zeros(1))
    with pytest.raises(InvalidRobotState, match=r"starts at 0\.6, inside its stop"):
        simulate(used, motion, OPTIONS, initial_position=[0.6])
    simulate(used, motion, replace(OPTIONS, stops=None), initial_position=[0.6])
    with pytest.raises(InvalidRobotState, match=r"initial position of joint 'q1' is 1e[+]09"):
        simulate(used, motion, OPTIONS, initial_position=[1e9])
    with pytest.raises(InvalidRobotState, match=r"initial velocity of joint 'q1' is -2e[+]06"):
        simulate(used, motion, OPTIONS, initial_velocity=[-2e6])

"""Linear and quadratic models against finite differences, limits against their definition."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics.model.payload import with_payload
from planning.optimize import objective
from planning.optimize.iterate import Iterate
from planning.optimize.linearization import Checkpoints, least_factor, linearize
from planning.optimize.quadratic import Quadratic
from planning.optimize.response import tool_speed, torques
from planning.optimize.rows import end_rows, limit_rows, local_matrix, stack_rows
from planning.optimize.task import End
from planning.values.deadline import Deadline
from planning.values.limits import EffortLimits
from planning.values.optimize_options import Objective
from tests.planning.optimize.motions import PANDA, SPACE, iterate, packed, task, unpacked
from tests.planning.scenes import pillar

U = np.linspace(0.03, 0.97, 9)


@pytest.mark.parametrize("response", [torques, tool_speed])
def test_responses_change_as_their_derivatives_say(response: object) -> None:
    assert callable(response)
    at = iterate(1)
    found = response(PANDA, at, U)
    m = found.values.shape[1]
    rows = [g.reshape(-1, 7) for g in found.gradients]
    A = local_matrix(at, np.repeat(U, m), rows, found.in_time.ravel()).toarray()
    direction = np.append(np.random.default_rng(2).normal(size=A.shape[1] - 1), 0.0)
    step, z = 1e-6, packed(at)
    ahead = response(PANDA, unpacked(z + step * direction), U).values.ravel()
    behind = response(PANDA, unpacked(z - step * direction), U).values.ravel()
    slope = (ahead - behind) / (2.0 * step)
    np.testing.assert_allclose(A @ direction, slope, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("name", ["time", "jerk", "energy"])
def test_models_have_the_gradient_of_the_objective(name: Objective) -> None:
    at, weights = iterate(3), {name: 1.0}
    model = objective.model(task(), weights, at)
    z, rng = packed(at), np.random.default_rng(4)
    gradient = model.H @ z + model.g
    for _ in range(5):
        direction = np.append(rng.normal(size=len(z) - 1), 0.0)
        step = 1e-6
        values = [
            objective.value(
                unpacked(z + sign * step * direction).trajectory(PANDA.joint_names), weights, PANDA
            )
            for sign in (1.0, -1.0)
        ]
        slope = (values[0] - values[1]) / (2.0 * step)
        # The smoothing of the time objective is part of its model.
        assert gradient @ direction == pytest.approx(slope, rel=1e-4, abs=0.1)
    assert (np.linalg.eigvalsh(model.H.toarray()) > -1e-6 * abs(model.H).max()).all()


def test_limit_rows_lie_on_the_safe_side() -> None:
    at, asked, rng = replace(iterate(5, 0.01), duration=2.5), task(), np.random.default_rng(6)
    rows = stack_rows(limit_rows(asked, at, 0.0))
    kept = 0
    for _ in range(300):
        T = at.duration * rng.uniform(0.5, 2.0)
        other = Iterate(SPACE, at.points + 0.01 * rng.normal(size=at.points.shape), T)
        if (rows.A @ packed(other) <= rows.upper).all():
            kept += 1
            motion = other.trajectory(PANDA.joint_names)
            for order, limits in asked.orders.items():
                assert (motion.peaks(order).value <= limits * (1.0 + 1e-9)).all()
    assert kept > 20


def test_ends_that_move_are_exact() -> None:
    rng = np.random.default_rng(8)
    start, end = (End(*rng.normal(size=(3, 7))) for _ in range(2))
    at = iterate(9).with_ends(start, end)
    motion = at.trajectory(PANDA.joint_names)
    for given, time in ((start, 0.0), (end, motion.duration)):
        for order, values in enumerate(given.derivatives):
            np.testing.assert_allclose(motion.sample([time], order)[0], values, atol=1e-9)
    rows = stack_rows(end_rows(at, start, end))
    np.testing.assert_allclose(rows.A @ packed(at), rows.lower, atol=1e-9)


def test_rows_of_obstacles_follow_distances() -> None:
    at, scene = iterate(10, 0.02), pillar(angle=0.4, distance=0.55)
    asked = task(scene=scene)
    places = Checkpoints.uniform(SPACE.breaks, 3, 0.0)
    rows = stack_rows(list(linearize(asked, at, places, 0.3, Deadline.after(60.0)).rows))
    z = packed(at)
    room = rows.upper - rows.A @ z
    nearest = []
    for q in at.sample(places.at):
        near = asked.checker.gradient(q, 0.3)
        reached = near.distances < 0.3 * np.abs(near.gradients).sum(axis=1) / 2.0
        nearest += near.distances[reached].tolist()
    assert room.min() == pytest.approx(min(nearest), abs=1e-6)


def test_loads_tell_how_much_slower() -> None:
    chain = with_payload(PANDA, 3.0)
    loads = EffortLimits(chain, PANDA.limits.effort, 0.4)
    at, asked = iterate(11), task(loads)
    places = Checkpoints.uniform(SPACE.breaks, 3, 0.0)
    factor = least_factor(asked, at, places)
    assert factor > 1.0
    slower = Iterate(SPACE, at.points, at.duration * factor)
    assert linearize(asked, slower, places, 0.1, Deadline.after(60.0)).violation == 0.0
    assert least_factor(asked, slower, places) == pytest.approx(1.0, abs=0.02)


def test_problems_without_solution_have_none() -> None:
    one, none = np.eye(2), np.zeros(2)
    wide = np.full(2, np.inf)
    apart = Quadratic(one, none, one, np.full(2, 1.0), wide, -wide, np.full(2, -1.0))
    assert apart.solve() is None
    found = Quadratic(one, np.array([-3.0, 0.0]), one, -wide, np.ones(2), -wide, wide).solve()
    assert found is not None
    np.testing.assert_allclose(found, [1.0, 0.0], atol=1e-6)

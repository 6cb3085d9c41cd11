"""Curves of nearly singular arms: angles without turns, places that were visited, last digits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.arrays import Array, Indices
from kinematics.forward import forward
from kinematics.frame import Frame
from kinematics.ik.closed_form.continuation import (
    is_visited_kernel,
    sharpen_kernel,
    tangent_kernel,
    wrap_kernel,
)
from kinematics.jacobian import geometric
from tests.kinematics.ik.arms import general_arm

SIX: Indices = np.arange(6)


def frame(T: Array) -> Frame:
    """A transform as the kernels have it."""
    return tuple(float(x) for x in T[:3].flat)  # type: ignore[return-value]


@given(st.floats(-100.0, 100.0))
def test_an_angle_without_turns_is_the_same_direction(angle: float) -> None:
    found = wrap_kernel(angle)
    assert -np.pi <= found < np.pi + 1e-12
    assert np.cos(found) == pytest.approx(np.cos(angle), abs=1e-12)
    assert np.sin(found) == pytest.approx(np.sin(angle), abs=1e-12)


def test_angles_within_half_a_turn_stay_as_they_are() -> None:
    for angle in (-np.pi, -1.0, 0.0, 1e-300, 3.0):
        assert wrap_kernel(angle) == angle


def visited(points: Array, tangents: Array) -> Array:
    """The table of a curve's points and unit tangents."""
    return np.column_stack([points, tangents])


@pytest.mark.parametrize(
    ("along", "across", "expected"),
    [
        (0.0, 0.0, True),
        (0.1, 0.0, True),  # the curve goes on along its tangent
        (0.13, 0.0, False),  # further than a step along
        (0.0, 0.9e-3, True),
        (0.0, 1.5e-3, False),
        (0.05, 1.2e-3, True),  # further along, the curve may have bent
        (0.05, 3e-3, False),
    ],
)
def test_places_beside_a_curve_are_visited_as_near_as_it_is_known(
    along: float, across: float, expected: bool
) -> None:
    rng = np.random.default_rng(0)
    frame6, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    point, tangent, normal = rng.uniform(-3.0, 3.0, 6), frame6[0], frame6[1]
    table = visited(point[None], tangent[None])
    for turn in (0.0, 2.0 * np.pi):
        q = point + along * tangent + across * normal
        q[2] += turn
        assert is_visited_kernel(table, 1, SIX, q, 1e-3) is expected


def test_rows_that_are_not_filled_do_not_count() -> None:
    table = visited(np.zeros((3, 6)), np.eye(6)[:3])
    assert not is_visited_kernel(table, 0, SIX, np.zeros(6), 1e-3)
    assert is_visited_kernel(table, 1, SIX, np.zeros(6), 1e-3)


def test_only_the_joints_that_move_are_compared() -> None:
    table = visited(np.zeros((1, 6)), np.eye(6)[:1])
    q = np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert is_visited_kernel(table, 1, np.array([0, 2, 3, 4, 5, 6]), q, 1e-3)
    assert not is_visited_kernel(table, 1, SIX, q, 1e-3)


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-6, 1e-4, 1e-2])
def test_newtons_steps_reach_the_last_digits(size: float) -> None:
    rng = np.random.default_rng(1)
    chain = general_arm(rng, "spherical")
    for goal in rng.uniform(-2.0, 2.0, (8, 6)):
        if np.linalg.svd(geometric(chain, goal), compute_uv=False)[-1] < 1e-2:
            continue
        T = forward(chain, goal)
        q = goal + size * rng.uniform(-1.0, 1.0, 6)
        errors = sharpen_kernel(chain.model, chain.index["tip"], frame(T), SIX, q)
        assert max(errors) < 1e-14
        assert np.abs(q - goal).max() < 1e-12


def test_steps_that_do_not_help_are_not_taken() -> None:
    chain = general_arm(np.random.default_rng(2), "spherical")
    q = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
    T = forward(chain, q)
    T[:3, 3] *= 50.0
    before, start = np.linalg.norm(forward(chain, q)[:3, 3] - T[:3, 3]), q.copy()
    position, _ = sharpen_kernel(chain.model, chain.index["tip"], frame(T), SIX, q)
    assert position <= before * (1.0 + 1e-12)
    assert np.isfinite(q).all()
    assert (q == start).all() or position < before


@pytest.mark.parametrize("least", [0.5, 1e-3, 1e-9, 0.0])
def test_the_tangent_of_a_curve_moves_the_error_along_the_open_direction_only(least: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        U, _ = np.linalg.qr(rng.normal(size=(6, 6)))
        V, _ = np.linalg.qr(rng.normal(size=(6, 6)))
        J = np.asarray(U * [2.0, 1.5, 1.2, 1.0, 0.8, least] @ V.T)
        u, t = U[:, 5].copy(), V[:, 5] + 0.05 * rng.normal(size=6)
        t /= np.linalg.norm(t)
        way = np.sign(t @ V[:, 5])
        fine, slope = tangent_kernel(J, SIX, False, u, t)
        assert fine
        assert np.linalg.norm(t) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(J @ t + slope * u, 0.0, atol=1e-9)
        assert np.sign(t @ V[:, 5]) == way
        assert abs(slope) == pytest.approx(least, abs=1e-9)

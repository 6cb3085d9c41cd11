"""The functions that rows are made of: rotation vectors by scipy, gradients by differences."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.forward import frames_kernel
from kinematics.model.chain import Chain
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.row import WIDTH, Column, RowKind
from planning.constraints.row_value import (
    angle_kernel,
    away_kernel,
    axis_kernel,
    gradient_kernel,
    log_kernel,
    log_slope_kernel,
    point_kernel,
    relative_point_kernel,
    residual_kernel,
    sideways_kernel,
    to_base_kernel,
    value_kernel,
)
from tests.dynamics.samples import random_chain
from tests.planning.constraints.samples import some_of_each

#: Joints of both types, rows of every kind between the base and any two of its links.
CHAIN = random_chain(3, 7)
PACKED = np.array(ConstraintSet(CHAIN, tuple(some_of_each(CHAIN, 8))).packed)
RNG = np.random.default_rng(0)
TINY = (0.0, 1e-14, 1e-9, 1e-4, 0.1, 1.0, 3.0, math.pi - 1e-4, math.pi - 1e-7)


def frames_at(chain: Chain, q: Array) -> Array:
    frames = np.empty((chain.n, 4, 4))
    frames_kernel(chain.model, q, frames)
    return frames


def draw(seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-1.5, 1.5, CHAIN.n)


def unit(seed: int) -> tuple[float, float, float]:
    v = np.random.default_rng(seed).normal(size=3)
    x, y, z = v / np.linalg.norm(v)
    return float(x), float(y), float(z)


@pytest.mark.parametrize("angle", TINY)
def test_rotation_vectors_are_scipys(angle: float) -> None:
    for seed in range(20):
        wanted = angle * np.array(unit(seed))
        E = Rotation.from_rotvec(wanted).as_matrix()
        found = np.array(log_kernel(E))
        np.testing.assert_allclose(found, wanted, atol=1e-7 if angle > 3.1 else 1e-13)


@pytest.mark.parametrize("axis", range(3))
def test_half_a_turn_has_a_rotation_vector_of_its_length(axis: int) -> None:
    E = np.diag(np.where(np.arange(3) == axis, 1.0, -1.0))
    found = np.abs(log_kernel(E))
    np.testing.assert_allclose(found, math.pi * np.eye(3)[axis], atol=1e-12)


@pytest.mark.parametrize("angle", TINY)
def test_angles_are_exact_near_none_and_half_a_turn(angle: float) -> None:
    for seed in range(10):
        d = np.array(unit(seed))
        across = np.cross(d, unit(seed + 100))
        across /= np.linalg.norm(across)
        a = math.cos(angle) * d + math.sin(angle) * across
        assert angle_kernel(tuple(a), tuple(d)) == pytest.approx(angle, rel=1e-7, abs=1e-15)


def test_turning_away_makes_the_angle_grow_as_fast_as_it_turns() -> None:
    for seed in range(30):
        a, d = unit(seed), unit(seed + 50)
        w = np.array(away_kernel(a, d))
        assert np.linalg.norm(w) == pytest.approx(1.0)
        turned = Rotation.from_rotvec(1e-6 * w).apply(a)
        growth = angle_kernel(tuple(turned), d) - angle_kernel(a, d)
        assert growth == pytest.approx(1e-6, rel=1e-5)


def test_along_a_direction_nothing_leads_away_and_opposite_to_it_anything_back() -> None:
    for seed in range(10):
        d = unit(seed)
        assert away_kernel(d, d) == (0.0, 0.0, 0.0)
        a = (-d[0], -d[1], -d[2])
        w = np.array(away_kernel(a, d))
        assert np.linalg.norm(w) == pytest.approx(1.0)
        assert abs(w @ d) < 1e-12


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, 0.7, 2.0, 3.0])
def test_the_slope_of_a_rotation_vector_is_that_of_differences(angle: float) -> None:
    """E' = S(w) E: of a . log(E), along every w."""
    for seed in range(10):
        e, a = angle * np.array(unit(seed)), unit(seed + 30)
        E = Rotation.from_rotvec(e)
        slope = np.array(log_slope_kernel(tuple(e), a))
        h = 1e-6
        for w in np.eye(3):
            ahead, behind = (
                np.dot(a, (Rotation.from_rotvec(sign * h * w) * E).as_rotvec())
                for sign in (1.0, -1.0)
            )
            assert slope @ w == pytest.approx((ahead - behind) / (2.0 * h), abs=1e-7)


@pytest.mark.parametrize("kind", list(RowKind))
def test_gradients_are_the_slopes_of_values_for_every_kind_of_row(kind: RowKind) -> None:
    rows = PACKED[PACKED[:, Column.KIND] == kind]
    E, gradient = np.empty((3, 3)), np.empty(CHAIN.n)
    checked = 0
    for seed in range(12):
        q = draw(seed)
        for row in rows:
            value = gradient_kernel(CHAIN.model, q, frames_at(CHAIN, q), row, E, gradient)
            h, slopes, bends = 1e-6, np.empty(CHAIN.n), 0.0
            for j in range(CHAIN.n):
                step = h * np.eye(CHAIN.n)[j]
                ahead, behind = (
                    value_kernel(x, frames_at(CHAIN, x), row, E)[0] for x in (q + step, q - step)
                )
                slopes[j] = (ahead - behind) / (2.0 * h)
                bends = max(bends, abs(ahead + behind - 2.0 * value))
            if bends < 1e-8:
                np.testing.assert_allclose(gradient, slopes, atol=1e-5)
                checked += 1
    assert checked > 6 * len(rows)


@pytest.mark.parametrize("kind", list(RowKind))
def test_only_joints_between_the_two_bodies_count(kind: RowKind) -> None:
    E, gradient = np.empty((3, 3)), np.empty(CHAIN.n)
    q = draw(99)
    for row in PACKED[PACKED[:, Column.KIND] == kind]:
        gradient_kernel(CHAIN.model, q, frames_at(CHAIN, q), row, E, gradient)
        carrier, reference = int(row[Column.CARRIER]), int(row[Column.REFERENCE])
        between = np.arange(min(carrier, reference) + 1, max(carrier, reference) + 1)
        if kind == RowKind.JOINT:
            between = np.array([carrier])
            assert gradient[carrier] == 1.0
        assert not np.delete(gradient, between).any()


@pytest.mark.parametrize("kind", [RowKind.DISTANCE, RowKind.ANGLE, RowKind.LOOK])
def test_bounds_across_hold_wherever_the_row_does(kind: RowKind) -> None:
    """To first order: a violated row's step that keeps them does not run past the set."""
    rows = PACKED[PACKED[:, Column.KIND] == kind]
    seen = 0
    for seed in range(6):
        q = draw(200 + seed)
        frames = frames_at(CHAIN, q)
        for row in rows:
            for second in (False, True):
                bound, linear, angular = sideways_kernel(frames, row, second)
                if math.isinf(bound):
                    continue
                seen += 1
                _, along, about = value_kernel(q, frames, row, np.empty((3, 3)))
                limit = row[Column.UPPER]
                expected = limit if kind == RowKind.DISTANCE else math.sin(limit)
                assert bound == pytest.approx(expected)
                # Unit covectors, across the one that the value is measured along.
                if kind == RowKind.ANGLE:
                    assert np.linalg.norm(angular) == pytest.approx(1.0)
                    assert np.dot(angular, about) == pytest.approx(0.0, abs=1e-9)
                if kind == RowKind.DISTANCE:
                    assert np.linalg.norm(linear) == pytest.approx(1.0)
                    assert np.dot(linear, along) == pytest.approx(0.0, abs=1e-9)
    assert seen > 6


def test_a_ball_is_bounded_two_ways_across_a_line_one_and_a_wide_cone_none() -> None:
    q = draw(1)
    frames = frames_at(CHAIN, q)

    def count(row: Array) -> int:
        return sum(
            not math.isinf(sideways_kernel(frames, row, second)[0]) for second in (False, True)
        )

    distances = PACKED[PACKED[:, Column.KIND] == RowKind.DISTANCE]
    lines = np.linalg.norm(distances[:, 12:15], axis=1) > 0.5
    assert {count(row) for row in distances[~lines]} == {2}
    assert {count(row) for row in distances[lines]} == {1}
    for kind in (RowKind.ANGLE, RowKind.LOOK):
        row = PACKED[PACKED[:, Column.KIND] == kind][0].copy()
        row[Column.UPPER] = 0.5 * math.pi - 1e-6
        assert count(row) == 1
        row[Column.UPPER] = 0.5 * math.pi
        assert count(row) == 0
    for kind in (RowKind.JOINT, RowKind.COORDINATE, RowKind.ROTATION):
        assert count(PACKED[PACKED[:, Column.KIND] == kind][0]) == 0


def test_points_and_axes_are_seen_from_their_reference() -> None:
    q = draw(5)
    frames = frames_at(CHAIN, q)
    for row in PACKED[PACKED[:, Column.KIND] == RowKind.LOOK]:
        carrier, reference = int(row[Column.CARRIER]), int(row[Column.REFERENCE])
        C = np.eye(4) if carrier < 0 else frames[carrier]
        R = np.eye(4) if reference < 0 else frames[reference]
        P = C[:3, :3] @ row[3:6] + C[:3, 3]
        np.testing.assert_allclose(point_kernel(frames, row), P, atol=1e-12)
        seen = R[:3, :3].T @ (P - R[:3, 3])
        found = relative_point_kernel(frames, row, point_kernel(frames, row))
        np.testing.assert_allclose(found, seen, atol=1e-12)
        axis = R[:3, :3].T @ C[:3, :3] @ row[6:9]
        np.testing.assert_allclose(axis_kernel(frames, row), axis, atol=1e-12)
        back = to_base_kernel(frames, row, axis_kernel(frames, row))
        np.testing.assert_allclose(back, C[:3, :3] @ row[6:9], atol=1e-12)


@pytest.mark.parametrize(
    ("value", "residual", "sign"),
    [(2.5, 0.5, 1.0), (0.5, 0.5, -1.0), (1.5, -0.5, 1.0), (1.2, -0.2, -1.0), (2.0, 0.0, 1.0)],
)
def test_the_residual_is_that_of_the_nearer_bound(
    value: float, residual: float, sign: float
) -> None:
    row = np.zeros(WIDTH)
    row[Column.LOWER], row[Column.UPPER] = 1.0, 2.0
    found = residual_kernel(value, row)
    assert found[0] == pytest.approx(residual)
    assert found[1] == sign
    row[Column.LOWER] = -math.inf
    assert residual_kernel(value, row) == (value - 2.0, 1.0)

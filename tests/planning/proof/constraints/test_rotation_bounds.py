"""Rotation vectors and bounds of their components, against scipy at dense samples."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from planning.proof.constraints.residual_row import (
    AXIS,
    CARRIER,
    LOWER,
    REFERENCE,
    TURN,
    UPPER,
    WIDTH,
)
from planning.proof.constraints.rotation_bounds import rotation_bounds, rotation_log
from planning.proof.relative_motion import RelativeMotion


def row(K: Array, axis: Array, lower: float, upper: float, reference: int = -1) -> Array:
    packed = np.zeros(WIDTH)
    packed[CARRIER], packed[REFERENCE] = 0, reference
    packed[AXIS : AXIS + 3], packed[LOWER], packed[UPPER] = axis, lower, upper
    packed[TURN:] = K.ravel()
    return packed


def turning(w: Array, half: float) -> RelativeMotion:
    """A turn at a constant rate."""
    speed, still = float(np.linalg.norm(w)), (0.0, 0.0, 0.0)
    rate = (float(w[0]), float(w[1]), float(w[2]))
    return RelativeMotion(still, rate, 0.0, 0.0, 0.0, speed * half, 0.0, speed, 0.0)


def frames_of(*rotations: Array) -> Array:
    frames = np.tile(np.eye(4), (len(rotations), 1, 1))
    frames[:, :3, :3] = rotations
    return frames


@pytest.mark.parametrize("angle", [0.0, 1e-13, 1e-9, 1e-4, 1.0, 3.0, np.pi - 1e-4, np.pi - 1e-9])
def test_the_rotation_vector_is_that_of_scipy(angle: float) -> None:
    random = np.random.default_rng(1)
    for axis in [*np.eye(3), *-np.eye(3), *random.normal(size=(30, 3))]:
        vector = angle * axis / np.linalg.norm(axis)
        E = Rotation.from_rotvec(vector).as_matrix()
        # Near half a turn a matrix knows its angle to the root of its digits only.
        np.testing.assert_allclose(rotation_log(E), vector, atol=1e-7 if angle > 3.1 else 1e-12)


def test_the_vector_turns_back_into_the_matrix() -> None:
    """Half turns too, about axes of every octant: each branch of the quaternion."""
    random = np.random.default_rng(2)
    axes = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)][:13])
    for axis in [*axes, *random.normal(size=(20, 3))]:
        for angle in (0.3, 2.0, np.pi):
            E = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
            back = Rotation.from_rotvec(rotation_log(E)).as_matrix()
            np.testing.assert_allclose(back, E, atol=1e-9)
            assert np.linalg.norm(rotation_log(E)) <= np.pi + 1e-12


@pytest.mark.parametrize("size", [1e-3, 0.1, 0.9, 2.0, 3.1])
@pytest.mark.parametrize("speed", [1e-3, 0.3, 3.0])
def test_components_stay_within_their_bounds(size: float, speed: float) -> None:
    """Of e = log(K X) while X turns at a constant rate, from dense samples by scipy."""
    random = np.random.default_rng(3)
    for _ in range(20):
        axes = random.normal(size=(3, 3))
        a, e, w = (v / np.linalg.norm(v) for v in axes)
        X = Rotation.random(random_state=random)
        K = (Rotation.from_rotvec(size * e) * X.inv()).as_matrix()
        half = 0.2
        value, low, high = rotation_bounds(
            frames_of(X.as_matrix()), row(K, a, -1.0, 1.0), turning(speed * w, half), half, 1e-12
        )
        assert value == pytest.approx(size * float(a @ e), abs=1e-6)
        s = np.linspace(-half, half, 101)[:, None]
        turned = Rotation.from_rotvec(s * speed * w) * X
        values = (Rotation.from_matrix(K) * turned).as_rotvec() @ a
        # Across half a turn the vector changes its sign: the size of a component is bounded.
        if size + speed * half < np.pi:
            assert values.min() >= low - 1e-9
            assert values.max() <= high + 1e-9
        assert np.abs(values).max() <= max(-low, high) + 1e-9


def test_bounds_shrink_with_the_interval_to_first_order() -> None:
    """Along an axis across the rate the component changes by the second order alone."""
    w, X = np.array([0.0, 0.0, 1.0]), np.eye(3)
    widths = []
    for half in (0.1, 0.01, 0.001):
        across = row(np.eye(3), np.array([1.0, 0.0, 0.0]), -1.0, 1.0)
        _, low, high = rotation_bounds(frames_of(X), across, turning(w, half), half, 0.0)
        widths.append(high - low)
        along = row(np.eye(3), w, -1.0, 1.0)
        _, low, high = rotation_bounds(frames_of(X), along, turning(w, half), half, 0.0)
        assert half <= high <= 1.1 * half
    assert widths[1] < 0.02 * widths[0]
    assert widths[2] < 0.02 * widths[1]


def test_a_still_link_has_the_value_it_has() -> None:
    random = np.random.default_rng(4)
    X, a = Rotation.random(random_state=random), np.array([0.0, 1.0, 0.0])
    value, low, high = rotation_bounds(
        frames_of(X.as_matrix()), row(np.eye(3), a, -1.0, 1.0), turning(np.zeros(3), 0.1), 0.1, 0.0
    )
    assert low == pytest.approx(value, abs=1e-15)
    assert high == pytest.approx(value, abs=1e-15)
    assert value == pytest.approx(X.as_rotvec() @ a)


def test_what_rounding_loses_widens_the_bounds() -> None:
    X, a = np.eye(3), np.array([1.0, 0.0, 0.0])
    bounds = [
        rotation_bounds(frames_of(X), row(X, a, -1.0, 1.0), turning(np.zeros(3), 0.1), 0.1, lost)
        for lost in (0.0, 1e-6)
    ]
    assert bounds[1][2] - bounds[0][2] >= 1e-6
    assert bounds[0][1] - bounds[1][1] >= 1e-6


@pytest.mark.parametrize("symmetric", [True, False])
def test_beyond_half_a_turn_nothing_is_told_but_the_size(symmetric: bool) -> None:
    """A row that is not symmetric can be violated by either sign: then it is half a turn."""
    X = Rotation.from_rotvec([3.1, 0.0, 0.0]).as_matrix()
    a = np.array([1.0, 0.0, 0.0])
    packed = row(np.eye(3), a, -1.0 if symmetric else 0.0, 1.0)
    value, low, high = rotation_bounds(
        frames_of(X), packed, turning(np.array([1.0, 0.0, 0.0]), 0.1), 0.1, 0.0
    )
    assert value == pytest.approx(3.1)
    assert low == -high
    assert high >= np.pi if symmetric else high == pytest.approx(np.pi)


def test_it_is_seen_from_the_reference() -> None:
    """Turning both links alike changes nothing; the rate is in the base's axes."""
    random = np.random.default_rng(5)
    A, B = Rotation.random(2, random_state=random)
    a, w, half = np.array([0.0, 0.6, 0.8]), np.array([0.3, -0.2, 0.5]), 0.05
    K = (B.inv() * A).inv().as_matrix()
    seen = row(K, a, -1.0, 1.0, reference=1)
    value, low, high = rotation_bounds(
        frames_of(A.as_matrix(), B.as_matrix()), seen, turning(w, half), half, 0.0
    )
    assert value == pytest.approx(0.0, abs=1e-9)
    s = np.linspace(-half, half, 51)[:, None]
    moved = B.inv() * Rotation.from_rotvec(s * w) * A
    values = (Rotation.from_matrix(K) * moved).as_rotvec() @ a
    assert low - 1e-9 <= values.min() <= 0.9 * low
    assert 0.9 * high <= values.max() <= high + 1e-9

"""Deviations from lines and arcs: closed forms in the middle, dense samples of an interval."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from planning.proof.relative_motion import RelativeMotion
from planning.proof.tool.tool_curve import (
    ALONG,
    AXIS,
    CENTER,
    KIND,
    LENGTH,
    NORMAL,
    ROTATION,
    START,
    SWEEP,
    TURN,
    WIDTH,
    Deviations,
    angle_to_nominal,
    arc_deviation,
    line_deviation,
)

ARC, RADIUS, SWEPT = 1.0, 0.5, 2.0


def line(start: Array, along: Array, length: float) -> Array:
    m = np.zeros(WIDTH)
    m[START : START + 3], m[ALONG : ALONG + 3], m[LENGTH] = start, along, length
    m[ROTATION:] = np.eye(3).ravel()
    return m


def arc(sweep: float = SWEPT) -> Array:
    """Half a metre about the origin, from the x axis towards y."""
    m = np.zeros(WIDTH)
    m[KIND], m[ALONG : ALONG + 3], m[NORMAL : NORMAL + 3] = ARC, [1, 0, 0], [0, 0, 1]
    m[CENTER : CENTER + 3], m[LENGTH], m[SWEEP] = [0, 0, 0], RADIUS, sweep
    m[ROTATION:] = np.eye(3).ravel()
    return m


def vector(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def steady(velocity: Array, half: float, turn_rate: Array | None = None) -> RelativeMotion:
    """A point at a constant velocity, of a link that turns at a constant rate."""
    w = np.zeros(3) if turn_rate is None else turn_rate
    speed, turning = float(np.linalg.norm(velocity)), float(np.linalg.norm(w))
    return RelativeMotion(
        vector(velocity), vector(w), speed * half, 0.0, 0.0, turning * half, 0.0, turning, 0.0
    )


def empty(R: Array | None = None) -> Deviations:
    T = np.zeros((3, 4))
    T[:, :3] = np.eye(3) if R is None else R
    return Deviations(np.zeros(2), np.zeros(2), T)


def off_segment(points: Array, start: Array, along: Array, length: float) -> Array:
    x = np.clip((points - start) @ along, 0.0, length)
    return np.asarray(np.linalg.norm(points - start - x[:, None] * along, axis=1))


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def test_off_a_line_it_is_the_distance_from_the_segment() -> None:
    random = np.random.default_rng(1)
    for _ in range(60):
        start, along, length = random.normal(size=3), unit(random.normal(size=3)), 0.7
        p, v, half = start + random.normal(size=3) * 0.5, random.normal(size=3), 0.1
        found = empty()
        judged, s, pace, bend = line_deviation(
            line(start, along, length), vector(p), steady(v, half), half, np.zeros(3), found
        )
        assert judged
        assert found.now[0] == pytest.approx(off_segment(p[None], start, along, length)[0])
        assert s == pytest.approx((p - start) @ along / length)
        assert pace == pytest.approx(v @ along / length)
        assert bend == 0.0
        times = np.linspace(-half, half, 41)[:, None]
        dense = off_segment(p + times * v, start, along, length)
        assert dense.max() <= found.upper[0] + 1e-12
        assert found.upper[0] <= dense.max() + 2.0 * half * float(np.linalg.norm(v))


def test_along_a_line_motion_costs_nothing() -> None:
    along, half = np.array([1.0, 0.0, 0.0]), 0.2
    found = empty()
    p = (0.5, 0.03, 0.0)
    line_deviation(line(np.zeros(3), along, 1.0), p, steady(along, half), half, np.zeros(3), found)
    assert found.now[0] == found.upper[0] == pytest.approx(0.03)
    # Across it, it does; and so does what is not known of the motion.
    across = steady(np.array([0.0, 1.0, 0.0]), half)._replace(bend=0.01)
    line_deviation(line(np.zeros(3), along, 1.0), p, across, half, np.zeros(3), found)
    assert found.upper[0] == pytest.approx(0.03 + 0.2 + 0.01)


@pytest.mark.parametrize(("x", "over"), [(-0.2, 0.2), (1.3, 0.3), (0.95, 0.0)])
def test_beyond_its_ends_a_line_ends(x: float, over: float) -> None:
    along, found = np.array([1.0, 0.0, 0.0]), empty()
    m = line(np.zeros(3), along, 1.0)
    line_deviation(m, (x, 0.1, 0.0), steady(along, 0.1), 0.1, np.zeros(3), found)
    assert found.now[0] == pytest.approx(np.hypot(0.1, over))
    assert found.upper[0] == pytest.approx(np.hypot(0.1, max(0.0, 0.1 - x, x + 0.1 - 1.0)))


def test_a_turn_on_the_spot_is_followed_by_its_angle() -> None:
    m = line(np.zeros(3), np.zeros(3), 0.0)
    m[AXIS : AXIS + 3], m[TURN] = [0.0, 0.0, 1.0], 4.0
    w, place = np.array([0.0, 0.0, 2.0]), np.zeros(3)
    for angle in (0.0, 0.5, 1.5, 3.0, 3.5, 4.0):
        found = empty(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix())
        spread = steady(np.zeros(3), 0.01, w)
        judged, s, pace, _ = line_deviation(m, (0.0, 0.1, 0.0), spread, 0.01, place, found)
        assert judged
        # Beyond half a turn too: the angle goes on from where it was.
        assert s == pytest.approx(angle / 4.0)
        assert pace == pytest.approx(0.5)
        assert found.now[0] == pytest.approx(0.1)
    judged, *_ = line_deviation(m, (0.0, 0.0, 0.0), steady(w, 1.0, w), 1.0, place, empty())
    assert not judged


def test_standing_still_has_one_place() -> None:
    found = empty()
    m = line(np.array([1.0, 0.0, 0.0]), np.zeros(3), 0.0)
    asked = line_deviation(
        m, (1.0, 0.0, 0.2), steady(np.ones(3), 5.0, np.ones(3)), 5.0, np.zeros(3), found
    )
    assert asked == (True, 0.0, 0.0, 0.0)
    assert found.now[0] == pytest.approx(0.2)


def off_arc(points: Array, sweep: float) -> Array:
    """An upper bound of the distance from the arc: radial and axial, and along it past its ends."""
    phi = np.arctan2(points[:, 1], points[:, 0])
    over = RADIUS * np.maximum(0.0, np.maximum(-phi, phi - sweep))
    radial = np.hypot(np.hypot(points[:, 0], points[:, 1]) - RADIUS, points[:, 2])
    return np.asarray(np.hypot(radial, over))


def test_off_an_arc_it_is_radial_and_axial_distance() -> None:
    random = np.random.default_rng(2)
    judged_ones = 0
    for _ in range(80):
        phi = random.uniform(-0.3, SWEPT + 0.3)
        r, z = random.uniform(0.3, 0.8), random.normal() * 0.1
        p = np.array([r * np.cos(phi), r * np.sin(phi), z])
        v, half, found = random.normal(size=3) * 0.3, 0.1, empty()
        judged, s, pace, bend = arc_deviation(
            arc(), vector(p), steady(v, half), half, np.zeros(3), found
        )
        if not judged:
            continue
        judged_ones += 1
        assert found.now[0] == pytest.approx(off_arc(p[None], SWEPT)[0])
        assert s == pytest.approx(phi / SWEPT)
        # How fast the angle changes, and by how much that can change.
        times = np.linspace(-half, half, 41)
        path = p + times[:, None] * v
        angles = np.unwrap(np.arctan2(path[:, 1], path[:, 0]))
        slope = (angles[21] - angles[19]) / (times[21] - times[19])
        assert pace == pytest.approx(slope / SWEPT, abs=1e-3)
        rest = np.abs(angles - angles[20] - pace * SWEPT * times)
        assert (rest <= 0.5 * bend * SWEPT * times**2 + 1e-9).all()
        assert off_arc(path, SWEPT).max() <= found.upper[0] + 1e-12
    assert judged_ones > 60


def test_around_an_arc_the_angle_is_followed_past_a_turn() -> None:
    m, place = arc(3.0 * np.pi), np.zeros(3)
    for phi in np.arange(0.0, 3.0 * np.pi, 0.3):
        p, v = RADIUS * np.array([np.cos(phi), np.sin(phi), 0.0]), np.zeros(3)
        judged, s, _, _ = arc_deviation(m, vector(p), steady(v, 0.1), 0.1, place, empty())
        assert judged
        assert s == pytest.approx(phi / (3.0 * np.pi))


@pytest.mark.parametrize(
    ("place", "velocity"),
    [((0.1, 0.0, 0.0), (-1.0, 0.0, 0.0)), ((0.5, 0.0, 0.0), (0.0, 1.9, 0.0))],
    ids=["towards the centre", "too far around"],
)
def test_what_turns_too_far_is_not_judged(
    place: tuple[float, float, float], velocity: tuple[float, float, float]
) -> None:
    spread = steady(np.array(velocity), 0.1)
    assert not arc_deviation(arc(), place, spread, 0.1, np.zeros(3), empty())[0]
    short = steady(np.array(velocity), 0.01)
    assert arc_deviation(arc(), place, short, 0.01, np.zeros(3), empty())[0]


@pytest.mark.parametrize("turn", [0.0, 1e-9, 0.7, 3.0])
def test_the_angle_to_the_nominal_orientation_is_that_of_scipy(turn: float) -> None:
    random = np.random.default_rng(3)
    for s in (0.0, 0.25, 1.0, 1.2):
        R0, off = Rotation.random(random_state=random), random.normal(size=3) * 0.4
        axis = unit(random.normal(size=3))
        m = line(np.zeros(3), np.zeros(3), 1.0)
        m[AXIS : AXIS + 3], m[TURN], m[ROTATION:] = axis, turn, R0.as_matrix().ravel()
        nominal = Rotation.from_rotvec(s * turn * axis) * R0
        T = np.zeros((3, 4))
        T[:, :3] = (Rotation.from_rotvec(off) * nominal).as_matrix()
        assert angle_to_nominal(m, s, T) == pytest.approx(float(np.linalg.norm(off)), abs=1e-9)
        T[:, :3] = nominal.as_matrix()
        assert angle_to_nominal(m, s, T) == pytest.approx(0.0, abs=1e-15 + 1e-8 * (turn > 0))

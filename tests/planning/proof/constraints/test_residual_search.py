"""Bounds of residuals and rotation vectors judged by pinocchio and scipy."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import edge_holds
from planning.constraints.kinds.constraint import (
    ConeConstraint,
    Geometric,
    JointConstraint,
    LineRegion,
    LookAtConstraint,
    OrientationConstraint,
    PlaneRegion,
    PositionConstraint,
    RelativePoseConstraint,
    SphereRegion,
)
from planning.constraints.row import WIDTH, Column
from planning.proof.constraints.residual_search import (
    LEAST_GAP,
    SHARP,
    TOLERANCE,
    ResidualBounds,
    Verdict,
    bound_residuals,
)
from planning.proof.constraints.rotation_bounds import rotation_bounds, rotation_log
from planning.proof.relative_motion import RelativeMotion
from tests.planning.constraints.samples import some_of_each
from tests.planning.pinocchio_arm import PinocchioArm

#: What dense samples may miss of a maximum [m or rad].
MISSED = 2e-5
SAMPLES = 1501


class Frames(PinocchioArm):
    """Poses of links by pinocchio."""

    def poses(self, configurations: Array, link: str) -> Array:
        """Of one link in many configurations, (k, 4, 4)."""
        return np.array([self.pose(q, link) for q in configurations])


@dataclass(frozen=True)
class Case:
    """A quantity measured from the poses of tip and reference, and the constraint on it."""

    name: str
    measured: Callable[[Array, Array], Array]
    bounded: Callable[[float], Geometric]

    @property
    def angular(self) -> bool:
        """Whether half a turn is all that it can be."""
        return any(word in self.name for word in ("cone", "look", "orientation"))


def bounds_of(constraints: ConstraintSet, motion: Trajectory) -> ResidualBounds:
    return bound_residuals(constraints.chain, constraints.rows, motion)


def angle(a: Array, b: Array) -> Array:
    """Between vectors (k, 3) [rad]."""
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.arctan2(sine, (a * b).sum(axis=-1)))


def drawn(rng: np.random.Generator, reference: str) -> list[Case]:
    """One of each kind with random numbers, seen from the base and from a link."""
    a, d, c, p = (rng.normal(size=3) for _ in range(4))
    a, d = a / np.linalg.norm(a), d / np.linalg.norm(d)
    c, p = 0.5 * c, 0.1 * p
    R = pin.exp3(rng.normal(size=3))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, c

    def point(tip: Array) -> Array:
        return np.asarray(tip[:, :3, :3] @ p + tip[:, :3, 3])

    def seen(tip: Array, ref: Array) -> Array:
        return np.asarray(np.linalg.inv(ref) @ tip)

    def turn(tip: Array, _: Array) -> Array:
        return np.asarray(np.abs([pin.log3(R.T @ X[:3, :3]) for X in tip]).max(axis=1))

    def off_line(tip: Array, _: Array) -> Array:
        off = point(tip) - c
        return np.asarray(np.linalg.norm(off - (off @ d)[:, None] * d, axis=1))

    return [
        Case(
            "cone", lambda tip, _: angle(tip[:, :3, :3] @ a, d), lambda w: ConeConstraint(a, d, w)
        ),
        Case(
            "cone seen from a link",
            lambda tip, ref: angle(seen(tip, ref)[:, :3, :3] @ a, d),
            lambda w: ConeConstraint(a, d, w, reference_link=reference),
        ),
        Case(
            "look-at",
            lambda tip, _: angle(tip[:, :3, :3] @ a, 3.0 * c - point(tip)),
            lambda w: LookAtConstraint(a, 3.0 * c, w, point=p),
        ),
        Case("orientation", turn, lambda w: OrientationConstraint(R, w)),
        Case(
            "plane",
            lambda tip, _: np.abs((point(tip) - c) @ d),
            lambda w: PositionConstraint(PlaneRegion(c, d, w), point=p),
        ),
        Case(
            "sphere",
            lambda tip, _: np.linalg.norm(point(tip) - c, axis=1),
            lambda w: PositionConstraint(SphereRegion(c, w), point=p),
        ),
        Case("line", off_line, lambda w: PositionConstraint(LineRegion(c, d, w), point=p)),
        Case(
            "sphere seen from a link",
            lambda tip, ref: np.linalg.norm(seen(tip, ref)[:, :3, 3] - c, axis=1),
            lambda w: PositionConstraint(SphereRegion(c, w), reference_link=reference),
        ),
        Case(
            "relative position",
            lambda tip, ref: np.abs((seen(tip, ref)[:, :3, 3] - c) @ R).max(axis=1),
            lambda w: RelativePoseConstraint(
                T, reference_link=reference, position_tolerances=w, orientation_tolerances=np.pi
            ),
        ),
    ]


@pytest.mark.parametrize(
    ("name", "reference"), [("panda", "panda_link3"), ("ur5e", "forearm_link")]
)
def test_every_kind_is_bounded_soundly_and_sharply(name: str, reference: str) -> None:
    chain, frames, rng = builtin_chain(name), Frames(name), np.random.default_rng(11)
    low, high = chain.sampling_bounds()
    checked = dict.fromkeys((Verdict.HOLDS, Verdict.VIOLATED), 0)
    for _ in range(12):
        start = rng.uniform(low, high)
        scale = 0.4 ** np.arange(6) * rng.choice([0.2, 1.0])
        coefficients = rng.normal(size=(2, chain.n, 6)) * scale
        coefficients[:, :, 0] = start
        given = Trajectory(chain.joint_names, np.array([0.0, 0.6, 1.5]), coefficients)
        # The pieces do not meet: the end of the first one is looked at as closely as it can be.
        pieces = np.linspace(0.0, 0.6 - 1e-12, SAMPLES), np.linspace(0.6, 1.5, SAMPLES)
        times = np.concatenate(pieces)
        configurations = given.sample(times)
        tip, ref = (frames.poses(configurations, link) for link in (chain.tip_link, reference))
        for case in drawn(rng, reference):
            values = case.measured(tip, ref)
            most = float(values.max())
            for spare in (1e-4, 0.05 * most):
                width = most + spare
                if case.angular and width >= np.pi:
                    continue
                found = bounds_of(ConstraintSet(chain, (case.bounded(width),)), given)
                worst = found.worst
                assert found.verdict == Verdict.HOLDS, (case.name, spare)
                assert worst >= -spare - MISSED, case.name
                assert worst <= -spare + SHARP * spare + LEAST_GAP + MISSED, case.name
                checked[Verdict.HOLDS] += 1
            if most < 1e-3:
                continue
            tight = ConstraintSet(chain, (case.bounded(most - 1e-5),))
            found = bounds_of(tight, given)
            assert found.verdict == Verdict.VIOLATED, case.name
            at = given.sample([found.time])
            here = case.measured(*(frames.poses(at, link) for link in (chain.tip_link, reference)))
            assert here[0] > most - 1e-5 + 0.99 * TOLERANCE, case.name
            assert abs(here[0] - (most - 1e-5) - found.residual) < 1e-9, case.name
            assert not any(
                edge_holds(chain, tight.packed, piece * h ** np.arange(6))
                for piece, h, own in zip(
                    given.coefficients, np.diff(given.breaks), (times < 0.6, times >= 0.6),
                    strict=True,
                )
                if values[own].max() > most - 1e-5 + TOLERANCE
            )  # fmt: skip
            checked[Verdict.VIOLATED] += 1
    assert checked[Verdict.HOLDS] > 150
    assert checked[Verdict.VIOLATED] > 80


def test_joints_are_bounded_by_their_extrema() -> None:
    chain, rng = builtin_chain("panda"), np.random.default_rng(12)
    times = np.linspace(0.0, 1.0, SAMPLES)
    for _ in range(40):
        coefficients = rng.normal(size=(1, chain.n, 5)) * 0.5
        given = Trajectory(chain.joint_names, np.array([0.0, 1.0]), coefficients)
        q = given.sample(times)[:, 3]
        for spare in (1e-4, -1e-4):
            asked = JointConstraint("panda_joint4", -50.0, float(q.max()) + 50.0 + spare, 100.0)
            found = bounds_of(ConstraintSet(chain, (asked,)), given)
            assert found.verdict == (Verdict.HOLDS if spare > 0.0 else Verdict.VIOLATED)


def test_values_are_those_of_the_planner_at_every_sample() -> None:
    """Two evaluations written apart, on every kind of row, seen from the base and from links."""
    for name in ("panda", "stanford", "scara"):
        chain, rng = builtin_chain(name), np.random.default_rng(5)
        constraints = ConstraintSet(chain, tuple(some_of_each(chain, 1)))
        for q in rng.normal(size=(60, chain.n)):
            rest = Trajectory(chain.joint_names, np.array([0.0, 1.0]), q.reshape(1, chain.n, 1))
            residuals = [bound_residuals(chain, [row], rest).worst for row in constraints.rows]
            np.testing.assert_allclose(residuals, constraints.residuals(q), atol=1e-9)


def test_a_violation_between_samples_is_found() -> None:
    chain = builtin_chain("planar_rr")
    asked = JointConstraint(chain.joint_names[0], 0.0, 0.5, 0.5)
    # Out and back within a thousandth of the motion's time.
    times = np.array([0.0, 1.0, 1.0005, 1.001, 2.0])
    q = np.zeros((5, 2))
    q[2, 0] = 0.51
    rates = np.diff(q, axis=0) / np.diff(times)[:, None]
    spike = Trajectory(chain.joint_names, times, np.stack([q[:-1], rates], axis=2))
    bounds = bounds_of(ConstraintSet(chain, (asked,)), spike)
    assert bounds.verdict == Verdict.VIOLATED
    assert bounds.time == pytest.approx(1.0005 * 0.5 / 0.51 + 1.0 * (1.0 - 0.5 / 0.51), abs=1e-4)
    assert bounds.worst == pytest.approx(0.01, rel=SHARP)


def test_a_bound_that_is_met_exactly_holds_and_one_beyond_does_not() -> None:
    chain = builtin_chain("panda")
    q = np.array([0.3, -0.5, 0.1, -2.0, 0.2, 1.6, 0.4])
    free = ConstraintSet(chain, (ConeConstraint([0, 0, 1], [0, 0, 1], 1.0),))
    exact = float(free.values(q)[0])
    # Only the last joint turns: the axis stays where it is, on the cone.
    coefficients = np.zeros((1, 7, 2))
    coefficients[0, :, 0], coefficients[0, 6, 1] = q, 1.0
    turn = Trajectory(chain.joint_names, np.array([0.0, 1.0]), coefficients)
    for bound, verdict in ((exact, Verdict.HOLDS), (exact - 1e-4, Verdict.VIOLATED)):
        tight = ConstraintSet(chain, (ConeConstraint([0, 0, 1], [0, 0, 1], bound),))
        assert bounds_of(tight, turn).verdict == verdict


def row(K: Array, axis: Array, lower: float, upper: float, reference: int = -1) -> Array:
    packed = np.zeros(WIDTH)
    packed[Column.CARRIER], packed[Column.REFERENCE] = 0, reference
    packed[Column.AXIS : Column.AXIS + 3], packed[Column.LOWER], packed[Column.UPPER] = (
        axis,
        lower,
        upper,
    )
    packed[Column.TURN :] = K.ravel()
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

"""Edges under constraints: held for every instant by pinocchio, kept back from bounds, free."""

from itertools import pairwise

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker, narrow_rows
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import ConeConstraint, JointConstraint
from planning.constraints.row import Column
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin, pillar

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
ORACLE = PinocchioArm()
TILT = 0.3
UPRIGHT = ConeConstraint([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], TILT)


def tilt(q: Array) -> float:
    """Angle of the tool's z axis from straight down, by pinocchio [rad]."""
    return float(np.arccos(np.clip(-ORACLE.pose(q)[2, 2], -1.0, 1.0)))


def checker(scene: Scene, spare: float = 0.0, slack: float = 0.0) -> ConstrainedChecker:
    model = Checker.of(ROBOT, scene).model
    wanted = ConstraintSet(CHAIN, (UPRIGHT,))
    return ConstrainedChecker(
        model, slack, constraints=wanted, spare=np.full(len(wanted.rows), spare)
    )


def along(a: Array, b: Array, count: int = 60) -> Array:
    return np.asarray(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))


def test_an_edge_is_free_only_where_every_sample_holds() -> None:
    random, plain, held = np.random.default_rng(0), Checker.of(ROBOT, Scene()), checker(Scene())
    verdicts = []
    for _ in range(150):
        a, b = (HOME + random.uniform(-0.25, 0.25, 7) for _ in range(2))
        worst = max(tilt(q) for q in along(a, b))
        free = held.free(a, b)
        motion = held.segment(a, b)
        assert motion.free is held.straight(a, b).free is free
        if free:
            assert worst <= TILT + 1e-6
            assert plain.free(a, b)
        else:
            # What is left out holds nowhere near the bound, or collides.
            assert worst > 0.9 * TILT or not plain.free(a, b)
            assert motion.pair is not None
        verdicts.append(free)
    assert 20 < sum(verdicts) < 130


def test_a_curve_that_leaves_the_set_between_its_ends_is_refused_and_told() -> None:
    """q6 goes out and back as 4 s (1 - s): both ends hold, the middle does not."""
    held, bend = checker(Scene()), np.zeros(7)
    bend[5] = 1.5 * TILT
    motion = held.curve(HOME, 4.0 * bend, -4.0 * bend)
    assert not motion.free
    assert not motion.colliding
    assert motion.pair is not None
    assert "constraint 0" in motion.pair[1]
    assert motion.at == pytest.approx(0.5, abs=0.2)
    assert held.curve(HOME, 0.5 * 4.0 * bend, -0.5 * 4.0 * bend).free


def test_what_holds_but_collides_is_not_free() -> None:
    """The base turns the tool about the vertical: it stays upright and meets the post."""
    start, goal = HOME.copy(), HOME.copy()
    start[0], goal[0] = -0.8, 0.8
    assert checker(Scene()).free(start, goal)
    barred = checker(pillar(0.0, 0.4))
    assert not barred.free(start, goal)
    motion = barred.segment(start, goal)
    assert motion.colliding
    assert motion.pair is not None
    assert motion.pair[1] == "post"


def test_a_polyline_names_the_first_leg_that_leaves_the_set() -> None:
    tilted = HOME.copy()
    tilted[5] += 2.0 * TILT
    aside = HOME + np.array([0.3, 0, 0, 0, 0, 0, 0])
    held = checker(Scene())
    motion, leg = held.polyline(np.array([HOME, aside, tilted, HOME]))
    assert (motion.free, leg) == (False, 1)
    motion, leg = held.polyline(np.array([HOME, aside, HOME]))
    assert motion.free
    assert all(held.free(a, b) for a, b in pairwise([HOME, aside, HOME]))


def test_half_of_what_the_ends_have_to_spare_is_kept_back_at_most() -> None:
    """Two milliradians of the cone's 0.3 are kept back where start and goal have them to spare."""
    for share, spare in ((0.998, 0.0), (0.998, 1.0), (0.99, 1.0)):
        q = HOME.copy()
        for _ in range(5):
            q[5] += share * TILT - tilt(q)
        assert tilt(q) == pytest.approx(share * TILT, abs=1e-5)
        narrow = spare > 0.0 and share > 0.995
        assert checker(Scene(), spare).free(q, q + np.eye(7)[0] * 1e-3) is not narrow


def test_rows_are_narrowed_on_both_sides_and_at_most_by_what_is_said() -> None:
    wanted = ConstraintSet(CHAIN, (UPRIGHT, JointConstraint(CHAIN.joint_names[0], 0.5, 0.1, 0.3)))
    true = np.array(wanted.packed)
    two_sided = np.isfinite(true[:, Column.LOWER])
    assert two_sided.any()
    assert not two_sided.all()
    half = np.where(
        two_sided, 0.5 * (true[:, Column.UPPER] - true[:, Column.LOWER]), true[:, Column.UPPER]
    )
    for share in (0.0, 0.05, 0.5, 1.0):
        rows = narrow_rows(wanted, share)
        np.testing.assert_allclose(
            true[:, Column.UPPER] - rows[:, Column.UPPER], share * half, atol=1e-15
        )
        inwards = rows[two_sided, Column.LOWER] - true[two_sided, Column.LOWER]
        np.testing.assert_allclose(inwards, (share * half)[two_sided], atol=1e-15)
        assert (rows[two_sided, Column.LOWER] <= rows[two_sided, Column.UPPER] + 1e-15).all()
    capped = narrow_rows(wanted, 0.5, 0.01)
    np.testing.assert_allclose(true[:, Column.UPPER] - capped[:, Column.UPPER], 0.01, atol=1e-15)
    np.testing.assert_array_equal(narrow_rows(wanted, 0.5, -1.0), true)
    np.testing.assert_array_equal(np.array(wanted.packed), true)


def test_a_cubic_is_held_to_the_rows_by_all_of_its_powers() -> None:
    """q6 goes out, back and out again the other way: s (1 - s) (1 - 2 s)."""
    held, bend, none = checker(Scene()), np.zeros(7), np.zeros(7)
    bend[5] = 12.0 * TILT
    powers = bend, -3.0 * bend, 2.0 * bend
    largest = 12.0 * TILT / (6.0 * np.sqrt(3.0))
    assert largest > 1.1 * TILT
    assert not held.curve(HOME, *powers).free
    assert held.curve(HOME, *(0.8 * power for power in powers)).free
    assert not held.curve(HOME, none, none, 0.2 * bend).free
    assert held.curve(HOME, none, none, 0.05 * bend).free


def test_the_row_that_is_violated_most_is_named() -> None:
    names = CHAIN.joint_names
    near = [JointConstraint(names[j], float(HOME[j]), 0.2, 0.2) for j in (0, 2)]
    wanted = ConstraintSet(CHAIN, tuple(near))
    model = Checker.of(ROBOT, Scene()).model
    held = ConstrainedChecker(model, 0.0, constraints=wanted, spare=np.zeros(2))
    for joint, number in ((0, 0), (2, 1)):
        motion = held.segment(HOME, HOME + 0.5 * np.eye(7)[joint])
        assert motion.pair == (CHAIN.tip_link, wanted.label(number))
        assert motion.at == 1.0

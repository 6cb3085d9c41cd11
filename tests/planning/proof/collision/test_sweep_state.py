"""Intervals of a sweep: halves tile what they are halves of, joints are enclosed on each."""

import numpy as np
import pytest

from kinematics.trajectory.trajectory import Trajectory
from planning.proof.collision.pair_table import PairTable
from planning.proof.collision.sweep_state import (
    BEGIN,
    CENTER,
    DEPTH,
    END,
    FIRST,
    HALF,
    LAST,
    MIDDLE,
    OBSTACLE,
    OPEN,
    OWN,
    PROBE,
    TOP,
    VISITS,
    Sweep,
    enlarge,
    moves_far,
    note_clearance,
    pass_on,
    pop_interval,
    push_halves,
)
from planning.proof.motion_bounds import RADIUS, VALUE
from tests.planning.proof.sweeping import WALL, start_sweep, through
from tests.planning.slider import slider


def random_motion(seed: int, pieces: int = 5) -> Trajectory:
    """Joined cubics of unequal lengths."""
    random = np.random.default_rng(seed)
    lengths = random.uniform(0.01, 1.0, pieces)
    coefficients = random.normal(size=(pieces, 2, 4)) * 0.2
    for k in range(1, pieces):
        coefficients[k, :, 0] = coefficients[k - 1] @ lengths[k - 1] ** np.arange(4)
    breaks = np.concatenate([[0.0], np.cumsum(lengths)])
    return Trajectory(slider().chain.joint_names, breaks, coefficients)


def begun(trajectory: Trajectory) -> Sweep:
    return start_sweep(trajectory, PairTable.of(slider(), WALL, 0.0).arrays)


def pop_ends(trajectory: Trajectory, w: Sweep) -> None:
    """Take the start and the end, so that the whole motion is next."""
    for _ in range(2):
        pop_interval(trajectory.breaks, trajectory.coefficients, w)


def span(trajectory: Trajectory, w: Sweep) -> tuple[float, float]:
    """The last interval from the start of the trajectory [s]."""
    one = w.counters[FIRST] == w.counters[LAST]
    begins = trajectory.breaks[w.counters[FIRST]] if one else 0.0
    return float(begins + w.interval[BEGIN]), float(begins + w.interval[END])


def test_it_starts_with_the_start_alone_and_probes_the_end_and_then_takes_all() -> None:
    trajectory = random_motion(1)
    w = begun(trajectory)
    assert w.counters[TOP] == 3
    pop_interval(trajectory.breaks, trajectory.coefficients, w)
    assert span(trajectory, w) == (0.0, 0.0)
    np.testing.assert_allclose(w.joints[:, VALUE], trajectory.start)
    assert w.counters[PROBE] == 0
    pop_interval(trajectory.breaks, trajectory.coefficients, w)
    assert span(trajectory, w) == pytest.approx((trajectory.duration, trajectory.duration))
    np.testing.assert_allclose(w.joints[:, VALUE], trajectory.end)
    assert w.counters[PROBE] == 1
    pop_interval(trajectory.breaks, trajectory.coefficients, w)
    assert span(trajectory, w) == (0.0, trajectory.duration)
    assert w.counters[PROBE] == 0
    assert w.counters[TOP] == 0
    assert w.counters[VISITS] == 3


@pytest.mark.parametrize("pieces", [1, 2, 5, 8])
def test_halves_tile_the_trajectory_in_order(pieces: int) -> None:
    random = np.random.default_rng(2)
    trajectory = random_motion(3, pieces)
    w = begun(trajectory)
    pop_ends(trajectory, w)
    reached = 0.0
    while w.counters[TOP] > 0:
        pop_interval(trajectory.breaks, trajectory.coefficients, w)
        begin, end = span(trajectory, w)
        assert begin == pytest.approx(reached, abs=1e-12)
        depth = w.counters[DEPTH]
        if depth < 3 or (depth < 12 and random.random() < 0.4):
            w.counters[OPEN] = 0
            push_halves(w, trajectory.breaks, True)
            # An interval over several pieces is cut between two of them.
            if w.counters[FIRST] < w.counters[LAST]:
                assert w.counters[FIRST] < w.counters[MIDDLE] <= w.counters[LAST]
            continue
        reached = end
    assert reached == pytest.approx(trajectory.duration)


def test_pieces_are_halved_near_the_middle_in_time() -> None:
    trajectory = through(*[[0.1 * k, 0.0] for k in range(6)], times=[0, 1, 2, 3, 9, 10])
    w = begun(trajectory)
    pop_ends(trajectory, w)
    pop_interval(trajectory.breaks, trajectory.coefficients, w)
    # The first break that is not before the middle of ten seconds.
    assert w.interval[CENTER] == 9.0
    assert w.interval[HALF] >= 9.0


def test_the_first_half_alone_leaves_out_what_is_later() -> None:
    trajectory = random_motion(4, 4)
    for depth in range(6):
        w = begun(trajectory)
        pop_ends(trajectory, w)
        pop_interval(trajectory.breaks, trajectory.coefficients, w)
        for _ in range(depth):
            push_halves(w, trajectory.breaks, False)
            assert w.counters[TOP] == 1
            before = span(trajectory, w)
            pop_interval(trajectory.breaks, trajectory.coefficients, w)
            begin, end = span(trajectory, w)
            assert begin == before[0] == 0.0
            assert end < before[1]


def test_joints_are_enclosed_on_every_interval() -> None:
    random = np.random.default_rng(5)
    for seed in range(4):
        trajectory = random_motion(6 + seed)
        w = begun(trajectory)
        while w.counters[TOP] > 0:
            pop_interval(trajectory.breaks, trajectory.coefficients, w)
            times = np.clip(np.linspace(*span(trajectory, w), 25), 0.0, trajectory.duration)
            away = np.abs(trajectory.sample(times) - w.joints[:, VALUE]).max(axis=0)
            assert (away <= w.joints[:, RADIUS] + 1e-12).all()
            assert w.interval[HALF] >= 0.5 * (w.interval[END] - w.interval[BEGIN])
            if w.counters[DEPTH] < 3 or random.random() < 0.3:
                push_halves(w, trajectory.breaks, True)


def test_open_pairs_are_those_of_the_halves() -> None:
    trajectory = random_motion(7)
    w = begun(trajectory)
    pop_ends(trajectory, w)
    pop_interval(trajectory.breaks, trajectory.coefficients, w)
    w.counters[OPEN] = 3
    push_halves(w, trajectory.breaks, True)
    assert w.counts[1] == 3
    assert w.counters[TOP] == 2
    pop_interval(trajectory.breaks, trajectory.coefficients, w)
    assert w.counters[DEPTH] == 1


def test_what_is_passed_on_unseen_has_the_pairs_it_had() -> None:
    trajectory = random_motion(7)
    w = begun(trajectory)
    pop_ends(trajectory, w)
    pop_interval(trajectory.breaks, trajectory.coefficients, w)
    before, whole = int(w.counts[0]), span(trajectory, w)
    pass_on(w, trajectory.breaks)
    assert w.counters[TOP] == 2
    assert (w.starts[1], w.counts[1]) == (w.starts[0], before)
    reached = whole[0]
    while w.counters[TOP] > 0:
        pop_interval(trajectory.breaks, trajectory.coefficients, w)
        assert w.counters[DEPTH] == 1
        assert span(trajectory, w)[0] == pytest.approx(reached)
        reached = span(trajectory, w)[1]
    assert reached == pytest.approx(whole[1])


def test_far_is_what_all_joints_move_together() -> None:
    for reach, far in ((0.3, False), (4.0, True)):
        trajectory = through([0.0, 0.0], [reach, reach])
        w = begun(trajectory)
        pop_ends(trajectory, w)
        assert not moves_far(w)
        pop_interval(trajectory.breaks, trajectory.coefficients, w)
        assert moves_far(w) is far


def test_the_least_clearance_is_noted_with_its_pair() -> None:
    w = begun(random_motion(8))
    for against in (OBSTACLE, OWN):
        for i, clearance in enumerate((0.5, 0.2, 0.3, 0.2, 0.1)):
            note_clearance(w, against, i, 10 + i, clearance)
        assert w.clearance[against] == 0.1
        assert w.closest[against].tolist() == [4, 14]
    other = begun(random_motion(8))
    note_clearance(other, OWN, 1, 2, 0.3)
    assert other.clearance.tolist() == [np.inf, 0.3]
    # Of equal ones the first.
    note_clearance(other, OWN, 3, 4, 0.3)
    assert other.closest[OWN].tolist() == [1, 2]


def test_twice_the_room_keeps_all_that_is_there() -> None:
    w = begun(random_motion(9))
    w.pairs[:] = np.arange(w.pairs.size).reshape(w.pairs.shape)
    w.referred_moves[:] = 0.25
    larger = enlarge(w)
    for name in ("pairs", "directions", "referred", "referred_moves"):
        old, new = getattr(w, name), getattr(larger, name)
        assert len(new) == 2 * len(old)
        np.testing.assert_array_equal(new[: len(old)], old)
    for name in set(Sweep._fields) - {"pairs", "directions", "referred", "referred_moves"}:
        assert getattr(larger, name) is getattr(w, name)

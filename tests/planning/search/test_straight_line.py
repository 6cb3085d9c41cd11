"""Straight motions of a ball that slides: which goal is taken, and what blocks the others."""

from typing import Any

import numpy as np
import pytest

from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.search.straight_line import straight_line
from tests.planning.scenes import box
from tests.planning.slider import slider

START = np.array([-0.6, 0.0])
BEHIND, BESIDE, FARTHER = np.array([0.6, 0.0]), np.array([-0.6, 0.7]), np.array([-0.5, 0.8])
CHECKER = Checker.of(slider(), Scene((box("wall", (0.1, 1.0, 0.4), (0.0, 0.0, 0.0)),)))


def test_the_first_goal_that_can_be_reached_is_taken() -> None:
    path, motions = straight_line(CHECKER, START, [BEHIND, BESIDE, FARTHER])
    assert path is not None
    np.testing.assert_array_equal(path, [START, BESIDE])
    assert [motion.free for motion in motions] == [False, True]


def test_blocked_motions_name_their_pair_and_place() -> None:
    path, (motion,) = straight_line(CHECKER, START, [BEHIND])
    assert path is None
    assert motion.pair == ("ball", "wall")
    # The ball of 5 cm meets the wall's face, 5 cm before the middle: 0.5 m of 1.2 m.
    assert motion.colliding
    assert 0.5 / 1.2 <= motion.at <= 0.7 / 1.2


def test_a_motion_that_keeps_too_little_distance_is_not_free() -> None:
    wary = Checker(CHECKER.model, 0.1)
    past = np.array([-0.17, 0.5])
    assert straight_line(CHECKER, START, [past])[0] is not None
    path, _ = straight_line(wary, START, [past])
    assert path is None


def test_a_motion_that_no_look_finds_blocked_is_proved() -> None:
    contact = CHECKER.straight(START, BEHIND)
    assert contact.colliding
    assert contact.pair == ("ball", "wall")
    assert not CHECKER.valid(START + contact.at * (BEHIND - START))
    assert CHECKER.straight(START, BESIDE).free
    # Thinner than the way from look to look: only the proof finds it.
    thin = Checker.of(slider(), Scene((box("foil", (1e-5, 1.0, 0.4), (0.07, 0.0, 0.0)),)))
    far = 30.0 * BEHIND
    assert all(thin.valid(s * far) for s in np.linspace(-1.0, 1.0, 17))
    path, (motion,) = straight_line(thin, -far, [far])
    assert path is None
    assert motion.pair == ("ball", "foil")


@pytest.mark.parametrize("kind", [np.int64, np.float32])
def test_numbers_of_other_kinds_are_looked_at_as_such(kind: Any) -> None:
    one = np.array([1.0, 0.0])
    other: Any = one.astype(kind)
    assert CHECKER.straight(-other, other) == CHECKER.straight(-one, one)

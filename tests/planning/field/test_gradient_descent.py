"""The rules of the descent, of the kernel and of the one in Python: lengths, halvings, ends."""

from typing import Any

import numpy as np
import pytest

from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.joint import JointConstraint
from planning.field.gradient_descent import (
    ARRIVED,
    BLOCKED,
    GOING,
    GROWTH,
    LINE_BLOCKED,
    LOWEST,
    MINIMUM,
    STALE,
    STALLED,
    STEP,
)
from tests.planning.field.slide import Slide
from tests.planning.scenes import box
from tests.planning.slider import slider

#: Between x = 0.45 and 0.55: the ball of 0.05 m is clear of it for x < 0.4.
WALL = Scene((box("wall", (0.1, 0.4, 0.4), (0.5, 0.0, 0.0)),))
ACROSS = np.array([0.0, 1.0])

pytestmark = pytest.mark.parametrize("engine", ["kernel", "python"])


def test_where_the_straight_line_is_free_it_has_arrived_at_once(engine: str) -> None:
    slide = Slide(engine, [0.0, 0.0], [0.5, 0.3])
    assert slide.go(10) == ARRIVED
    np.testing.assert_array_equal(slide.visited, [[0.0, 0.0], [0.5, 0.3]])
    assert slide.iterations == 0
    assert slide.potentials.tolist() == pytest.approx([0.17, 0.0])


def test_at_the_goal_there_is_nothing_to_add(engine: str) -> None:
    slide = Slide(engine, [0.5, 0.3], [0.5, 0.3], connect=False)
    assert slide.go(10) == ARRIVED
    # The goal is there, and once more as what it arrived at: a motion has two ends.
    assert len(slide.visited) == 2
    assert slide.iterations == 0


def test_without_connecting_it_arrives_within_its_tolerance(engine: str) -> None:
    slide = Slide(
        engine,
        [0.0, 0.0],
        [0.5, 0.0],
        connect=False,
        step_sizes=0.5,
        longest_step=1.0,
        tolerance=0.1,
    )
    assert slide.go(10) == ARRIVED
    # Each step goes half of the way that is left: 0.25, 0.125 and 0.0625 are left.
    np.testing.assert_allclose(slide.visited[:, 0], [0.0, 0.25, 0.375, 0.4375, 0.5])
    assert slide.iterations == 3


def test_given_sizes_multiply_the_force(engine: str) -> None:
    slide = Slide(
        engine, [0.0, 0.0], [0.8, -0.4], connect=False, step_sizes=[0.1, 0.3, 0.2],
        longest_step=1.0, tolerance=1e-9,
    )  # fmt: skip
    assert slide.go(5) == GOING
    left = np.cumprod([1.0, 0.9, 0.7, 0.8, 0.8, 0.8])
    np.testing.assert_allclose(slide.visited, np.array([0.8, -0.4]) * (1.0 - left)[:, None])


def test_no_step_is_longer_than_the_longest(engine: str) -> None:
    """Of the joint that moves most: the direction stays that of the force."""
    slide = Slide(engine, [0.0, 0.0], [0.8, -0.4], connect=False, step_sizes=50.0, longest_step=0.1)
    slide.go(4)
    np.testing.assert_allclose(slide.steps, 0.1)
    np.testing.assert_allclose(np.diff(slide.visited, axis=0), [[0.1, -0.05]] * 4)


def test_steps_of_their_own_size_grow_while_they_lower_the_potential(engine: str) -> None:
    slide = Slide(engine, [-0.9, 0.0], [0.9, 0.0], connect=False, longest_step=0.4)
    slide.track.gauges[STEP] = 0.02
    assert slide.go(12) in (GOING, ARRIVED)
    lengths, grown = slide.steps, 0.02 * GROWTH ** np.arange(8)
    first = int(np.argmax(grown > 0.4))
    np.testing.assert_allclose(lengths[:first], grown[:first])
    assert lengths.max() <= 0.4 + 1e-12
    assert (np.diff(slide.potentials) < 0.0).all()


def test_a_step_over_the_minimum_is_halved_until_it_is_lower(engine: str) -> None:
    """From 0.1 before the goal a step of 0.4 leads 0.3 beyond it; one of 0.1 to the goal."""
    slide = Slide(engine, [0.0, 0.0], [0.1, 0.0], connect=False, longest_step=0.4, tolerance=1e-6)
    slide.go(1)
    np.testing.assert_allclose(slide.visited[-1], [0.1, 0.0])
    assert slide.track.gauges[STEP] == pytest.approx(GROWTH * 0.1)


def test_a_given_size_is_kept_although_it_leads_uphill(engine: str) -> None:
    slide = Slide(engine, [0.0, 0.0], [0.1, 0.0], connect=False, step_sizes=3.0, longest_step=0.4)
    slide.go(1)
    np.testing.assert_allclose(slide.visited[-1], [0.3, 0.0])


def test_a_step_into_a_wall_is_halved_until_it_is_proved(engine: str) -> None:
    slide = Slide(
        engine, [0.2, 0.0], [0.9, 0.0], WALL, connect=False, step_sizes=100.0, longest_step=0.3
    )
    slide.go(1)
    # 0.3 ends in the wall; 0.15 at x = 0.35 does not.
    np.testing.assert_allclose(slide.visited[-1], [0.35, 0.0], atol=1e-12)
    slide.go(2)
    # There 0.3, 0.15 and 0.075 end in it: 0.0375 does not.
    np.testing.assert_allclose(slide.visited[-1], [0.3875, 0.0], atol=1e-12)


@pytest.mark.parametrize(("halvings", "taken"), [(0, False), (1, False), (2, True)])
def test_halvings_are_counted(engine: str, halvings: int, taken: bool) -> None:
    slide = Slide(
        engine, [0.3, 0.0], [0.9, 0.0], WALL, connect=False, step_sizes=100.0, longest_step=0.3,
        halvings=halvings,
    )  # fmt: skip
    assert slide.go(1) == (GOING if taken else BLOCKED)
    assert slide.iterations == int(taken)
    assert len(slide.visited) == 1 + int(taken)


def test_slack_is_kept_from_the_wall(engine: str) -> None:
    slide = Slide(
        engine, [0.2, 0.0], [0.9, 0.0], WALL, connect=False, step_sizes=100.0, longest_step=0.15,
        slack=0.06, halvings=12, max_iterations=60,
    )  # fmt: skip
    slide.go(40)
    assert 0.33 < slide.visited[:, 0].max() <= 0.34 + 1e-9
    for q in slide.visited:
        assert slide.checker.valid(q)


def test_joint_limits_end_a_step(engine: str) -> None:
    """The slides end at 1: a step beyond is cut off there, joint by joint."""
    slide = Slide(engine, [0.9, 0.0], [1.5, 0.5], connect=False, step_sizes=100.0, longest_step=0.3)
    slide.go(1)
    np.testing.assert_allclose(slide.visited[-1], [1.0, 0.25])
    slide.go(2)
    assert slide.visited[-1, 0] == 1.0


def test_at_its_limits_it_is_stuck(engine: str) -> None:
    slide = Slide(engine, [1.0, 0.0], [1.5, 0.0], connect=False, step_sizes=100.0)
    assert slide.go(5) == BLOCKED
    assert slide.iterations == 0


@pytest.mark.parametrize("tolerance", [0.3, 1e-3, 1e-6])
def test_where_the_force_vanishes_is_a_local_minimum(engine: str, tolerance: float) -> None:
    """Before the wall its push holds the pull: the force vanishes where both are as strong."""

    def rest(x: float) -> float:
        """The force that is left, as a share of pull and push."""
        rho, pull = 0.45 - x, 0.9 - x
        push = 1e-3 * (1.0 / rho - 1.0 / 0.1) / rho**2 if rho < 0.1 else 0.0
        return abs(pull - push) / (pull + push)

    slide = Slide(
        engine, [0.3, 0.0], [0.9, 0.0], WALL, connect=False, repulsive=1e-3,
        force_tolerance=tolerance,
    )  # fmt: skip
    assert slide.go(400) == MINIMUM
    assert (slide.visited[:, 1] == 0.0).all()
    assert rest(slide.visited[-1, 0]) <= tolerance
    # Nowhere before it.
    assert min(rest(x) for x in slide.visited[:-1, 0]) > tolerance


def test_no_force_at_all_is_a_minimum_too(engine: str) -> None:
    slide = Slide(engine, [0.3, 0.0], [0.9, 0.0], WALL, connect=False)
    slide.track.force[:] = 0.0
    assert slide.go(5) == MINIMUM


def test_a_weak_force_beside_strong_ones_before_is_followed(engine: str) -> None:
    """Near the goal nothing pushes: the pull is all there is, however weak."""
    slide = Slide(engine, [0.0, 0.0], [0.5, 0.3], connect=False, step_sizes=0.5, tolerance=1e-8)
    assert slide.go(100) == ARRIVED


def test_without_progress_patience_ends(engine: str) -> None:
    """Before the wall steps become so short that they do not lower the potential by a hundredth."""
    slide = Slide(
        engine, [0.3, 0.0], [0.9, 0.0], WALL, connect=False, patience=3, halvings=30,
        longest_step=0.01, progress=0.01,
    )  # fmt: skip
    assert slide.go(200) == STALLED
    assert slide.track.counts[STALE] == 3
    lowest = slide.potentials.min()
    assert slide.track.gauges[LOWEST] == pytest.approx(lowest)
    # The last three steps made no progress, the one before them did.
    before = slide.potentials[-4:]
    assert (before >= 0.99 * slide.potentials[:-3].min()).all()


def test_it_goes_on_where_it_stopped(engine: str) -> None:
    options: dict[str, Any] = {
        "connect": False, "step_sizes": [0.1, 0.05, 0.2], "tolerance": 1e-9
    }  # fmt: skip
    whole = Slide(engine, [-0.5, 0.3], [0.9, 0.3], **options)
    parts = Slide(engine, [-0.5, 0.3], [0.9, 0.3], **options)
    assert whole.go(9) == GOING
    for until in (1, 2, 5, 9):
        assert parts.go(until) == GOING
        assert parts.iterations == until
    np.testing.assert_array_equal(parts.visited, whole.visited)
    np.testing.assert_array_equal(parts.potentials, whole.potentials)


def test_the_line_to_the_goal_is_looked_at_again_when_its_block_is_gone(engine: str) -> None:
    slide = Slide(engine, [-0.9, 0.19], [0.9, 0.19], WALL, longest_step=0.05)
    assert slide.go(3) == GOING
    share = slide.track.gauges[LINE_BLOCKED]
    # Blocked at the wall's face: where the ball is between x = 0.4 and 0.6.
    x = 0.9 + share * (slide.visited[-1, 0] - 0.9)
    assert 0.39 < x < 0.61
    # Stepped aside, the line is free: it arrives with the first look.
    aside = Slide(engine, [0.0, 0.6], [0.9, 0.6], WALL)
    aside.track.gauges[LINE_BLOCKED] = 0.5
    assert aside.go(3) == ARRIVED
    assert len(aside.visited) == 2


def test_a_walk_goes_across_by_longest_steps_before_the_descent(engine: str) -> None:
    slide = Slide(
        engine, [0.3, 0.0], [0.9, 0.0], WALL, connect=False, longest_step=0.05, tolerance=1e-6
    )
    assert slide.go(3, ACROSS, 3) == GOING
    np.testing.assert_allclose(slide.visited[:4], [[0.3, 0.05 * k] for k in range(4)], atol=1e-12)
    assert slide.iterations == 3
    # It may go uphill: what is lowest counts from here on.
    assert slide.potentials[3] > slide.potentials[0]
    assert slide.go(4) == GOING
    assert slide.potentials[4] < slide.potentials[3]


def test_a_walk_ends_before_what_is_not_proved(engine: str) -> None:
    # A wall above begins at y = 0.25: the ball may go to 0.2.
    roof = Scene((box("roof", (2.0, 0.1, 0.4), (0.0, 0.3, 0.0)),))
    slide = Slide(
        engine, [0.0, 0.12], [0.9, 0.12], roof, connect=False, longest_step=0.05, halvings=0
    )
    slide.go(1, ACROSS, 5)
    np.testing.assert_allclose(slide.visited[:2, 1], [0.12, 0.17], atol=1e-12)
    assert slide.visited[:, 1].max() < 0.2


def test_constraints_are_held_by_every_step(engine: str) -> None:
    """The second slide may go up to 0.1, the goal lies at 0.5: it gets as far as its halvings."""
    chain = slider().chain
    rows = ConstraintSet(chain, (JointConstraint("jy", 0.0, 0.1, 0.1),)).packed
    slide = Slide(
        engine, [0.0, 0.0], [0.0, 0.5], rows=rows, connect=False, step_sizes=100.0,
        longest_step=0.08, halvings=8,
    )  # fmt: skip
    slide.go(30)
    assert 0.099 < slide.visited[:, 1].max() <= 0.1 + 1e-9
    # The straight line to the goal does not hold them, so it has not arrived either.
    direct = Slide(engine, [0.0, 0.0], [0.0, 0.5], rows=rows, halvings=0, longest_step=0.3)
    assert direct.go(5) == BLOCKED
    free = Slide(engine, [0.0, 0.0], [0.3, 0.05], rows=rows)
    assert free.go(5) == ARRIVED


def test_the_potential_written_down_is_that_of_each_configuration(engine: str) -> None:
    slide = Slide(
        engine, [-0.3, 0.25], [0.9, 0.0], WALL, connect=False, longest_step=0.07, patience=5
    )
    slide.go(40)
    values = [slide.field.value(q)[0] for q in slide.visited]
    np.testing.assert_allclose(slide.potentials, values, rtol=1e-12)
    np.testing.assert_allclose(
        slide.track.force, slide.field.value(slide.visited[-1])[1], rtol=1e-9
    )
    assert len(slide.visited) == 1 + slide.iterations
    for a, b in zip(slide.visited[:-1], slide.visited[1:], strict=True):
        assert slide.checker.free(a, b)


def test_after_a_walk_it_has_all_its_patience_and_its_longest_step_again(engine: str) -> None:
    slide = Slide(
        engine, [0.3, 0.0], [0.9, 0.0], WALL, connect=False, patience=3, halvings=30,
        longest_step=0.01, progress=0.01,
    )  # fmt: skip
    assert slide.go(200) == STALLED
    taken = slide.iterations
    assert slide.go(taken + 2, ACROSS, 1) == GOING
    assert slide.iterations == taken + 2
    assert slide.track.counts[STALE] < 3
    np.testing.assert_allclose(slide.steps[taken], 0.01)

"""The rules of the descent, by either projection: lengths, halvings, ends."""

from typing import Any

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.projection.fcl_projection import FclProjector
from obstacles.projection.projection import Projector
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import JointConstraint
from planning.constraints.row import WIDTH
from planning.field.control_points import origin_points
from planning.field.gradient_descent import GROWTH, Descent, Outcome, Proof
from planning.field.options import FieldOptions
from planning.field.potential import Field
from planning.field.weights import FieldWeights
from planning.values.deadline import Deadline
from tests.planning.scenes import box
from tests.planning.slider import slider

#: Between x = 0.45 and 0.55: the ball of 0.05 m is clear of it for x < 0.4.
WALL = Scene((box("wall", (0.1, 0.4, 0.4), (0.5, 0.0, 0.0)),))
ACROSS = np.array([0.0, 1.0])

pytestmark = pytest.mark.parametrize("engine", ["exact", "fcl"])


def test_a_step_over_the_minimum_is_halved_until_it_is_lower(engine: str) -> None:
    """From 0.1 before the goal a step of 0.4 leads 0.3 beyond it; one of 0.1 to the goal."""
    slide = Slide(engine, [0.0, 0.0], [0.1, 0.0], connect=False, longest_step=0.4, tolerance=1e-6)
    slide.go(1)
    np.testing.assert_allclose(slide.visited[-1], [0.1, 0.0])
    assert slide.descent.step == pytest.approx(GROWTH * 0.1)


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
    assert slide.go(400) == Outcome.MINIMUM
    assert (slide.visited[:, 1] == 0.0).all()
    assert rest(slide.visited[-1, 0]) <= tolerance
    # Nowhere before it.
    assert min(rest(x) for x in slide.visited[:-1, 0]) > tolerance


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
    assert direct.go(5) == Outcome.BLOCKED
    free = Slide(engine, [0.0, 0.0], [0.3, 0.05], rows=rows)
    assert free.go(5) == Outcome.ARRIVED


class Slide:
    """One descent of the slider.

    Args:
        engine: "exact" or "fcl" projections.
        start: Where it begins, shape (2,) [m].
        goal: Shape (2,) [m].
        scene: What stands in the way.
        rows: Rows of constraints, shape (r, WIDTH).
        slack: Distance to keep beyond margins [m].
        repulsive: eta of the ball's middle [N m^3]. Its pull grows all the way: far from obstacles
            U = |q - goal|^2 / 2.
        options: Of ``FieldOptions``.
    """

    def __init__(
        self,
        engine: str,
        start: list[float],
        goal: list[float],
        scene: Scene | None = None,
        rows: Array | None = None,
        slack: float = 0.0,
        repulsive: float = 1e-6,
        **options: Any,
    ) -> None:
        robot, around = slider(), scene or Scene()
        limits = robot.chain.limits
        self.checker = Checker(Checker.of(robot, around).model, slack)
        rules = FieldOptions(**options).rules(limits.lower, limits.upper)
        constraints = np.zeros((0, WIDTH)) if rows is None else np.array(rows)
        proof = Proof(self.checker.model.arrays, slack, constraints)
        where = origin_points(robot.chain)
        spring = FieldWeights((0.0, 1.0), attractive_cap=10.0, repulsive_weights=(0.0, repulsive))
        obstacles = FclProjector(around) if engine == "fcl" else Projector(around)
        field = Field(robot.chain, where, obstacles, np.array(goal), spring)
        self.descent = Descent(field, proof, rules, np.array(start))

    def go(self, until: int, across: Array | None = None, walk: int = 0) -> Outcome | None:
        """Descend until so many steps were taken, after a walk; the outcome."""
        return self.descent.run(until, Deadline.after(60.0), across, walk)

    @property
    def visited(self) -> Array:
        """Configurations so far, shape (k, 2) [m]."""
        return np.array(self.descent.visited)

    @property
    def potentials(self) -> Array:
        """U at each of them, shape (k,) [J]."""
        return np.array(self.descent.potentials)

    @property
    def iterations(self) -> int:
        """Steps taken so far."""
        return self.descent.iterations

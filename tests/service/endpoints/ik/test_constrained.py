"""What would help an attempt of constrained inverse kinematics that has a pair too near."""

import numpy as np
import pytest

from kinematics.robots import builtin_chain
from obstacles.scenes.scene import Scene
from planning.constrained.ik import ConstrainedSolution
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.limit import ClearanceConstraint
from service.endpoints.attached_objects import RobotInScene
from service.endpoints.ik.constrained import _too_near
from tests.planning.scenes import box, builtin

CHAIN = builtin_chain("panda")
BESIDE = "widen the constraints, move the obstacle, or try another seed."
WALL = box("wall", (0.1, 0.1, 0.1), (0.4, 0.3, 0.4))


@pytest.mark.parametrize(
    ("margin", "clearance", "other", "cures"),
    [
        (0.0, -0.05, "wall", BESIDE.capitalize()),
        (0.02, -0.05, "wall", BESIDE.capitalize()),
        (
            0.1,
            -0.05,
            "wall",
            f"Lower the margin by 0.05 m, {BESIDE}",
        ),
        (0.1, -0.05, "panda_link2", "Widen the constraints, or try another seed."),
    ],
)  # fmt: skip
def test_only_what_is_there_is_to_be_changed(
    margin: float, clearance: float, other: str, cures: str
) -> None:
    """A margin of less than the overlap is no cure, and own links know none."""
    wanted = ConstraintSet(CHAIN, (ClearanceConstraint(margin),) if margin else ())
    pair = ("panda_hand", other)
    nearest = ConstrainedSolution(np.zeros(7), np.zeros(0), clearance, pair, 0.0, "descent")
    what, hint = _too_near(wanted, nearest, RobotInScene(builtin("panda"), Scene((WALL,))))
    assert "closer than they may be by 0.05 m" in what
    assert hint == cures


def test_what_touches_is_not_closer_by_nothing() -> None:
    nearest = ConstrainedSolution(np.zeros(7), np.zeros(0), -1e-9, ("a", "b"), 0.0, "descent")
    what, hint = _too_near(ConstraintSet(CHAIN, (ClearanceConstraint(0.1),)), nearest, None)
    assert what == "has 'a' and 'b' touching"
    assert "margin" not in hint

"""Lines and arcs that requests ask for, one after the other."""

import numpy as np
import pytest

from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.pose import transform
from planning.options import CartesianOptions, ToolMotionOptions
from planning.tool_paths.motions import tool_motions

START = transform(None, [0.4, 0.0, 0.4])


def at(x: float, y: float) -> np.ndarray:
    return transform(None, [x, y, 0.4])


def test_each_motion_begins_where_the_one_before_ends() -> None:
    asked = CartesianOptions(
        motions=(
            ToolMotionOptions("lin", at(0.5, 0.0)),
            ToolMotionOptions("circ", at(0.4, 0.1), center=[0.4, 0.0, 0.4], normal=[0, 0, 1.0]),
            ToolMotionOptions("circ", at(0.3, 0.0), via=[0.4 - 0.1 * 2**-0.5, 0.1 * 2**-0.5, 0.4]),
        )
    )
    first, second, third = tool_motions(START, asked, at(9.0, 9.0))
    np.testing.assert_array_equal(first.pose(0.0), START)
    for one, other in ((first, second), (second, third)):
        np.testing.assert_allclose(one.pose(1.0), other.pose(0.0), atol=1e-12)
    assert first.length == pytest.approx(0.1)
    assert second.length == pytest.approx(0.1 * np.pi / 2.0)
    assert third.length == pytest.approx(0.1 * np.pi / 2.0)
    for s in (0.2, 0.7):
        for arc in (second, third):
            assert np.linalg.norm(arc.pose(s)[:3, 3] - [0.4, 0.0, 0.4]) == pytest.approx(0.1)


def test_without_motions_one_line_leads_to_the_goal() -> None:
    (only,) = tool_motions(START, CartesianOptions(), at(0.4, 0.2))
    assert only.kind == "lin"
    np.testing.assert_allclose(only.pose(1.0), at(0.4, 0.2), atol=1e-15)
    with pytest.raises(InvalidOption, match="no motion"):
        tool_motions(START, CartesianOptions())


def test_an_arc_that_is_none_is_named_by_its_number() -> None:
    asked = CartesianOptions(
        motions=(
            ToolMotionOptions("lin", at(0.5, 0.0)),
            ToolMotionOptions("circ", at(0.7, 0.0), via=[0.6, 0.0, 0.4]),
        )
    )
    with pytest.raises(InvalidGoal, match=r"motions\[1\]") as caught:
        tool_motions(START, asked)
    assert caught.value.details["motion"] == 1

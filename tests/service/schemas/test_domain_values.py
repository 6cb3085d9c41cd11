"""Values and rules that the models repeat, since they import nothing: the domain has the same."""

import numpy as np
import pytest

from armwright_wire import pose
from armwright_wire.goals import goal
from armwright_wire.plans import plan
from armwright_wire.scenes import tool
from kinematics.errors import InvalidPose
from kinematics.rounding import check_axis_length, check_quaternion_norm, check_rotation
from obstacles.robots.tool import SIZES
from planning.pipeline.planners import PLANNERS
from planning.values.preferences import DEFAULT_PREFERRED, MAX_PREFERRED, GoalCosts


def test_defaults_and_names_are_those_of_planning() -> None:
    assert set(plan.PLANNERS) == set(PLANNERS)
    assert goal.GoalCosts().model_dump() == {
        name: getattr(GoalCosts(), name) for name in GoalCosts.__slots__
    }
    assert goal.DEFAULT_PREFERRED == DEFAULT_PREFERRED
    assert goal.MAX_PREFERRED == MAX_PREFERRED


def test_built_in_tools_have_the_same_sizes() -> None:
    forms = (tool.ParallelJaw, tool.ThreeJaw, tool.SuctionCup, tool.Torch, tool.Spindle)
    sizes = {form().type: form().model_dump(exclude={"type"}) for form in forms}
    assert sizes == SIZES
    assert tuple(sizes) == tool.BUILTIN_TOOLS


def refusal(check: object, value: object) -> str | None:
    try:
        check(value)  # type: ignore[operator]
    except InvalidPose as error:
        return f"{error.message}. {error.hint or ''}".rstrip()
    except ValueError as error:
        return str(error)
    return None


@pytest.mark.parametrize("digits", [1, 2, 3, 4, 6, 9, 15])
def test_rounding_is_judged_alike(digits: int) -> None:
    random = np.random.default_rng(digits)
    for _ in range(200):
        q = random.normal(size=4)
        q /= np.linalg.norm(q)
        x, y, z, w = q
        rotation = np.eye(3) + 2 * np.array([
            [-y * y - z * z, x * y - z * w, x * z + y * w],
            [x * y + z * w, -x * x - z * z, y * z - x * w],
            [x * z - y * w, y * z + x * w, -x * x - y * y],
        ])  # fmt: skip
        for scale in (1.0, 1.0005, 1.01, -1.0, 2.0):
            rows = (scale * rotation).round(digits).tolist()
            written = (scale * q).round(digits).tolist()
            assert refusal(pose.check_rotation, rows) == refusal(check_rotation, rows)
            assert refusal(pose.check_quaternion_norm, written) == refusal(
                lambda value: check_quaternion_norm(float(np.linalg.norm(value))), written
            )
    for axis in ([0.0, 0.0, 0.0], [1e-13, 0.0, 0.0], [1e-11, 0.0, 0.0]):
        assert refusal(pose.check_axis_length, axis) == refusal(
            lambda value: check_axis_length(float(np.linalg.norm(value))), axis
        )

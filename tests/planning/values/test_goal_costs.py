"""Weights of goal configurations: finite and not negative."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from planning.values.goal_costs import GoalCosts


@pytest.mark.parametrize("value", [-1.0, np.inf, np.nan])
def test_an_odd_weight_is_refused(value: float) -> None:
    with pytest.raises(InvalidOption, match="turns"):
        GoalCosts(turns=value)

"""Preferred distances: their range, and the smaller one between own links."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from planning.values.preferred_clearance import PreferredClearance


@pytest.mark.parametrize("distance", [-1e-9, 1.1, np.nan])
def test_a_distance_out_of_range_is_refused(distance: float) -> None:
    with pytest.raises(InvalidOption, match="preferred"):
        PreferredClearance(distance)


@pytest.mark.parametrize(
    ("obstacles", "own"), [(0.0, 0.0), (0.01, 0.0025), (0.02, 0.005), (1.0, 0.005)]
)
def test_own_links_are_nearer_by_four_and_by_five_millimetres_at_most(
    obstacles: float, own: float
) -> None:
    assert PreferredClearance(obstacles).own_links == own

"""The compiled reachability analysis against scipy's linear programs."""

import numpy as np
import pytest
from scipy.optimize import linprog

from planning.timing.path.blend import blend, largest_reaches
from planning.timing.speed.constraints import Cells, cells
from planning.timing.speed.reachability import squared_speeds


def random_cells(rng: np.random.Generator) -> Cells:
    n = int(rng.integers(2, 8))
    waypoints = rng.uniform(-2.0, 2.0, (4, n))
    path = blend(waypoints, rng.choice([0.1, 0.6, 1.0], 2) * largest_reaches(waypoints))
    limits = 10.0 ** rng.uniform([[-0.5], [-0.5]], [[0.5], [1.0]], (2, n))
    return cells(path, int(rng.integers(10, 60)), limits)


@pytest.mark.parametrize("seed", range(12))
def test_speeds_solve_the_linear_programs(seed: int) -> None:
    grid = random_cells(np.random.default_rng(seed))
    count = len(grid.lengths)
    most = np.zeros(count + 1)
    for i in range(count - 1, 0, -1):
        rows = grid.rows[i]
        bounds = [(0.0, grid.caps[i]), (0.0, most[i + 1])]
        best = linprog([-1.0, 0.0], rows, np.ones(len(rows)), bounds=bounds)
        most[i] = float(np.asarray(best.x)[0])
    expected = np.zeros(count + 1)
    for i in range(count):
        rows = grid.rows[i]
        # A hair below, so that a single point left by rounding is found.
        here = expected[i] * (1.0 - 1e-9)
        bounds = [(here, here), (0.0, most[i + 1])]
        best = linprog([0.0, -1.0], rows, np.ones(len(rows)), bounds=bounds)
        expected[i + 1] = float(np.asarray(best.x)[1])
    np.testing.assert_allclose(squared_speeds(grid), expected, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_every_row_and_cap_holds(seed: int) -> None:
    grid = random_cells(np.random.default_rng(100 + seed))
    x = squared_speeds(grid)
    used = grid.rows[:, :, 0] * x[:-1, None] + grid.rows[:, :, 1] * x[1:, None]
    assert used.max() <= 1.0 + 1e-12
    assert (x <= grid.caps).all()
    assert (x[grid.rest] == 0.0).all()
    assert (x[~grid.rest] > 0.0).all()


def test_speeds_below_the_caps_keep_the_velocity_limits_between_grid_points() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        n = 5
        waypoints = rng.uniform(-2.0, 2.0, (3, n))
        path = blend(waypoints, largest_reaches(waypoints))
        limits = np.stack([10.0 ** rng.uniform(-0.5, 0.5, n), np.ones(n)])
        grid = cells(path, 8, limits)
        starts = np.concatenate([[0.0], np.cumsum(grid.lengths)])
        for i in np.flatnonzero(~grid.straight):
            w = np.linspace(0.0, 1.0, 201)
            slopes = path.sample(starts[i] + 0.999999 * w * grid.lengths[i], 1)
            for x0, x1 in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (0.5, 1.0)):
                x = (1.0 - w) * x0 * grid.caps[i] + w * x1 * grid.caps[i + 1]
                assert (np.abs(slopes) * np.sqrt(x)[:, None] <= limits[0] * (1.0 + 1e-5)).all()

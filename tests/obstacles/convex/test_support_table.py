"""Support tables: no corner that could be the farthest is missing from any list."""

import numpy as np

from obstacles.distance.piece_set import CELLS, cell_of, support_table


def test_the_farthest_corner_is_always_in_the_list() -> None:
    random = np.random.default_rng(1)
    for count in (13, 60, 200):
        corners = random.normal(size=(count, 3)) * random.uniform(0.1, 2.0, 3)
        table = support_table(corners)
        directions = random.normal(size=(2000, 3))
        # On edges and corners of the cube that cells are cut from, too.
        directions[:300] = random.integers(-1, 2, (300, 3))
        for n in directions:
            cell = cell_of(*n)
            assert 0 <= cell < CELLS
            listed = table[table[cell] : table[cell + 1]]
            assert (corners[listed] @ n).max() >= (corners @ n).max() - 1e-12


def test_the_lists_are_short() -> None:
    random = np.random.default_rng(2)
    corners = random.normal(size=(100, 3))
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    table = support_table(corners)
    assert np.diff(table[: CELLS + 1]).mean() < 10.0


def test_a_direction_of_no_length_has_a_cell() -> None:
    assert cell_of(0.0, 0.0, 0.0) == 0

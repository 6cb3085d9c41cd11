"""Rows as the proof's kernels read them: every number in its column."""

from dataclasses import replace

import numpy as np
import pytest

from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import JointConstraint
from planning.constraints.row import Row
from planning.proof.constraints import residual_row
from planning.proof.constraints.residual_row import (
    AXIS,
    CARRIER,
    CENTER,
    DIRECTION,
    KIND,
    LOWER,
    POINT,
    REFERENCE,
    TURN,
    UPPER,
    WIDTH,
    pack,
)
from tests.planning.slider import slider

VECTORS = {"point": POINT, "axis": AXIS, "center": CENTER, "direction": DIRECTION}


def rows() -> tuple[Row, ...]:
    both = (JointConstraint("jy", 0.2, 0.1, 0.3), JointConstraint("jx", -0.5, 0.0, 0.25))
    random = np.random.default_rng(1)
    # All that rows of joints leave at zero is given a value of its own.
    return tuple(
        replace(
            row, reference=k, point=random.normal(size=3), axis=random.normal(size=3),
            center=random.normal(size=3), direction=random.normal(size=3),
            turn=random.normal(size=(3, 3)),
        )
        for k, row in enumerate(ConstraintSet(slider().chain, both).rows)
    )  # fmt: skip


def test_every_number_is_in_its_column() -> None:
    packed = pack(rows())
    assert packed.shape == (2, WIDTH)
    for line, row in zip(packed, rows(), strict=True):
        assert line[KIND] == row.kind
        assert line[CARRIER] == row.carrier
        assert line[REFERENCE] == row.reference
        for name, first in VECTORS.items():
            np.testing.assert_array_equal(line[first : first + 3], getattr(row, name))
        assert (line[LOWER], line[UPPER]) == (row.lower, row.upper)
        np.testing.assert_array_equal(line[TURN:].reshape(3, 3), row.turn)


def test_bounds_are_those_that_were_asked_for() -> None:
    packed = pack(rows())
    assert packed[:, LOWER] == pytest.approx([-0.1, -0.75])
    assert packed[:, UPPER] == pytest.approx([0.3, -0.5])


def test_columns_do_not_overlap() -> None:
    widths = {"KIND": 1, "CARRIER": 1, "REFERENCE": 1, "POINT": 3, "AXIS": 3, "CENTER": 3,
              "DIRECTION": 3, "LOWER": 1, "UPPER": 1, "TURN": 9}  # fmt: skip
    at = 0
    for name, width in widths.items():
        assert getattr(residual_row, name) == at
        at += width
    assert at == WIDTH


def test_no_rows_pack_to_nothing() -> None:
    assert pack(()).shape == (0, WIDTH)

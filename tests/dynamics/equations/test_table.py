"""Tables in symbols: which angles add, and which numbers are symbols."""

import math
from typing import Any

import numpy as np
import pytest

from dynamics.equations.table import symbolic_table
from kinematics.model.dh_table import DhRow, DhTable
from tests.dynamics.equations.tables import text_sheet


def table(*alphas: float, convention: Any = "standard", **changes: Any) -> DhTable:
    rows = tuple(DhRow("revolute", a=0.3, alpha=alpha, **changes) for alpha in alphas)
    return DhTable(convention, rows)


@pytest.mark.parametrize(
    ("alphas", "standard", "modified"),
    [
        ((0.0, 0.0, 0.0), (0, 0, 0), (0, 0, 0)),
        ((math.pi, 0.0, 0.5), (0, 0, 0), (0, 0, 1)),
        ((math.pi / 2, 0.0, 0.0), (0, 1, 1), (0, 0, 0)),
        ((0.0, 0.5, 0.0), (0, 0, 1), (0, 1, 1)),
    ],
)
def test_angles_of_parallel_axes_are_of_one_group(
    alphas: tuple[float, ...], standard: tuple[int, ...], modified: tuple[int, ...]
) -> None:
    assert symbolic_table(table(*alphas)).groups == standard
    assert symbolic_table(table(*alphas, convention="modified")).groups == modified


def test_a_slightly_turned_axis_is_not_parallel() -> None:
    assert symbolic_table(table(0.0, 0.0, beta=1e-8)).groups == (0, 1)


def test_angles_of_opposite_axes_are_subtracted() -> None:
    sheet = text_sheet(table(math.pi, 0.0))
    assert sheet.frame[0][0] == "c_1m2"
    assert dict(sheet.abbreviations)["c_1m2"] == "cos(q_1 - q_2)"


def test_zeros_and_quarter_turns_are_no_symbols() -> None:
    rows = (
        DhRow("revolute", a=0.3, alpha=math.pi / 2, d=0.0, theta=-math.pi),
        DhRow("prismatic", a=1e-14, alpha=0.3, d=0.2, mass=1.0, center_of_mass=[0.0, 0.1, 0.0],
              inertia=np.diag([0.1, 0.2, 0.3])),
    )  # fmt: skip
    symbols = symbolic_table(DhTable("standard", rows))
    names = [parameter.symbol for parameter in symbols.parameters]
    assert names == ["a_1", "d_2", "alpha_2", "m_2", "y_c2", "I_xx2", "I_yy2", "I_zz2", "g"]

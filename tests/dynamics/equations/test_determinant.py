"""Determinants of rows of the Jacobian: singularities of small arms as formulas."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy

from dynamics.equations.formula import Notation
from dynamics.equations.sheet import AXES, write_sheet
from kinematics.errors import InvalidOption
from kinematics.model.dh_table import DhRow, DhTable
from tests.dynamics.equations.tables import TABLES, evaluate, parse, state

UP = math.pi / 2


def arm(*rows: dict[str, Any]) -> DhTable:
    return DhTable("standard", tuple(DhRow(row.pop("type", "revolute"), **row) for row in rows))


def elbow() -> DhTable:
    return arm({"a": 0.1, "d": 0.4, "alpha": UP}, {"a": 0.5, "d": 0.1}, {"a": 0.35})


def skew() -> DhTable:
    return arm({"d": 0.4, "alpha": 0.4}, {"a": 0.5, "alpha": 0.7}, {"a": 0.35})


def spherical() -> DhTable:
    return arm({"d": 0.3, "alpha": -UP}, {"d": 0.1, "alpha": UP}, {"type": "prismatic"})


def scara() -> DhTable:
    return arm({"a": 0.5, "d": 0.3}, {"a": 0.4, "alpha": math.pi}, {"type": "prismatic"}, {})


def wrist() -> DhTable:
    return arm({"alpha": -UP}, {"alpha": UP}, {"d": 0.1})


@pytest.mark.parametrize(
    ("table", "axes", "expected"),
    [
        (TABLES["planar"], "x,y", "l_1 * l_2 * s_2"),
        (TABLES["planar of three"], "x,y,rz", "l_1 * l_2 * s_2"),
        (elbow(), "x,y,z", "-a_2 * a_3 * s_3 * (a_1 + a_2 * c_2 + a_3 * c_23)"),
        (spherical(), "x,y,z", "-s_2 * q_3**2"),
        (scara(), "x,y,z,rz", "a_1 * a_2 * s_2"),
        (wrist(), "rx,ry,rz", "-s_2"),
        (
            skew(),
            "x,y,z",
            "a_2 * a_3 * s_alpha1 * s_3 * (a_3 * c_alpha2 * s_2 * s_3 - c_2 * (a_2 + a_3 * c_3))",
        ),
        (wrist(), "x,y,z", "0"),
    ],
)
def test_textbook_arms_have_their_factors(table: DhTable, axes: str, expected: str) -> None:
    assert write_sheet(table, Notation.TEXT, axes.split(",")).determinant == expected


@pytest.mark.parametrize("name", ["planar", "articulated", "cart"])
def test_the_determinant_is_that_of_sympy(name: str) -> None:
    table = TABLES[name]
    axes = AXES[: len(table.rows)]
    sheet = write_sheet(table, Notation.TEXT, axes)
    J = sympy.Matrix([[parse(sheet, text) for text in row] for row in sheet.jacobian[: len(axes)]])
    assert sheet.determinant is not None
    assert sympy.simplify(parse(sheet, sheet.determinant) - J.det()) == 0


@pytest.mark.parametrize("seed", range(6))
def test_arms_at_odd_angles_have_the_values_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = rng.choice(["revolute", "revolute", "prismatic"], 4 - seed % 2)
    rows = tuple(
        DhRow(kind, a=rng.uniform(), d=rng.uniform(), alpha=rng.choice([0.0, UP, -UP, 0.3]),
              theta=rng.choice([0.0, 0.4, UP]))
        for kind in kinds
    )  # fmt: skip
    axes = rng.permutation(AXES)[: len(rows)].tolist()
    sheet = write_sheet(DhTable("standard", rows), Notation.TEXT, axes)
    for q in rng.uniform(-2.0, 2.0, (3, len(rows))):
        J = evaluate(sheet, sheet.jacobian, state(q, q, q))[[AXES.index(axis) for axis in axes]]
        found = evaluate(sheet, [sheet.determinant], state(q, q, q))[0]
        assert found == pytest.approx(np.linalg.det(J.astype(float)), abs=1e-12)


def test_an_added_angle_is_part_of_the_factor() -> None:
    table = arm({"a": 0.5, "theta": 0.3}, {"a": 0.4, "theta": 0.2})
    sheet = write_sheet(table, Notation.LATEX, ["x", "y"])
    assert (sheet.determinant or "").endswith("s_{2}")


def test_long_arms_and_wrong_axes_are_told() -> None:
    table = TABLES["planar"]
    for axes in (["x"], ["x", "x"], ["x", "y", "z"], ["x", "up"]):
        with pytest.raises(InvalidOption, match="as many rows of the Jacobian as there are joints"):
            write_sheet(table, Notation.TEXT, axes)
    five = replace(table, rows=tuple(DhRow("revolute", a=0.3) for _ in range(5)))
    sheet = write_sheet(five, Notation.TEXT, AXES[:5])
    assert sheet.determinant is None
    assert "beyond 4 joints" in sheet.notes[0]

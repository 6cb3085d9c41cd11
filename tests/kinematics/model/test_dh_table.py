"""DH tables as values: which of them can be built, at the exact bounds."""

import math
from collections.abc import Callable
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest

from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import MAX_JOINTS
from kinematics.model.dh import chain_from_dh
from kinematics.model.dh_table import DhRow, DhTable, check_table
from kinematics.pose import from_rpy, transform
from kinematics.rounding import TENSOR_TOLERANCE

ROW = DhRow("revolute", a=0.3, alpha=0.5, d=0.1, theta=-0.2, lower=-1.0, upper=2.0)


def table(*rows: DhRow, **changes: Any) -> DhTable:
    """A table of rows, or of the one above."""
    return DhTable("standard", rows or (ROW,), **changes)


def changes(name: str, value: float) -> Any:
    """One field of a row."""
    return {name: value}


def with_inertia(tensor: Any) -> DhTable:
    """A table whose row has a tensor."""
    return table(replace(ROW, mass=1.0, inertia=tensor))


def refused(wrong: DhTable, words: str) -> None:
    """See that no chain is made of a table, which is told with certain words."""
    with pytest.raises(InvalidRobotDescription, match=words):
        chain_from_dh("wrong", wrong)


FITTING: dict[str, Callable[[], DhTable]] = {
    "plain": table,
    "modified": lambda: DhTable("modified", (ROW,)),
    "prismatic": lambda: table(replace(ROW, type="prismatic")),
    "longest": lambda: table(*[ROW] * MAX_JOINTS),
    "unlimited": lambda: table(replace(ROW, lower=-math.inf, upper=math.inf)),
    "half open": lambda: table(replace(ROW, lower=0.0, upper=math.inf)),
    "a joint that stands still": lambda: table(replace(ROW, lower=0.5, upper=0.5)),
    "no speed limit": lambda: table(replace(ROW, velocity=math.inf)),
    "slow": lambda: table(replace(ROW, velocity=1e-12)),
    "massless": lambda: table(replace(ROW, mass=0.0)),
    "no friction": lambda: table(replace(ROW, viscous_friction=0.0, motor_inertia=0.0)),
    "point mass": lambda: table(replace(ROW, mass=1.0, center_of_mass=(0, 0, 1))),
    "turned base": lambda: table(base=transform(from_rpy([0.1, 0.2, 0.3]), [1.0, 2.0, 3.0])),
    "weightless": lambda: table(gravity=np.zeros(3)),
    "flat body": lambda: with_inertia(np.diag([1.0, 1.0, 0.0])),
    "no inertia": lambda: with_inertia(np.zeros((3, 3))),
}


@pytest.mark.parametrize("name", FITTING)
def test_tables_that_can_be_built_are_taken(name: str) -> None:
    check_table(FITTING[name]())


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_symmetry_and_sign_of_a_tensor_may_miss_by_the_tolerance(share: float) -> None:
    skew, negative = np.diag([2.0, 2.0, 2.0]), np.diag([2.0000001, 2.0, 0.0])
    skew[0, 1] = share * TENSOR_TOLERANCE * 2.0
    negative[2, 2] = -share * TENSOR_TOLERANCE * 2.0
    if share < 1.0:
        check_table(with_inertia(skew))
        check_table(with_inertia(negative))
    else:
        refused(with_inertia(skew), "not symmetric")
        refused(with_inertia(negative), "not positive semi-definite")


def test_a_tensor_that_is_negative_in_turned_axes_is_refused() -> None:
    R = from_rpy([0.4, -0.7, 1.1])
    refused(with_inertia(R @ np.diag([1.0, 1.0, -0.5]) @ R.T), "row 1 .*semi-definite")


@pytest.mark.parametrize("name", ["a", "alpha", "d", "theta", "beta"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_every_number_of_the_geometry_must_be_finite(name: str, value: float) -> None:
    refused(table(ROW, replace(ROW, **changes(name, value))), f"^{name} in row 2")


@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk", "effort"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_every_limit_must_be_positive(name: str, value: float) -> None:
    refused(table(ROW, ROW, replace(ROW, **changes(name, value))), f"^{name} in row 3 .*positive")


@pytest.mark.parametrize("name", ["mass", "motor_inertia", "viscous_friction"])
@pytest.mark.parametrize("value", [-1e-12, math.nan, math.inf])
def test_masses_and_motors_must_not_be_negative(name: str, value: float) -> None:
    refused(table(replace(ROW, **changes(name, value))), f"^{name} in row 1")


@pytest.mark.parametrize(
    ("lower", "upper"),
    [(1.0, 0.999), (math.inf, math.inf), (-math.inf, -math.inf), (math.nan, 1.0), (0.0, math.nan)],
)
def test_a_range_without_positions_is_refused(lower: float | None, upper: float | None) -> None:
    refused(table(replace(ROW, lower=lower, upper=upper)), "row 1 .*lower .*upper")


@pytest.mark.parametrize(
    "values",
    [
        {"center_of_mass": "abc"},
        {"center_of_mass": [0.0, 0.0]},
        {"center_of_mass": [[0.0], [0.0], [0.0]]},
        {"center_of_mass": [0.0, 0.0, math.inf]},
        {"center_of_mass": [None, 0.0, 0.0]},
        {"inertia": "diagonal"},
        {"inertia": [1.0, 1.0, 1.0]},
        {"inertia": np.eye(4)},
        {"inertia": [[1, 0, 0], [0, 1, 0], [0, 0]]},
        {"inertia": np.full((3, 3), math.nan)},
    ],
)
def test_hostile_mass_properties_are_refused_by_name(values: dict[str, Any]) -> None:
    refused(table(replace(ROW, mass=1.0, **values)), f"^{next(iter(values))} in row 1")


def test_mass_properties_without_a_mass_are_refused() -> None:
    refused(table(replace(ROW, inertia=np.eye(3))), "has inertia but no mass")
    refused(table(replace(ROW, center_of_mass=[0, 0, 0])), "has center_of_mass but no mass")


@pytest.mark.parametrize("name", ["base", "tool"])
@pytest.mark.parametrize(
    "T",
    [
        np.eye(3),
        np.full((4, 4), math.nan),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.diag([1.0, 1.0, 1.001, 1.0]),
        np.diag([1.0, 1.0, 1.0, 2.0]),
        np.eye(4) + np.eye(4, k=-3),
        transform(None, [0.0, 0.0, math.inf]),
    ],
)
def test_a_base_or_tool_that_is_no_rigid_motion_is_refused(name: str, T: Any) -> None:
    refused(table(**{name: T}), f"^{name} of the DH table")


def test_unknown_conventions_and_types_are_refused_with_those_there_are() -> None:
    for wrong, words in (
        (DhTable("usual", (ROW,)), "'usual'"),  # type: ignore[arg-type]
        (table(ROW, replace(ROW, type="helical")), "row 2 .*'helical'"),  # type: ignore[arg-type]
    ):
        with pytest.raises(InvalidRobotDescription, match=words) as error:
            chain_from_dh("wrong", wrong)
        assert "One of" in str(error.value.hint)


@pytest.mark.parametrize("count", [0, MAX_JOINTS + 1])
def test_the_number_of_rows_is_bounded(count: int) -> None:
    refused(DhTable("standard", (ROW,) * count), f"this one has {count}")


@pytest.mark.parametrize("gravity", [[0.0, 9.81], [0.0, 0.0, math.nan], [[0.0, 0.0, 9.81]]])
def test_gravity_is_three_finite_numbers(gravity: Any) -> None:
    refused(table(gravity=np.array(gravity)), "gravity")


def test_a_table_keeps_its_own_copies_and_cannot_be_changed() -> None:
    base, rows = np.eye(4), [ROW, ROW]
    made = DhTable("standard", rows, base=base)  # type: ignore[arg-type]
    base[0, 3] = 1.0
    rows.clear()
    assert len(made.rows) == 2
    assert made.base[0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        made.tool[0, 3] = 1.0
    with pytest.raises(FrozenInstanceError):
        made.convention = "modified"  # type: ignore[misc]

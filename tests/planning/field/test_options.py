"""Options of the potential field: presets, what they change, and what the descent gets of them."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from planning.field.options import MAX_ITERATIONS, PRESETS, QUICK, FieldOptions
from planning.field.weights import FieldWeights

LOWER, UPPER = np.array([-1.0, -2.0]), np.array([1.0, 2.0])
NAMES = [item.name for item in fields(FieldOptions) if item.init]


def values(options: FieldOptions) -> dict[str, Any]:
    return {name: getattr(options, name) for name in NAMES}


def test_nothing_named_is_the_preset_of_the_notes() -> None:
    assert values(FieldOptions.of({})) == values(FieldOptions())
    assert values(FieldOptions.of({"preset": "notes"})) == values(FieldOptions())
    assert values(FieldOptions.of({"preset": "quick"})) == values(QUICK)


@pytest.mark.parametrize("preset", list(PRESETS))
def test_a_named_option_changes_that_one_alone(preset: str) -> None:
    changes = {
        "attractive_weights": [1.0, 2.0], "attractive_cap": 0.3, "repulsive_weights": 0.5,
        "influence_distance": 0.2, "least_distance": 2e-3, "control_points": "links",
        "joint_weight": 2.0, "step_sizes": 0.1, "longest_step": 0.07, "halvings": 0,
        "tolerance": 0.5, "connect": False, "max_iterations": 7, "patience": 3, "escapes": 4,
        "escape_steps": 2, "progress": 0.5, "force_tolerance": 0.1, "engine": "fcl",
        "fallback": "prm",
    }  # fmt: skip
    assert {*changes, "point_radii", "keep_path"} == set(NAMES)
    base = values(PRESETS[preset])
    for name, value in changes.items():
        assert values(FieldOptions.of({"preset": preset, name: value})) == {**base, name: value}
    # The field's own path has no fallback.
    kept = values(FieldOptions.of({"preset": preset, "keep_path": True}))
    assert kept == {**base, "keep_path": True, "fallback": None}


def test_radii_belong_to_origins() -> None:
    assert FieldOptions.of({"point_radii": [0.1, 0.0]}).point_radii == [0.1, 0.0]
    with pytest.raises(InvalidOption, match="point_radii are those of origins"):
        FieldOptions.of({"preset": "quick", "point_radii": 0.1})
    for bad in (-0.1, [], [0.1, -1.0], "wide", True, float("nan"), float("inf")):
        with pytest.raises(InvalidOption, match="point_radii must be"):
            FieldOptions.of({"point_radii": bad})


def test_a_kept_path_has_no_straight_connection() -> None:
    assert FieldOptions().rules(LOWER, UPPER).connect
    assert not FieldOptions(keep_path=True).rules(LOWER, UPPER).connect


def test_the_thorough_preset_is_the_quick_one_that_does_not_give_up() -> None:
    thorough, quick = PRESETS["thorough"], PRESETS["quick"]
    patient = {"max_iterations", "patience", "escapes"}
    for name in NAMES:
        if name in patient:
            assert getattr(thorough, name) > getattr(quick, name)
        else:
            assert getattr(thorough, name) == getattr(quick, name)


def test_options_given_are_not_changed() -> None:
    given = {"preset": "quick", "escapes": 2}
    FieldOptions.of(given)
    assert given == {"preset": "quick", "escapes": 2}


def test_the_first_unknown_name_is_told() -> None:
    with pytest.raises(InvalidOption) as refused:
        FieldOptions.of({"zeta": 1, "alpha": 2})
    assert refused.value.message == "planner 'potential_field' has no option 'alpha'"
    assert refused.value.details["options"] == ["preset", *NAMES]


def test_a_value_out_of_range_is_told_with_its_place() -> None:
    with pytest.raises(InvalidOption) as refused:
        FieldOptions.of({"attractive_cap": -1.0})
    assert refused.value.message.startswith("planner_options.attractive_cap must be")
    with pytest.raises(InvalidOption) as refused:
        FieldOptions.of({"least_distance": 0.5})
    assert refused.value.hint is not None
    assert refused.value.hint.startswith("Lower least_distance")


def test_the_weights_are_those_of_the_options() -> None:
    options = FieldOptions(attractive_weights=2.0, attractive_cap=0.5, influence_distance=0.3)
    for item in fields(FieldWeights):
        assert getattr(options.weights, item.name) == getattr(options, item.name)
    assert replace(options, attractive_cap=0.6).weights.attractive_cap == 0.6


@pytest.mark.parametrize(
    ("sizes", "expected"), [(None, []), (0.3, [0.3]), ([0.1, 0.2], [0.1, 0.2]), ((5,), [5.0])]
)
def test_rules_have_the_sizes_as_an_array(sizes: Any, expected: list[float]) -> None:
    rules = FieldOptions(step_sizes=sizes).rules(LOWER, UPPER)
    assert rules.sizes.dtype == np.float64
    assert rules.sizes.tolist() == expected


def test_rules_are_the_options_of_the_descent() -> None:
    options = FieldOptions(
        longest_step=1, halvings=3, tolerance=2, connect=False, patience=9, max_iterations=4
    )
    rules = options.rules(LOWER, UPPER)
    assert rules.lower is LOWER
    assert rules.upper is UPPER
    # Kernels are compiled for floats.
    assert isinstance(rules.longest, float)
    assert isinstance(rules.tolerance, float)
    assert (rules.longest, rules.halvings, rules.tolerance) == (1.0, 3, 2.0)
    assert (rules.connect, rules.patience) == (False, 9)
    assert (rules.progress, rules.force_tolerance) == (0.0, 1e-3)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("halvings", 0, 30), ("max_iterations", 1, MAX_ITERATIONS), ("patience", 1, MAX_ITERATIONS),
     ("escapes", 0, 1000), ("escape_steps", 1, 1000)],
)  # fmt: skip
def test_counts_are_taken_from_end_to_end(name: str, least: int, most: int) -> None:
    for value in (least, most):
        assert getattr(FieldOptions.of({name: value}), name) == value
    for value in (least - 1, most + 1):
        with pytest.raises(InvalidOption, match=f"{name} must be a whole number"):
            FieldOptions.of({name: value})


def test_step_sizes_are_at_most_so_many() -> None:
    rules = FieldOptions(step_sizes=[0.1] * 10_000).rules(LOWER, UPPER)
    assert len(rules.sizes) == 10_000
    with pytest.raises(InvalidOption, match="step_sizes must be 1 to 10000 numbers"):
        FieldOptions(step_sizes=[0.1] * 10_001)


@pytest.mark.parametrize("weight", [0.0, 1e-9, 5])
def test_a_joint_weight_of_zero_is_none(weight: float) -> None:
    assert FieldOptions(joint_weight=weight).joint_weight == weight

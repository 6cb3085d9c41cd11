"""Weights, options and control points of a field: ranges, refusals, forces by hand."""

import json
import math
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armwright_wire.plans.plan import PlanRequest
from armwright_wire.robots.potential import PotentialOptions
from kinematics.errors import InvalidLinkName, InvalidOption
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.pose import transform
from kinematics.robots import builtin_chain
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.field.options import PRESETS, FieldOptions
from planning.field.planner import potential_of
from planning.field.weights import MAX_WEIGHT, FieldWeights, positive, share, whole
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan

BOTH = ("attractive_weights", "repulsive_weights")


def refused(**options: Any) -> InvalidOption:
    with pytest.raises(InvalidOption) as caught:
        FieldWeights(**options)
    return caught.value


def test_shares_of_one_number_and_none_of_one_each() -> None:
    weights = FieldWeights(attractive_weights=3.0, repulsive_weights=[1.0, 2.0], attractive_cap=0.4)
    shared = weights.with_share(0.25)
    assert shared.attractive_weights == 0.75
    assert shared.repulsive_weights == [1.0, 2.0]
    assert shared.attractive_cap == 0.4
    assert weights.with_share(1.0) is weights
    assert weights.attractive_weights == 3.0


@pytest.mark.parametrize(
    "value", [-1e-9, 1.001 * MAX_WEIGHT, np.nan, np.inf, True, "1", ["1"], [None], [[1.0]], [], {}]
)  # fmt: skip
@pytest.mark.parametrize("name", BOTH)
def test_weights_out_of_range_are_refused_by_name(name: str, value: Any) -> None:
    assert refused(**{name: value}).message.startswith(f"{name} must be a number from 0 to 1e+09")


@given(st.one_of(st.floats(min_value=5e-324, max_value=1.7e308), st.integers(1, 10**30)))
def test_numbers_in_range_are_taken(value: float) -> None:
    positive("size", value)
    whole("count", -3 + int(value) % 11, -3, 7)
    share("part", min(value, 0.999))


_NO_NUMBERS = [True, None, "1", [1.0], float("nan")]


@pytest.mark.parametrize(
    ("check", "values", "words"),
    [
        (positive, [*_NO_NUMBERS, 0, -0.0, -1e-300, np.inf, 1j], "size must be a positive number"),
        (share, [*_NO_NUMBERS, -1e-9, 1], "size must be a number from 0 to less than 1"),
        (
            partial(whole, least=-3, most=7), [*_NO_NUMBERS, -4, 8, 2.0],
            "size must be a whole number from -3 to 7",
        ),
    ],
)  # fmt: skip
def test_values_out_of_range_are_refused_by_name(check: Any, values: list[Any], words: str) -> None:
    for value in values:
        with pytest.raises(InvalidOption) as caught:
            check("size", value)
        assert caught.value.message.startswith(words)


LOWER, UPPER = np.array([-1.0, -2.0]), np.array([1.0, 2.0])
NAMES = [item.name for item in fields(FieldOptions) if item.init]


def values(options: FieldOptions) -> dict[str, Any]:
    return {name: getattr(options, name) for name in NAMES}


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


def test_a_kept_path_has_no_straight_connection() -> None:
    assert FieldOptions().rules(LOWER, UPPER).connect
    assert not FieldOptions(keep_path=True).rules(LOWER, UPPER).connect


CHAIN = builtin_chain("panda")
BARE = RobotGeometry(CHAIN, (), (), np.zeros(0, np.int64), np.zeros(0, np.int64), {})
Q = np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.5, 0.7])
GOAL = Q + 0.2


def test_forces_on_own_points_are_those_of_the_notes() -> None:
    place = np.array([0.05, -0.02, 0.1])
    points = [{"link": "panda_link4", "point": place.tolist()}]
    ball = forward(CHAIN, Q, "panda_link4") @ [0.05, -0.02, 0.25, 1.0]
    scene = Scene((Obstacle("ball", Sphere(0.05), transform(None, ball[:3])),))
    options = FieldOptions(control_points=points, attractive_weights=2.0, repulsive_weights=1e-3)
    field, where = potential_of(BARE, scene, GOAL, options)
    value = field.at(Q)
    at = (forward(CHAIN, Q, "panda_link4") @ [*place, 1.0])[:3]
    there = (forward(CHAIN, GOAL, "panda_link4") @ [*place, 1.0])[:3]
    e, rho = at - there, float(np.linalg.norm(at - ball[:3])) - 0.05
    pull = -2.0 * e * min(1.0, 0.2 / float(np.linalg.norm(e)))
    push = 1e-3 * (1.0 / rho - 1.0 / 0.1) / rho**2 * (at - ball[:3]) / (rho + 0.05)
    J = geometric(CHAIN, Q, "panda_link4", place)[:3]
    assert len(where) == 1
    np.testing.assert_allclose(value.joint_force, J.T @ (pull + push), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "points",
    ["tips", [], [{"link": "panda_link4"}], [{"link": 4, "point": [0, 0, 0]}],
     [{"link": "panda_link4", "point": [0, 0]}],
     [{"link": "panda_link4", "point": [0, 0, math.nan]}],
     [{"link": "panda_link4", "point": [0, 0, 0], "radius": 1}]],
)  # fmt: skip
def test_what_is_no_point_is_refused(points: Any) -> None:
    with pytest.raises(InvalidOption, match="control_points"):
        FieldOptions(control_points=points)


def test_points_of_links_that_do_not_exist_or_move_are_refused() -> None:
    nowhere = FieldOptions(control_points=[{"link": "nowhere", "point": [0, 0, 0]}])
    still = FieldOptions(control_points=[{"link": CHAIN.base_link, "point": [0, 0, 0]}])
    with pytest.raises(InvalidLinkName):
        potential_of(BARE, Scene(), GOAL, nowhere)
    with pytest.raises(InvalidOption, match="does not move"):
        potential_of(BARE, Scene(), GOAL, still)
    radii = FieldOptions(
        control_points=[{"link": "panda_link4", "point": [0, 0, 0]}], point_radii=[0.1, 0.2]
    )
    with pytest.raises(InvalidOption, match="point_radii"):
        potential_of(BARE, Scene(), GOAL, radii)


def test_obstacles_push_the_points_of_an_arm_without_solids() -> None:
    rows = tuple(
        DhRow("revolute", a, lower=-3.0, upper=3.0, velocity=1.0, acceleration=5.0)
        for a in (0.5, 0.4)
    )
    chain = chain_from_dh("planar", DhTable("standard", rows))
    none = np.zeros(0, np.int64)
    bare = RobotGeometry(chain, (), (), none, none, {})
    tip = forward(chain, [0.9, 0.4])[:3, 3]
    ball = Scene((Obstacle("ball", Sphere(0.04), transform(None, 1.08 * tip)),))
    options = {
        "fallback": None, "max_iterations": 5000, "repulsive_weights": 5e-3,
        "influence_distance": 0.3,
    }  # fmt: skip
    ways = []
    for scene in (Scene(), ball):
        problem = Problem(
            bare, Scene(), np.array([0.2, 0.4]), (JointGoal([1.6, 0.4]),), field_cell=(bare, scene)
        )
        result = plan(
            problem, Options(planner="potential_field", planner_options=options, timeout=300.0)
        )
        assert isinstance(result, Plan)
        assert not result.certificate.proved.collisions
        ways.append(result.path.waypoints)
    near = [
        min(float(np.linalg.norm(forward(chain, q)[:3, 3] - 1.08 * tip)) for q in way)
        for way in ways
    ]
    assert near[1] > near[0] + 0.02


def test_options_of_the_descent_are_documented_with_their_defaults() -> None:
    described = {item.name: item.default for item in fields(FieldOptions) if item.init}
    names = set(described) - set(PotentialOptions.model_fields)
    text = PlanRequest.model_fields["planner_options"].description or ""
    for name in names - {"step_sizes", "engine", "fallback"}:
        assert f"{name} ({json.dumps(described[name])})" in text
    assert all(name in text for name in names)

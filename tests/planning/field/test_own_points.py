"""Control points of one's own, and fields of robots whose bodies are left out, by hand."""

import json
import math
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

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
from planning.field.options import FieldOptions
from planning.field.planner import potential_of
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan

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

"""The potential, its control points, weights and options: closed forms, slopes, refusals."""

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
from kinematics.arrays import Array
from kinematics.errors import InvalidLinkName, InvalidOption
from kinematics.forward import forward, link_poses
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.model.dh import DhRow, DhTable, chain_from_dh, dh_from_chain
from kinematics.pose import transform
from kinematics.robots import builtin_chain, builtin_names
from obstacles.convex.piece import Piece
from obstacles.projection.projection import Projector
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    PointCloud,
    Shape,
    Sphere,
)
from planning.field.control_points import along_links, control_points, origin_points
from planning.field.options import PRESETS, FieldOptions
from planning.field.planner import potential_of
from planning.field.potential import Field
from planning.field.weights import MAX_WEIGHT, FieldWeights, positive, share, whole
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from tests.obstacles.solids import random_transform
from tests.planning.scenes import builtin, pillar, shelf
from tests.planning.slider import slider

STEP = 1e-6


def slope(field: Field, q: Array) -> Array:
    ahead = [field.at(q + step).potential for step in STEP * np.eye(len(q))]
    behind = [field.at(q - step).potential for step in STEP * np.eye(len(q))]
    return np.asarray((np.array(ahead) - np.array(behind)) / (2.0 * STEP))


def near_a_kink(field: Field, q: Array, reach: float) -> bool:
    """Second derivatives jump at the rim of the reach; inside, ways out may tie."""
    return bool((np.abs(field.at(q).distances - reach) < 1e-4).any())


@pytest.mark.parametrize("name", ["panda", "stanford", "kr6_sixx", "scara", "planar_rr"])
def test_joint_force_is_minus_the_slope_of_the_potential(name: str) -> None:
    robot = builtin(name)
    chain = robot.chain
    random = np.random.default_rng(0)
    lower, upper = chain.sampling_bounds()
    where = origin_points(chain)
    reach = 0.3
    felt = 0
    for k in range(60):
        goal, q = random.uniform(lower, upper, (2, chain.n))
        points = control_points(chain, where, q)[0]
        obstacles = tuple(
            Obstacle(f"ball{i}", Sphere(0.05), transform(None, point + random.normal(0.0, 0.15, 3)))
            for i, point in enumerate(points[-3:])
        )
        weights = FieldWeights(
            attractive_weights=random.uniform(0.5, 2.0, chain.n).tolist(),
            attractive_cap=0.3,
            repulsive_weights=random.uniform(0.001, 0.01, chain.n).tolist(),
            influence_distance=reach,
        )
        joint_weight = 0.5 * (k % 2)
        field = Field(chain, where, Projector(obstacles), goal, weights, joint_weight)
        value = field.at(q)
        if near_a_kink(field, q, reach) or value.distances.min() < 0.01:
            continue
        felt += int((value.distances < reach).any())
        expected = -slope(field, q)
        assert value.joint_force == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert felt > 10


def one_point(point: Array, *obstacles: Obstacle, **weights: float) -> tuple[Array, Field, Chain]:
    """The field at the tip of the SCARA, brought to a point by moving the scene instead."""
    chain = builtin("scara").chain
    q = np.array([0.3, 0.4, 0.05, 0.2])
    tip = control_points(chain, origin_points(chain), q)[0][-1]
    moved = tuple(
        Obstacle(o.id, o.shape, transform(None, tip - point) @ o.T_world_obstacle)
        for o in obstacles
    )
    only_tip = [0.0] * (chain.n - 1)
    options = FieldWeights(
        attractive_weights=0.0,
        repulsive_weights=[*only_tip, 1.0],
        influence_distance=weights.get("influence_distance", 0.5),
        least_distance=weights.get("least_distance", 1e-3),
    )
    return q, Field(chain, origin_points(chain), Projector(moved), q, options), chain


@pytest.mark.parametrize(
    ("gap", "potential", "force"),
    [
        (0.6, 0.0, 0.0),
        (0.5, 0.0, 0.0),
        (0.25, 0.5 * (4 - 2) ** 2, (4 - 2) * 16),
        (0.1, 0.5 * (10 - 2) ** 2, (10 - 2) * 100),
        # The tangent at rho_m = 0.05: U = 162, slope -7200.
        (0.05, 162.0, 7200.0),
        (0.01, 162.0 + 7200.0 * 0.04, 7200.0),
        (-0.02, 162.0 + 7200.0 * 0.07, 7200.0),
    ],
)  # fmt: skip
def test_repulsion_in_closed_form(gap: float, potential: float, force: float) -> None:
    wall = Obstacle("wall", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0), transform(None, [0, 0, 0]))
    q, field, _ = one_point(np.array([0.0, 0.0, gap]), wall, least_distance=0.05)
    value = field.at(q)
    assert value.potential == pytest.approx(potential, abs=1e-9)
    assert value.repulsive_forces[-1] == pytest.approx([0.0, 0.0, force], abs=1e-6)
    assert value.distances[-1] == pytest.approx(gap)


def test_inside_the_force_points_along_the_shortest_way_out() -> None:
    crate = Obstacle("crate", Box(np.array([0.4, 0.4, 0.4])), transform(None, [0, 0, 0]))
    q, field, _ = one_point(np.array([0.15, 0.02, -0.03]), crate)
    push = field.at(q).repulsive_forces[-1]
    assert push[0] > 0.0
    assert push[1:] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_a_union_pushes_once_from_what_is_nearest() -> None:
    cloud = PointCloud(np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]), 0.05)
    ball = Obstacle("b", Sphere(0.05), transform(None, [0, 0, 0]))
    point = np.array([0.0, 0.0, 0.2])
    q, union, _ = one_point(point, Obstacle("c", cloud, transform(None, [0, 0, 0])))
    q, single, _ = one_point(point, ball)
    assert union.at(q).potential == pytest.approx(single.at(q).potential)
    assert union.at(q).repulsive_forces == pytest.approx(single.at(q).repulsive_forces)
    q, both, _ = one_point(
        point, ball, Obstacle("d", Sphere(0.05), transform(None, [0.3, 0.0, 0.0]))
    )
    assert both.at(q).potential > single.at(q).potential


def test_attraction_in_closed_form() -> None:
    chain = builtin("planar_rr").chain
    where = origin_points(chain)
    goal, q = np.array([0.0, 0.0]), np.array([0.0, 0.05])
    weights = FieldWeights(attractive_weights=3.0, attractive_cap=0.2)
    field = Field(chain, where, Projector(()), goal, weights)
    points, goals = (control_points(chain, where, at)[0] for at in (q, goal))
    length = np.linalg.norm(points - goals, axis=1)
    value = field.at(q)
    assert value.potential == pytest.approx(1.5 * (length**2).sum())
    assert value.attractive_forces == pytest.approx(3.0 * (goals - points))
    far = np.array([2.0, 0.5])
    points = control_points(chain, where, far)[0]
    length = np.linalg.norm(points - goals, axis=1)
    assert (length > 0.2).all()
    value = field.at(far)
    assert value.potential == pytest.approx(3.0 * (0.2 * length - 0.02).sum())
    assert np.linalg.norm(value.attractive_forces, axis=1) == pytest.approx([0.6, 0.6])
    assert not np.isfinite(value.distances).any()
    assert (value.nearest == -1).all()


@pytest.mark.parametrize("name", ["panda", "stanford", "kr6_sixx"])
def test_jacobians_of_the_control_points(name: str) -> None:
    robot = builtin(name)
    chain = robot.chain
    random = np.random.default_rng(2)
    lower, upper = chain.sampling_bounds()
    for where in (origin_points(chain), along_links(robot)):
        q = random.uniform(lower, upper)
        _, jacobians = control_points(chain, where, q)
        for j, step in enumerate(STEP * np.eye(chain.n)):
            ahead, behind = (control_points(chain, where, at)[0] for at in (q + step, q - step))
            assert jacobians[:, :, j] == pytest.approx((ahead - behind) / 2e-6, abs=1e-8)
            # What joint j moves lies beyond it.
            assert not jacobians[where.joints < j, :, j].any()


@pytest.mark.parametrize("name", ["panda", "scara", "ur5e"])
def test_a_slope_has_the_value_and_the_force_of_all_obstacles(name: str) -> None:
    robot = builtin(name)
    random = np.random.default_rng(17)
    lower, upper = robot.chain.sampling_bounds()
    floor = Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.1), np.eye(4))
    scenes = (Scene(), shelf(0.5), Scene((*shelf(0.4).obstacles, *pillar().obstacles, floor)))
    for scene in scenes:
        for where in (origin_points(robot.chain), along_links(robot)):
            goal = random.uniform(lower, upper)
            field = Field(robot.chain, where, Projector(scene), goal, FieldWeights(), 0.3)
            for _ in range(30):
                q = random.uniform(lower, upper)
                expected, (potential, force, _) = field.at(q), field.slope(q)
                assert potential == pytest.approx(expected.potential, rel=1e-12)
                scale = np.abs(expected.joint_force).max() + 1.0
                assert force == pytest.approx(expected.joint_force, abs=1e-12 * scale)


def carrying(shape: Shape, T: Array | None = None, joint: int = 1) -> RobotGeometry:
    """The two slides with one solid on a joint."""
    pose = np.eye(4) if T is None else T
    pieces: tuple[Piece, ...] = tuple(piece.placed(pose) for piece in shape.pieces())
    names = ("ball",) * len(pieces)
    joints, solids = np.full(len(pieces), joint), np.zeros(len(pieces), dtype=np.int64)
    return RobotGeometry(slider().chain, pieces, names, joints, solids, {})


@pytest.mark.parametrize("name", builtin_names())
def test_origins_are_those_of_the_table_and_of_the_tip(name: str) -> None:
    chain = builtin(name).chain
    q = np.random.default_rng(1).uniform(*chain.sampling_bounds())
    points, _ = control_points(chain, origin_points(chain), q)
    np.testing.assert_allclose(points[-1], forward(chain, q)[:3, 3], atol=1e-12)
    # The chain of its own table has frame i as link_i.
    table = chain_from_dh("table", dh_from_chain(chain))
    frames = link_poses(table, q, [f"link_{i + 1}" for i in range(chain.n - 1)])
    np.testing.assert_allclose(points[:-1], frames[:, :3, 3], atol=1e-12)
    assert not origin_points(chain).radii.any()


@pytest.mark.parametrize(
    ("shape", "count", "width"),
    [
        (Sphere(0.1), 1, 0.1),
        (Box(np.full(3, 0.2)), 1, 0.1),
        (Box(np.array([0.2, 0.3, 0.2])), 1, 0.1),
        (Box(np.array([0.2, 0.31, 0.2])), 2, 0.1),
        (Box(np.array([0.2, 0.2, 0.5])), 3, 0.1),
        (Box(np.array([2.0, 0.2, 0.1])), 4, 0.1),
        (Cylinder(0.05, 0.4), 4, 0.05),
        (Capsule(0.1, 0.2), 2, 0.1),
        (Box(np.array([0.4, 0.4, 0.01])), 1, 0.2),
    ],
)
def test_slender_solids_get_several_points(shape: Shape, count: int, width: float) -> None:
    """From 1.5 times as long as wide on; one for each width, and at most four."""
    where = along_links(carrying(shape))
    assert len(where) == count
    np.testing.assert_allclose(where.radii, width)


def test_points_lie_on_the_longest_axis_from_end_to_end() -> None:
    T = random_transform(np.random.default_rng(2), 0.3)
    where = along_links(carrying(Box(np.array([0.1, 0.7, 0.12])), T))
    local = (where.places - T[:3, 3]) @ T[:3, :3]
    np.testing.assert_allclose(local[:, [0, 2]], 0.0, atol=1e-12)
    # The balls of the outermost end where the box does, and all are as far apart.
    np.testing.assert_allclose(local[:, 1], np.linspace(-0.29, 0.29, 4), atol=1e-12)
    assert set(where.joints) == {1}


def test_what_stands_still_and_what_is_endless_has_no_points() -> None:
    """A robot without any solid that moves is pulled by its frame origins."""
    chain = slider().chain
    origins = origin_points(chain)
    still = carrying(Sphere(0.1), joint=-1)
    endless = carrying(HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0))
    none = np.zeros(0, dtype=np.int64)
    bare = RobotGeometry(chain, (), (), none, none, {})
    for robot in (still, endless, bare):
        where = along_links(robot)
        np.testing.assert_array_equal(where.places, origins.places)
        np.testing.assert_array_equal(where.joints, origins.joints)
        assert not where.radii.any()


@pytest.mark.parametrize("name", builtin_names())
def test_every_moving_solid_has_its_points_in_the_order_of_the_solids(name: str) -> None:
    robot = builtin(name)
    where, first = along_links(robot), 0
    for piece, joint in zip(robot.pieces, robot.joints, strict=True):
        if joint < 0:
            continue
        T, box = piece.T_owner_piece, piece.local_box()
        _, width, longest = np.sort(box[3:])
        count = min(int(np.ceil(longest / width)), 4) if longest > 1.5 * width else 1
        local = (where.places[first : first + count] - T[:3, 3]) @ T[:3, :3] - box[:3]
        assert (np.abs(local) <= box[3:] + 1e-12).all()
        np.testing.assert_allclose(
            np.abs(local).max(initial=0.0), longest - width if count > 1 else 0.0, atol=1e-12
        )
        assert set(where.joints[first : first + count]) == {joint}
        np.testing.assert_allclose(where.radii[first : first + count], width)
        first += count
    assert first == len(where)


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

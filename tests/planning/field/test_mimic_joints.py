"""Links that mimic feel the field: forces against differences of the potential, and a descent."""

import numpy as np
import pytest

from kinematics.pose import transform
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.projection.projection import Projector
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.field.control_points import along_links, control_points
from planning.field.field_kernels import value_kernel
from planning.field.options import FieldOptions
from planning.field.planner import potential_field
from planning.field.potential import Field
from planning.field.weights import FieldWeights
from planning.values.deadline import Deadline
from tests.mimic_joints import configurations, urdf
from tests.planning.field.test_potential import near_a_kink, slope

REACH = 0.3


@pytest.fixture(scope="module")
def robot() -> RobotGeometry:
    description = parse_urdf(urdf())
    return robot_geometry(serial_chain(description, tip_link="flange"), description)


def test_force_is_minus_the_slope_where_only_a_mimic_joint_is_near(robot: RobotGeometry) -> None:
    chain, where = robot.chain, along_links(robot)
    carried = np.flatnonzero(where.joints >= chain.n)
    assert set(where.joints[carried]) == set(range(chain.n, chain.n + len(chain.mimic_joints)))
    random = np.random.default_rng(3)
    felt = set()
    states, goals = configurations(200, 1), configurations(200, 2)
    for q, goal in zip(states, goals, strict=True):
        near = random.choice(carried)
        center = control_points(chain, where, q)[0][near] + random.normal(0.0, 0.12, 3)
        ball = Obstacle("ball", Sphere(0.02), transform(None, center))
        weights = FieldWeights(attractive_cap=0.3, influence_distance=REACH)
        field = Field(chain, where, Projector((ball,)), goal, weights, 0.2)
        value = field.at(q)
        if near_a_kink(field, q, REACH) or value.distances.min() < 0.01:
            continue
        if value.distances[near] < REACH:
            felt.add(int(where.joints[near]))
        expected = -slope(field, q)
        assert value.joint_force == pytest.approx(expected, rel=1e-5, abs=1e-5)
        force = np.empty(chain.n)
        assert value_kernel(field.model, q.copy(), force) == pytest.approx(value.potential)
        assert force == pytest.approx(value.joint_force, abs=1e-10)
    # Every mimic joint was pushed at.
    assert felt == set(range(chain.n, chain.n + len(chain.mimic_joints)))


def test_the_descent_stops_before_what_a_mimic_joint_would_hit(robot: RobotGeometry) -> None:
    # j1 turns the drum behind the base by twice its angle; at -pi / 2 it points at the ball.
    start, goal = np.zeros(6), np.zeros(6)
    start[0], goal[0] = -1.2, -1.95
    ball = Obstacle("ball", Sphere(0.04), transform(None, [-0.7, 0.0, 0.3]))
    for obstacles, is_free in (((), True), ((ball,), False)):
        scene = Scene(obstacles)
        checker = Checker.of(robot, scene)
        assert checker.valid(start)
        assert checker.valid(goal)
        assert checker.valid(0.5 * (start + goal)) == is_free
        result = potential_field(
            robot, checker, scene, start, [goal], FieldOptions(), 0, Deadline.after(30.0)
        )
        assert (result.waypoints is not None) == is_free
        assert checker.each_valid(result.visited).all()

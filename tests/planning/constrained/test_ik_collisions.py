"""Collisions in constrained inverse kinematics: own links, meshes, and when enough is found."""

import numpy as np
import trimesh

from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.constrained.ik import IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.joint import JointConstraint
from planning.constraints.kinds.limit import ClearanceConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import SphereRegion
from planning.constraints.solvers.active_set_program import search_arrays, without_surfaces
from tests.obstacles.collision.test_fcl_distance import slide
from tests.obstacles.distance.triangles.test_distance import apart, mesh
from tests.obstacles.meshes.test_decomposition import ring
from tests.planning.scenes import builtin

UR5E = builtin("ur5e")
#: A ring on a rail along x whose hole is 0.398 m wide, and a ball that has 28 mm to spare in it.
RING = slide(*mesh(ring()).pieces())
BALL = Scene((Obstacle("ball", Sphere(0.37)),))


def at_x(x: float, width: float) -> ConstraintSet:
    return ConstraintSet(RING.chain, (JointConstraint("x", x, width, width),))


def test_own_links_are_apart_without_a_scene() -> None:
    """A ball beside the base that the tip reaches by folding the forearm into it, or without."""
    place = PositionConstraint(SphereRegion(np.array([0.0, -0.2, 0.1]), 0.005))
    wanted, free = ConstraintSet(UR5E.chain, (place,)), Checker.of(UR5E, Scene(()))
    for seed in range(8):
        answer = constrained_ik(UR5E, wanted, None, IkOptions(seed=seed, starts=30))
        for solution in answer.solutions:
            assert free.valid(solution.joints)
        assert answer.solutions


def test_a_seed_in_a_hollow_is_not_led_out_of_it() -> None:
    """What covers the ring is struck by the ball; its triangles are not."""
    seed = IkOptions(seed_joints=np.array([0.01]))
    (solution,) = constrained_ik(RING, at_x(0.0, 0.5), BALL, seed).solutions
    assert abs(solution.joints[0] - 0.01) < 1e-6
    sphere = trimesh.creation.icosphere(4, 0.37)
    turn = np.eye(4)
    turn[0, 3] = solution.joints[0]
    assert apart(ring(), turn, sphere, np.eye(4)) > 0.0


def test_a_hollow_is_found_from_outside() -> None:
    """Only starts that keep triangles apart arrive where covers overlap the ball."""
    how = IkOptions(seed_joints=np.array([2.0]), starts=40)
    answer = constrained_ik(RING, at_x(0.0, 0.02), BALL, how)
    assert answer.solutions
    assert 1 < answer.starts < 40


def test_covers_are_solids_where_surfaces_are_left_out() -> None:
    model = Checker.of(RING, BALL).model
    arrays = search_arrays(model, 1e-6)
    bare = without_surfaces(arrays)
    assert without_surfaces(bare._replace(surfaces=bare.surfaces[:0])).robot is bare.robot
    assert (arrays.robot != bare.robot).any()
    assert bare.margin == arrays.margin


def test_more_solutions_than_there_are_do_not_cost_all_starts() -> None:
    answer = constrained_ik(RING, at_x(0.0, 1e-5), BALL, IkOptions(most=2, starts=1000))
    assert len(answer.solutions) == 1
    assert answer.starts < 60


def test_clearance_is_kept_from_obstacles_by_meshes() -> None:
    wanted = ConstraintSet(
        RING.chain, (JointConstraint("x", 0.0, 0.5, 0.5), ClearanceConstraint(0.02))
    )
    how = IkOptions(seed_joints=np.array([0.02]))
    (solution,) = constrained_ik(RING, wanted, BALL, how).solutions
    assert Checker.of(RING, BALL, 0.02).valid(solution.joints)

"""The proof for a robot with links that mimic: bounds of their motion, and what they prove."""

from typing import Any

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Scene
from planning.proof.collision import pair_table
from planning.proof.collision.collision_proof import CollisionProof
from planning.proof.collision.displacement import (
    MOVE_COLUMNS,
    MOVED,
    displacement_along,
    displacement_bounds,
    meeting_body,
)
from planning.proof.collision.pair_table import PairArrays, PairTable
from planning.proof.joint_frames import forward_kernel, mimic_frames
from planning.proof.motion_bounds import (
    JOINT_COLUMNS,
    PARENT,
    RADIUS,
    TYPE,
    VALUE,
    enclose,
    enclose_mimic_joints,
)
from tests.mimic_joints import configurations, mimic_positions, mimic_robot, urdf
from tests.obstacles.test_mimic_joints import scene

#: Instants at which a motion is looked at.
_SAMPLES = 120


@pytest.fixture
def robot() -> RobotGeometry:
    return mimic_robot()


def motion(robot: RobotGeometry, seed: int) -> Trajectory:
    """Two joined cubics through free configurations, from a tenth to all of the joints' range."""
    random = np.random.default_rng(seed)
    a, b, c = configurations(3, seed)
    b, c = a + (b - a) * random.uniform(0.1, 1.0), a + (c - a) * random.uniform(0.1, 1.0)
    rate = random.uniform(-1.0, 1.0, 6)
    zero = np.zeros(6)
    pieces = [_cubic(a, zero, b, rate), _cubic(b, rate, c, zero)]
    return Trajectory(robot.chain.joint_names, np.array([0.0, 1.0, 2.0]), np.array(pieces))


def _cubic(a: Array, v: Array, b: Array, w: Array) -> Array:
    """Coefficients (6, 4) on a second, from positions and velocities at both ends."""
    return np.stack([a, v, 3.0 * (b - a) - 2.0 * v - w, 2.0 * (a - b) + v + w], axis=1)


def enclosed(arrays: PairArrays, trajectory: Trajectory, at: float, half: float) -> Array:
    joints = np.empty((arrays.bodies.shape[1], JOINT_COLUMNS))
    coefficients = trajectory.coefficients[0]
    enclose(coefficients, at, half, np.empty((2, coefficients.shape[1])), joints)
    enclose_mimic_joints(arrays.leaders, arrays.leads, joints)
    return joints


def test_frames_of_the_proof_are_those_of_the_chain(robot: RobotGeometry) -> None:
    arrays = PairTable.of(robot, Scene(), 0.0).arrays
    for q in configurations(20, 6):
        joints = np.zeros((arrays.bodies.shape[1], JOINT_COLUMNS))
        joints[:6, VALUE] = q
        enclose_mimic_joints(arrays.leaders, arrays.leads, joints)
        names = [mimic.name for mimic in robot.chain.mimic_joints]
        positions = mimic_positions(q)
        np.testing.assert_allclose(joints[6:, VALUE], [positions[name] for name in names])
        frames = np.zeros((arrays.bodies.shape[1], 4, 4))
        frames[:, 3, 3] = 1.0
        forward_kernel(arrays.bodies[TYPE], arrays.offsets, joints[:6, VALUE], frames)
        mimic_frames(arrays.bodies, arrays.offsets, 6, joints[:, VALUE], frames)
        np.testing.assert_allclose(frames, joint_frames(robot.chain, q), atol=1e-14)


def farthest(robot: RobotGeometry, still_mimics: bool) -> float:
    """Largest of |displacement| / bound for balls on bodies, seen from bodies they hang on.

    Args:
        robot: The robot.
        still_mimics: Whether the bounds know that mimic joints move.
    """
    arrays, chain = PairTable.of(robot, Scene(), 0.0).arrays, robot.chain
    random, worst, count = np.random.default_rng(8), 0.0, arrays.bodies.shape[1]
    for case in range(80):
        trajectory = motion(robot, case)
        half = float(0.5 * 10.0 ** -random.uniform(0.0, 3.0))
        at = float(random.uniform(half, 1.0 - half))
        joints = enclosed(arrays, trajectory, at, half)
        if not still_mimics:
            joints[6:, RADIUS:] = 0.0
        frames = joint_frames(chain, joints[:6, VALUE])
        carrier, still = int(random.integers(6, count)), -1
        way = [carrier]
        while way[-1] >= 0:
            way.append(int(arrays.bodies[PARENT, way[-1]]))
        still = int(random.choice(way[1:]))
        radius, local = float(random.uniform(0.0, 0.2)), np.append(random.normal(size=3) * 0.3, 1.0)
        center = (frames[carrier] @ local)[:3]
        moves = np.zeros((count, MOVE_COLUMNS))
        x, y, z = (float(value) for value in center)
        ball, every = ((x, y, z), radius), np.ones(count, dtype=np.bool_)
        displacement_bounds(arrays.bodies, frames, ball, carrier, joints, half, every, moves)
        offsets = random.normal(size=(12, 3))
        offsets *= radius / np.linalg.norm(offsets, axis=1, keepdims=True)
        inside = np.concatenate([offsets, np.zeros((12, 1))], axis=1)
        points = local + inside @ np.linalg.inv(frames[carrier]).T
        base = np.eye(4) if still < 0 else frames[still]
        start = (frames[carrier] @ points.T)[:3]
        for time in np.linspace(at - half, at + half, 15):
            then = joint_frames(chain, trajectory.sample([min(max(time, 0.0), 1.0)])[0])
            seen = np.eye(4) if still < 0 else then[still]
            moved = (base @ np.linalg.inv(seen) @ then[carrier] @ points.T)[:3] - start
            bound = moves[still + 1, MOVED] + 1e-12
            worst = max(worst, float(np.linalg.norm(moved, axis=0).max()) / bound)
            for towards in random.normal(size=(6, 3)):
                u = towards / np.linalg.norm(towards)
                along = displacement_along(moves, still + 1, radius, half, (u[0], u[1], u[2]))
                worst = max(worst, float(np.abs(u @ moved).max()) / (along + 1e-12))
    return worst


def test_no_point_of_a_mimic_joint_moves_farther_than_its_bounds(robot: RobotGeometry) -> None:
    assert 0.9 < farthest(robot, True) <= 1.0


def test_bounds_without_the_mimic_are_found_to_be_too_small(robot: RobotGeometry) -> None:
    assert farthest(robot, False) > 1.5


def test_bodies_meet_where_both_hang(robot: RobotGeometry) -> None:
    bodies = PairTable.of(robot, Scene(), 0.0).arrays.bodies
    number = {link.name: link.joint for link in robot.chain.links}
    for one, other, meeting in (
        ("turret", "crank", "turret"), ("crank", "rod", "crank"), ("rod", "fore", "turret"),
        ("cover", "flange", "fore"), ("flap", "piston", "upper"), ("drum", "turret", "base"),
    ):  # fmt: skip
        for a, b in ((one, other), (other, one)):
            assert meeting_body(bodies, number[a], number[b]) == number[meeting]


def wrong_proofs(robot: RobotGeometry, first: int, count: int) -> tuple[int, int, int]:
    """Motions whose proof says more than dense samples do, that are proved, and that collide."""
    wrong, proved, colliding = 0, 0, 0
    for seed in range(first, first + count):
        trajectory, around = motion(robot, seed), scene(seed)
        proof = CollisionProof(trajectory, robot, around, 0.0, None)
        proof.run()
        judge, own = FclJudge(robot, around), Checker.of(robot, Scene())
        if proof.violation is not None:
            colliding += 1
            q = trajectory.sample([proof.violation.time])[0]
            # The first contact is told, which need not be an overlap yet.
            wrong += min(judge.obstacle_distance(q), own.clearance(q)[0]) > 1e-6
            continue
        proved += 1
        states = trajectory.sample(np.linspace(0.0, 2.0, _SAMPLES))
        from_obstacles, among_links = proof.clearances
        least = min(judge.obstacle_distance(q) for q in states)
        between = min(own.clearance(q)[0] for q in states)
        wrong += from_obstacles > least + 1e-6 or among_links > between + 1e-6
        wrong += any(judge.collides(q) for q in states[::4])
    return wrong, proved, colliding


@pytest.mark.parametrize("first", range(0, 200, 50))
def test_proved_clearance_is_a_lower_bound_of_fcls(robot: RobotGeometry, first: int) -> None:
    wrong, proved, colliding = wrong_proofs(robot, first, 50)
    assert wrong == 0
    assert proved >= 8
    assert colliding >= 8


def _still(arrays: PairArrays) -> dict[str, Any]:
    return {"leads": arrays.leads * [0.0, 1.0]}


def _half(arrays: PairArrays) -> dict[str, Any]:
    return {"leads": arrays.leads * [0.5, 1.0]}


def _on_leaders(arrays: PairArrays) -> dict[str, Any]:
    bodies = arrays.bodies.copy()
    bodies[PARENT, 6:] = arrays.leaders
    return {"bodies": bodies}


@pytest.mark.parametrize("lie", [_still, _half, _on_leaders])
def test_a_proof_that_forgets_the_mimic_is_found_out(
    robot: RobotGeometry, monkeypatch: pytest.MonkeyPatch, lie: Any
) -> None:
    truth = pair_table._arrays

    def told(*asked: Any) -> PairArrays:
        arrays = truth(*asked)
        return arrays._replace(**lie(arrays))

    monkeypatch.setattr(pair_table, "_arrays", told)
    assert wrong_proofs(robot, 0, 25)[0] > 0


def test_without_mimic_joints_the_table_has_none(robot: RobotGeometry) -> None:
    description = parse_urdf(urdf(()))
    plain = robot_geometry(serial_chain(description), description)
    arrays = PairTable.of(plain, Scene(), 0.0).arrays
    assert arrays.leaders.shape == (0,)
    assert arrays.leads.shape == (0, 2)
    np.testing.assert_array_equal(arrays.bodies[PARENT], np.arange(-1, 5))

"""The certificate beside a sweep by FCL alone, on motions chosen to make it lie."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.model.chain import Limits
from kinematics.pose import from_axis_angle, transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.fcl_distance import FclWorld
from obstacles.convex.piece import Piece
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Capsule, Cone, Convex, Cylinder, HalfSpace, Shape, Sphere
from planning.proof.certificate import Certificate, certify
from planning.proof.collision.pair_table import PairTable
from planning.proof.collision.sweep import DONE, FULL, PAUSED, run
from planning.proof.collision.sweep_state import enlarge
from tests.obstacles.collision.test_fcl_distance import slide
from tests.planning.fcl_sweep import sweep
from tests.planning.proof.sweeping import start_sweep
from tests.planning.scenes import box, builtin


def unlimited(robot: RobotGeometry) -> RobotGeometry:
    """The same robot without limits: only collisions are of interest here."""
    chain = robot.chain
    none = np.full(chain.n, np.inf)
    limits = Limits(-none, none, none, none, none, none)
    return replace(robot, chain=replace(chain, limits=limits))


def collision(certificate: Certificate) -> bool:
    violation = certificate.violation
    return violation is not None and violation.kind in ("collision", "undecided")


def random_shape(random: np.random.Generator) -> Shape:
    """Thin, tiny and usual ones."""
    size = 10.0 ** random.uniform(-3.5, -0.7, 3)
    normal = random.normal(size=3)
    shapes = (
        Box(size),
        Sphere(size[0]),
        Cylinder(size[0], 10.0 * size[1]),
        Capsule(size[0], 10.0 * size[1]),
        Cone(size[0], 10.0 * size[1]),
        Convex(random.normal(size=(random.integers(1, 12), 3)) * size[0]),
        HalfSpace(normal, -random.uniform(0.4, 1.2)),
    )
    return shapes[random.integers(len(shapes))]


def random_scene(random: np.random.Generator, robot: RobotGeometry, start: Array) -> Scene:
    obstacles = []
    for k in range(random.integers(1, 4)):
        rotation = from_axis_angle(random.normal(size=3), random.uniform(0.0, np.pi))
        T = transform(rotation, random.normal(size=3) * 0.5)
        margin = float(random.choice([0.0, 0.01]))
        obstacles.append(Obstacle(f"thing{k}", random_shape(random), T, margin))
    own = {hit.pair for hit in FclWorld(robot, Scene()).collisions(start)}
    return Scene(tuple(obstacles), frozenset(own))


def random_motion(random: np.random.Generator, robot: RobotGeometry) -> Trajectory:
    """Up to degree 16, from a crawl to many turns a second."""
    n = robot.chain.n
    lower, upper = builtin(robot.chain.name).chain.sampling_bounds()
    pieces, size = int(random.integers(1, 4)), int(random.choice([2, 3, 4, 6, 17]))
    breaks = np.concatenate([[0.0], np.cumsum(10.0 ** random.uniform(-2.0, 0.3, pieces))])
    reach = 10.0 ** random.uniform(-2.0, 0.6)
    coefficients = np.zeros((pieces, n, size))
    value, rate = random.uniform(lower, upper), random.normal(size=n)
    for i in range(pieces):
        length = breaks[i + 1] - breaks[i]
        powers = length ** np.arange(size)
        coefficients[i] = random.normal(size=(n, size)) * reach / (size * powers)
        coefficients[i, :, 0], coefficients[i, :, 1] = value, rate
        value = coefficients[i] @ powers
        rate = (coefficients[i, :, 1:] * np.arange(1, size)) @ powers[:-1]
    return Trajectory(robot.chain.joint_names, breaks, coefficients)


@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford", "scara", "planar_rr"])
def test_same_verdict_as_fcl_alone(name: str) -> None:
    robot = unlimited(builtin(name))
    random = np.random.default_rng(11)
    proved = refused = 0
    for _ in range(6 if name == "panda" else 10):
        motion = random_motion(random, robot)
        scene = random_scene(random, robot, motion.start)
        margin = float(random.choice([0.0, 0.005]))
        certificate = certify(motion, robot, scene, margin=margin)
        oracle = sweep(motion, robot, scene, margin)
        assert collision(certificate) is (oracle.contact is not None)
        if oracle.contact is None:
            proved += 1
            continue
        refused += 1
        violation = certificate.violation
        assert violation is not None
        assert violation.time == pytest.approx(oracle.contact, abs=1e-4 * motion.duration)
        assert violation.details["distance"] <= violation.details["margin"] + 3e-7
    assert proved
    assert refused


def test_directions_from_a_liar_prove_nothing_that_is_false() -> None:
    """The sweep is given random, opposite and broken directions after every few cells."""
    robot = unlimited(builtin("ur5e"))
    random = np.random.default_rng(13)
    for _ in range(6):
        motion = random_motion(random, robot)
        scene = random_scene(random, robot, motion.start)
        table = PairTable.of(robot, scene, 0.0)
        sweeping, state = start_sweep(motion, table.arrays), PAUSED
        while state in (PAUSED, FULL):
            sweeping = enlarge(sweeping) if state == FULL else sweeping
            sweeping.directions[:] = random.normal(size=sweeping.directions.shape)
            sweeping.directions[random.random(len(sweeping.directions)) < 0.2] = np.nan
            sweeping.nearest[:] = random.normal(size=2)
            state = run(
                table.arrays,
                motion.breaks,
                motion.coefficients,
                sweeping,
                bool(random.random() < 0.5),
                3,
            )
        if state == DONE:
            assert sweep(motion, robot, scene).contact is None


def rail(*pieces: Piece) -> RobotGeometry:
    """Solids on an endless rail along x."""
    return unlimited(slide(*pieces))


def along(*coefficients: float, duration: float = 1.0) -> Trajectory:
    return Trajectory(("x",), np.array([0.0, duration]), np.array([[coefficients]]))


@pytest.mark.parametrize("gap", [1e-3, 1e-5, 1e-6])
@pytest.mark.parametrize("margin", [0.0, 0.02])
def test_a_sphere_that_turns_back_just_before_contact(gap: float, margin: float) -> None:
    """x = 4 s (1 - s) reaches 1 at s = 1/2 and no sample need be there."""
    robot = rail(*Sphere(0.1).pieces())
    for sign in (1.0, -1.0):
        center = 1.0 + 0.1 + 0.2 + margin + sign * gap
        ball = Obstacle("ball", Sphere(0.2), transform(None, [center, 0.0, 0.0]))
        certificate = certify(along(0.0, 4.0, -4.0), robot, Scene((ball,)), margin=margin)
        assert certificate.verified is (sign > 0.0)
        if sign > 0.0:
            true = margin + gap
            assert 0.79 * min(true, 0.05) <= certificate.min_obstacle_clearance <= true
        else:
            assert certificate.violation is not None
            first = 0.5 - 0.5 * np.sqrt(gap)
            assert certificate.violation.time == pytest.approx(first, abs=1e-4)


@pytest.mark.parametrize("distance", [0.0, 1e-9, -1e-9])
def test_contact_to_the_last_digit_is_refused(distance: float) -> None:
    robot = rail(*Box(np.array([0.2, 0.2, 0.2])).pieces())
    for margin in (0.0, 0.05):
        wall = Obstacle("wall", HalfSpace(np.array([-1.0, 0.0, 0.0]), -(1.1 + margin + distance)))
        certificate = certify(along(0.0, 4.0, -4.0), robot, Scene((wall,)), margin=margin)
        if certificate.verified:
            # To second order a parabola is told exactly: a nanometre can be proved.
            assert margin < certificate.min_obstacle_clearance <= margin + distance
            continue
        assert certificate.violation is not None
        assert certificate.violation.time == pytest.approx(0.5, abs=2e-4)


def test_touching_start_and_goal_are_told() -> None:
    robot = rail(*Box(np.array([0.2, 0.2, 0.2])).pieces())
    wall = Scene((Obstacle("wall", HalfSpace(np.array([-1.0, 0.0, 0.0]), -1.1)),))
    start = certify(along(1.0, -1.0), robot, wall).violation
    goal = certify(along(0.0, 1.0), robot, wall).violation
    assert start is not None
    assert goal is not None
    assert (start.time, start.details["at"]) == (0.0, "start")
    assert "at the start" in start.message
    assert goal.time == pytest.approx(1.0, abs=1e-6)
    assert goal.details["at"] == "goal"


def test_thin_blade_and_fast_spin() -> None:
    """A rod that turns hundreds of times passes a blade a tenth of a millimetre thick."""
    rod = Piece(Sphere(1.0).pieces()[0].kind, np.eye(4), np.array([[0.0, 0, 0], [1.0, 0, 0]]))
    slid = rail(rod)
    about_z = replace(slid.chain, joint_types=np.array([0]), offsets=np.eye(4)[None])
    robot = replace(slid, chain=about_z, pieces=(rod,))
    for turns in (0.3, 3.0, 300.0):
        spin = along(0.0, 2.0 * np.pi * turns)
        blade = box("blade", (0.05, 1e-4, 0.05), (-0.9, 0.05, 0.0))
        hit = certify(spin, robot, Scene((blade,)))
        passes = turns > 0.49
        assert hit.verified is not passes
        if passes:
            assert hit.violation is not None
            at = 2.0 * np.pi * turns * hit.violation.time
            assert at == pytest.approx(np.pi - np.arctan2(0.05005, 0.875), abs=0.02)
        beside = box("blade", (0.05, 1e-4, 0.05), (1.03, 0.05, 0.0))
        over = certify(spin, robot, Scene((beside,)))
        assert over.verified
        assert over.min_obstacle_clearance >= 0.79 * 0.004


def test_earliest_of_many_contacts_is_named() -> None:
    robot = rail(*Sphere(0.05).pieces())
    posts = [0.9, 0.3, 0.6, 0.300001]
    scene = Scene(
        tuple(
            Obstacle(f"post {x}", Cylinder(0.01, 1.0), transform(None, [x, 0.0, 0.0]))
            for x in posts
        )
    )
    pieces = 40
    breaks = np.linspace(0.0, 1.0, pieces + 1)
    c = np.stack([breaks[:-1], np.ones(pieces)], axis=-1)[:, None, :]
    violation = certify(Trajectory(("x",), breaks, c), robot, scene).violation
    assert violation is not None
    assert violation.details["pair"] == ["car", "post 0.3"]
    assert violation.time == pytest.approx(0.24, abs=1e-6)


def test_jump_into_an_obstacle_between_pieces_is_seen() -> None:
    robot = rail(*Sphere(0.05).pieces())
    ball = Scene((Obstacle("ball", Sphere(0.05), transform(None, [1.0, 0.0, 0.0])),))
    breaks, c = np.linspace(0.0, 1.0, 6), np.zeros((5, 1, 2))
    c[2, 0] = [0.95, 0.0]
    violation = certify(Trajectory(("x",), breaks, c), robot, ball).violation
    assert violation is not None
    assert violation.time == pytest.approx(0.4)
    c[2, 0] = [0.0, 0.0]
    assert certify(Trajectory(("x",), breaks, c), robot, ball).verified

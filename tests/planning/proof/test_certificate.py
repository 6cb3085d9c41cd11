"""The certificate: what it proves holds, what it refuses is wrong, and it says when and where."""

import re

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory, interpolate
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace, PointCloud
from planning.proof.certificate import certify
from planning.proof.limits.limits import check_limits
from planning.values.deadline import Deadline
from planning.values.limits import EffortLimits, MotionLimits
from tests.planning.dense import least_clearance
from tests.planning.scenes import HOME, box, builtin, pillar, shelf

NO_LIMITS = MotionLimits({q: np.full(2, np.inf) for q in ("velocity", "acceleration", "jerk")})


def cubic(robot: RobotGeometry, start: Array, end: Array, duration: float = 2.0) -> Trajectory:
    """Rest to rest along a straight line."""
    step = (end - start) / duration**2
    rows = [start, np.zeros_like(start), 3.0 * step, -2.0 * step / duration]
    coefficients = np.stack(rows, axis=-1)[None]
    return Trajectory(robot.chain.joint_names, np.array([0.0, duration]), coefficients)


@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford", "scara", "planar_rr"])
def test_clearance_is_a_sharp_lower_bound(name: str) -> None:
    robot = builtin(name)
    lower, upper = robot.chain.sampling_bounds()
    random = np.random.default_rng(1)
    proved = refused = 0
    for _ in range(25):
        scene = pillar(random.uniform(-3.0, 3.0), random.uniform(0.3, 0.8))
        a, b = lower + random.uniform(0.1, 0.9, (2, robot.chain.n)) * (upper - lower)
        trajectory = cubic(robot, a, a + (b - a) * random.uniform(0.05, 0.5), 5.0)
        certificate = certify(trajectory, robot, scene)
        dense = least_clearance(trajectory, robot, scene, samples=400)
        if certificate.violation is None or certificate.violation.kind != "collision":
            proved += 1
            assert 0.0 < certificate.min_clearance <= dense + 1e-7
            assert certificate.min_clearance >= min(0.9 * dense, 0.179)
        else:
            refused += 1
            at = trajectory.sample([certificate.violation.time])[0]
            distance = FclWorld(robot, scene).clearance(at).distance
            assert distance <= 1e-6
    assert proved > 2


def test_points_of_a_cloud_take_no_more_cells_than_spheres() -> None:
    """Wherever the cloud's frame is: a witness is looked for where the points are."""
    robot = builtin("panda")
    lower, upper = robot.chain.sampling_bounds()
    random = np.random.default_rng(3)
    cells = np.zeros((2, 12))
    for k in range(12):
        points = random.uniform([0.2, -0.3, 0.2], [0.8, 0.3, 0.8], (20, 3))
        T = transform(None, random.uniform(-0.5, 0.5, 3))
        cloud = Scene((Obstacle("cloud", PointCloud(points - T[:3, 3], 0.01), T),))
        spheres = Scene(
            tuple(
                Obstacle(f"{i}", PointCloud(np.zeros((1, 3)), 0.01), transform(None, p))
                for i, p in enumerate(points)
            )
        )
        a, b = lower + random.uniform(0.1, 0.9, (2, robot.chain.n)) * (upper - lower)
        trajectory = cubic(robot, a, a + 0.3 * (b - a), 5.0)
        proofs = [certify(trajectory, robot, scene) for scene in (cloud, spheres)]
        cells[:, k] = [proof.cells for proof in proofs]
        assert proofs[0].min_obstacle_clearance == pytest.approx(
            proofs[1].min_obstacle_clearance, rel=0.25, abs=1e-6
        )
    assert cells.max() < 3000.0
    assert np.all(cells[0] <= 1.5 * cells[1] + 20.0)


def test_collision_between_coarse_samples_is_found() -> None:
    """A thin rod that an arm passes at speed: a look every tenth of a second misses it."""
    robot = builtin("planar_rr")
    trajectory = cubic(robot, np.array([-1.0, 0.0]), np.array([1.0, 0.0]), 1.0)
    missed = 0
    for angle in np.linspace(-0.9, 0.9, 40):
        rod = Scene((box("rod", (0.004, 0.5, 0.004), _around(robot, angle)),))
        certificate = certify(trajectory, robot, rod, limits=NO_LIMITS)
        assert certificate.violation is not None
        assert certificate.violation.kind == "collision"
        assert certificate.violation.details["pair"][1] == "rod"
        at = trajectory.sample([certificate.violation.time])[0]
        assert FclWorld(robot, rod).clearance(at).distance <= 1e-6
        missed += least_clearance(trajectory, robot, rod, samples=11) > 0.0
    assert missed > 5


def _around(robot: RobotGeometry, angle: float) -> tuple[float, float, float]:
    """A point that the stretched arm passes when its first joint is at ``angle``."""
    pose = forward(robot.chain, np.array([angle, 0.0]))
    center = robot.chain.offsets[0, :3, 3]
    point = center + 0.85 * (pose[:3, 3] - center)
    return float(point[0]), float(point[1]), float(point[2])


def test_margin_is_held_from_obstacles_not_between_links() -> None:
    robot = builtin("panda")
    trajectory = cubic(robot, HOME, HOME + 0.2)
    free = certify(trajectory, robot, Scene())
    assert free.verified
    floor = Scene((Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0)),))
    near = certify(trajectory, robot, floor)
    distance = near.min_clearance
    # The robot's own links are this close; a larger margin asks nothing of them.
    assert certify(trajectory, robot, Scene(), margin=10.0).verified
    to_floor = least_clearance(trajectory, robot, floor, margin=0.0)
    assert to_floor >= distance - 1e-7
    refused = certify(trajectory, robot, floor, margin=1.0)
    assert refused.violation is not None
    assert refused.violation.kind == "collision"
    assert refused.violation.details["margin"] == 1.0
    assert "m apart, 1 m are asked for" in refused.violation.message


def test_violations_say_overlap_where_solids_overlap() -> None:
    robot = builtin("planar_rr")
    trajectory = cubic(robot, np.array([0.0, 0.0]), np.array([0.1, 0.0]))
    post = Scene((box("post", (0.1, 0.1, 0.5), _around(robot, 0.05)),))
    certificate = certify(trajectory, robot, post, limits=NO_LIMITS)
    assert certificate.violation is not None
    overlap = re.search(r"overlap by ([0-9.]+) m at the start", certificate.violation.message)
    assert overlap is not None
    depth = FclWorld(robot, post).clearance(trajectory.start).distance
    assert float(overlap[1]) == pytest.approx(-depth, abs=1e-4)


def test_clearances_from_obstacles_and_of_the_robot_itself_are_told_apart() -> None:
    robot = builtin("panda")
    trajectory = cubic(robot, HOME, HOME + 0.2)
    alone = certify(trajectory, robot, Scene())
    assert alone.min_obstacle_clearance == np.inf
    assert alone.min_self_clearance == alone.min_clearance
    for height in (-0.3, -0.01):
        floor = Scene((Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), height)),))
        both = certify(trajectory, robot, floor)
        assert both.min_self_clearance == pytest.approx(alone.min_self_clearance, rel=0.3)
        least = min(both.min_obstacle_clearance, both.min_self_clearance)
        assert both.min_clearance == least
        assert both.clearance_pair is not None
        with_floor = "floor" in both.clearance_pair
        assert with_floor is (both.min_obstacle_clearance < both.min_self_clearance)


def test_limits_are_decided_by_exact_extrema() -> None:
    robot = builtin("panda")
    names = robot.chain.joint_names
    velocity = robot.chain.limits.velocity[0]
    # A cubic's top speed is 1.5 times its mean speed.
    for excess, expected in ((1e-6, False), (-1e-6, True)):
        duration = 1.5 * 0.5 / (velocity * (1.0 + excess))
        end = HOME.copy()
        end[0] += 0.5
        certificate = certify(
            cubic(robot, HOME, end, duration), robot, Scene(),
            limits=MotionLimits({"acceleration": np.full(7, np.inf), "jerk": np.full(7, np.inf)}),
        )  # fmt: skip
        assert certificate.verified is expected
        assert certificate.limits["velocity"].worst_ratio == pytest.approx(1.0 + excess, abs=1e-9)
        assert certificate.limits["velocity"].joint == names[0]
        assert certificate.limits["velocity"].time == pytest.approx(duration / 2.0)
        if not expected:
            assert certificate.violation is not None
            assert certificate.violation.kind == "velocity"
            assert certificate.violation.details["joint"] == names[0]


def test_position_limit_between_samples() -> None:
    robot = builtin("panda")
    upper = robot.chain.limits.upper[0]
    start = HOME.copy()
    start[0] = upper - 0.1
    coefficients = np.zeros((1, 7, 3))
    coefficients[0, :, 0] = start
    coefficients[0, 0, 1:] = [1.0, -1.0]  # out by 0.25 at half a second and back
    trajectory = Trajectory(robot.chain.joint_names, np.array([0.0, 1.0]), coefficients)
    certificate = certify(trajectory, robot, Scene())
    assert certificate.violation is not None
    assert certificate.violation.kind == "position"
    # It goes out where t - t^2 = 0.1.
    assert certificate.violation.time == pytest.approx(0.5 * (1.0 - 0.6**0.5))
    assert certificate.violation.details["value"] == pytest.approx(upper + 0.15)


def test_jumps_are_refused() -> None:
    robot = builtin("panda")
    coefficients = np.zeros((2, 7, 1))
    coefficients[0, :, 0] = HOME
    coefficients[1, :, 0] = HOME + 1e-3
    trajectory = Trajectory(robot.chain.joint_names, np.array([0.0, 1.0, 2.0]), coefficients)
    certificate = certify(trajectory, robot, Scene())
    assert certificate.violation is not None
    assert certificate.violation.kind == "continuity"
    assert certificate.violation.time == 1.0
    assert certificate.continuity["position"] == pytest.approx(1e-3)


def test_first_violation_in_time_is_named() -> None:
    robot = builtin("panda")
    end = HOME.copy()
    end[0] += 2.5
    scene = pillar(1.2, 0.33)
    slow = certify(cubic(robot, HOME, end, 20.0), robot, scene)
    assert slow.violation is not None
    assert slow.violation.kind == "collision"
    first = slow.violation.time
    trajectory = cubic(robot, HOME, end, 20.0)
    before = trajectory.split(first * 0.8)[0]
    assert certify(
        before, robot, scene, limits=MotionLimits({"velocity": np.full(7, np.inf)})
    ).verified


def test_limits_of_tool_speed_are_part_of_the_limits() -> None:
    robot = builtin("panda")
    motion = cubic(robot, HOME, HOME + 0.3)
    tool = forward(robot.chain, motion.sample(np.linspace(0.0, motion.duration, 2001)))[:, :3, 3]
    fastest = float(np.linalg.norm(np.diff(tool, axis=0), axis=1).max()) * 2000 / motion.duration
    for share, is_proved in ((1.01, True), (0.99, False)):
        asked = MotionLimits({}, EffortLimits(robot.chain, tool_speed=share * fastest))
        certificate = certify(motion, robot, Scene(), limits=asked)
        assert certificate.verified is is_proved
        assert certificate.limits["tool_speed"].worst_ratio == pytest.approx(1.0 / share, rel=2e-3)
        violation = certificate.violation
        assert is_proved or (violation is not None and violation.kind == "tool_speed")


def test_time_up_proves_nothing() -> None:
    robot = builtin("panda")
    certificate = certify(
        cubic(robot, HOME, HOME + 0.5), robot, shelf(), deadline=Deadline.after(-1.0)
    )
    assert not certificate.verified
    assert certificate.violation is not None
    assert certificate.violation.kind == "time"


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_broken_limit_is_told_when_it_is_first_broken(order: int) -> None:
    """Against a dense look at random quintics of several pieces, a later peak notwithstanding."""
    robot = builtin("panda")
    lower, upper = robot.chain.limits.lower, robot.chain.limits.upper
    random = np.random.default_rng(order)
    told = 0
    for _ in range(30):
        via = random.uniform(lower + 0.2, upper - 0.2, (6, 7))
        slopes = random.uniform(-3.0, 3.0, (6, 7))
        times = np.cumsum(random.uniform(0.5, 2.0, 6))
        motion = interpolate(robot.chain.joint_names, times - times[0], via, "cubic", slopes)
        bounds = {name: np.full(7, np.inf) for name in ("velocity", "acceleration", "jerk")}
        name = ("position", "velocity", "acceleration")[order]
        if order:
            bounds[name] = random.uniform(0.5, 1.0) * motion.peaks(order).value
        _, wrong, _ = check_limits(motion, robot.chain.limits, MotionLimits(bounds))
        first = [violation for violation in wrong if violation.kind == name]
        at = np.linspace(0.0, motion.duration, 20001)
        values = motion.sample(at, order)
        low, high = (lower, upper) if not order else (-bounds[name], bounds[name])
        out = ((values < low - 1e-6) | (values > high + 1e-6)).any(axis=1)
        assert bool(first) or not out.any()
        if out.any():
            told += 1
            dense = at[np.argmax(out)]
            assert dense - 2.0 * at[1] <= first[0].time <= dense + 1e-9
    assert told > 5

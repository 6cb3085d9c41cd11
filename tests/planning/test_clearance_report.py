"""Reports of clearance, of configurations and of margins."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import coal
import numpy as np
import pinocchio
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.robots import builtin_urdf
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import Clearance, FclWorld
from obstacles.robots.robot_geometry import RobotGeometry, hulled
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Sphere
from planning.clearance_report import clearance_report
from planning.configuration_check import configuration_checker
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import ClearanceConstraint
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.planner import Ready
from planning.preflight.preflight import preflight
from planning.problem import JointGoal, Problem
from planning.result import Failure, Plan
from planning.values.preferences import DEFAULT_PREFERRED, PreferredClearance
from tests.obstacles.test_hulled import robot
from tests.planning.roomy_scenes import KINDS, with_room
from tests.planning.scenes import HOME, box, builtin, planned_motion
from tests.planning.slider import slider

#: The arm of two links, bent, turns past a bar and back in four seconds.
MOTION = Trajectory(
    ("joint_1", "joint_2"),
    np.array([0.0, 2.0, 4.0]),
    np.array([[[-1.2, 1.2], [0.9, 0.0]], [[1.2, -1.2], [0.9, 0.0]]]),
)
BAR = Scene((box("bar", (0.1, 1.0, 0.1), (1.88, 0.0, 0.0)),))


def test_spans_and_distances_are_those_of_fcl() -> None:
    robot = builtin("planar_rr")
    world = FclWorld(robot, BAR)
    times = np.linspace(0.0, 4.0, 2001)
    truth = np.array([world.clearance(q).distance for q in MOTION.sample(times)])
    preferred = truth.min() + 0.03
    report = clearance_report(
        (Checker.of(robot, BAR),), MOTION, PreferredClearance(float(preferred)), 0.0
    )
    assert len(report.spans) == 2
    inside = np.zeros(len(times), dtype=bool)
    for span in report.spans:
        here = (times >= span.begins) & (times <= span.ends)
        inside |= here
        assert abs(span.distance - truth[here].min()) < 0.02 * preferred + 1e-3
        assert span.distance >= truth[here].min() - 1e-6
        assert span.pair[1] == "bar"
    assert not (truth[~inside] < preferred - 1e-3).any()
    assert abs(report.time_below - np.mean(truth < preferred) * 4.0) < 4.0 * report.period + 0.01


def test_nothing_near_is_no_span() -> None:
    report = clearance_report(
        (Checker.of(builtin("planar_rr"), Scene()),), MOTION, PreferredClearance(), 0.0
    )
    assert report.spans == ()
    assert report.time_below == 0.0


def test_the_margin_is_the_least_distance_that_counts() -> None:
    checker = Checker.of(builtin("planar_rr"), BAR, 0.05)
    report = clearance_report((checker,), MOTION, PreferredClearance(0.0), 0.05)
    assert (report.preferred, report.least) == (0.05, 0.05)


def test_hulls_are_only_a_first_look() -> None:
    """A ball in the pocket of a hook: close to its hull all along, to the hook itself at times."""
    exact = robot()
    ball = Obstacle("ball", Sphere(0.03), transform(None, [0.2, 0.2, 0.05]))
    scene = Scene((ball,))
    swing = Trajectory(("turn",), np.array([0.0, 2.0]), np.array([[[-0.45, 0.45]]]))
    hulls, solids = (Checker.of(r, scene) for r in (hulled(exact), exact))
    reports = [
        clearance_report(checkers, swing, PreferredClearance(0.06), 0.0)
        for checkers in ((solids,), (hulls, solids), (hulls,))
    ]
    assert reports[0].spans
    assert reports[0] == reports[1]
    assert 0.0 < reports[1].time_below < reports[2].time_below


def test_what_is_proved_to_keep_its_distance_is_not_looked_at() -> None:
    """A bound below the preferred distances changes nothing, one above them spares the look."""
    checker = Checker.of(builtin("planar_rr"), BAR)
    preferred = PreferredClearance(0.05)
    looked = clearance_report((checker,), MOTION, preferred, 0.0)
    assert looked.spans
    own = preferred.own_links
    for known in ((0.05, np.inf), (np.inf, own), (0.0, 0.0)):
        assert clearance_report((checker,), MOTION, preferred, 0.0, known) == looked
    spared = clearance_report((checker,), MOTION, preferred, 0.0, (0.051, own + 1e-3))
    assert spared == replace(looked, spans=())


def test_margins_of_obstacles_are_taken_off_what_is_proved() -> None:
    (bar,) = BAR.obstacles
    checker = Checker.of(builtin("planar_rr"), Scene((replace(bar, margin=0.02),)))
    preferred, known = PreferredClearance(0.05), (0.06, np.inf)
    looked = clearance_report((checker,), MOTION, preferred, 0.0)
    assert looked.spans
    assert clearance_report((checker,), MOTION, preferred, 0.0, known) == looked


def test_the_distance_of_a_span_is_the_least_of_a_fast_arm_too() -> None:
    """Of looks 25 ms apart the nearest is up to millimetres farther away than the arm comes."""
    robot = builtin("planar_rr")
    world = FclWorld(robot, BAR)
    times = np.linspace(0.0, 4.0, 8001)
    truth = np.array([world.clearance(q).distance for q in MOTION.sample(times)])
    few = 0.0
    for speed in (5.0, 6.1, 7.3):
        fast = MOTION.dilate(1.0 / speed)
        report = clearance_report(
            (Checker.of(robot, BAR),), fast, PreferredClearance(float(truth.min() + 0.05)), 0.0
        )
        looks = np.arange(33) * report.period
        for span in report.spans:
            here = (times / speed >= span.begins) & (times / speed <= span.ends)
            assert -1e-6 <= span.distance - truth[here].min() < 1e-4
            seen = [world.clearance(q).distance for q in fast.sample(looks[
                (looks >= span.begins) & (looks <= span.ends)])]  # fmt: skip
            few = max(few, min(seen) - truth[here].min())
    assert few > 2e-4


BALL = np.array([0.5, 0.1, 0.75])


def ball(radius: float, margin: float = 0.0) -> Scene:
    T = transform(None, BALL)
    return Scene((Obstacle("ball", Sphere(radius), T, margin),))


def links_in_the_ball(q: Array, radius: float) -> set[str]:
    """Moving links that overlap the ball, by pinocchio and coal."""
    urdf = builtin_urdf("panda")
    model = pinocchio.buildModelFromXML(urdf)
    geometry = pinocchio.buildGeomFromUrdfString(model, urdf, pinocchio.GeometryType.COLLISION)
    data, placed = model.createData(), geometry.createData()
    pinocchio.updateGeometryPlacements(model, data, geometry, placed, q)
    at = coal.Transform3s(np.eye(3), BALL)
    hit = set()
    for item, M in zip(geometry.geometryObjects, placed.oMg, strict=True):
        where = coal.Transform3s(M.rotation, M.translation)
        result = coal.CollisionResult()
        request = coal.CollisionRequest()
        coal.collide(item.geometry, where, coal.Sphere(radius), at, request, result)
        if result.isCollision() and item.parentJoint > 0:
            hit.add(model.frames[item.parentFrame].name)
    return hit


@pytest.mark.parametrize("seed", range(40))
def test_obstacle_collisions_are_those_of_coal(seed: int) -> None:
    panda = builtin("panda")
    rng = np.random.default_rng(seed)
    limits = panda.chain.limits
    q = rng.uniform(limits.lower, limits.upper)
    scene = ball(0.15)
    report = configuration_checker(panda, scene).check(q)
    found = {name for c in report.collisions for name in c.pair if "ball" in c.pair} - {"ball"}
    assert found == links_in_the_ball(q, 0.15)


def test_margins_decide_validity_but_not_the_clearance() -> None:
    panda = builtin("panda")
    q = HOME
    free = configuration_checker(panda, ball(0.05)).check(q)
    assert free.valid
    gap = free.clearance
    far = Scene((Obstacle("ball", Sphere(0.05), ball(0.05).obstacles[0].T_world_obstacle, 10.0),))
    near = configuration_checker(panda, far).check(q)
    assert near.clearance == gap
    assert not near.valid
    assert not near.collisions
    assert not configuration_checker(panda, ball(0.05), 10.0).check(q).valid


def test_limits_are_reported_with_the_one_that_is_exceeded() -> None:
    panda = builtin("panda")
    q = panda.chain.limits.upper.copy()
    q[2] += 0.1
    q[3] = panda.chain.limits.lower[3] - 0.2
    report = configuration_checker(panda, Scene()).check(q)
    told = {v.joint: (v.value, v.limit) for v in report.limit_violations}
    assert told == {
        "panda_joint3": (q[2], panda.chain.limits.upper[2]),
        "panda_joint4": (q[3], panda.chain.limits.lower[3]),
    }
    assert not report.valid


@pytest.mark.parametrize("depth", [1e-4, 1e-3, 5e-3])
def test_a_ball_that_is_larger_than_its_gap_is_as_deep_as_the_difference(depth: float) -> None:
    panda = builtin("panda")
    radius = 0.02
    while "ball" not in (
        (small := configuration_checker(panda, ball(radius)).check(HOME)).clearance_pair or ()
    ):
        radius += 0.005
    large = configuration_checker(panda, ball(radius + small.clearance + depth)).check(HOME)
    assert large.collisions[0].pair == small.clearance_pair
    assert large.collisions[0].depth == pytest.approx(depth, abs=1e-6)
    assert large.clearance == -large.collisions[0].depth


def test_what_the_checker_finds_touching_is_not_free_whatever_fcl_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    checker = configuration_checker(builtin("panda"), ball(0.15))
    found = next(q for q in _states() if checker.check(q).collisions)
    monkeypatch.setattr(FclWorld, "collisions", lambda *_: [])
    monkeypatch.setattr(FclWorld, "clearance", lambda *_: Clearance(0.05, ("nobody", "nothing")))
    report = checker.check(found)
    assert not report.valid
    assert report.clearance <= 0.0
    assert [collision.pair for collision in report.collisions] == [report.clearance_pair]
    assert report.clearance_pair == checker.bare.clearance(found)[1]


def _states() -> Iterator[Array]:
    limits, random = builtin("panda").chain.limits, np.random.default_rng(5)
    while True:
        yield random.uniform(limits.lower, limits.upper)


#: The example of the README.
START = np.array([0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8])
GOAL = np.array([-0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8])
PREFERRED = 0.02
#: What FCL's distances are good for [m].
ACCURACY = 1e-5


def distances(
    robot: RobotGeometry, scene: Scene, motion: Trajectory, times: Array, most: float = 0.1
) -> Array:
    """Distance of the robot from obstacles at some instants by FCL, or ``most``, shape (k,)."""
    world = FclWorld(robot, scene)
    pairs = np.flatnonzero(world.pairs[:, 1] >= len(robot.pieces))
    found = np.full(len(times), most)
    for k, q in enumerate(motion.sample(times)):
        world.set_configuration(q)
        bounds = world.ball_bounds(*world.pairs[pairs].T)
        for number in np.argsort(bounds):
            if bounds[number] >= found[k]:
                break
            found[k] = min(found[k], world.distance(int(pairs[number])))
    return found


def nearest(problem: Problem, answer: object) -> float:
    """Least distance of a motion from obstacles, looked at every 3 ms, or ``PREFERRED`` [m]."""
    assert isinstance(answer, Plan)
    motion = answer.trajectory
    times = np.linspace(0.0, motion.duration, int(motion.duration / 3e-3))
    return float(distances(problem.robot, problem.scene, motion, times, PREFERRED).min())


@pytest.mark.parametrize("seed", range(6))
def test_a_post_with_room_beside_it_is_passed_at_the_preferred_distance(seed: int) -> None:
    random = np.random.default_rng(seed)
    place = (0.5, 0.0) if seed < 3 else random.uniform([0.45, -0.15], [0.65, 0.15])
    post = Obstacle("post", Box((0.1, 0.1, 1.0)), transform(None, (*place, 0.5)))
    problem = Problem(builtin("panda"), Scene((post,)), START, (JointGoal(GOAL),))
    answer = plan(problem, Options(seed=seed, timeout=60.0))
    assert nearest(problem, answer) >= PREFERRED - ACCURACY
    assert isinstance(answer, Plan)
    assert answer.clearance is not None
    assert answer.clearance.spans == ()


@pytest.mark.parametrize("arm", ["ur5e", "kr6_sixx", "iiwa14"])
@pytest.mark.parametrize("kind", list(KINDS))
def test_motions_in_scenes_with_room_keep_the_preferred_distance(arm: str, kind: str) -> None:
    random = np.random.default_rng([7, len(kind)])
    problem = with_room(builtin(arm), kind, PREFERRED, random)
    assert nearest(problem, plan(problem, Options(timeout=60.0))) >= PREFERRED - ACCURACY


def test_a_motion_to_a_near_goal_is_near_there_alone_and_says_so() -> None:
    # Beside the post at its goal, with the post in between.
    post = Obstacle("post", Box((0.1, 0.1, 1.0)), transform(None, (0.5, 0.0, 0.5)))
    robot, scene = builtin("panda"), Scene((post,))
    checker = Checker.of(robot, scene)
    ways = np.linspace(GOAL, START, 200)
    kept = checker.each_valid(ways)
    goal = ways[int(np.argmin(kept)) - 3]
    problem = Problem(robot, scene, START, (JointGoal(goal),))
    answer = planned_motion(problem, Options(timeout=60.0))
    report, motion = answer.clearance, answer.trajectory
    assert report is not None
    times = np.linspace(0.0, motion.duration, 800)
    truth = distances(robot, scene, motion, times)
    assert truth[-1] < PREFERRED
    (span,) = report.spans
    assert span.ends == motion.duration
    assert span.begins > 0.7 * motion.duration
    inside = times >= span.begins
    assert (truth[~inside] >= PREFERRED - ACCURACY).all()
    assert abs(span.distance - truth[inside].min()) < 1e-3
    assert span.pair[1] == "post"


ROBOT, RADIUS = slider(), 0.05
MARGINS_START, MARGINS_GOAL = np.array([-0.6, 0.0]), np.array([0.6, 0.0])


def post(name: str, x: float, y: float, margin: float = 0.0, size: float = 0.1) -> Obstacle:
    """A square post, by its middle."""
    return Obstacle(name, Box(np.array([size, size, 0.4])), transform(None, [x, y, 0.0]), margin)


def gap(obstacle: Obstacle, q: Array) -> Array:
    """The ball's distance from a post, margins not taken off, shape (k,)."""
    assert isinstance(obstacle.shape, Box)
    outside = np.abs(q - obstacle.T_world_obstacle[:2, 3]) - 0.5 * obstacle.shape.size[:2]
    return np.asarray(np.linalg.norm(np.maximum(outside, 0.0), axis=1) - RADIUS)


def asked(scene: Scene, margin: float = 0.0, clearance: float | None = None) -> Problem:
    held = (
        None if clearance is None else ConstraintSet(ROBOT.chain, (ClearanceConstraint(clearance),))
    )
    return Problem(
        ROBOT, scene, MARGINS_START, (JointGoal(MARGINS_GOAL),), margin, constraints=held
    )


@pytest.mark.parametrize(
    ("request_margin", "own", "clearance", "total"),
    [
        (0.0, 0.0, None, 0.0),
        (0.02, 0.0, None, 0.02),
        (0.0, 0.03, None, 0.03),
        (0.02, 0.03, None, 0.05),
        (0.0, 0.0, 0.04, 0.04),
        (0.02, 0.01, 0.04, 0.05),
        (0.05, 0.01, 0.04, 0.06),
    ],
)
def test_a_start_is_valid_beyond_all_margins_together_and_no_nearer(
    request_margin: float, own: float, clearance: float | None, total: float
) -> None:
    """The obstacle's own margin, and the larger of the request's and the constraint's."""
    for spare, valid in ((1e-4, True), (-1e-4, False)):
        if total + spare <= 0.0:
            continue
        beside = RADIUS + 0.05 + total + spare
        scene = Scene((post("post", float(MARGINS_START[0]), beside, own),))
        found = preflight(asked(scene, request_margin, clearance), 0)
        assert isinstance(found, Ready) is valid
        if isinstance(found, Failure):
            assert found.code == "START_STATE_IN_COLLISION"
            assert found.details["margin"] == pytest.approx(total, abs=1e-6)
            assert found.details["clearance"] == pytest.approx(total + spare, abs=1e-6)
            assert found.details["depth"] == 0.0


@pytest.mark.parametrize("margin", [0.0, 0.02, 0.05])
def test_each_obstacle_is_passed_at_its_own_margin_and_the_requests(margin: float) -> None:
    obstacles = (post("west", -0.25, 0.03, 0.04), post("east", 0.25, -0.03))
    answer = planned_motion(asked(Scene(obstacles), margin), Options(timeout=20.0))
    path = answer.trajectory.sample(np.linspace(0.0, answer.trajectory.duration, 4001))
    for obstacle in obstacles:
        assert gap(obstacle, path).min() >= margin + obstacle.margin
    assert answer.certificate.verified
    # Not much farther round than is needed: quick ways have fewer corners than the shortest one.
    problem, lengths = asked(Scene(obstacles), margin), list[float]()
    for seed in range(16):
        answer = planned_motion(problem, Options(timeout=20.0, seed=seed))
        lengths.append(answer.path.length)
    shortest = shortest_way(obstacles, max(margin, DEFAULT_PREFERRED))
    assert np.mean(lengths) < 1.08 * shortest
    assert max(lengths) < 1.2 * shortest


def shortest_way(obstacles: Sequence[Obstacle], kept: float) -> float:
    """Length of the shortest way of the ball past posts by a visibility graph [m].

    Args:
        obstacles: The posts.
        kept: Distance from them, beyond their own margins [m].
    """
    turns = np.linspace(0.0, 0.5 * np.pi, 17)
    quarter, corners = np.stack([np.cos(turns), np.sin(turns)], axis=1), [(1, 1), (1, -1), (-1, 1)]
    points = [MARGINS_START[None], MARGINS_GOAL[None]]
    for obstacle in obstacles:
        assert isinstance(obstacle.shape, Box)
        away = RADIUS + obstacle.margin + kept + 3e-4
        place, half = obstacle.T_world_obstacle[:2, 3], 0.5 * obstacle.shape.size[:2]
        points += [place + (half + away * quarter) * side for side in (*corners, (-1, -1))]
    nodes, shares = np.concatenate(points), np.linspace(0.0, 1.0, 101)[:, None]
    lengths = np.zeros((len(nodes), len(nodes)))
    for i, a in enumerate(nodes):
        legs = a + shares * (nodes[:, None] - a)
        gaps = [gap(o, legs.reshape(-1, 2)).reshape(len(nodes), -1) - o.margin for o in obstacles]
        free = np.min(gaps, axis=(0, 2)) >= kept
        lengths[i] = np.where(free, np.linalg.norm(nodes - a, axis=1), 0.0)
    return float(dijkstra(csr_array(lengths), directed=True, indices=[0])[0, 1])


@pytest.mark.parametrize("spare", [4e-3, -4e-3])
def test_a_gate_is_passed_where_it_is_wider_than_the_ball_with_its_margins(spare: float) -> None:
    """Walls that reach across the table, but for a gate in the middle."""
    margin = 0.03
    half = RADIUS + margin + spare
    walls = [
        Obstacle(
            name, Box(np.array([0.1, 2.0, 0.4])), transform(None, [0.0, sign * (1.0 + half), 0.0])
        )
        for name, sign in (("north", 1.0), ("south", -1.0))
    ]
    answer = plan(asked(Scene(tuple(walls)), margin), Options(timeout=2.0))
    assert isinstance(answer, Plan) is (spare > 0.0)
    if isinstance(answer, Plan):
        path = answer.trajectory.sample(np.linspace(0.0, answer.trajectory.duration, 2001))
        assert min(gap_to_wall(path, half, sign) for sign in (1.0, -1.0)) >= margin


def gap_to_wall(path: Array, half: float, sign: float) -> float:
    outside = np.stack([np.abs(path[:, 0]) - 0.05, half - sign * path[:, 1]], axis=1)
    return float(np.linalg.norm(np.maximum(outside, 0.0), axis=1).min()) - RADIUS

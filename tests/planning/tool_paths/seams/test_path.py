"""Paths of seams and searches in layers, against Dijkstra's algorithm and closed forms."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from benchmarks.planning import seams
from benchmarks.planning.seams import SHAPES, SPEED, STARTS, judge, load, seam
from kinematics.errors import InvalidGoal
from kinematics.forward import forward
from kinematics.pose import from_axis_angle, transform
from kinematics.robots import builtin_chain
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Cylinder
from planning.options import CartesianOptions, Options
from planning.pipeline.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.result import Failure, Plan
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance
from planning.tool_paths.blending import FLAT_CORNER
from planning.tool_paths.projection import pack_tolerance, project, project_kernel
from planning.tool_paths.seams.nodes import COARSE, nodes, sample_deviations
from planning.tool_paths.seams.path import seam_places, seam_runs, through_spline
from planning.tool_paths.seams.search import Layers, Steps, Ways, layer_kernel
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, planned_motion
from tests.planning.tool_paths.seams.ladder import ALL_STARTS, around, ask, ladder, work

EXACT = ToolTolerance.of({})
FREE = ToolTolerance.of({}, ("rz",), tilt=0.2)


def at(*place: float, turn: float = 0.0) -> SeamWaypoint:
    return SeamWaypoint(transform(from_axis_angle([0.0, 0.0, 1.0], turn), list(place)))


def bend(angle: float) -> tuple[SeamWaypoint, ...]:
    """Two ways of 0.2 m with a corner of this angle."""
    return at(0, 0, 0), at(0.2, 0, 0), at(0.2 + 0.2 * math.cos(angle), 0.2 * math.sin(angle), 0)


@pytest.mark.parametrize(("factor", "count"), [(0.98, 1), (1.02, 2)])
def test_only_sharp_corners_part_the_runs(factor: float, count: int) -> None:
    runs = seam_runs(SeamOptions(bend(factor * FLAT_CORNER), EXACT, tool_speed=0.1), 0.0)
    assert len(runs) == count
    assert [asked for run in runs for asked in run.asked] == [0, 1]
    assert sum(run.length for run in runs) == pytest.approx(0.4)
    assert {run.name for run in runs} == {"seam"}
    assert {speed for run in runs for speed in run.tool_speeds} == {0.1}


def test_a_blend_joins_what_a_sharp_corner_parts() -> None:
    first, corner, last = bend(1.2)
    rounded = SeamWaypoint(corner.T_base_tip, blend=0.05)
    (run,) = seam_runs(SeamOptions((first, rounded, last), EXACT), 0.0)
    assert run.asked == (0, 0, 0, 1)
    assert run.blends == (False, True, True, False)
    (same,) = seam_runs(SeamOptions((first, corner, last), EXACT), 0.05)
    assert same.length == pytest.approx(run.length)
    # A circle of radius 0.05 / tan(0.6) for the two times 0.05 m.
    assert run.length == pytest.approx(0.3 + 1.2 * 0.05 / math.tan(0.6))


def test_an_arc_goes_through_its_point() -> None:
    end = SeamWaypoint(at(0.2, 0, 0).T_base_tip, via=np.array([0.1, 0.1, 0.0]))
    (run,) = seam_runs(SeamOptions((at(0, 0, 0), end), EXACT), 0.0)
    assert run.length == pytest.approx(0.1 * math.pi)
    np.testing.assert_allclose(run.pose(0.5)[:3, 3], [0.1, 0.1, 0.0], atol=1e-12)


def test_two_waypoints_at_a_place_and_an_arc_without_a_circle_are_refused_by_number() -> None:
    with pytest.raises(InvalidGoal, match=r"waypoints\[2\] is at the place of waypoints\[1\]"):
        seam_runs(SeamOptions((at(0, 0, 0), at(0.1, 0, 0), at(0.1, 0, 0, turn=1.0)), EXACT), 0.0)
    flat = SeamWaypoint(at(0.2, 0, 0).T_base_tip, via=np.array([0.1, 0.0, 0.0]))
    with pytest.raises(InvalidGoal, match=r"waypoints\[1\]: ") as refusal:
        seam_runs(SeamOptions((at(0, 0, 0), flat), EXACT), 0.0)
    assert refusal.value.details["waypoint"] == 1


def test_places_are_near_each_other_and_tell_where_they_are() -> None:
    points = tuple(at(0.1 * k, 0.01 * k * k, 0.0, turn=0.3 * k) for k in range(6))
    places = seam_places(seam_runs(SeamOptions(points, FREE), 0.0))
    assert len(places.runs) == 1
    np.testing.assert_array_equal(places.run, 0)
    corners = np.array([point.T_base_tip[:3, 3] for point in points])
    ways = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(ways)])
    assert places.length == pytest.approx(length[-1])
    for axis in range(3):
        expected = np.interp(places.along, length, corners[:, axis])
        np.testing.assert_allclose(places.nominal[:, axis, 3], expected, atol=1e-12)
    turns = np.interp(places.along, length, 0.3 * np.arange(6))
    angles = np.arctan2(places.nominal[:, 1, 0], places.nominal[:, 0, 0])
    np.testing.assert_allclose(angles, turns, atol=1e-12)
    np.testing.assert_allclose(places.turned, turns, atol=1e-12)
    np.testing.assert_allclose(places.s, places.along / length[-1], atol=1e-12)
    ahead = np.diff(places.nominal[:, :3, 3], axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    np.testing.assert_allclose(places.directions, [*ahead, ahead[-1]], atol=1e-9)
    np.testing.assert_array_equal(
        places.waypoint, np.searchsorted(length, places.along + 1e-9, side="right") - 1
    )
    assert np.diff(places.along).max() <= 0.03 + 1e-9
    assert np.diff(places.turned).max() <= 0.15 + 1e-9
    assert places.ends == (len(places.s) - 1,)
    np.testing.assert_array_equal(places.layers(every=True), np.arange(len(places.s)))


def test_layers_skip_places_that_are_near_each_other() -> None:
    points = tuple(at(0.005 * k, 0, 0, turn=0.002 * k) for k in range(101))
    places = seam_places(seam_runs(SeamOptions(points, EXACT), 0.0))
    layers = places.layers()
    assert (layers[0], layers[-1]) == (0, len(places.s) - 1)
    ways = np.diff(places.along[layers])
    assert ways.max() <= 0.04 + 1e-9
    assert ways[:-1].min() >= 0.035 - 1e-9
    turning = tuple(at(0.005 * k, 0, 0, turn=0.05 * k) for k in range(101))
    places = seam_places(seam_runs(SeamOptions(turning, EXACT), 0.0))
    assert np.diff(places.turned[places.layers()]).max() <= 0.25 + 1e-9


def test_places_of_several_runs_share_the_corner() -> None:
    places = seam_places(seam_runs(SeamOptions(bend(2.0), EXACT), 0.0))
    assert len(places.ends) == 2
    corner = places.ends[0]
    assert (places.run[corner - 1], places.run[corner]) == (0, 1)
    assert places.s[corner] == 0.0
    np.testing.assert_allclose(places.nominal[corner, :3, 3], [0.2, 0.0, 0.0], atol=1e-12)


def great_circle(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """The point between two unit vectors on the great circle through them (Shoemake, 1985)."""
    angle = math.acos(float(np.clip(a @ b, -1.0, 1.0)))
    if angle < 1e-9:
        return a
    return np.asarray(math.sin((1.0 - share) * angle) * a + math.sin(share * angle) * b) / math.sin(
        angle
    )


def random_pose(random: np.random.Generator, place: np.ndarray) -> np.ndarray:
    axis = random.normal(size=3)
    return transform(from_axis_angle(axis / np.linalg.norm(axis), random.uniform(-1.2, 1.2)), place)


@pytest.mark.parametrize("seed", range(40))
def test_axes_alone_turn_along_the_great_circle(seed: int) -> None:
    random = np.random.default_rng(seed)
    places = np.array([[0.1 * k, 0.0, 0.0] for k in range(6)]) + random.uniform(-0.01, 0.01, (6, 3))
    alone = random.random(6) < 0.7
    points = tuple(
        SeamWaypoint(random_pose(random, place), tolerance=FREE if axis else EXACT, axis_only=axis)
        for place, axis in zip(places, alone.tolist(), strict=True)
    )
    runs = seam_runs(SeamOptions(points, EXACT), 0.0)
    motions = [motion for run in runs for motion in run.motions]
    assert len(motions) == 5
    for k, motion in enumerate(motions):
        given = [points[k + i].T_base_tip for i in (0, 1)]
        for share in (0.0, 0.3, 0.8, 1.0):
            T = motion.pose(share)
            if alone[k] or alone[k + 1]:
                axis = great_circle(given[0][:3, 2], given[1][:3, 2], share)
                np.testing.assert_allclose(T[:3, 2], axis, atol=1e-9)
        # What is given whole is kept whole, at either end of the way.
        for i, pose in enumerate((motion.T_start, motion.T_end)):
            if not alone[k + i]:
                np.testing.assert_allclose(pose, given[i], atol=1e-12)


def test_a_corner_that_is_rounded_turns_the_axis_alone_too() -> None:
    random = np.random.default_rng(1)
    corner = [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.2, 0.0]]
    points = [SeamWaypoint(random_pose(random, np.array(p)), axis_only=True) for p in corner]
    points[1] = SeamWaypoint(points[1].T_base_tip, blend=0.05, axis_only=True)
    (run,) = seam_runs(SeamOptions(tuple(points), FREE), 0.0)
    arcs = [motion for motion, blends in zip(run.motions, run.blends, strict=True) if blends]
    first, last = arcs[0].T_start[:3, 2], arcs[-1].T_end[:3, 2]
    plane = np.cross(first, last)
    for arc in arcs:
        for share in np.linspace(0.0, 1.0, 5):
            assert abs(arc.pose(float(share))[:3, 2] @ plane) < 1e-9


def test_opposite_axes_name_no_way() -> None:
    up = SeamWaypoint(transform(np.eye(3), [0.0, 0.0, 0.0]), axis_only=True)
    down = SeamWaypoint(transform(np.diag([1.0, -1.0, -1.0]), [0.1, 0.0, 0.0]), axis_only=True)
    with pytest.raises(InvalidGoal, match=r"waypoints\[0\] and waypoints\[1\].*opposite") as told:
        seam_runs(SeamOptions((up, down), FREE), 0.0)
    assert told.value.details["waypoint"] == 1


@pytest.mark.parametrize("step", [0.05, 0.15, 0.4])
def test_a_spline_through_points_of_a_circle_is_nearly_that_circle(step: float) -> None:
    radius, angles = 0.08, np.arange(0.0, 3.0, step)
    points = tuple(at(radius * math.cos(a), radius * math.sin(a), 0.0) for a in angles)
    seam, away = through_spline(SeamOptions(points, EXACT, through="spline"))
    # The sagitta of a chord; a cubic is off a circle by the fourth power of the step.
    sagitta = radius * (1.0 - math.cos(0.5 * step))
    assert away == pytest.approx(sagitta, rel=0.06)
    (run,) = seam_runs(seam, 0.0)
    off = np.abs(np.linalg.norm(run.poses(np.linspace(0.0, 1.0, 400))[:, :3, 3], axis=1) - radius)
    assert off.max() <= 0.06 * sagitta
    bends = [
        float(np.linalg.norm(one.direction(1.0) - other.direction(0.0)))
        for one, other in pairwise(run.motions)
    ]
    assert max(bends) <= 0.15 * step
    for point, waypoint in zip(points, seam.waypoints, strict=True):
        np.testing.assert_array_equal(point.T_base_tip, waypoint.T_base_tip)


def test_a_spline_leaves_corners_arcs_and_straight_ways_as_they_are() -> None:
    along = [(x, 0.0) for x in (0.0, 0.05, 0.1)] + [(0.1, 0.05), (0.1, 0.1)]
    points = [at(x, y, 0.0) for x, y in along]
    seam, away = through_spline(SeamOptions(tuple(points), EXACT, through="spline"))
    assert away == 0.0
    assert all(point.via is None for point in seam.waypoints)
    assert seam.through == "polyline"
    via = np.array([0.12, 0.125, 0.0])
    points.append(SeamWaypoint(at(0.1, 0.15, 0.0).T_base_tip, via=via))
    seam, _ = through_spline(SeamOptions(tuple(points), EXACT, through="spline"))
    np.testing.assert_array_equal(seam.waypoints[-1].via, via)


JUMP, CALM = 0.9, 0.2
WEIGHTS = np.array([0.5, 1.0, 2.0])
ORACLE = PinocchioArm()
CHAIN = ORACLE.chain
LIMITS = np.array([CHAIN.limits.lower, CHAIN.limits.upper])


def solve(
    joints: np.ndarray, firsts: np.ndarray, costs: np.ndarray, blocked: np.ndarray, turns: int = 0
) -> Ways:
    m = len(joints)
    ways = Ways(np.full(m, np.inf), np.full(m, -1), np.zeros(m, dtype=np.int64))
    times = np.full(len(firsts) - 2, 0.3)
    steps = Steps(WEIGHTS, np.full(3, turns, dtype=np.int64), JUMP, blocked)
    layer_kernel(Layers(joints, firsts, costs, times), steps, ways)
    return ways


def step_cost(a: np.ndarray, b: np.ndarray) -> float:
    """Cost of a step: the longest time, and a share of the squared ones; inf for a jump."""
    if np.abs(b - a).max() > JUMP:
        return np.inf
    times = np.abs(b - a) * WEIGHTS
    return float(max(0.3, times.max()) + CALM * (times**2).sum() / 0.3)


@pytest.mark.parametrize("seed", range(6))
def test_the_cheapest_way_is_that_of_dijkstra(seed: int) -> None:
    random = np.random.default_rng(seed)
    sizes = random.integers(3, 9, 8)
    firsts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    joints = random.uniform(-0.6, 0.6, (firsts[-1], 3))
    costs = random.uniform(0.0, 0.3, firsts[-1])
    costs[random.integers(firsts[1], firsts[-1], 4)] = np.inf
    pairs = [(int(firsts[2]), int(firsts[3])), (int(firsts[4]), int(firsts[5]) + 1)]
    ways = solve(joints, firsts, costs, np.array(pairs))
    source = len(joints)
    graph = np.zeros((source + 1, source + 1))
    layer = np.searchsorted(firsts, np.arange(len(joints)), side="right") - 1
    for j in np.flatnonzero(np.isfinite(costs)):
        if layer[j] == 0:
            graph[source, j] = costs[j]
            continue
        for i in range(firsts[layer[j] - 1], firsts[layer[j]]):
            cost = step_cost(joints[i], joints[j]) + costs[j]
            if np.isfinite(cost + costs[i]) and (i, int(j)) not in pairs:
                graph[i, j] = cost
    expected = np.asarray(dijkstra(csr_matrix(graph), indices=[source]))[0, :source]
    complete = np.isfinite(expected)
    assert complete[firsts[-2] :].any()
    np.testing.assert_allclose(ways.best[complete], expected[complete], rtol=1e-12)
    np.testing.assert_array_equal(ways.origin[complete], 0)
    assert (ways.origin[~complete & np.isfinite(costs)] > 0).all()


def test_whole_turns_count_only_where_they_are_told_to() -> None:
    joints = np.array([[0.0, 0.0, 0.0], [2.0 * np.pi + 0.1, 0.0, 0.0]])
    firsts, none = np.array([0, 1, 2]), np.zeros((0, 2), dtype=np.int64)
    apart = solve(joints, firsts, np.zeros(2), none)
    near = solve(joints, firsts, np.zeros(2), none, turns=1)
    assert (apart.before[1], apart.origin[1]) == (-1, 1)
    assert (near.before[1], near.origin[1]) == (0, 0)


@pytest.mark.parametrize("seed", range(5))
def test_projections_end_inside_the_box_and_leave_alone_what_is_there(seed: int) -> None:
    random = np.random.default_rng(seed)
    axes = Rotation.random(random_state=seed).as_matrix() if seed % 2 else None
    box = ToolTolerance.of(
        {"x": (-0.002, 0.004), "y": (-0.001, 0.001), "rx": (-0.1, 0.05), "ry": (-0.1, 0.2)},
        ("rz",),
        axes=axes,
    )
    near = HOME + random.uniform(-0.3, 0.3, (8, 7))
    nominal = forward(CHAIN, near)
    joints = near + random.uniform(-0.15, 0.15, (8, 7))
    joints[0] = near[0]
    before, errors = joints.copy(), np.empty((8, 2))
    boxes = np.repeat(pack_tolerance(box)[None], 8, axis=0)
    project_kernel(CHAIN.model, nominal, boxes, LIMITS, 12, joints, errors)
    np.testing.assert_array_equal(joints[0], before[0])
    assert errors.max() < 1e-6
    for q, N in zip(joints, nominal, strict=True):
        T = ORACLE.pose(q)
        A = N[:3, :3] if axes is None else axes
        off = A.T @ (T[:3, 3] - N[:3, 3])
        angles = Rotation.from_matrix(A.T @ T[:3, :3] @ N[:3, :3].T @ A).as_euler("XYZ")
        assert (off >= np.array([-0.002, -0.001, 0.0]) - 1e-6).all()
        assert (off <= np.array([0.004, 0.001, 0.0]) + 1e-6).all()
        assert (angles[:2] >= np.array([-0.1, -0.1]) - 1e-6).all()
        assert (angles[:2] <= np.array([0.05, 0.2]) + 1e-6).all()


def test_a_range_about_half_a_turn_is_met_from_either_side() -> None:
    half = transform(Rotation.from_rotvec([0.0, 0.0, np.pi]).as_matrix(), [0.0, 0.0, 0.0])
    nominal = (forward(CHAIN, HOME) @ half)[None].repeat(2, axis=0)
    joints = np.array([HOME, HOME])
    joints[:, 6] += [0.1, -0.1]
    before, errors = joints.copy(), np.empty((2, 2))
    box = pack_tolerance(ToolTolerance.of({"rz": (np.pi - 0.2, np.pi + 0.2)}))
    project_kernel(CHAIN.model, nominal, np.array([box, box]), LIMITS, 12, joints, errors)
    np.testing.assert_array_equal(joints, before)


def test_sampled_deviations_are_within_the_tolerance_and_begin_with_the_least() -> None:
    box = ToolTolerance.of({"x": (-0.01, 0.01)}, ("rz",), tilt=0.3)
    grid = sample_deviations(box, is_redundant=False)
    assert 2 <= len(grid) <= 48
    assert np.abs(grid[:, 0]).max() <= 0.01
    np.testing.assert_array_equal(grid[:, 1:3], 0.0)
    tilt = np.arccos(np.cos(grid[:, 3]) * np.cos(grid[:, 4]))
    assert 0.1 < tilt.max() <= 0.3 + 1e-9
    # Spins on either side: what is cut off is the largest, not one way round.
    spins = np.sin(grid[:, 5])
    assert spins.min() < -0.5 < 0.5 < spins.max()
    np.testing.assert_allclose(grid[0], 0.0)
    exact = sample_deviations(ToolTolerance.of({}), is_redundant=True)
    np.testing.assert_array_equal(exact, np.zeros((1, 6)))


def test_configurations_of_a_place_reach_its_pose_within_the_tolerance() -> None:
    down = np.diag([1.0, -1.0, -1.0])
    points = [SeamWaypoint(transform(down, [0.45, y, 0.35])) for y in (-0.1, 0.0, 0.1)]
    options = SeamOptions(tuple(points), ToolTolerance.of({}, ("rz",)))
    places = seam_places(seam_runs(options, 0.0))
    layers = places.layers()
    found = nodes(CHAIN, places, layers, HOME, COARSE)
    assert len(found.firsts) == len(layers) + 1
    for k, place in enumerate(layers):
        mine = found.joints[found.firsts[k] : found.firsts[k + 1]]
        assert 20 <= len(mine) <= COARSE.most
        assert ((mine >= LIMITS[0]) & (mine <= LIMITS[1])).all()
        for q in mine[:: len(mine) // 5]:
            T = ORACLE.pose(q)
            np.testing.assert_allclose(T[:3, 3], places.nominal[place, :3, 3], atol=1e-6)
            np.testing.assert_allclose(T[:3, 2], [0.0, 0.0, -1.0], atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_a_free_spin_is_left_to_the_joints(seed: int) -> None:
    """The least motion into a box with a free spin is no longer than to any one spin."""
    random = np.random.default_rng(seed)
    start = HOME + random.uniform(-0.3, 0.3, 7)
    nominal = forward(CHAIN, start + random.uniform(-0.08, 0.08, 7))[None]
    free = pack_tolerance(ToolTolerance.of({}, ("rz",)))[None]
    joints = start[None].copy()
    assert project(CHAIN, nominal, free, LIMITS, joints).max() < 1e-9
    moved = float(np.linalg.norm(joints - start))
    for spin in np.linspace(-0.3, 0.3, 31):
        turned = pack_tolerance(ToolTolerance.of({"rz": (spin, spin)}))[None]
        one = start[None].copy()
        if project(CHAIN, nominal, turned, LIMITS, one).max() < 1e-9:
            # Newton's steps add up to nearly the least motion.
            assert moved <= 1.01 * float(np.linalg.norm(one - start)) + 1e-4


def test_any_orientation_will_do_for_an_arm_that_has_none_to_spare() -> None:
    arm = builtin_chain("planar_rr")
    start, limits = np.array([[0.3, 1.2]]), np.array([[-3.0, -3.0], [3.0, 3.0]])
    nominal = forward(arm, np.array([[0.5, 0.9]]))
    box = pack_tolerance(None, turns=True)[None]
    assert project(arm, nominal, box, limits, start).max() < 1e-9
    np.testing.assert_allclose(forward(arm, start)[0, :3, 3], nominal[0, :3, 3], atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_a_joint_at_its_limit_is_left_out_of_a_projection(seed: int) -> None:
    random = np.random.default_rng(seed)
    start = HOME + random.uniform(-0.2, 0.2, 7)
    near = start + random.uniform(-0.05, 0.05, 7)
    limits = LIMITS.copy()
    k = seed % 7
    # Where the joint would go by itself is beyond this.
    limits[int(near[k] > start[k]), k] = start[k]
    joints = start[None].copy()
    box = pack_tolerance(None)[None]
    assert project(CHAIN, forward(CHAIN, near)[None], box, limits, joints).max() < 1e-6
    assert (joints >= limits[0]).all()
    assert (joints <= limits[1]).all()


@pytest.mark.parametrize(
    ("arm", "kind", "number", "posts"),
    [
        ("ur5e", "spiral", 1, False),
        ("ur5e", "sphere", 0, False),
        ("ur5e", "sphere", 2, False),
        ("ur5e", "raster", 3, True),
        ("kr6_sixx", "spiral", 0, True),
        ("panda", "spiral", 2, False),
        ("panda", "program", 1, False),
        ("panda", "sphere", 37, False),
    ],
)
def test_a_seam_that_a_ladder_follows_is_followed(
    arm: str, kind: str, number: int, posts: bool
) -> None:
    one, loaded, start = work(arm, kind, number), load(arm), np.array(ALL_STARTS[arm])
    scene = around(one.seam, posts=posts)
    how = Options(planner="cartesian", cartesian=CartesianOptions(seam=one.seam), timeout=60.0)
    answer = plan(ask(loaded.robot, one.seam, start, scene), how)
    assert ladder(Checker.of(loaded.robot, scene), one.seam, start, spins=one.spins)
    assert isinstance(answer, Plan), answer
    verdict = judge(loaded, scene, one.seam.waypoints, answer)
    assert verdict.away <= 1.2e-4
    assert not verdict.collides


@pytest.mark.parametrize(("arm", "number"), [("panda", 0), ("kr6_sixx", 0), ("ur5e", 2)])
def test_sharp_turns_of_the_tool_on_short_ways_are_followed(arm: str, number: int) -> None:
    """Between two edges of a box the tool turns by a right angle on some millimetres."""
    one, loaded = work(arm, "edge", number), load(arm)
    how = Options(planner="cartesian", cartesian=CartesianOptions(seam=one.seam), timeout=60.0)
    answer = plan(ask(loaded.robot, one.seam, np.array(ALL_STARTS[arm])), how)
    assert isinstance(answer, Plan), answer
    assert answer.certificate.verified
    assert answer.certificate.tool_box is not None
    assert answer.certificate.tool_box.share <= 1.0


#: A seam over a ball, of 1 m: of its last 5 mm a tilt of nearly all 15 degrees is all that is left.
_NUMBER = 38


def test_the_end_of_reach_is_found_from_the_layers_beside_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(seams, "INSTANTS", 151)
    random = np.random.default_rng(7)
    for k in range(_NUMBER + 1):
        waypoints = seam(SHAPES[k % len(SHAPES)], random, 1.0)
    arm, tilt = load("panda"), math.radians(15.0)
    post = Obstacle("post", Cylinder(0.03, 0.8), transform(None, [0.0, 0.6, 0.4]))
    scene = Scene((post,))
    asked = SeamOptions(waypoints, ToolTolerance.of({}, ("rz",), tilt), tool_speed=SPEED)
    goal = PoseGoal(waypoints[-1].T_base_tip)
    problem = Problem(arm.robot, scene, np.array(STARTS["panda"]), (goal,))
    how = CartesianOptions(seam=asked)
    answer = planned_motion(problem, Options(planner="cartesian", cartesian=how, timeout=30.0))
    verdict = judge(arm, scene, waypoints, answer)
    assert verdict.away <= 1e-4
    assert verdict.tilt <= tilt + 1e-3
    assert not verdict.collides


def test_bends_that_joints_can_not_follow_are_told_with_what_helps() -> None:
    arm = load("ur5e")
    down = np.diag([1.0, -1.0, -1.0])
    angles = np.radians([0.0, 3.0, 6.0, 18.0, 21.0, 24.0])
    circle = [[0.45 + 0.1 * math.cos(a), 0.1 * math.sin(a), 0.3] for a in angles]

    def ask(blend: float | None, max_deviation: float) -> Plan | Failure:
        waypoints = tuple(SeamWaypoint(transform(down, p), blend=blend) for p in circle)
        asked = SeamOptions(waypoints, ToolTolerance.of({}, ("rz",)), tool_speed=0.05)
        goal = PoseGoal(waypoints[-1].T_base_tip)
        problem = Problem(arm.robot, Scene(), np.array(STARTS["ur5e"]), (goal,))
        how = CartesianOptions(seam=asked, max_deviation=max_deviation)
        return plan(problem, Options(planner="cartesian", cartesian=how, timeout=30.0))

    refused = ask(None, 1e-7)
    assert isinstance(refused, Failure)
    assert refused.code == "PLANNING_FAILED"
    # Chords of 3 and 12 degrees meet at an angle of half their sum.
    assert refused.details["waypoint"] in (2, 3)
    assert refused.details["bend"] == pytest.approx(math.radians(7.5))
    assert "waypoints[" in refused.message
    assert "by 7.5 degrees" in refused.message
    assert isinstance(ask(0.001, 1e-6), Plan)
    assert isinstance(ask(None, 1e-4), Plan)

"""Search in layers against Dijkstra's algorithm, and projections against scipy's Euler angles."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.robots import builtin_chain
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance
from planning.tool_paths.projection import pack_tolerance, project, project_kernel
from planning.tool_paths.seams.nodes import COARSE, nodes, sample_deviations
from planning.tool_paths.seams.path import seam_places, seam_runs
from planning.tool_paths.seams.search import Layers, Steps, Ways, layer_kernel
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME

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
    assert not found.outside.any()
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

"""Reach, base placement and grids: beside forward kinematics, FCL and numpy's singular values."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidOption, InvalidPose
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches
from kinematics.ik.closed_form.refine import CODE
from kinematics.ik.closed_form.structure import structure
from kinematics.jacobian import geometric
from kinematics.pose import inverse, rotation_error, rotation_x, rotation_z, transform
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.attachment import Attachment, hold
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, HalfSpace, Sphere
from planning.reach import evaluation
from planning.reach.assessment import GAIN
from planning.reach.base_placement import moved, place_base
from planning.reach.evaluation import (
    Axis,
    Choice,
    PoseGrid,
    Reach,
    ReachOptions,
    Status,
    Tolerance,
    parameter_values,
    reach,
)
from planning.values.deadline import Deadline
from tests.planning.scenes import builtin

CLOSED = ["kr6_sixx", "ur5e", "panda", "iiwa14"]
SEARCHED = ["scara", "planar_rr", "stanford"]
SCENE = Scene(
    [
        Obstacle("post", Box(np.array([0.1, 0.1, 1.2])), transform(None, [0.45, 0.1, 0.6])),
        Obstacle("ball", Sphere(0.15), transform(None, [-0.3, 0.4, 0.5])),
    ]
)


def figures(robot: RobotGeometry, world: FclWorld, q: np.ndarray) -> tuple[float, float, float]:
    """Manipulability, clearance and distance from the limits."""
    lower, upper = robot.chain.limits.lower, robot.chain.limits.upper
    volume = np.linalg.svd(geometric(robot.chain, q), compute_uv=False).prod()
    share = (np.minimum(q - lower, upper - q) / (0.5 * (upper - lower))).min()
    return volume, world.clearance(q).distance, min(share, 1.0)


def touches(world: FclWorld, q: np.ndarray) -> bool:
    """Whether anything touches; how deep, which takes long to find, nobody asks here."""
    world.set_configuration(q)
    return any(world.distance(int(pair)) <= 0.0 for pair in _near(world))


def _near(world: FclWorld) -> np.ndarray:
    """Pairs whose bounding balls touch, those first that overlap the most."""
    bounds = world.ball_bounds(*world.pairs.T)
    return np.argsort(bounds)[: np.count_nonzero(bounds <= 0.0)]


def poses(name: str, count: int, stretch: float = 1.0) -> np.ndarray:
    chain = builtin(name).chain
    q = np.random.default_rng(1).uniform(*chain.sampling_bounds(), (count, chain.n))
    T = forward(chain, q)
    T[:, :3, 3] *= stretch
    return T


@pytest.mark.parametrize("name", CLOSED + SEARCHED)
def test_configurations_take_their_poses_and_touch_nothing(name: str) -> None:
    robot = builtin(name)
    T = poses(name, 60)
    found = reach(robot, SCENE, T, ReachOptions(threads=1))
    assert found.completed == 60
    assert found.is_reached.sum() > 15
    world = FclWorld(robot, SCENE)
    for k in np.flatnonzero(found.is_reached):
        q = found.joints[k]
        assert (q >= robot.chain.limits.lower).all()
        assert (q <= robot.chain.limits.upper).all()
        arrived = forward(robot.chain, q)
        assert arrived[:3, 3] == pytest.approx(T[k, :3, 3], abs=1e-6)
        assert np.abs(rotation_error(arrived[:3, :3], T[k, :3, :3])).max() < 1e-6
        assert not touches(world, q)
        values = np.linalg.svd(geometric(robot.chain, q), compute_uv=False)
        assert found.manipulability[k] == pytest.approx(values.prod(), rel=1e-6, abs=1e-9)
        assert found.clearance[k] > 0.0
    assert np.isnan(found.joints[~found.is_reached]).all()
    assert np.isnan(found.manipulability[~found.is_reached]).all()


@pytest.mark.parametrize("name", ["kr6_sixx", "ur5e"])
def test_the_branches_are_those_that_fcl_finds_free(name: str) -> None:
    robot = builtin(name)
    T = poses(name, 25)
    found = reach(robot, SCENE, T, ReachOptions(threads=1, clearance=False))
    world = FclWorld(robot, SCENE)
    for k in range(len(T)):
        every = branches(robot.chain, T[k])
        free = [
            q
            for q, inside in zip(every.joints, every.within_limits, strict=True)
            if inside and not touches(world, q)
        ]
        assert found.branches[k] == len(free)
        assert found.is_reached[k] == bool(free)
        if free:
            best = max(np.linalg.svd(geometric(robot.chain, q))[1].prod() for q in free)
            assert found.manipulability[k] == pytest.approx(best, rel=1e-6)
    assert np.isnan(found.clearance).all()


def test_each_choice_is_best_in_what_it_is_chosen_for() -> None:
    robot, T = builtin("kr6_sixx"), poses("kr6_sixx", 80)
    by = {
        choice: reach(robot, SCENE, T, ReachOptions(choice=choice, threads=1))
        for choice in ("manipulability", "clearance", "limits")
    }
    ok = by["limits"].is_reached
    assert ok.sum() > 40
    for other in by.values():
        assert (by["manipulability"].manipulability >= other.manipulability - 1e-12)[ok].all()
        # What is less than a micrometre better is no better.
        assert (by["clearance"].clearance >= other.clearance - GAIN)[ok].all()
        assert (by["limits"].limit_distance >= other.limit_distance - 1e-12)[ok].all()
    lower, upper = robot.chain.limits.lower, robot.chain.limits.upper
    q = by["limits"].joints[ok]
    share = (np.minimum(q - lower, upper - q) / (0.5 * (upper - lower))).min(axis=1)
    assert by["limits"].limit_distance[ok] == pytest.approx(share)


def test_the_status_says_how_far_a_pose_came() -> None:
    robot = builtin("kr6_sixx")
    far = transform(None, [5.0, 0.0, 0.5])
    inside = forward(robot.chain, np.array([0.0, -1.2, 1.5, 0.0, 0.6, 0.0]))
    block = Scene([Obstacle("block", Sphere(0.1), transform(None, inside[:3, 3]))])
    found = reach(robot, block, [far, inside], ReachOptions(threads=1))
    assert found.status.tolist() == [Status.OUT_OF_REACH, Status.IN_COLLISION]
    assert reach(robot, Scene(), [inside]).status.tolist() == [Status.REACHED]


def test_a_pose_beyond_a_limit_alone_is_outside_the_limits() -> None:
    robot = builtin("kr6_sixx")
    # Joint 1 of a KR 6 turns by 170 degrees: what is behind it in the last ten is out of limits
    # for shoulders to the front, and the elbow's other side is too far back.
    q = np.array([np.pi, -0.5, 0.6, 0.0, 0.5, 0.0])
    every = branches(robot.chain, forward(robot.chain, q))
    found = reach(robot, Scene(), [forward(robot.chain, q)], ReachOptions(threads=1))
    expected = Status.REACHED if every.within_limits.any() else Status.OUTSIDE_LIMITS
    assert found.status.tolist() == [expected]
    assert expected == Status.OUTSIDE_LIMITS


def test_a_margin_takes_poses_away_and_clearance_says_so() -> None:
    robot, T = builtin("ur5e"), poses("ur5e", 200)
    plain = reach(robot, SCENE, T, ReachOptions(choice="clearance", threads=1))
    kept = reach(robot, SCENE, T, ReachOptions(margin=0.05, choice="clearance", threads=1))
    assert kept.is_reached.sum() < plain.is_reached.sum()
    assert not (kept.is_reached & ~plain.is_reached).any()
    both = kept.is_reached
    assert (kept.clearance[both] <= plain.clearance[both] + 1e-9).all()


@pytest.mark.parametrize("name", ["kr6_sixx", "ur5e", "iiwa14", "panda"])
def test_turns_about_the_last_axis_are_judged_like_any_deviation(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # More values of a parameter are tried where no deviation is reached, not at each of them.
    monkeypatch.setattr(evaluation, "_LEVELS", 1)
    bar = Obstacle("bar", Box(np.array([0.5, 0.04, 0.04])), transform(None, [0.1, 0.0, 0.1]))
    robot = hold(builtin(name), Scene(), [Attachment(bar, builtin(name).chain.tip_link)]).robot
    tolerance = Tolerance({"rz": (-1.0, 2.0)}, samples=5)
    T = poses(name, 80)
    free = reach(robot, SCENE, T, ReachOptions(tolerance, threads=1))
    alone = [reach(robot, SCENE, T @ D, ReachOptions(threads=1)) for D in tolerance.deviations()]
    if name != "iiwa14":  # its arm angle begins elsewhere at each deviation
        assert free.status.tolist() == np.max([one.status for one in alone], axis=0).tolist()
        assert free.samples.tolist() == np.sum([one.is_reached for one in alone], axis=0).tolist()
        assert free.branches.tolist() == np.max([one.branches for one in alone], axis=0).tolist()
        best = np.max([np.nan_to_num(one.manipulability) for one in alone], axis=0)
        assert np.nan_to_num(free.manipulability) == pytest.approx(best, rel=1e-6, abs=1e-9)
    assert np.count_nonzero((free.samples > 0) & (free.samples < 5)) > 0
    world = FclWorld(robot, SCENE)
    for k in np.flatnonzero(free.is_reached):
        q = free.joints[k]
        assert (q >= robot.chain.limits.lower).all()
        assert (q <= robot.chain.limits.upper).all()
        miss = np.abs(T[k] @ tolerance.deviations() - forward(robot.chain, q)).max(axis=(1, 2))
        assert miss.min() < 1e-6
        assert not touches(world, q)


@pytest.mark.parametrize("name", ["kr6_sixx", "ur5e", "panda", "scara"])
@pytest.mark.parametrize("axis", ["rx", "rz"])
def test_the_first_free_configuration_tells_the_same_poses(name: str, axis: Axis) -> None:
    robot, T = builtin(name), poses(name, 60, stretch=1.1)
    tolerance = Tolerance.free(axis, samples=4)
    every = reach(robot, SCENE, T, ReachOptions(tolerance, threads=1))
    first = reach(robot, SCENE, T, ReachOptions(tolerance, choice="first", threads=1))
    assert first.status.tolist() == every.status.tolist()
    assert first.samples.tolist() == every.is_reached.astype(int).tolist()
    assert first.branches.tolist() == first.samples.tolist()
    world = FclWorld(robot, SCENE)
    for k in np.flatnonzero(first.is_reached):
        assert not touches(world, first.joints[k])
        assert first.manipulability[k] <= every.manipulability[k] + 1e-9
        miss = T[k] @ tolerance.deviations() - forward(robot.chain, first.joints[k])
        assert np.abs(miss).max(axis=(1, 2)).min() < 1e-6


@pytest.mark.parametrize("axis", ["rx", "rz"])
@pytest.mark.parametrize("name", ["kr6_sixx", "ur5e", "panda"])
def test_what_is_not_looked_at_would_change_nothing(
    name: str, axis: Axis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every branch of every deviation, judged by FCL one after another."""
    monkeypatch.setattr(evaluation, "_LEVELS", 1)
    robot, T = builtin(name), poses(name, 6)
    chain, world = robot.chain, FclWorld(robot, SCENE)
    tolerance = Tolerance.free(axis, samples=4)
    form = structure(chain)
    assert form is not None
    assert form.redundant == (name == "panda")
    values = parameter_values(chain, form) if form.redundant else None
    expected = []
    for pose in T:
        counts, all_figures = [], [(-np.inf, -np.inf, -np.inf)]
        for deviation in tolerance.deviations():
            found = branches(chain, pose @ deviation, parameters=values)
            free = [k for k in np.flatnonzero(found.within_limits)
                    if not touches(world, found.joints[k])]  # fmt: skip
            codes = [int(found.table[k, chain.n + CODE]) if form.redundant else k for k in free]
            counts.append(len(set(codes)))
            all_figures += [figures(robot, world, found.joints[k]) for k in free]
        expected.append(
            (max(counts), sum(count > 0 for count in counts), *np.max(all_figures, axis=0))
        )
    branch_counts, samples, manipulability, clearance, limits = np.array(expected).T
    choices: tuple[Choice, ...] = ("manipulability", "clearance", "limits")
    for choice in choices:
        got = reach(robot, SCENE, T, ReachOptions(tolerance, choice=choice, threads=1))
        assert got.branches.tolist() == branch_counts.tolist()
        assert got.samples.tolist() == samples.tolist()
        best = {
            "manipulability": (got.manipulability, manipulability),
            "clearance": (got.clearance, clearance),
            "limits": (got.limit_distance, limits),
        }
        ours, theirs = (figure[got.is_reached] for figure in best[choice])
        assert ours == pytest.approx(theirs, abs=2.0 * GAIN)


def crowd(seed: int) -> Scene:
    """Fourteen boxes around an arm, none of them on its base."""
    random, boxes = np.random.default_rng(seed), list[Obstacle]()
    for k in range(14):
        place = random.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.0])
        place[:2] *= max(0.35 / np.hypot(*place[:2]), 1.0)
        turn = Rotation.random(rng=random).as_matrix()
        boxes.append(Obstacle(f"box {k}", Box(random.uniform(0.05, 0.35, 3)),
                              transform(turn, place)))  # fmt: skip
    return Scene(boxes)


@pytest.mark.parametrize(("name", "seeds"), [("panda", (21, 23)), ("iiwa14", (5, 11))])
def test_a_redundant_arm_reaches_what_a_thousand_values_reach(
    name: str, seeds: tuple[int, ...]
) -> None:
    """Also where sixteen values all collide, and where what is behind the last joint does."""
    robot = builtin(name)
    chain, form, narrow = robot.chain, structure(robot.chain), 0
    assert form is not None
    fine = np.linspace(-np.pi, np.pi, 1000, endpoint=False)
    if form.locked is not None:
        low, high = chain.sampling_bounds()
        fine = np.linspace(low[form.locked], high[form.locked], 1000)
    for seed in seeds:
        scene, random = crowd(seed), np.random.default_rng(seed)
        checker = Checker.of(robot, scene)

        def free(T: np.ndarray, values: np.ndarray, checker: Checker = checker) -> bool:
            found = branches(chain, T, parameters=values)
            inside = found.joints[found.within_limits]
            return any(checker.valid(q) for q in inside)

        T = forward(chain, random.uniform(*chain.sampling_bounds(), (30, chain.n)))
        got = reach(robot, scene, T, ReachOptions(threads=1)).is_reached
        for k in range(len(T)):
            coarse = free(T[k], parameter_values(chain, form))
            by_parts = (free(T[k], fine[part::20]) for part in range(20))
            assert got[k] == (coarse or any(by_parts))
            narrow += bool(got[k]) and not coarse
    assert narrow > 0


def test_a_planar_arm_reaches_with_the_rotation_that_it_has() -> None:
    robot = builtin("planar_rr")
    T = forward(robot.chain, np.array([[0.3, 0.8], [1.0, -0.5]]))
    assert reach(robot, Scene(), T).is_reached.all()
    tilted = T @ transform(rotation_x(0.3))
    assert not reach(robot, Scene(), tilted).is_reached.any()


def test_a_deadline_cuts_the_answer_short() -> None:
    found = reach(builtin("ur5e"), SCENE, poses("ur5e", 50), deadline=Deadline.after(0.0))
    assert found.completed == 0
    assert isinstance(found, Reach)


def test_progress_is_reported_up_to_one() -> None:
    shares: list[float] = []
    reach(builtin("ur5e"), Scene(), poses("ur5e", 4_100), report=shares.append)
    assert shares == sorted(shares)
    assert len(shares) == 3
    assert shares[-1] == 1.0


@pytest.mark.parametrize("seed", range(6))
def test_what_is_held_goes_no_deeper_into_a_floor_than_touch_depth_says(seed: int) -> None:
    random, panda = np.random.default_rng(seed), builtin("panda")
    limit, radius = random.uniform(0.001, 0.02), 0.05
    ball = Obstacle("ball", Sphere(radius), transform(None, [0.0, 0.0, 0.2]))
    held = Attachment(ball, "panda_hand", ("floor",), limit)
    floor = Obstacle("floor", HalfSpace([0.0, 0.0, 1.0], 0.2))
    base = [("panda_link0", "floor"), ("panda_link1", "floor")]
    holding = hold(panda, Scene([floor]), [held], base)
    depths = random.uniform(0.0, 2.0 * limit, 20)
    targets = np.tile(transform(rotation_x(np.pi), [0.45, 0.0, 0.0]), (20, 1, 1))
    # The hand points down: the lowest point of the ball is below it by 0.2 m and its radius.
    targets[:, 2, 3] = 0.2 - depths + 0.2 + radius
    found = reach(holding.robot, holding.scene, targets, link="panda_hand")
    np.testing.assert_array_equal(found.is_reached, depths <= limit)
    assert (found.status[depths > limit] == Status.IN_COLLISION).all()


DOWN = rotation_x(np.pi)
TASKS = np.array([transform(DOWN, [x, y, 0.3]) for x in (0.9, 1.1) for y in (-0.3, 0.0, 0.3)])
WALL = Scene([Obstacle("wall", Box(np.array([0.1, 0.6, 1.0])), transform(None, [0.5, 0.0, 0.5]))])
BASES = np.array(
    [transform(None, [0.0, 0.0, 0.0]), transform(rotation_z(np.pi), [1.6, 0.0, 0.0]),
     transform(rotation_z(-np.pi / 2), [1.0, 0.55, 0.0])]
)  # fmt: skip
OPTIONS = ReachOptions(threads=1)


def test_the_best_base_reaches_most_and_is_proved_in_the_world_frame() -> None:
    robot = builtin("ur5e")
    placements = place_base(robot, WALL, TASKS, BASES, OPTIONS)
    assert [item.score for item in placements] == sorted(
        (item.score for item in placements), reverse=True
    )
    best = placements[0]
    # The wall stands between the first candidate and the tasks.
    assert placements[-1].index == 0
    assert not placements[-1].reach.is_reached.all()
    assert best.reach.is_reached.all()
    world = FclWorld(robot, moved(WALL, inverse(best.T_world_base)))
    assert not any(world.collisions(q) for q in best.reach.joints)
    clearance, manipulability, limits = best.worst
    assert clearance == best.reach.clearance.min()
    assert manipulability == best.reach.manipulability.min()
    assert limits == best.reach.limit_distance.min()


def test_candidates_after_the_deadline_are_left_out() -> None:
    assert not place_base(builtin("ur5e"), WALL, TASKS, BASES, deadline=Deadline.after(0.0))


def test_odd_bases_are_refused() -> None:
    with pytest.raises(InvalidOption, match="no candidate"):
        place_base(builtin("ur5e"), WALL, TASKS, np.zeros((0, 4, 4)))
    with pytest.raises(InvalidPose):
        place_base(builtin("ur5e"), WALL, TASKS, np.eye(4))


ONE = np.eye(3)[None]


def test_the_points_span_the_box_at_most_a_spacing_apart() -> None:
    T = transform(rotation_z(np.pi / 2), [1.0, 2.0, 3.0])
    grid = PoseGrid(np.array([0.4, 0.1, 0.0]), 0.15, T, ONE)
    assert grid.shape == (4, 2, 1, 1)
    points = grid.points()
    assert points.min(axis=0) == pytest.approx([0.95, 1.8, 3.0])
    assert points.max(axis=0) == pytest.approx([1.05, 2.2, 3.0])


def test_each_point_has_every_orientation() -> None:
    rotations = np.array([np.eye(3), rotation_z(0.5)])
    grid = PoseGrid(np.array([0.1, 0.0, 0.0]), 0.1, np.eye(4), rotations)
    T = grid.poses()
    assert T.shape == (4, 4, 4)
    assert T[:, 0, 3] == pytest.approx([-0.05, -0.05, 0.05, 0.05])
    assert T[1, :3, :3] == pytest.approx(rotations[1])
    assert T[2, :3, :3] == pytest.approx(rotations[0])


@pytest.mark.parametrize(
    ("size", "spacing", "message"),
    [
        ([1, 1, 1], 0.0, "positive"),
        ([1, -1, 1], 0.1, "negative"),
        ([1, 1, 1], 0.005, "at most 1000000"),
        ([1e6, 1e6, 1e6], 1e-9, "at most"),
    ],
)
def test_grids_without_sense_are_refused(size: list[float], spacing: float, message: str) -> None:
    with pytest.raises(InvalidOption, match=message):
        PoseGrid(np.array(size, dtype=float), spacing, np.eye(4), ONE)


def test_deviations_are_translations_and_rotations_in_the_poses_frame() -> None:
    tolerance = Tolerance({"x": (-0.1, 0.1), "rx": (0.2, 0.2), "rz": (-0.3, 0.3)}, samples=3)
    T = tolerance.deviations()
    assert len(T) == 9
    expected = {
        (x, z): (Rotation.from_rotvec([0.2, 0, 0]) * Rotation.from_rotvec([0, 0, z])).as_matrix()
        for x in (-0.1, 0.0, 0.1)
        for z in (-0.3, 0.0, 0.3)
    }
    for (x, _), R in expected.items():
        assert any(np.allclose(D[:3, :3], R) and np.allclose(D[:3, 3], [x, 0, 0]) for D in T)
    # The least deviation is tried first.
    assert T[0, :3, 3] == pytest.approx([0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("ranges", "samples", "message"),
    [
        ({"x": (0.1, -0.1)}, 4, "above"),
        ({"rz": (-4.0, 4.0)}, 4, "more than a turn"),
        ({"x": (0, 1), "y": (0, 1), "rz": (0, 1)}, 12, "1728 deviations"),
    ],
)
def test_contradictions_are_refused(
    ranges: dict[Axis, tuple[float, float]], samples: int, message: str
) -> None:
    with pytest.raises(InvalidOption, match=message):
        Tolerance(ranges, samples)

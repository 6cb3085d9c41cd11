"""Seams that are followed with changes of branch, ranges of position, and reasons."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from kinematics.pose import transform
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.options import CartesianOptions, Options
from planning.pipeline.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.result import Failure, Plan
from planning.tool_motions.tool_path import ToolRun
from planning.tool_motions.tool_tolerance import (
    Axis,
    SeamOptions,
    SeamWaypoint,
    StraightOffset,
    ToolTolerance,
)
from planning.tool_paths.seams.failure import explain_search
from planning.tool_paths.seams.following import refine, with_fewer_ranges
from planning.tool_paths.seams.path import SeamPlaces, seam_places, seam_runs
from planning.tool_paths.seams.search import SeamGraph, SeamSearch
from planning.tool_paths.tool_deviation import _own_motions, places_at
from planning.values.deadline import Deadline
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, box, builtin
from tests.planning.tool_boxes import deviations, excess

TILT = 0.2
DOWN = np.diag([1.0, -1.0, -1.0])


def line_search(reach: float) -> SeamSearch:
    """The search along a line in front of a Panda."""
    ends = np.linspace(-reach, reach, 80)
    points = tuple(SeamWaypoint(transform(DOWN, [0.5, y, 0.35])) for y in ends)
    tolerance = ToolTolerance.of({}, ("rz",), tilt=TILT)
    places = seam_places(seam_runs(SeamOptions(points, tolerance), 0.0))
    checker = Checker.of(builtin("panda"), Scene())
    return SeamSearch(checker, places, np.array(HOME), (), Deadline.after(60.0))


@pytest.mark.parametrize("reach", [0.15, 0.3, 0.4])
def test_a_calmer_way_is_short_and_keeps_to_the_tolerance_and_from_limits(reach: float) -> None:
    search = line_search(reach)
    joints = search.run().joints
    assert joints is not None
    calm = refine(search, joints)
    rates, calm_rates = (float((np.diff(q, axis=0) ** 2).sum()) for q in (joints, calm))
    assert calm_rates < 0.35 * rates
    oracle = PinocchioArm()
    for q, nominal in zip(calm, search.places.nominal, strict=True):
        T = oracle.pose(q)
        np.testing.assert_allclose(T[:3, 3], nominal[:3, 3], atol=2e-6)
        assert T[:3, 2] @ nominal[:3, 2] >= np.cos(TILT + 2e-6)
    limits = search.chain.limits
    half = 0.5 * (limits.upper - limits.lower)
    left, calm_left = (
        np.minimum(q - limits.lower, limits.upper - q).min(axis=0) / half for q in (joints, calm)
    )
    assert (calm_left >= np.minimum(left, 0.02) - 1e-9).all()


def test_a_way_near_a_limit_may_stay_as_near_to_it() -> None:
    search = line_search(0.15)
    joints = np.tile(np.array(HOME), (len(search.places.s), 1))
    joints[:, 6] = search.chain.limits.upper[6] - 0.01
    errors = search.project(joints, 0.1)
    assert errors.max() < 1e-6
    assert joints[:, 6].max() <= search.chain.limits.upper[6] - 0.01 + 1e-9


def layers(layer: int) -> tuple[SeamSearch, SeamGraph, np.ndarray]:
    """A line, the layers along it, checked, and the configurations of one of them."""
    points = tuple(SeamWaypoint(transform(DOWN, [0.5, y, 0.4])) for y in np.linspace(-0.2, 0.2, 9))
    places = seam_places(seam_runs(SeamOptions(points, ToolTolerance.of({}, ("rz",))), 0.0))
    checker = Checker.of(builtin("panda"), Scene())
    search = SeamSearch(checker, places, np.array(HOME), (), Deadline.after(60.0))
    graph = search.prepare(places.layers())
    search.check_all(graph)
    mine = np.arange(graph.nodes.firsts[layer], graph.nodes.firsts[layer + 1])
    return search, graph, mine


def leading_on(search: SeamSearch, graph: SeamGraph, layer: int) -> np.ndarray:
    """Configurations of a layer that lead to the few that are kept of the next one."""
    search.solve(graph)
    after = np.arange(graph.nodes.firsts[layer + 1], graph.nodes.firsts[layer + 2])
    kept = after[np.isfinite(graph.best[after])][:5]
    graph.costs[np.setdiff1d(after, kept)] = np.inf
    mine = np.arange(graph.nodes.firsts[layer], graph.nodes.firsts[layer + 1])
    steps = np.abs(graph.nodes.joints[mine][:, None] - graph.nodes.joints[kept][None])
    leads = (steps.max(axis=2).min(axis=1) <= graph.jump) & np.isfinite(graph.costs[mine])
    assert leads.any()
    assert (np.isfinite(graph.costs[mine]) & ~leads).any()
    return np.asarray(mine[leads])


@pytest.mark.parametrize(("in_the_way", "reason"), [(True, "collision"), (False, "branch")])
def test_a_way_that_collides_is_no_matter_of_branches(in_the_way: bool, reason: str) -> None:
    search, graph, _ = layers(4)
    closed = leading_on(search, graph, 3)
    graph.costs[closed] = np.inf
    graph.collided[closed] = in_the_way
    failure = explain_search(search, [graph])
    assert failure.details["reason"] == reason
    assert failure.details["waypoint"] == search.places.waypoint[graph.layers[4]]


def test_steps_with_a_collision_on_the_way_are_told_as_one() -> None:
    search, graph, _ = layers(4)
    opened = leading_on(search, graph, 3)
    after = np.arange(graph.nodes.firsts[4], graph.nodes.firsts[5])
    steps = [(int(i), int(j)) for i in opened for j in after[np.isfinite(graph.costs[after])]]
    graph.blocked += steps
    assert explain_search(search, [graph]).details["reason"] == "branch"
    graph.hits |= {step: graph.nodes.joints[step[0]] for step in steps}
    assert explain_search(search, [graph]).details["reason"] == "collision"


def test_the_look_that_comes_farthest_tells_where() -> None:
    search, far, mine = layers(6)
    _, near, few = layers(2)
    for graph, closed in ((far, mine), (near, few)):
        graph.costs[closed], graph.collided[closed] = np.inf, True
    for graphs in ([far, near], [near, far]):
        details = explain_search(search, graphs).details
        assert details["waypoint"] == search.places.waypoint[far.layers[6]]
        assert details["reason"] == "collision"


def test_what_stands_on_a_seam_is_no_matter_of_branches() -> None:
    search, graph, _ = layers(4)
    closed = [np.arange(graph.nodes.firsts[k], graph.nodes.firsts[k + 1]) for k in (4, 5)]
    for mine in closed:
        graph.costs[mine], graph.collided[mine] = np.inf, True
    failure = explain_search(search, [graph])
    assert not failure.details["other_branches"]
    at = search.places.waypoint[graph.layers]
    last = len(search.places.runs[0].motions)
    # The part begins at a waypoint, or at the next one where its first place lies behind.
    begins = int(at[6] + (search.places.waypoint[graph.layers[6] - 1] == at[6]))
    assert failure.details["followable"] == [
        {"from_waypoint": 0, "to_waypoint": int(at[3])},
        {"from_waypoint": begins, "to_waypoint": last},
    ]
    assert f"{begins} to {last} can be followed" in failure.hint


HAIR = 1e-4


def ranged(*axes: Axis) -> ToolTolerance:
    return ToolTolerance.of(dict.fromkeys(axes, (-0.001, 0.001)))


def along(tolerance: ToolTolerance, bends: bool) -> SeamPlaces:
    """Places on a line along y, or on a half circle."""
    if bends:
        points = [[0.4, 0.1, 0.3], [0.4, -0.1, 0.3]]
        via: list[np.ndarray | None] = [None, np.array([0.5, 0.0, 0.3])]
    else:
        points, via = [[0.4, -0.1, 0.3], [0.4, 0.1, 0.3]], [None, None]
    waypoints = tuple(
        SeamWaypoint(transform(DOWN, p), via=v) for p, v in zip(points, via, strict=True)
    )
    return seam_places(seam_runs(SeamOptions(waypoints, tolerance), 0.0))


@pytest.mark.parametrize(
    ("axes", "bends", "kept"),
    [
        ((), True, [()]),
        (("x", "z"), False, [("x", "z")]),
        (("x", "y"), False, [("x", "y"), ("x",), ()]),
        (("z",), True, [("z",)]),
        (("x",), True, [("x",), ()]),
        (("x", "z"), True, [("x", "z"), ("z",), ()]),
    ],
)
def test_ranges_across_the_path_are_kept_longest(
    axes: tuple[Axis, ...], bends: bool, kept: list[tuple[Axis, ...]]
) -> None:
    tried = list(with_fewer_ranges(along(ranged(*axes), bends), HAIR))
    for places, names in zip(tried, kept, strict=True):
        want = ranged(*names)
        for tolerance in (*places.tolerances, *places.runs[0].tolerances):
            np.testing.assert_array_equal(tolerance.lower, want.lower)
            np.testing.assert_array_equal(tolerance.upper, want.upper)
        np.testing.assert_array_equal(
            places.boxes[:, :3], np.tile(want.lower[:3], (len(places.s), 1))
        )


def off_at_own_places(run: ToolRun, poses: np.ndarray) -> float:
    """How far poses are out of the box of a run at the places that the tool is at [m]."""
    owners, box = _own_motions(run, poses), run.tolerances[0]
    motions = [run.motions[k] for k in owners]
    nominal = np.array(
        [m.poses(places_at(m, T[None]))[0] for m, T in zip(motions, poses, strict=True)]
    )
    return float(excess(box, deviations(box, nominal, poses))[:, 0].max())


def test_a_deviation_is_seen_from_the_place_that_the_tool_is_at() -> None:
    run = along(ranged("x"), True).runs[0]
    poses = run.poses(np.linspace(0.0, 1.0, 50))
    assert off_at_own_places(run, poses) < 1e-9
    oblique = poses.copy()
    # Along x by as much as is allowed: from the nearest place on the circle it is partly along y.
    oblique[:, 0, 3] += 1e-3
    radius = np.linalg.norm(oblique[:, :2, 3] - [0.4, 0.0], axis=1)
    angle = np.arctan2(oblique[:, 1, 3], oblique[:, 0, 3] - 0.4)
    off = np.abs((radius - 0.1) * np.sin(angle)).max()
    assert math.isclose(off, 5e-4, rel_tol=0.02)
    assert off_at_own_places(run, oblique) == pytest.approx(off, rel=0.1)


def test_a_point_outside_a_corner_belongs_to_the_motion_on_its_side() -> None:
    corner = [[0.4, -0.1, 0.3], [0.4, 0.0, 0.3], [0.42, 0.1, 0.3]]
    waypoints = tuple(SeamWaypoint(transform(DOWN, p)) for p in corner)
    run = seam_runs(SeamOptions(waypoints, ranged("x")), 0.0)[0]
    poses = run.poses(np.linspace(0.0, 1.0, 41))
    poses[:, 0, 3] -= 1e-3
    # The second line is oblique to x: along y it sees 1 mm sin cos of the angle.
    angle = math.atan(0.2)
    off = 1e-3 * math.sin(angle) * math.cos(angle)
    assert off_at_own_places(run, poses) == pytest.approx(off, rel=0.1)


SPEED, REACH, HEIGHT = 0.2, 0.5, 0.35
ANGLES = np.radians(np.linspace(130.0, 240.0, 111))
START = np.array([2.2, -1.2, 1.5, 0.1, 1.2, 0.1])
#: Largest angle of the first joint either way [rad].
TURN = 3.4
BACK = StraightOffset(np.array([0.0, 0.0, -1.0]), 0.06)


def arm() -> RobotGeometry:
    """A KR 6 that turns a little more than once, and can't reach over its back."""
    robot = builtin("kr6_sixx")
    lower, upper = robot.chain.limits.lower.copy(), robot.chain.limits.upper.copy()
    lower[:2], upper[0] = (-TURN, -1.7), TURN
    limits = replace(robot.chain.limits, lower=lower, upper=upper)
    return replace(robot, chain=replace(robot.chain, limits=limits))


def behind() -> tuple[SeamWaypoint, ...]:
    """An arc behind an arm whose first joint has to turn back, beyond 195 degrees."""
    down = np.diag([1.0, -1.0, -1.0])
    places = [[REACH * math.cos(a), REACH * math.sin(a), HEIGHT] for a in ANGLES]
    return tuple(SeamWaypoint(transform(down, place)) for place in places)


def ask(changes: StraightOffset | None, scene: Scene | None = None) -> Plan | Failure:
    points = behind()
    seam = SeamOptions(
        points, ToolTolerance.of({}, ("rz",)), tool_speed=SPEED, branch_changes=changes
    )
    problem = Problem(arm(), scene or Scene(), START, (PoseGoal(points[-1].T_base_tip),))
    how = CartesianOptions(seam=seam)
    return plan(problem, Options(planner="cartesian", cartesian=how, timeout=20.0))


def test_without_leave_the_seam_is_refused_where_the_branch_ends() -> None:
    answer = ask(None)
    assert isinstance(answer, Failure)
    assert answer.code == "PLANNING_FAILED"
    assert answer.details["reason"] in {"branch", "limit"}
    last = float(np.degrees(ANGLES[answer.details["reached_waypoint"]]))
    assert 185.0 <= last <= 195.0
    assert "branch_changes" in answer.hint


def test_with_a_change_the_whole_seam_is_followed_from_rest_to_rest() -> None:
    scene = Scene((box("post", (0.1, 0.1, 1.0), (-0.6, 0.6, 0.5)),))
    answer = ask(BACK, scene)
    assert isinstance(answer, Plan), answer
    assert answer.certificate.verified
    parts = [report.part for report in answer.tool_motions]
    cut = parts.index("retreat")
    assert parts[cut + 1] == "approach"
    assert parts.count("retreat") == parts.count("approach") == 1
    # Every way from waypoint to waypoint is carried out, once.
    seam = [report for report in answer.tool_motions if report.part == "seam"]
    assert [report.asked for report in seam] == list(range(len(ANGLES) - 1))
    changed = seam[cut].asked
    assert f"waypoints[{changed}]" in answer.notes[0]
    assert 180.0 <= np.degrees(ANGLES[changed]) <= 195.0
    # The tool is free while the first joint turns back, and at rest before and after.
    away, back = answer.tool_motions[cut], answer.tool_motions[cut + 1]
    motion = answer.trajectory
    assert back.begins > away.ends
    first, second = motion.sample([away.begins, back.ends])
    assert abs(second[0] - first[0]) > 4.0
    rests = [away.begins, away.ends, back.begins, back.ends, motion.duration]
    np.testing.assert_allclose(motion.sample(rests, 1), 0.0, atol=1e-6)
    # Tool and clearance hold by independent kinematics.
    oracle, fcl = PinocchioArm("kr6_sixx"), FclJudge(builtin("kr6_sixx"), scene)
    for time in np.linspace(0.0, motion.duration, 400):
        assert not fcl.collides(motion.sample([time])[0])
    for report in seam:
        for time in np.linspace(report.begins, report.ends, 5):
            q = motion.sample([min(time, motion.duration)])[0]
            T = oracle.pose(q)
            a, b = report.motion.T_start[:3, 3], report.motion.T_end[:3, 3]
            s = np.clip((T[:3, 3] - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            assert np.linalg.norm(T[:3, 3] - a - s * (b - a)) <= 1.1e-4
            assert T[2, 2] <= -math.cos(1.1e-3)


def test_a_retreat_out_of_reach_leaves_the_reason_of_one_branch() -> None:
    answer = ask(StraightOffset(np.array([0.0, 0.0, -1.0]), 3.0))
    assert isinstance(answer, Failure)
    assert answer.details["reason"] in {"branch", "limit"}
    assert "waypoint" in answer.details

"""Exported files read back, and the controller's motion between their points sampled densely."""

import csv
import io
import json
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import yaml
from scipy.interpolate import BPoly, PPoly

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.trajectory.trajectory import Trajectory, interpolate
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import lever_arms
from obstacles.scenes.scene import Scene
from planning.exports.export import Export, export, joint_tolerance, plain
from planning.exports.options import PATH_FORMATS, ExportFormat, ExportOptions
from planning.options import Options
from planning.problem import JointGoal, Problem
from planning.timing.options import Solver, TimingOptions
from planning.timing.path.simplification import fewest_waypoints
from tests.mimic_joints import mimic_robot
from tests.planning.exports.interpreters import read, single
from tests.planning.scenes import builtin, pillar, planned_motion

FORMATS = list(ExportFormat)
STREAMS = [ExportFormat.EGM, ExportFormat.RSI]
UR = builtin("ur5e")
START = np.array([0.0, -1.4, 1.2, -1.0, 0.3, 0.1])
END = np.array([1.3, -1.1, 0.7, -1.6, -0.4, 0.9])
SCENE = pillar(-1.2, 0.6)


def rest_to_rest(duration: float = 2.0) -> Trajectory:
    """The quintic from START to END that begins and ends at rest without acceleration."""
    step = END - START
    powers = [START, 0 * step, 0 * step, 10 * step, -15 * step, 6 * step]
    rows = [row / duration**k for k, row in enumerate(powers)]
    return Trajectory(UR.chain.joint_names, np.array([0.0, duration]), np.stack(rows, -1)[None])


def curved(duration: float = 3.0) -> Trajectory:
    """One quintic after another, the first joint ahead of the others: no straight path."""
    motion = rest_to_rest(duration)
    c = motion.coefficients.copy()
    c[0, 0, 3:] = 0.0
    c[0, 0, :4] = [START[0], 0.0, 3.0 * (END - START)[0] / duration**2, 0.0]
    c[0, 0, 3] = -2.0 * (END - START)[0] / duration**3
    return Trajectory(motion.joint_names, motion.breaks, c)


def write(format_: ExportFormat, motion: Trajectory | None = None, **options: object) -> Export:
    period = {"sample_period": None if format_ in STREAMS else 0.05}
    wanted = ExportOptions(format_, **period | options)  # type: ignore[arg-type]
    return export(motion or curved(), UR, SCENE, wanted)


def points_of(made: Export, format_: ExportFormat) -> tuple[Array | None, list[Array]]:
    """Times and derivatives as parsers that were not written here read them."""
    if format_ == ExportFormat.CSV:
        body = [line for line in made.text.splitlines() if not line.startswith("#")]
        rows = np.array(list(csv.reader(io.StringIO("\n".join(body))))[1:], dtype=float)
        return rows[:, 0], np.split(rows[:, 1:], rows.shape[1] // 6, axis=1)
    if format_ in STREAMS:
        rows = np.array([one.q for one in read(made.text, format_)])
        return ExportOptions(format_).period * np.arange(float(len(rows))), [rows]
    if format_ in (*PATH_FORMATS, ExportFormat.URSCRIPT_SERVOJ):
        rows = np.array([one.q for one in read(made.text, format_) if one.q is not None])
        steps = [float(t) for t in re.findall(r", t=(.*?),", made.text)]
        return np.cumsum([0.0, *steps]) if steps else None, [rows]
    load = json.loads if format_ == ExportFormat.JOINT_TRAJECTORY_JSON else yaml.safe_load
    message = load(made.text)
    message = message.get("trajectory", message)
    assert message["joint_names"] == list(UR.chain.joint_names)
    stamps = [p["time_from_start"] for p in message["points"]]
    kinds = [k for k in ("positions", "velocities", "accelerations") if message["points"][0].get(k)]
    read_rows = [np.array([p[kind] for p in message["points"]], dtype=float) for kind in kinds]
    return np.array([s["sec"] + s["nanosec"] / 1e9 for s in stamps]), read_rows


def interpolated(times: Array | None, rows: list[Array], count: int) -> Array:
    """Configurations between points by scipy's Hermite polynomials; legs where there is no time."""
    if times is None:
        shares = np.linspace(0.0, 1.0, max(2, count // len(rows[0])))[:, None]
        return np.vstack([a + shares * (b - a) for a, b in pairwise(rows[0])])
    curve = PPoly.from_bernstein_basis(BPoly.from_derivatives(times, np.stack(rows, axis=1)))
    return np.asarray(curve(np.linspace(0.0, times[-1], count)))


@pytest.mark.parametrize("format_", FORMATS)
def test_the_interpolation_of_what_is_read_back_is_as_clear_as_proved(
    format_: ExportFormat,
) -> None:
    made = write(format_)
    assert made.proved, made.certificate.violation
    times, rows = points_of(made, format_)
    assert len(rows[0]) == made.point_count
    np.testing.assert_array_equal(made.motion.coefficients[:, :, 0], rows[0][:-1])
    world = FclWorld(UR, SCENE)
    dense = interpolated(times, rows, 300)
    least = min(world.clearance(q).distance for q in dense)
    assert made.certificate.min_clearance <= least + 1e-7
    if times is not None:
        apart = np.abs(dense - curved().sample(np.linspace(0.0, times[-1], 300))).max(axis=0)
        assert made.joint_deviation is not None
        assert (apart <= made.joint_deviation + 1e-9).all()
        assert (made.joint_deviation <= apart + 1e-4).all()
        np.testing.assert_allclose(
            dense, made.motion.sample(np.linspace(0, times[-1], 300)), atol=1e-9
        )


@pytest.mark.parametrize("format_", [ExportFormat.CSV, ExportFormat.ROS2_CONTROL])
def test_points_are_as_many_and_as_far_apart_as_asked(format_: ExportFormat) -> None:
    rng = np.random.default_rng(1)
    motion = planned_motion(Problem(UR, SCENE, START, (JointGoal(END),))).trajectory
    for _ in range(8):
        count = int(rng.integers(60, 300))
        many = write(format_, motion, sample_period=None, sample_count=count)
        times, rows = points_of(many, format_)
        assert times is not None
        assert len(rows[0]) == count
        np.testing.assert_allclose(np.diff(times), motion.duration / (count - 1), atol=2e-9)
        at = np.minimum(times, motion.duration)
        np.testing.assert_allclose(rows[0], motion.sample(at), atol=1e-6)
        least = float(rng.uniform(0.005, 0.05))
        apart = write(format_, motion, sample_period=0.01, least_spacing=least)
        times, rows = points_of(apart, format_)
        assert times is not None
        assert np.diff(times).min() >= least - 2e-9
        assert np.diff(times).max() < 2.0 * least + 0.011
        # What is between fewer points is judged, by the interpolation of the reader.
        dense = interpolated(times, rows, 300)
        assert apart.joint_deviation is not None
        off = np.abs(dense - motion.sample(np.linspace(0.0, motion.duration, 300))).max(axis=0)
        assert (off <= apart.joint_deviation + 1e-6).all()
    for wrong in ({"sample_count": 9, "sample_period": 0.1}, {"sample_count": 1},
                  {"least_spacing": np.nan}, {"least_spacing": -1.0}):  # fmt: skip
        with pytest.raises(InvalidOption):
            write(format_, motion, **{"sample_period": None} | wrong)
    for other in (ExportFormat.RAPID, ExportFormat.EGM):
        with pytest.raises(InvalidOption, match="do not belong"):
            write(other, sample_period=None, sample_count=9)


@pytest.mark.parametrize("format_", sorted(PATH_FORMATS))
def test_a_path_stays_within_its_tolerance(format_: ExportFormat) -> None:
    made = write(format_, path_tolerance=0.01)
    _, rows = points_of(made, format_)
    legs = interpolated(None, rows, 4000)
    for q in curved().sample(np.linspace(0.0, 3.0, 61)):
        assert np.linalg.norm(legs - q, axis=1).min() <= 0.01 + 2e-3
    assert made.point_count < 20
    assert write(format_, rest_to_rest()).point_count == 2  # a straight line needs no more


def test_quintics_through_a_quintic_change_nothing() -> None:
    made = write(ExportFormat.CSV, rest_to_rest())
    assert made.rule == "quintic"
    assert made.joint_deviation is not None
    assert made.joint_deviation.max() < 1e-9
    assert made.certificate.verified


def test_points_at_jumps_of_the_acceleration_keep_its_limit() -> None:
    """Bang-bang motions, as the fastest timing has them, are cubics between their jumps."""
    half = 0.5 * (END - START)
    c = np.zeros((2, 6, 3))
    c[0, :, 0], c[0, :, 2] = START, half / 1.3**2
    c[1, :, 0], c[1, :, 1], c[1, :, 2] = START + half, 2.0 * half / 1.3, -half / 1.3**2
    motion = Trajectory(UR.chain.joint_names, np.array([0.0, 1.3, 2.6]), c)
    for period in (0.5, 0.51, 1.2999):
        made = write(ExportFormat.JOINT_TRAJECTORY_YAML, motion, sample_period=period)
        assert made.rule == "cubic"
        assert made.joint_deviation is not None
        assert made.joint_deviation.max() < 1e-9
        peaks = made.motion.peaks(2).value
        np.testing.assert_allclose(peaks, np.abs(c[0, :, 2]) * 2.0, rtol=1e-6)


@pytest.mark.parametrize("solver", ["quintic_spline", "double_s"])
@pytest.mark.parametrize("period", [0.01, 0.37, 5.0])
def test_motions_of_bounded_jerk_keep_their_limits(solver: Solver, period: float) -> None:
    """Quintics across two pieces exceeded the jerk of planned motions by a third."""
    options = Options(timing=TimingOptions("jerk_limited", solver=solver))
    planned = planned_motion(Problem(UR, SCENE, START, (JointGoal(END),)), options)
    made = write(ExportFormat.ROS2_CONTROL, planned.trajectory, sample_period=period)
    assert made.rule == "quintic"
    assert made.certificate.verified, made.unproved
    assert made.joint_deviation is not None
    assert made.joint_deviation.max() < 1e-5
    times, rows = points_of(made, ExportFormat.ROS2_CONTROL)
    assert times is not None
    curve = PPoly.from_bernstein_basis(BPoly.from_derivatives(times, np.stack(rows, axis=1)))
    for order, (name, used) in enumerate(made.certificate.limits.items()):
        if order:
            limit = getattr(UR.chain.limits, name)
            peak = np.abs(curve.derivative(order)(np.linspace(0.0, times[-1], 2000))).max(axis=0)
            assert (peak <= limit * (1.0 + 1e-8)).all()
            assert used.worst_ratio <= 1.0 + 1e-9


def test_lines_between_few_points_are_proved_as_such() -> None:
    motion = curved()
    coarse = write(ExportFormat.CSV, motion, interpolation="linear", sample_period=1.0)
    fine = write(ExportFormat.CSV, motion, interpolation="linear", sample_period=0.01)
    assert coarse.joint_deviation is not None
    assert fine.joint_deviation is not None
    assert coarse.joint_deviation.max() > 100.0 * fine.joint_deviation.max()
    assert any("velocity jumps" in reason for reason in coarse.unproved)


def test_an_interpolation_that_cuts_into_an_obstacle_is_not_proved() -> None:
    """The motion goes around a pillar, the straight line between two exported points through it."""
    start, end = (
        np.array([-0.8, -0.4, 0.3, 0.0, 0.0, 0.0]),
        np.array([0.8, -0.4, 0.3, 0.0, 0.0, 0.0]),
    )
    over = np.array([0.0, -2.2, 2.0, 0.0, 0.0, 0.0])
    q, names = np.array([start, over, end]), UR.chain.joint_names
    motion = interpolate(names, [0.0, 2.0, 4.0], q, "quintic", np.zeros((3, 6)), np.zeros((3, 6)))
    for period, is_free in ((0.02, True), (4.0, False)):
        options = ExportOptions(ExportFormat.CSV, period, "linear")
        made = export(motion, UR, pillar(0.0, -0.8), options)
        assert made.proved == is_free
        assert made.text.splitlines()[2].startswith("# PROVED" if is_free else "# NOT PROVED")
        _, rows = points_of(made, ExportFormat.CSV)
        legs = interpolated(None, rows[:1], 400)
        world = FclWorld(UR, pillar(0.0, -0.8))
        assert (min(world.clearance(at).distance for at in legs) > 0.0) == is_free


def leaves(points: Array, k: int, end: int, radius: float) -> Array:
    """The farthest point of a leg from its corner that is within a radius about the flange."""
    shares = np.linspace(0.0, 1.0, 4001)[:, None]
    leg = points[k] + shares * (points[end] - points[k])
    away = np.linalg.norm((forward(UR.chain, leg) - forward(UR.chain, points[k]))[:, :3, 3], axis=1)
    return np.asarray(leg[np.flatnonzero(away <= radius)[-1]])


@pytest.mark.parametrize("format_", sorted(PATH_FORMATS))
def test_whatever_curve_cuts_a_corner_is_free(format_: ExportFormat) -> None:
    random, cut = np.random.default_rng(38), 0
    for _ in range(12):
        q = np.array([START, START + random.uniform(-0.6, 0.6, 6), END])
        q = np.vstack([q, END + random.uniform(-0.5, 0.5, 6)])
        times = [0.0, 1.0, 2.0, 3.0]
        motion = interpolate(UR.chain.joint_names, times, q, "cubic", np.zeros((4, 6)))
        scene = pillar(random.uniform(-1.5, 1.5), random.uniform(0.35, 0.8))
        blend = float(random.choice([0.01, 0.1, 0.5]))
        made = export(motion, UR, scene, ExportOptions(format_, 0.05, blend=blend))
        if not made.proved:
            assert not made.blends.any()
            continue
        points = points_of(made, format_)[1][0]
        assert (made.blends <= blend).all()
        assert not made.blends[[0, -1]].any()
        world = FclWorld(UR, scene)
        shares = np.zeros(len(points))
        if format_ == ExportFormat.KRL:
            written = re.findall(r"\$APO.CPTP = (\d+)\nPTP \{A1 (\S+?),", made.text)
            for percent, first in written:
                at = np.flatnonzero(np.abs(points[:, 0] - single(np.array([float(first)]))) == 0.0)
                shares[at[0]] = float(percent) / 200.0
        for k in np.flatnonzero(made.blends).tolist():
            cut += 1
            if format_ == ExportFormat.KRL:
                ends = [points[k] + shares[k] * (points[i] - points[k]) for i in (k - 1, k + 1)]
            else:
                ends = [leaves(points, k, i, made.blends[k]) for i in (k - 1, k + 1)]
                for i in (k - 1, k + 1):
                    T = forward(UR.chain, points[[k, i]])
                    chord = np.linalg.norm(T[0, :3, 3] - T[1, :3, 3])
                    assert made.blends[k] + made.blends[i] <= chord
            weights = random.dirichlet([0.5, 0.5, 0.5], 40)
            inside = weights @ np.array([points[k], *ends])
            assert min(world.clearance(at).distance for at in inside) > 0.0
    assert cut > 8


def test_one_unit_of_blends_is_written_in_that_of_each_language() -> None:
    made = {one: write(one, blend=0.02, path_tolerance=0.03) for one in PATH_FORMATS}
    assert all(one.proved for one in made.values())
    script, rapid, krl = (made[one] for one in (
        ExportFormat.URSCRIPT_MOVEJ, ExportFormat.RAPID, ExportFormat.KRL))  # fmt: skip
    radii = [float(r) for r in re.findall(r"r=(\S+)\)", script.text)]
    np.testing.assert_array_equal(radii, script.blends[1:])
    assert 0.001 < max(radii) <= 0.02
    size = f"{1e3 * rapid.blends.max():.2f}"
    assert f" := [FALSE, {size}, {size}, {size}, 1, {size}, 1];" in rapid.text
    assert re.findall(r"MoveAbsJ .*, (\w+), tool0", rapid.text)[0] == "fine"
    assert all(0 < int(x) <= 90 for x in re.findall(r"CPTP = (\d+)", krl.text))
    assert "Not covered: Corners that are cut outside of the triangle" in script.text


def test_joints_within_the_tolerance_touch_nothing() -> None:
    made = write(ExportFormat.ROS2_CONTROL)
    assert made.tolerance is not None
    goal = yaml.safe_load(made.text)
    assert [row["position"] for row in goal["path_tolerance"]] == [made.tolerance] * 6
    world, random = FclWorld(UR, SCENE), np.random.default_rng(5)
    for q in curved().sample(np.linspace(0.0, 3.0, 40)):
        off = q + made.tolerance * random.choice([-1.0, 1.0], 6)
        assert world.clearance(off).distance > 0.0


@pytest.mark.parametrize(
    ("robot", "options", "words"),
    [
        ("panda", {"format": ExportFormat.URSCRIPT_SERVOJ}, "moves 6 joints"),
        ("scara", {"format": ExportFormat.KRL}, "slides"),
        ("ur5e", {"format": ExportFormat.CSV, "blend": 1.0}, "blend"),
        ("ur5e", {"format": ExportFormat.RAPID, "interpolation": "cubic"}, "has its own"),
        ("puma560", {"format": ExportFormat.RAPID, "blend": 0.1}, "no link 'tool0'"),
        ("ur5e", {"format": ExportFormat.CSV, "interpolation": "spline"}, "there is no"),
        ("ur5e", {"format": ExportFormat.KRL, "name": "a b"}, "no name of a program"),
        ("ur5e", {"format": ExportFormat.CSV, "sample_period": 1e-6}, "more than"),
        ("ur5e", {"format": ExportFormat.CSV, "sample_period": 0.0}, "positive"),
    ],
)
def test_what_does_not_fit_is_refused(robot: str, options: dict[str, object], words: str) -> None:
    arm = builtin(robot)
    n = arm.chain.n
    motion = Trajectory(arm.chain.joint_names, np.array([0.0, 1.0]), np.zeros((1, n, 2)))
    with pytest.raises(InvalidOption, match=words):
        export(motion, arm, SCENE, ExportOptions(**options))  # type: ignore[arg-type]


def test_names_can_not_break_out_of_comments() -> None:
    assert plain("a\nmovej([0])\r\x85é") == "a?movej([0])???"


def trapezoids(random: np.random.Generator) -> Trajectory:
    """A motion at rest at both ends whose durations are no whole nanoseconds."""
    step, rise = END - START, random.uniform(0.003, 0.3)
    cruise = random.uniform(0.2, 2.0)
    v = step / (rise + cruise)
    c = np.zeros((3, 6, 3))
    c[0, :, 0], c[0, :, 2] = START, 0.5 * v / rise
    c[1, :, 0], c[1, :, 1] = START + 0.5 * v * rise, v
    c[2, :, 0], c[2, :, 1] = START + v * (0.5 * rise + cruise), v
    c[2, :, 2] = -0.5 * v / rise
    breaks = np.array([0.0, rise, rise + cruise, 2.0 * rise + cruise])
    return Trajectory(UR.chain.joint_names, breaks, c)


@pytest.mark.parametrize("format_", FORMATS)
def test_files_end_at_rest_where_the_motion_does(format_: ExportFormat) -> None:
    """joint_trajectory_controller refuses last velocities above the epsilon of float32."""
    random = np.random.default_rng(11)
    for _ in range(4):
        motion = trapezoids(random)
        period = None if format_ in STREAMS else 0.1
        times, rows = points_of(write(format_, motion, sample_period=period), format_)
        degrees = format_ in (ExportFormat.RAPID, ExportFormat.KRL, *STREAMS)
        np.testing.assert_allclose(rows[0][0], START, rtol=0.0, atol=1e-6 if degrees else 0.0)
        np.testing.assert_allclose(rows[0][-1], END, rtol=0.0, atol=1e-6 if degrees else 1e-15)
        if len(rows) > 1:
            assert not rows[1][[0, -1]].any()
        if times is not None:
            longer = ExportOptions(format_).period if format_ in STREAMS else 1e-9
            assert 0.0 <= times[-1] - motion.duration <= longer + 1e-15


def test_a_motion_that_ends_moving_is_written_so() -> None:
    motion = curved()
    half = Trajectory(motion.joint_names, np.array([0.0, 1.5]), motion.coefficients)
    _, rows = points_of(write(ExportFormat.CSV, half), ExportFormat.CSV)
    np.testing.assert_allclose(rows[1][-1], half.sample([1.5], 1)[0], rtol=1e-12)


GUARDS = {
    ExportFormat.URSCRIPT_SERVOJ: r"norm\(q_now\[i\] - q_start\[i\]\) > (\S+):",
    ExportFormat.URSCRIPT_MOVEJ: r"norm\(q_now\[i\] - q_start\[i\]\) > (\S+):",
    ExportFormat.RAPID: r"ABS\(now.robax.rax_\d - \((\S+)\)\) > (\S+) THEN",
    ExportFormat.KRL: r"WHILE ABS\(\$AXIS_ACT.A\d - \((\S+)\)\) > (\S+)",
}


@pytest.mark.parametrize("format_", sorted(GUARDS))
@pytest.mark.parametrize("distance", [0.45, 0.6, 1.2])
def test_programs_begin_only_where_their_proof_holds(
    format_: ExportFormat, distance: float
) -> None:
    options = ExportOptions(format_, sample_period=0.05)
    made = export(curved(), UR, pillar(-1.2, distance), options)
    assert made.tolerance is not None
    found = re.findall(GUARDS[format_], made.text)
    if format_ in (ExportFormat.URSCRIPT_SERVOJ, ExportFormat.URSCRIPT_MOVEJ):
        assert [float(x) for x in found] == [made.tolerance]
        return
    start = points_of(made, format_)[1][0][0]
    np.testing.assert_array_equal(single(np.array([float(x) for x, _ in found])), start)
    allowed = np.deg2rad([float(x) for _, x in found])
    assert len(allowed) == 6
    assert (allowed <= made.tolerance).all()
    np.testing.assert_allclose(allowed, made.tolerance, rtol=1e-5)


@pytest.mark.parametrize("format_", FORMATS)
def test_every_file_says_what_it_is_proved_against(format_: ExportFormat) -> None:
    if format_ == ExportFormat.JOINT_TRAJECTORY_JSON:
        return  # JSON has no comments
    premises = write(format_).certificate.premises
    head = " ".join(write(format_).text.splitlines()[:12])
    assert f"PROVED free of collisions by that rule, {premises.against()}" in head
    alone = export(curved(), UR, Scene(), ExportOptions(format_))
    assert "PROVED free of collisions by that rule, against the robot itself only" in alone.text


def test_a_motion_is_not_exported_for_another_scene_unless_told() -> None:
    planned = planned_motion(Problem(UR, SCENE, START, (JointGoal(END),)), Options())
    premises, options = planned.certificate.premises, ExportOptions(ExportFormat.CSV)
    motion = planned.trajectory
    assert export(motion, UR, SCENE, options, premises=premises).proved
    for scene in (Scene(), pillar(-1.2, 0.7), Scene(SCENE.obstacles, [("post", "wrist_3_link")])):
        with pytest.raises(InvalidOption, match="under other premises"):
            export(motion, UR, scene, options, premises=premises)
        made = export(motion, UR, scene, options, premises=premises, different_scene=True)
        assert made.certificate.premises.scene_hash == scene.content_hash


@pytest.mark.parametrize("name", ["ur5e", "panda", "scara", "stanford", "mimic joints"])
def test_a_joint_changes_distances_by_at_most_its_lever_arm(name: str) -> None:
    robot = mimic_robot() if name == "mimic joints" else builtin(name)
    every = {(a, b): "obstacles alone" for a in robot.names for b in robot.names if a < b}
    robot = replace(robot, allowed=every)
    arms, n = lever_arms(robot), robot.chain.n
    lower, upper = robot.chain.sampling_bounds()
    random = np.random.default_rng(6)
    largest = np.zeros(n)
    for _ in range(12):
        world = FclWorld(robot, pillar(random.uniform(-3.0, 3.0), random.uniform(0.3, 1.5)))
        q = random.uniform(lower, upper)
        before = world.clearance(q).distance
        for k in range(n):
            moved = q + 0.01 * np.eye(n)[k]
            if before > 0.05:
                rate = abs(world.clearance(moved).distance - before) / 0.01
                assert rate <= arms[k] + 1e-5
                largest[k] = max(largest[k], rate)
    assert largest.max() > 0.15 * arms[int(np.argmax(largest))]  # no bound that says nothing


@pytest.mark.parametrize("clearance", [0.0, -0.1, np.inf])
def test_no_tolerance_without_a_clearance(clearance: float) -> None:
    assert joint_tolerance(builtin("ur5e"), clearance) is None


def test_a_way_back_on_the_same_line_keeps_its_turn() -> None:
    line = np.array([[0.0], [0.4], [1.0], [0.5], [0.0]])
    assert fewest_waypoints(line, 1e-6, 2.0)[0].tolist() == [0, 2, 4]

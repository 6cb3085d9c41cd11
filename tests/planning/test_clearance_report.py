"""Spans of a motion nearer than preferred, against FCL at every ten thousandth of it."""

from dataclasses import replace

import numpy as np

from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import hulled
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.clearance_report import clearance_report
from planning.values.preferences import PreferredClearance
from tests.obstacles.test_hulled import robot
from tests.planning.scenes import box, builtin

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

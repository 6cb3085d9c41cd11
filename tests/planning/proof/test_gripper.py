"""The proof of a gripper's motion, against FCL at many instants of it."""

import random
from fractions import Fraction
from functools import cache
from pathlib import Path

import fcl
import numpy as np
import pytest
from scipy.spatial import ConvexHull

import armwright as aw
from benchmarks.problems.example_arms import ARMS
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from planning.proof.certificate import Certificate, certify_gripper
from planning.values.deadline import Deadline
from planning.values.finger_motion import FingerMotion, least_duration

_HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
_JOINT = "panda_finger_joint1"
_BAR = 0.02


@cache
def _panda() -> RobotGeometry:
    return ARMS["panda"].geometry({"acceleration": 10.0})


def _bar(y: float) -> aw.Scene:
    """A cube beside the finger tips, ``y`` along the way of the left one."""
    T = forward(_panda().chain, _HOME, "panda_hand_tcp") @ aw.pose([0.0, y, 0.0])
    return aw.Scene([aw.Obstacle("bar", aw.Box((_BAR,) * 3), T)])


def _motion(first: float, last: float, duration: float = 0.5) -> FingerMotion:
    return FingerMotion(_panda().fingers, {_JOINT: first}, {_JOINT: last}, duration)


def _proved(scene: aw.Scene, motion: FingerMotion, margin: float = 0.0) -> Certificate:
    return certify_gripper(motion, _panda(), scene, _HOME, margin=margin)


def _sampled(scene: aw.Scene, motion: FingerMotion) -> Array:
    """FCL's least distance of both fingers from the bar at 60 instants, shape (60,)."""
    chain, bar = _panda().chain, scene.obstacle("bar").T_world_obstacle
    solid = fcl.CollisionObject(fcl.Box(*(_BAR,) * 3), fcl.Transform(bar[:3, :3], bar[:3, 3]))
    trajectory = motion.trajectory
    least = []
    for values in trajectory.sample(np.linspace(0.0, motion.duration, 60)):
        robot = with_fingers(_panda(), {_JOINT: float(np.clip(values[0], 0.0, 0.04))})
        T_tip = forward(chain, _HOME) @ np.linalg.inv(chain.link(chain.tip_link).T_joint_link)
        distances = []
        for piece, link in zip(robot.pieces, robot.links, strict=True):
            if "finger" not in link:
                continue
            T = T_tip @ piece.T_owner_piece
            points = fcl.BVHModel()
            hull = aw.Mesh(*_hull(piece.vertices))
            points.beginModel(len(hull.faces), len(hull.vertices))
            points.addSubModel(hull.vertices, hull.faces)
            points.endModel()
            finger = fcl.CollisionObject(points, fcl.Transform(T[:3, :3], T[:3, 3]))
            distances.append(fcl.distance(finger, solid))
        least.append(min(distances))
    return np.array(least)


def _hull(vertices: Array) -> tuple[Array, Array]:
    return np.array(vertices), np.array(ConvexHull(vertices).simplices)


@pytest.mark.parametrize("y", [0.065, 0.0625, 0.08])
def test_a_proved_motion_is_clear_at_every_instant_and_by_no_less_than_is_told(y: float) -> None:
    scene, motion = _bar(y), _motion(0.0, 0.035)
    certificate, sampled = _proved(scene, motion), _sampled(scene, motion)
    assert certificate.verified
    assert certificate.proved.collisions
    assert certificate.obstacle_pair is not None
    assert 0.0 < certificate.min_obstacle_clearance <= sampled.min() + 1e-9
    assert "fingers" in certificate.method


@pytest.mark.parametrize(("first", "last"), [(0.0, 0.04), (0.04, 0.0)])
def test_a_finger_that_meets_something_on_its_way_is_told_with_its_time(
    first: float, last: float
) -> None:
    scene, motion = _bar(0.04), _motion(first, last)
    certificate, sampled = _proved(scene, motion), _sampled(scene, motion)
    assert sampled.min() <= 0.0
    violation = certificate.violation
    assert not certificate.verified
    assert violation is not None
    assert violation.kind == "collision"
    assert set(violation.details["pair"]) == {"panda_leftfinger", "bar"}
    touched = float(np.linspace(0.0, motion.duration, 60)[np.argmax(sampled <= 0.0)])
    assert violation.time == pytest.approx(touched, abs=0.03)


def test_margins_and_time_are_held_to() -> None:
    motion = _motion(0.0, 0.035)
    free = _proved(_bar(0.065), motion).min_obstacle_clearance
    assert _proved(_bar(0.065), motion, 0.5 * free).verified
    assert not _proved(_bar(0.065), motion, 0.02).verified
    late = certify_gripper(motion, _panda(), _bar(0.065), _HOME, deadline=Deadline.after(0.0))
    assert late.violation is not None
    assert late.violation.kind == "time"


_ARM = (
    '<robot name="g"><link name="base"/><link name="palm"><collision><geometry>'
    '<sphere radius="0.01"/></geometry></collision></link><joint name="turn" type="revolute">'
    '<parent link="base"/><child link="palm"/><axis xyz="0 0 1"/>'
    '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint><link name="tcp"/>'
    '<joint name="end" type="fixed"><parent link="palm"/><child link="tcp"/></joint>'
)
_FINGER = (
    '<link name="{0}_link"/><joint name="{0}" type="prismatic"><parent link="palm"/>'
    '<child link="{0}_link"/><axis xyz="0 1 0"/><limit effort="1" {1}/>{2}</joint>'
)
_MIMIC = '<mimic joint="{}" multiplier="{}" offset="{}"/>'
#: Largest derivatives of 10 s^3 - 15 s^4 + 6 s^5.
_PROFILE = {"velocity": 1.875, "acceleration": 10.0 / 3.0**0.5, "jerk": 60.0}
_Limits = dict[str, Fraction]


def _gripper(fingers: str, folder: Path) -> RobotGeometry:
    file = folder / "gripper.urdf"
    file.write_text(f"{_ARM}{fingers}</robot>", "utf-8")
    return aw.load_robot(file, tip_link="tcp")


def _written(name: str, limits: _Limits, mimic: str = "") -> str:
    given = " ".join(f'{quantity}="{float(value)!r}"' for quantity, value in limits.items())
    return _FINGER.format(name, given, mimic)


def test_a_finger_that_follows_keeps_its_limits(tmp_path: Path) -> None:
    slide = {"lower": Fraction(0), "upper": Fraction("0.04"), "velocity": Fraction("0.1")}
    mimic = _MIMIC.format("left", 2, 0)
    robot = _gripper(_written("left", slide) + _written("right", slide, mimic), tmp_path)
    for last, duration, kind in (
        (0.02, 0.75, None), (0.02, 0.74, "velocity"), (0.021, 9.0, "position")
    ):  # fmt: skip
        motion = FingerMotion(robot.fingers, {"left": 0.0}, {"left": last}, duration)
        certificate = certify_gripper(motion, robot, aw.Scene([]), np.zeros(1))
        assert certificate.verified is (kind is None)
        assert kind is None or certificate.violation is not None
        if certificate.violation is not None:
            assert certificate.violation.kind == kind
    with pytest.raises(InvalidOption, match=r"outside its limits \[0, 0.02\]"):
        with_fingers(robot, {"left": 0.03})
    assert any("narrow those of 'left' to [0, 0.02]" in line for line in robot.lint)


def test_mimic_joints_narrow_their_leader_as_exact_arithmetic_says(tmp_path: Path) -> None:
    """Lines of mimics with offsets and signs, each joint held to the numbers of its own line."""
    chance, verdicts = random.Random(4), set()
    for _ in range(30):
        joints, how = _linkage(chance)
        text = "".join(_written(name, joints[name], mimic) for name, (mimic, _, _) in how.items())
        robot = _gripper(text, tmp_path)
        room = [
            sorted((limit - b) / m for limit in (joints[name]["lower"], joints[name]["upper"]))
            for name, (_, m, b) in how.items()
        ]
        low, high = max(ends[0] for ends in room), min(ends[1] for ends in room)
        if low >= high:
            continue
        first = low + (high - low) * Fraction(chance.randrange(101), 100)
        last = low + (high - low) * Fraction(chance.randrange(-20, 121), 100)
        least = max(
            (peak * float(abs(m * (last - first)) / joints[name][quantity])) ** (1.0 / order)
            for name, (_, m, _) in how.items()
            for order, (quantity, peak) in enumerate(_PROFILE.items(), 1)
        )
        duration = least * chance.choice([0.9, 0.999, 1.001, 1.3]) + 1e-6
        ends = {"f0": float(first)}, {"f0": float(last)}
        motion = FingerMotion(robot.fingers, *ends, duration)
        wanted = low <= last <= high and duration >= least
        proved = certify_gripper(motion, robot, aw.Scene([]), np.zeros(1)).verified
        assert proved is wanted
        verdicts.add(proved)
        assert least_duration(robot.fingers, *ends) == pytest.approx(least, rel=1e-9)
    assert verdicts == {True, False}


def _linkage(
    chance: random.Random,
) -> tuple[dict[str, _Limits], dict[str, tuple[str, Fraction, Fraction]]]:
    """Limits of fingers by name, and how each follows f0: its mimic, multiplier and offset."""
    joints = {"f0": _drawn(chance, Fraction(chance.randrange(-3, 1), 50), Fraction(1, 20))}
    how = {"f0": ("", Fraction(1), Fraction(0))}
    for k in range(1, chance.randrange(2, 5)):
        above = chance.choice(list(how))
        m = Fraction(chance.choice([-1, 1]) * chance.randrange(3, 30), 10)
        b = Fraction(chance.randrange(-5, 6), 100)
        _, by, shift = how[above]
        how[f"f{k}"] = _MIMIC.format(above, float(m), float(b)), m * by, m * shift + b
        ends = sorted(m * by * joints["f0"][end] + m * shift + b for end in ("lower", "upper"))
        inset = [(ends[1] - ends[0]) * Fraction(chance.randrange(-30, 31), 100) for _ in ends]
        joints[f"f{k}"] = _drawn(chance, ends[0] + inset[0], ends[1] - inset[1])
    return joints, how


def _drawn(chance: random.Random, low: Fraction, high: Fraction) -> _Limits:
    rates = {name: Fraction(chance.randrange(5, 200), 100) for name in _PROFILE}
    rates["acceleration"] *= 10
    rates["jerk"] *= 100
    return {"lower": low, "upper": high, **rates}


@pytest.mark.parametrize(
    ("last", "duration", "kind"), [(0.05, 0.5, "position"), (0.04, 0.3, "velocity")]
)
def test_fingers_keep_their_own_limits(last: float, duration: float, kind: str) -> None:
    certificate = _proved(aw.Scene([]), _motion(0.0, last, duration))
    assert not certificate.verified
    assert not certificate.proved.limits
    assert certificate.violation is not None
    assert certificate.violation.kind == kind


def test_the_motion_is_from_rest_to_rest_and_its_time_is_that_of_its_share() -> None:
    motion = _motion(0.01, 0.03)
    trajectory = motion.trajectory
    assert trajectory.joint_names == (_JOINT, "panda_finger_joint2")
    ends = trajectory.sample([0.0, 0.5])
    np.testing.assert_allclose(ends, [[0.01, 0.01], [0.03, 0.03]], atol=1e-15)
    np.testing.assert_allclose(trajectory.sample([0.0, 0.5], 1), 0.0, atol=1e-12)
    for share in (0.0, 0.1, 0.5, 0.9, 1.0):
        at = trajectory.sample([motion.time_of(share)])[0, 0]
        assert at == pytest.approx(0.01 + 0.02 * share, abs=1e-9)

"""Deviations of the tool, against dense samples of pinocchio's poses and closed forms."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal
from kinematics.forward import forward
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain
from kinematics.pose import transform
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.tool.tool_deviation import check_tool_motions, path_deviation
from planning.tool_motions.timed_tool_motions import TimedToolMotions
from planning.tool_motions.tool_corner import ToolCorner, rounded_corner
from planning.tool_motions.tool_motion import ToolMotion, arc_about, arc_via, line
from planning.tool_motions.tool_path import Tolerances, ToolRun
from planning.tool_paths.tool_following import follow
from planning.values.deadline import Deadline
from tests.planning.pinocchio_arm import PinocchioArm


def poses(name: str, chain: Chain, q: Array) -> Array:
    """Tip poses (k, 4, 4) by pinocchio."""
    arm = PinocchioArm(name, chain=chain)
    return np.array([arm.pose(row) for row in q])


def off_line(T: Array, motion: ToolMotion) -> Array:
    """Distance (k,) of tips from the segment of a line, and angle to its slerp there, (k, 2)."""
    start, end = motion.T_start, motion.T_end
    way = end[:3, 3] - start[:3, 3]
    length = float(np.linalg.norm(way))
    along = (T[:, :3, 3] - start[:3, 3]) @ way / length
    nearest = start[:3, 3] + np.clip(along / length, 0.0, 1.0)[:, None] * way
    distance = np.linalg.norm(T[:, :3, 3] - nearest, axis=1)
    turn = Rotation.from_matrix(end[:3, :3] @ start[:3, :3].T).as_rotvec()
    nominal = Rotation.from_rotvec((along / length)[:, None] * turn) * Rotation.from_matrix(
        start[:3, :3]
    )
    angle = (nominal.inv() * Rotation.from_matrix(T[:, :3, :3])).magnitude()
    return np.column_stack([distance, angle])


def joint_line(chain: Chain, q: Array, step: Array, pieces: int) -> Trajectory:
    """A cubic from rest to rest in ``pieces`` seconds, cut into as many pieces."""
    n, whole = chain.n, float(pieces)
    p = np.polynomial.Polynomial([0.0, 0.0, 3.0 / whole**2, -2.0 / whole**3])
    c = np.zeros((pieces, n, 4))
    for i in range(pieces):
        shifted = p(np.polynomial.Polynomial([float(i), 1.0])).coef
        c[i] = np.outer(step, np.append(shifted, np.zeros(4 - len(shifted))))
        c[i, :, 0] += q
    return Trajectory(chain.joint_names, np.arange(pieces + 1.0), c)


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_lines_are_bounded_soundly_and_sharply(name: str) -> None:
    chain, random = builtin_chain(name), np.random.default_rng(2)
    low, high = chain.sampling_bounds()
    for case in range(12):
        q = np.clip(random.uniform(low, high), -2.0, 2.0)
        step = random.normal(size=chain.n) * 10.0 ** random.uniform(-2.0, -0.5)
        motion = joint_line(chain, q, step, 1 + case % 3)
        asked = line(forward(chain, q), forward(chain, q + step))
        if asked.length < 1e-4:
            continue
        times = np.linspace(0.0, motion.duration, 4001)
        most = off_line(poses(name, chain, motion.sample(times)), asked).max(axis=0)
        ends = np.array([0.0, motion.duration])
        wide = path_deviation(chain, motion, TimedToolMotions((asked,), ends, 10.0, 10.0))
        assert wide.verified
        near = TimedToolMotions((asked,), ends, 1.001 * most[0] + 1e-9, 1.001 * most[1] + 1e-9)
        bound = path_deviation(chain, motion, near)
        assert bound.verified
        assert most[0] <= bound.position + 1e-9 <= near.max_position + 2e-9
        assert bound.orientation is not None
        assert most[1] <= bound.orientation + 1e-9
        for share in ((0.99, 1.1), (1.1, 0.99)):
            tight = TimedToolMotions((asked,), ends, share[0] * most[0], share[1] * most[1])
            deviation, violation = check_tool_motions(chain, motion, tight)
            assert not deviation.verified
            assert violation is not None
            assert violation.kind == "path_deviation"
            here = off_line(poses(name, chain, motion.sample([violation.time])), asked)[0]
            assert here[0] > tight.max_position or here[1] > (tight.max_orientation or 0.0)


def test_a_whole_circle_in_one_piece_is_followed() -> None:
    """One joint turns an arm of two links about the base: its tip goes round a circle."""
    chain = builtin_chain("planar_rr")
    q = np.array([0.3, 0.8])
    c = np.zeros((1, 2, 2))
    c[0, :, 0], c[0, 0, 1] = q, 2.0 * np.pi
    turn = Trajectory(chain.joint_names, np.array([0.0, 1.0]), c)
    T = forward(chain, q)
    axis = chain.offsets[0][:3, 2]
    circle = arc_about(T, T, chain.offsets[0][:3, 3] + axis * float(axis @ T[:3, 3]), axis)
    free = TimedToolMotions((circle,), np.array([0.0, 1.0]), 1e-6)
    deviation = path_deviation(chain, turn, free)
    assert deviation.verified
    assert deviation.position < 1e-6
    assert deviation.orientation is None
    # The other way round the tool leaves the arc's beginning at once.
    back = Trajectory(chain.joint_names, turn.breaks, c * np.array([1.0, -1.0]))
    assert not path_deviation(chain, back, free).verified
    # So it does where a part of a circle is all that is asked for.
    half = arc_about(T, forward(chain, q + np.array([np.pi / 2.0, 0.0])), circle.center, axis)
    assert not path_deviation(
        chain, turn, TimedToolMotions((half,), np.array([0.0, 1.0]), 1e-3)
    ).verified


def test_every_motion_is_held_to_its_own_time() -> None:
    chain = builtin_chain("ur5e")
    q, step = np.array([0.1, -1.2, 1.4, -0.4, 0.5, 0.2]), np.full(6, 2e-3)
    there, back = joint_line(chain, q, step, 1), joint_line(chain, q + step, -step, 1)
    breaks = np.array([0.0, 1.0, 2.0])
    both = Trajectory(
        chain.joint_names, breaks, np.concatenate([there.coefficients, back.coefficients])
    )
    T, end = forward(chain, q), forward(chain, q + step)
    aside = transform(end[:3, :3], end[:3, 3] + np.array([0.0, 0.0, 0.05]))
    motions = line(T, end), line(end, T)
    assert path_deviation(chain, both, TimedToolMotions(motions, breaks, 1e-4)).verified
    wrong = line(T, end), line(end, aside)
    deviation = path_deviation(chain, both, TimedToolMotions(wrong, breaks, 1e-4))
    assert not deviation.verified
    assert deviation.time > 1.0
    # The first motion's time is too long: the tool leaves it with the second.
    early = np.array([0.0, 2.0, 2.0])
    assert not path_deviation(chain, both, TimedToolMotions(wrong, early, 1e-4)).verified


def test_a_turn_on_the_spot_is_held_to_its_angle() -> None:
    chain = builtin_chain("ur5e")
    q, turn = np.array([0.1, -1.2, 1.4, -0.4, 0.5, 0.2]), np.zeros(6)
    turn[5] = 2.5
    motion, ends = joint_line(chain, q, turn, 1), np.array([0.0, 1.0])
    T = forward(chain, q)
    axis = T[:3, 2] if abs(forward(chain, q + turn)[:3, 2] @ T[:3, 2] - 1.0) < 1e-9 else T[:3, 1]
    assert forward(chain, q + turn)[:3, 3] == pytest.approx(T[:3, 3], abs=1e-9)
    whole = line(T, forward(chain, q + turn))
    assert path_deviation(chain, motion, TimedToolMotions((whole,), ends, 1e-6, 1e-4)).verified
    R = Rotation.from_rotvec(axis * 1.0).as_matrix() @ T[:3, :3]
    less = line(T, transform(R, T[:3, 3]))
    assert not path_deviation(chain, motion, TimedToolMotions((less,), ends, 1e-6, 0.5)).verified


def test_times_have_to_fit_the_motions() -> None:
    T = np.eye(4)
    with pytest.raises(InvalidGoal, match="2 times"):
        TimedToolMotions((line(T, T),), np.zeros(3), 1e-3)
    with pytest.raises(InvalidGoal, match="descend"):
        TimedToolMotions((line(T, T),), np.array([1.0, 0.0]), 1e-3)


def off_corner(T: Array, corner: ToolCorner) -> Array:
    """Distance (k,) of tips from a corner on a fine grid, and angle to its orientation there."""
    nominal = corner.poses(np.linspace(0.0, 1.0, 20001))
    away, k = cKDTree(nominal[:, :3, 3]).query(T[:, :3, 3])
    turns = Rotation.from_matrix(nominal[k, :3, :3].swapaxes(1, 2) @ T[:, :3, :3])
    return np.column_stack([away, turns.magnitude()])


@pytest.mark.parametrize("name", ["ur5e", "panda", "iiwa14"])
def test_rounded_corners_are_bounded_soundly_and_sharply(name: str) -> None:
    """A motion that is led round a corner, held to it and to corners a little beside it."""
    chain, random = builtin_chain(name), np.random.default_rng(4)
    q = {
        "ur5e": [0.3, -1.4, 1.8, -1.9, -1.5, 0.2],
        "panda": [0.2, 0.4, 0.1, -1.6, 0.1, 1.2, 0.3],
        "iiwa14": [0.2, 0.6, 0.1, -1.5, 0.1, 0.9, 0.0],
    }[name]
    T = forward(chain, np.array(q))
    for case in range(4):
        ends = [T]
        for step in random.normal(size=(2, 3)):
            turn = Rotation.from_rotvec(0.2 * random.normal(size=3)).as_matrix()
            place = ends[-1][:3, 3] + 0.05 * step / np.linalg.norm(step)
            ends.append(transform(turn @ ends[-1][:3, :3], place))
        first = line(ends[0], ends[1])
        middle = 0.5 * (ends[0] + ends[1])[:3, 3] + 0.01 * random.normal(size=3)
        first = arc_via(ends[0], ends[1], middle) if case % 2 else first
        second = line(ends[1], ends[2])
        distance = min(first.length, second.length)
        corner = rounded_corner(first, second, distance)
        solved = numeric.solve(
            chain, corner.T_start, numeric.SearchOptions(), seed_joints=np.array(q)
        )
        run = ToolRun((corner,), (0,), (True,))
        led = follow(
            chain, run, solved.solutions[0].joints, Tolerances(1e-4, 1e-3), Deadline.after(60.0)
        )
        assert led.stop is None
        assert led.path is not None
        motion = Trajectory(chain.joint_names, led.path.breaks, led.path.coefficients)
        times = np.array([0.0, motion.duration])
        places = np.linspace(0.0, motion.duration, 401)
        tips = poses(name, chain, motion.sample(places))
        for shift in (0.0, 2e-3):
            beside = transform(None, shift * random.normal(size=3))
            legs = [
                ToolMotion(
                    leg.kind, beside @ leg.T_start, beside @ leg.T_end,
                    leg.center + beside[:3, 3], leg.normal, leg.sweep,
                )
                for leg in (corner.first, corner.second)
            ]  # fmt: skip
            held = ToolCorner(legs[0], legs[1], corner.slope)
            most = off_corner(tips, held).max(axis=0)
            near = TimedToolMotions((held,), times, 1.3 * most[0] + 1e-5, 1.3 * most[1] + 1e-4)
            bound = path_deviation(chain, motion, near)
            assert bound.verified
            # The grid of places leaves some micrometres.
            assert most[0] <= bound.position + 5e-6
            assert bound.orientation is not None
            assert most[1] <= bound.orientation + 5e-5
            if shift:
                tight = TimedToolMotions((held,), times, 0.97 * most[0], 1.0)
                assert not path_deviation(chain, motion, tight).verified


def test_a_corner_is_passed_from_its_start_to_its_end_only() -> None:
    chain = builtin_chain("ur5e")
    q = np.array([0.3, -1.4, 1.8, -1.9, -1.5, 0.2])
    T = forward(chain, q)
    first = line(T, transform(T[:3, :3], T[:3, 3] + [0.0, 0.05, 0.0]))
    second = line(first.T_end, transform(T[:3, :3], T[:3, 3] + [0.0, 0.05, -0.05]))
    whole = ToolRun((first, second), (0, 1), (False, False))
    tolerances, deadline = Tolerances(1e-4, 1e-3), Deadline.after(60.0)
    corner = rounded_corner(first, second, 0.05)
    led = follow(chain, ToolRun((corner,), (0,), (True,)), q, tolerances, deadline)
    assert led.path is not None
    motion = Trajectory(chain.joint_names, led.path.breaks, led.path.coefficients)
    ends = np.array([0.0, motion.duration])
    assert path_deviation(chain, motion, TimedToolMotions((corner,), ends, 1e-4, 1e-3)).verified
    # A shorter corner is left beyond its ends, a whole corner is not rounded.
    short = rounded_corner(first, second, 0.04)
    assert not path_deviation(chain, motion, TimedToolMotions((short,), ends, 1e-3, 1.0)).verified
    for line_of_it in whole.motions:
        held = TimedToolMotions((line_of_it,), ends, 1e-3, 1.0)
        assert not path_deviation(chain, motion, held).verified

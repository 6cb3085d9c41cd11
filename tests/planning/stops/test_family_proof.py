"""Stops of all joints and along the path: proved, and judged by ruckig and coal."""

from pathlib import Path

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, MissingLimit
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import certify, certify_limits
from planning.stops.braking import Braking, BrakingLimits
from planning.stops.certificate import StopCertificate, Surroundings, certify_stops
from planning.stops.path_stops import path_stop, prove_path_stops
from planning.stops.stop_family import Cells, Enclosed, StopFamily, joint_stop
from planning.values.limits import MotionLimits
from tests.planning.scenes import box
from tests.planning.slider import slider
from tests.planning.stops.judge import Brakes
from tests.planning.stops.motions import ARMS, arm, judge, motions

#: Begins of braking, and instants of each stop.
STARTS, INSTANTS = 1000, 8


def members(family: StopFamily, count: int, seed: int) -> tuple[Array, Array, Array]:
    """Begins and times of random members of a family, with where ruckig has the joints."""
    random, motion = np.random.default_rng(seed), family.trajectory
    starts = random.uniform(0.0, motion.duration, count)
    states, durations = Brakes(family.limits).stops(motion, starts, 41)
    pick = random.integers(0, 41, count)
    return starts, durations * pick / 40.0, states[np.arange(count), pick]


@pytest.mark.parametrize("jerk", [True, False])
@pytest.mark.parametrize("name", ["panda", "stanford"])
def test_cells_hold_every_member_of_the_family(name: str, jerk: bool) -> None:
    for moved in motions(name, 3, 4.0, jerk=jerk):
        family = StopFamily(moved.trajectory, moved.around.braking)
        cells = family.cells(0.1)
        for _ in range(4):
            enclosed = family.enclose(cells)
            check_members(family, cells, enclosed)
            random = np.random.default_rng(len(cells.piece))
            cells = cells.halves(random.random(len(cells.piece)) < 0.5)


def check_members(family: StopFamily, cells: Cells, enclosed: Enclosed) -> None:
    starts, after, states = members(family, 400, 3)
    held = 0
    for start, time, q in zip(starts, after, states, strict=True):
        s = (start - cells.begin[:, 0]) / cells.begin[:, 1]
        inside = (np.abs(s) <= 1.0) & (np.abs(time - cells.after[:, 0]) <= cells.after[:, 1])
        for k in np.flatnonzero(inside):
            held += 1
            off = np.abs(q - enclosed.middle[k])
            # Ruckig is good to this.
            assert (off <= enclosed.radius[k] + 1e-7).all()
            off = np.abs(q - enclosed.middle[k] - s[k] * enclosed.rate[k])
            assert (off <= enclosed.off[k] + 1e-7).all()
    assert held >= len(starts)


@pytest.mark.parametrize(("jerk", "weak"), [(True, 1.0), (True, 0.25), (False, 0.25)])
@pytest.mark.parametrize("name", ARMS)
def test_what_is_proved_touches_nothing_and_what_is_not_does(
    name: str, jerk: bool, weak: float, tmp_path: Path
) -> None:
    verdicts = []
    for moved in motions(name, 3, 3.0, jerk=jerk, weak=weak):
        stops = certify_stops(*moved, "joints")
        verdicts.append(stops.proved)
        coal = judge(name, moved.around.scene, tmp_path)
        brakes, motion = Brakes(moved.around.braking), moved.trajectory
        if stops.proved:
            starts = np.linspace(0.0, motion.duration, STARTS)
            states, durations = brakes.stops(motion, starts, INSTANTS)
            assert not coal.overlaps(states.reshape(-1, motion.n)).any()
            assert durations.max() <= stops.longest + 1e-6
            limits = arm(name).chain.limits
            assert (states >= limits.lower - 1e-6).all()
            assert (states <= limits.upper + 1e-6).all()
            continue
        assert stops.message
        states, durations = brakes.stops(motion, np.array([stops.worst.time]), 401)
        assert stops.worst.pair is not None
        if stops.worst.pair[0] == stops.worst.pair[1]:
            j = motion.joint_names.index(stops.worst.pair[0])
            limits = arm(name).chain.limits
            beyond = np.maximum(
                states[0, :, j] - limits.upper[j], limits.lower[j] - states[0, :, j]
            )
            assert abs(beyond.max() + stops.worst.clearance) < 1e-5
        else:
            at = round(400 * stops.worst.after / durations[0])
            near = states[0, max(at - 2, 0) : at + 3]
            assert stops.worst.clearance <= 0.0
            assert coal.overlaps(near).any()
    assert any(verdicts) or weak < 1.0


def test_both_verdicts_are_met_with_weak_brakes() -> None:
    some = motions("panda", 8, 3.0, weak=0.25)
    found = [certify_stops(*moved, "joints").proved for moved in some]
    assert 0 < sum(found) < len(found)


def test_a_family_that_forgets_how_far_joints_brake_is_caught(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A planted lie: what is believed under it, the judge refuses."""
    bad = [moved for moved in motions("panda", 8, 3.0, weak=0.25)
           if not certify_stops(*moved, "joints").proved]  # fmt: skip
    honest = StopFamily.enclose

    def lying(family: StopFamily, cells: Cells) -> Enclosed:
        still = cells._replace(after=0.0 * cells.after)
        return honest(family, still)

    monkeypatch.setattr(StopFamily, "enclose", lying)
    caught = 0
    for moved in bad:
        if not certify_stops(*moved, "joints").proved:
            continue
        coal = judge("panda", moved.around.scene, tmp_path)
        starts = np.linspace(0.0, moved.trajectory.duration, STARTS // 4)
        states, _ = Brakes(moved.around.braking).stops(moved.trajectory, starts, INSTANTS)
        caught += bool(coal.overlaps(states.reshape(-1, 7)).any())
    assert caught


def test_stops_of_a_motion_that_is_not_proved_are_not() -> None:
    moved = next(motions("panda", 1, 3.0))
    fast = moved.trajectory.dilate(0.5)
    certificate = certify(fast, moved.around.robot, moved.around.scene, limits=moved.around.limits)
    assert not certificate.verified
    for kind in ("path", "joints", "both"):
        stops = certify_stops(fast, certificate, moved.around, kind)
        assert not stops.proved
        assert "not proved" in stops.message


#: Weaker brakes of the slides than their own [m/s^2].
BRAKE = 0.6


def slid(begin: float) -> tuple[Trajectory, float]:
    """A slide by 20 cm in a second from ``begin`` [m] on, and where its stops end at the farthest.

    From s on a joint with velocity v needs v^2 / 2 a.
    """
    t = np.linspace(0.0, 1.0, 200_001)
    s, v = 0.2 * t * t * (3.0 - 2.0 * t), 1.2 * t * (1.0 - t)
    shape = np.zeros((1, 2, 4))
    shape[0, 0] = [begin, 0.0, 0.6, -0.4]
    motion = Trajectory(slider().chain.joint_names, np.array([0.0, 1.0]), shape)
    return motion, begin + float((s + 0.5 * v * v / BRAKE).max())


def stops_of_slide(motion: Trajectory, scene: Scene, margin: float, jerk: float) -> StopCertificate:
    """The certificate of stops of a slide by weak brakes."""
    robot = slider()
    sound = MotionLimits({"acceleration": np.full(2, 2.0), "jerk": np.full(2, np.inf)})
    certificate = certify(motion, robot, scene, limits=sound, margin=margin)
    assert certificate.verified
    weak = MotionLimits({"acceleration": np.full(2, BRAKE), "jerk": np.full(2, jerk)})
    return certify_stops(motion, certificate, Surroundings(robot, scene, margin, weak), "joints")


@pytest.mark.parametrize("beyond", [-1e-3, 1e-3])
@pytest.mark.parametrize("jerk", [np.inf, 1e4])
def test_a_range_is_left_where_the_braking_distance_is_longer_than_the_way_to_it(
    beyond: float, jerk: float
) -> None:
    upper = float(slider().chain.limits.upper[0])
    motion, _ = slid(upper - (slid(0.0)[1] - beyond))
    # Slides alone: nothing to be hit, nothing that is known of it either.
    wall = Scene((box("far", (0.1, 0.1, 0.1), (0.0, 0.0, 3.0)),))
    stops = stops_of_slide(motion, wall, 0.0, jerk)
    assert stops.proved == (beyond < 0.0)
    if beyond > 0.0:
        assert stops.worst.pair == (motion.joint_names[0],) * 2
        assert -1.1 * beyond <= stops.worst.clearance < 0.0


@pytest.mark.parametrize("spare", [-2e-4, 2e-4])
@pytest.mark.parametrize("margin", [0.0, 0.02])
def test_a_wall_is_kept_away_from_by_the_margin_and_no_more(spare: float, margin: float) -> None:
    """The ball of 5 cm brakes towards a wall."""
    motion, farthest = slid(-0.3)
    face = farthest + 0.05 + margin + spare
    wall = Scene((box("wall", (0.1, 0.4, 0.4), (face + 0.05, 0.0, 0.0)),))
    stops = stops_of_slide(motion, wall, margin, np.inf)
    assert stops.proved == (spare > 0.0)
    assert stops.worst.pair == ("ball", "wall")
    assert stops.worst.clearance <= margin + abs(spare) + 1e-6
    if spare < 0.0:
        assert stops.worst.clearance <= margin
        assert f"{margin:g} m are asked for" in stops.message or margin == 0.0


def test_stops_that_leave_the_path_are_refused_where_collisions_are_unknown() -> None:
    moved = next(motions("panda", 1, 3.0))
    robot = moved.around.robot
    none = np.zeros(0, dtype=np.int64)
    bare = RobotGeometry(robot.chain, (), (), none, none, {})
    proof = certify(moved.trajectory, bare, Scene(), limits=moved.around.limits)
    around = moved.around._replace(robot=bare, scene=Scene())
    assert certify_stops(moved.trajectory, proof, around, "path").proved
    with pytest.raises(InvalidOption, match="nothing is known of collisions"):
        certify_stops(moved.trajectory, proof, around, "joints")


def test_the_limits_of_a_family_have_to_be_known() -> None:
    chain = arm("meshes").chain
    with pytest.raises(MissingLimit, match="no acceleration limit is known for joint"):
        BrakingLimits.of(chain.limits, chain.joint_names, MotionLimits())


def states(count: int, seed: int) -> tuple[Array, Array, BrakingLimits]:
    """Velocities and accelerations (count,), with limits."""
    random = np.random.default_rng(seed)
    limit = 10.0 ** random.uniform(-1.0, 1.5, count)
    jerk = limit * 10.0 ** random.uniform(0.0, 2.5, count)
    # Of the sizes at which all forms of the profile occur, and at rest.
    v = random.normal(size=count) * limit * limit / jerk * 10.0 ** random.uniform(-2, 1, count)
    a = random.uniform(-1.0, 1.0, count) * limit
    v[: count // 50], a[: count // 100] = 0.0, 0.0
    return v, a, BrakingLimits(limit, jerk)


@pytest.mark.parametrize("seed", range(3))
def test_joints_brake_as_quickly_as_by_ruckig(seed: int) -> None:
    v, a, limits = states(500, seed)
    braking = Braking.of(v, a, limits)
    for k in range(len(v)):
        one = BrakingLimits(limits.acceleration[k : k + 1], limits.jerk[k : k + 1])
        ways, duration = Brakes(one).states(np.zeros(1), v[k : k + 1], a[k : k + 1], 9)
        assert braking.duration[k] == pytest.approx(duration, rel=1e-6, abs=1e-9)
        for time, way in zip(np.linspace(0.0, duration, 9), ways[:, 0], strict=True):
            size = 1e-6 * (1.0 + np.abs(ways).max())
            assert braking.moved(np.full(v.shape, time))[k] == pytest.approx(way, abs=size)


def test_without_a_limit_of_jerk_the_way_is_half_v_squared_over_a() -> None:
    random = np.random.default_rng(5)
    v, a, limit = random.normal(size=300), random.normal(size=300), random.uniform(0.5, 9.0, 300)
    braking = Braking.of(v, a, BrakingLimits(limit, np.full(300, np.inf)))
    np.testing.assert_allclose(braking.duration, np.abs(v) / limit)
    np.testing.assert_allclose(braking.moved(2.0 * braking.duration), 0.5 * v * np.abs(v) / limit)
    half = 0.5 * braking.duration
    np.testing.assert_allclose(braking.moved(half), 0.375 * v * np.abs(v) / limit)


@pytest.mark.parametrize("seed", range(3))
def test_states_in_order_stay_in_order(seed: int) -> None:
    """What ends of intervals bound rests on this, for every time."""
    v, a, limits = states(4000, seed)
    random = np.random.default_rng(seed)
    faster = v + np.abs(v) * random.uniform(0.0, 1.0, v.shape)
    harder = np.minimum(a + random.uniform(0.0, 0.5, v.shape) * limits.acceleration,
                        limits.acceleration)  # fmt: skip
    least, most = Braking.of(v, a, limits), Braking.of(faster, harder, limits)
    longest = np.maximum(least.duration, most.duration)
    for share in np.linspace(0.0, 1.0, 40):
        gap = most.moved(share * longest) - least.moved(share * longest)
        assert (gap >= -1e-9 * (1.0 + np.abs(most.moved(longest)))).all()
    between = Braking.of(0.5 * (v + faster), 0.5 * (a + harder), limits)
    assert (between.duration <= longest * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("jerk", [60.0, np.inf])
def test_a_stop_is_the_motion_that_braking_says(seed: int, jerk: float) -> None:
    random, n = np.random.default_rng(seed), 5
    names = tuple(f"j{k}" for k in range(n))
    motion = Trajectory(names, np.array([0.0, 1.0]), random.normal(size=(1, n, 4)) * 0.5)
    limits = BrakingLimits(np.full(n, 8.0), np.full(n, jerk))
    stop = joint_stop(motion, 0.3, limits)
    q, v, a = (motion.sample([0.3], order)[0] for order in range(3))
    braking = Braking.of(v, a, limits)
    assert stop.duration == pytest.approx(braking.duration.max(), abs=1e-12)
    for time in np.linspace(0.0, stop.duration, 30):
        expected = q + braking.moved(np.full(n, time))
        np.testing.assert_allclose(stop.sample([time])[0], expected, atol=1e-12)
    np.testing.assert_allclose(stop.sample([0.0], 1)[0], v, atol=1e-12)
    np.testing.assert_allclose(stop.sample([stop.duration], 1)[0], 0.0, atol=1e-10)
    if np.isfinite(jerk):
        np.testing.assert_allclose(stop.sample([0.0], 2)[0], a, atol=1e-12)
    np.testing.assert_array_less(stop.continuity()[:2], 1e-10)
    assert (stop.peaks(2).value <= 8.0 * (1.0 + 1e-9)).all()


def test_a_joint_at_rest_stays() -> None:
    still = Trajectory(("a", "b"), np.array([0.0, 1.0]), np.ones((1, 2, 1)))
    stop = joint_stop(still, 0.5, BrakingLimits(np.ones(2), np.ones(2)))
    np.testing.assert_array_equal(stop.start, [1.0, 1.0])
    np.testing.assert_array_equal(stop.end, [1.0, 1.0])


def trapeze(speed: float, acceleration: float) -> Trajectory:
    """One joint from rest to rest: up for a time, at a speed for a second, and down."""
    up = speed / acceleration
    way, on = 0.5 * speed * up, speed
    pieces = np.array([
        [[0.0, 0.0, 0.5 * acceleration]],
        [[way, speed, 0.0]],
        [[way + on, speed, -0.5 * acceleration]],
    ])  # fmt: skip
    return Trajectory(("j",), np.array([0.0, up, up + 1.0, 2.0 * up + 1.0]), pieces)


def test_a_joint_alone_stops_in_its_speed_over_its_acceleration() -> None:
    motion = trapeze(1.2, 4.0)
    for brake in (4.0, 8.0):
        limits = BrakingLimits(np.array([brake]), np.array([np.inf]))
        found = prove_path_stops(motion, limits)
        assert found.proved
        assert 0.3 * 4.0 / brake <= found.longest
        # A cell of a fiftieth of a second late at most.
        assert found.longest <= 0.3 * 4.0 / brake + 0.02
        for at in (0.31, 0.7, 1.1):
            speed = float(motion.sample([at], 1)[0, 0])
            stop = path_stop(motion, at, limits)
            assert stop.duration == pytest.approx(speed / brake, rel=1e-6)
            way = float(stop.end[0] - stop.start[0])
            assert way == pytest.approx(0.5 * speed * speed / brake, rel=1e-6)


@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford"])
def test_stops_keep_to_the_path_and_the_limits_and_are_within_the_longest(name: str) -> None:
    for moved in motions(name, 3, 3.0, jerk=False):
        motion, limits = moved.trajectory, moved.around.braking
        found = prove_path_stops(motion, limits)
        assert found.proved
        chain = arm(name).chain
        wanted = MotionLimits(dict(moved.around.limits.bounds))
        for at in np.linspace(0.0, motion.duration, 25):
            stop = path_stop(motion, float(at), limits)
            assert stop.duration <= found.longest + 1e-9
            proof = certify_limits(stop, chain, wanted)
            assert proof.verified, proof.violation
            np.testing.assert_allclose(stop.sample([0.0])[0], motion.sample([at])[0], atol=1e-12)
            np.testing.assert_allclose(stop.sample([stop.duration], 1), 0.0, atol=1e-9)
            assert _off_path(stop, motion) < 1e-9


def _off_path(stop: Trajectory, motion: Trajectory) -> float:
    """Largest distance of a stop from its motion, whose path is a straight line."""
    line = motion.end - motion.start
    off = stop.sample(np.linspace(0.0, stop.duration, 50)) - motion.start
    return float(np.abs(off - np.outer(off @ line, line) / (line @ line)).max())


def test_a_joint_that_brakes_at_its_limit_already_takes_the_rest_of_the_motion() -> None:
    motion = trapeze(1.2, 4.0)
    limits = BrakingLimits(np.array([4.0]), np.array([np.inf]))
    begun = 1.35
    stop = path_stop(motion, begun, limits)
    assert stop.duration == pytest.approx(motion.duration - begun, abs=1e-6)


def curved(seed: int) -> tuple[Trajectory, BrakingLimits]:
    """A curve of three joints from rest to rest, and limits that it keeps with little to spare."""
    random = np.random.default_rng(seed)
    shape = np.polynomial.Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    rows = []
    for _ in range(3):
        curve = np.polynomial.Polynomial([0.0, *random.normal(size=2)])
        rows.append(np.pad(curve(shape).coef, (0, 11))[:11])
    motion = Trajectory(
        ("a", "b", "c"), np.array([0.0, 1.0]), np.array(rows, dtype=np.float64)[None]
    )
    return motion, BrakingLimits(1.001 * motion.peaks(2).value, np.full(3, np.inf))


@pytest.mark.parametrize("seed", range(5))
def test_the_longest_stop_is_near_that_of_small_steps(seed: int) -> None:
    motion, limits = curved(seed)
    found = prove_path_stops(motion, limits)
    longest = max(_stepped(motion, limits, at) for at in np.linspace(0.02, 0.98, 25))
    assert longest <= found.longest
    assert found.longest <= 1.15 * longest + 0.02


def _stepped(motion: Trajectory, limits: BrakingLimits, at: float) -> float:
    """Time to rest by the largest deceleration at each of many small steps of time."""
    s, speed, time, step = at, 1.0, 0.0, 2e-4
    while speed > 0.0 and s < motion.duration:
        v, a = (motion.sample([min(s, motion.duration)], order)[0] for order in (1, 2))
        slower = _largest_deceleration(v, a * speed * speed, limits.acceleration)
        s, speed, time = s + step * speed, speed - step * slower, time + step
    return time


def _largest_deceleration(v: Array, a: Array, limit: Array) -> float:
    # |a - v d| <= limit.
    moving = np.abs(v) > 1e-12
    ends = (limit[moving] + np.sign(v[moving]) * a[moving]) / np.abs(v[moving])
    return float(ends.min()) if moving.any() else 1e9


def test_a_motion_that_ends_while_it_moves_has_no_stop_along_its_path() -> None:
    shape = np.array([[[0.0, 0.0, 1.0]]])
    motion = Trajectory(("j",), np.array([0.0, 1.0]), shape)
    found = prove_path_stops(motion, BrakingLimits(np.array([4.0]), np.array([np.inf])))
    assert not found.proved
    assert "ends while 'j' moves" in found.message

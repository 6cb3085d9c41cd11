"""The proof of all stops with every joint braking by itself, judged by ruckig, pinocchio, coal."""

from pathlib import Path

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, MissingLimit
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import certify
from planning.stops.braking import BrakingLimits
from planning.stops.certificate import StopCertificate, Surroundings, certify_stops
from planning.stops.stop_family import Cells, Enclosed, StopFamily
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

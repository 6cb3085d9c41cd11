"""Clearance that tracking leaves: own links and obstacles apart, each with its cure."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import httpx
import numpy as np
import pytest

from kinematics.pose import transform
from kinematics.robots import builtin_srdf, builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.values.deadline import Deadline
from service.endpoints.simulate.tracking_tube import Clearance, own_clearance, remaining
from tests.service.robots import answer, solid
from tests.tracking.corners import corner_displacement
from tracking.simulation.references import hold
from tracking.tube.tube import Displacement

#: A ball of 0.05 m that swings at 1 m in the vertical plane.
PENDULUM = """<robot name="pendulum">
<link name="world"/><joint name="swing" type="revolute"><parent link="world"/><child link="rod"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1000" velocity="20"/></joint>
<link name="rod"><inertial><origin xyz="0 0 -1"/><mass value="1"/>
<inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 -1"/><geometry><sphere radius="0.05"/></geometry></collision></link>
</robot>"""
#: Where a ball is whose surface is 1.29 m from the hand [m].
FAR = 1.874
HOME = [0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8]


def ball(angle: float, gap: float) -> dict[str, Any]:
    """A ball of 0.05 m that the bob touches less ``gap`` when it hangs at ``angle``."""
    along = angle + 2.0 * float(np.arcsin((0.1 + gap) / 2.0))
    center = [-float(np.sin(along)), 0.0, -float(np.cos(along))]
    return solid("ball", "sphere", center, radius=0.05)


def quintic(away: Any) -> dict[str, Any]:
    """A motion of a second from HOME, at rest at its ends."""
    rows = [
        [a, 0, 0, 10 * (b - a), -15 * (b - a), 6 * (b - a)] for a, b in zip(HOME, away, strict=True)
    ]
    return {"segments": [{"t0": 0.0, "t1": 1.0, "coefficients": rows}]}


def wall(x: float) -> dict[str, Any]:
    return {"obstacles": [solid("wall", "box", [x, 0, 0.5], size=[0.1, 2, 2])]}


@pytest.mark.parametrize(("tolerance", "period"), [(1e-3, 1.0), (1e-4, 0.5), (1e-8, 0.01)])
@pytest.mark.parametrize(("gap", "clears"), [(-5e-4, False), (3e-3, True)])
def test_a_swing_between_samples_counts(
    client: httpx.Client, tolerance: float, period: float, gap: float, clears: bool
) -> None:
    """A push makes the pendulum swing out and back between two samples."""
    client.post("/v1/robots", json={"name": "pendulum", "urdf": PENDULUM})
    w, zeta, peak = 6.0, 0.2, 0.0277
    wd = w * np.sqrt(1.0 - zeta**2)
    t = np.arctan2(wd, zeta * w) / wd
    rate = peak * wd / (np.exp(-zeta * w * t) * np.sin(wd * t))
    body = {
        "robot": "pendulum",
        "trajectory": {"segments": [{"t0": 0.0, "t1": 2.0, "coefficients": [[0.0]]}]},
        "controller": {"type": "computed_torque", "natural_frequency": w, "damping": zeta},
        "initial_state": {"velocity_offset": [rate]},
        "scene": {"obstacles": [ball(float(peak), gap)]},
        "relative_tolerance": tolerance,
        "absolute_tolerance": tolerance * 1e-2,
        "sample_period": period,
    }
    found = answer(client.post("/v1/simulate", json=body))
    assert found["max_tracking_error"] == pytest.approx(peak, rel=1e-5)
    around = found["tube"]
    assert around["joint_error"][0] >= peak
    assert around["clears"] is clears, around["reason"]
    true = 2.0 * float(np.sin(peak / 2.0)) * 1.05
    assert around["displacement"] == pytest.approx(true, rel=0.02)
    assert around["limits"]["velocity"]["ratio"] == pytest.approx(rate / 20.0, rel=1e-4)
    if not clears:
        assert "margin larger by more than" in around["reason"]
        assert "'ball'" in around["reason"]


def test_own_links_are_held_against_their_own_clearance(client: httpx.Client) -> None:
    """A push on the first joint turns the whole arm, and moves no link of it against another."""
    body = {
        "robot": "panda",
        "trajectory": quintic([0.5, *HOME[1:]]),
        "controller": {"type": "computed_torque", "natural_frequency": 12.0},
        "disturbance": {"torque": [2.0, 0, 0, 0, 0, 0, 0]},
        "scene": wall(1.9),
        "saturate": False,
    }
    around = answer(client.post("/v1/simulate", json=body))["tube"]
    own, obstacles = around["own_links"], around["obstacles"]
    # The wall is far, the links of the arm are as near to each other as ever.
    assert obstacles["clearance"] >= 0.05
    assert around["displacement"] > own["clearance"] > 0.005
    assert obstacles["remaining"] > 0.02
    assert own["remaining"] > 0.0
    assert around["clears"], around["reason"]
    # What the cubic through the samples keeps is more than what is proved to remain.
    assert around["tracked_clearance"] >= around["remaining_clearance"]
    push = {"torque": [0, 40.0, 0, -40.0, 0, 20.0, 0]}
    around = answer(client.post("/v1/simulate", json=body | {"disturbance": push}))["tube"]
    assert not around["clears"]
    assert around["own_links"]["remaining"] < 0.0
    assert "a margin does not concern them" in around["reason"]
    assert repr(around["own_links"]["pair"][0]) in around["reason"]


def test_a_margin_from_obstacles_and_a_smaller_one_among_own_links_both_hold(
    client: httpx.Client,
) -> None:
    """30 mm from a wall, at least 9.5 mm between own links, displaced by 10 mm: all is clear."""
    body = {
        "robot": "panda",
        "reference": {"type": "hold", "joints": [*HOME[:6], 0.2], "duration": 1.0},
        "controller": {"type": "computed_torque", "natural_frequency": 12.0},
        "disturbance": {"torque": [1.075, 0, 0, 0, 0, 0, 0]},
        "scene": wall(0.5617),
        "saturate": False,
    }
    around = answer(client.post("/v1/simulate", json=body))["tube"]
    assert around["obstacles"]["clearance"] == pytest.approx(0.030, abs=2e-3)
    assert around["reference_clearance"] == pytest.approx(0.0095, abs=2e-4)
    assert around["displacement"] == pytest.approx(0.0100, abs=2e-4)
    assert around["clears"], around["reason"]
    # A link that sees another one displaced by more than its clearance has a larger one of it.
    assert around["own_links"]["remaining"] > 0.0


def test_a_far_obstacle_with_a_margin_is_clear_of_a_wrong_model(client: httpx.Client) -> None:
    """A ball 1.29 m away with a margin of 0.1 m, and masses a tenth too large in the model."""
    far = solid("ball", "sphere", [FAR, 0.0, 0.5], radius=0.1) | {"margin": 0.1}
    body = {
        "robot": "panda",
        "trajectory": quintic(np.array(HOME) + np.linspace(0.6, -0.4, 7)),
        "controller": {"type": "computed_torque", "natural_frequency": 15.0},
        "model_error": {"mass_scale": 1.1},
        "scene": {"obstacles": [far]},
        "saturate": False,
        "sample_period": 1e-3,
    }
    found = answer(client.post("/v1/simulate", json=body))
    around = found["tube"]
    assert around["clears"], around["reason"]
    robot = panda()
    world = FclWorld(
        dataclasses.replace(robot, allowed=every_pair(robot)),
        Scene((Obstacle("ball", Sphere(0.1), transform(position=[FAR, 0.0, 0.5])),)),
    )
    samples = np.array(found["position"]), np.array(found["reference"]["position"])
    nearest = min(world.clearance(q).distance for q in samples[1][::20])
    assert nearest == pytest.approx(1.29, abs=0.01)
    true = max(corner_displacement(robot, *pair) for pair in zip(*samples, strict=True))
    assert true <= around["displacement"] <= 1.5 * true


def panda() -> RobotGeometry:
    description, semantics = parse_urdf(builtin_urdf("panda")), parse_srdf(builtin_srdf("panda"))
    chain = serial_chain(description, semantics=semantics)
    return robot_geometry(chain, description, None, semantics)


def every_pair(robot: RobotGeometry) -> dict[tuple[str, str], str]:
    names = sorted(set(robot.links))
    return {(a, b): "same body" for i, a in enumerate(names) for b in names[i + 1 :]}


def test_parts_that_lose_much_are_held_against_their_own_clearance() -> None:
    asked: list[set[str]] = []

    def clearance_of(parts: Mapping[str, Displacement]) -> Clearance:
        asked.append(set(parts))
        return Clearance(0.3, ("hand", "shelf"))

    moved = {"shoulder": Displacement(0.001), "hand": Displacement(0.02)}
    near = Clearance(0.01, ("shoulder", "floor"))
    left = remaining(near, moved, clearance_of)
    assert asked == [{"hand"}]
    assert (left.displaced, left.pair) == ("shoulder", ("shoulder", "floor"))
    assert left.distance == pytest.approx(0.009)
    # Without a proof for some all share the clearance of the nearest.
    assert remaining(near, moved, None).distance == pytest.approx(-0.01)
    # And where nothing is gained by asking on, that is what remains.
    assert remaining(near, moved, lambda _: near).distance == pytest.approx(-0.01)
    assert remaining(near, {}, None).distance == 0.01


def test_clearances_of_own_links_are_told_as_far_as_they_are_displaced() -> None:
    robot = panda()
    motion = hold(robot.chain, HOME, 1.0)
    pairs = robot.self_pairs
    far_apart = 0
    for near, far in pairs[:: max(1, len(pairs) // 12)].tolist():
        pair = robot.links[near], robot.links[far]
        every = every_pair(robot)
        every.pop((min(pair), max(pair)))
        world = FclWorld(dataclasses.replace(robot, allowed=every), Scene(()))
        true = world.clearance(np.array(HOME)).distance
        for moved in (0.01, 0.12):
            told = own_clearance(motion, robot, {pair: Displacement(moved)}, Deadline.after(60.0))
            assert told.distance <= true + 1e-6
            if true > moved + 0.06:
                far_apart += 1
                assert told.distance > moved + 0.04, pair
    assert far_apart >= 4


def test_an_unstable_loop_is_refused_in_words(client: httpx.Client) -> None:
    """Upright with a spring weaker than its weight, it falls: errors grow as exp(3 t)."""
    client.post("/v1/robots", json={"name": "pendulum", "urdf": PENDULUM})
    body = {
        "robot": "pendulum",
        "reference": {"type": "hold", "joints": [np.pi - 0.2], "duration": 12.0},
        "controller": {"type": "independent_joint", "Kp": 1e-3, "Kd": 1e-3, "inertia": 1e-6},
        "initial_state": {"joints": [np.pi]},
        "scene": {"obstacles": []},
        "saturate": False,
    }
    around = answer(client.post("/v1/simulate", json=body))["tube"]
    assert not around["clears"]
    assert "nothing is proved of an unstable loop" in around["reason"]
    # For a second it is not unstable enough to matter.
    short = body | {"reference": {"type": "hold", "joints": [np.pi - 0.2], "duration": 1.0}}
    around = answer(client.post("/v1/simulate", json=short))["tube"]
    assert "unstable" not in str(around["reason"])


def test_torques_between_steps_count(client: httpx.Client) -> None:
    """A spring and damper: u = -w² x - 2 w x', whose largest size is at the start or turns."""
    client.post("/v1/robots", json={"name": "pendulum", "urdf": PENDULUM})
    body = {
        "robot": "pendulum",
        "reference": {"type": "sine", "center": [0.0], "amplitude": 0.5, "frequency": 1.1,
                      "duration": 2.0},
        "controller": {"type": "computed_torque", "natural_frequency": 6.0},
        "scene": {"obstacles": []},
        "sample_period": 2.0,
    }  # fmt: skip
    coarse = answer(client.post("/v1/simulate", json=body))["tube"]["limits"]["torque"]["ratio"]
    fine = answer(client.post("/v1/simulate", json=body | {"sample_period": 1e-3}))
    largest = np.abs(fine["torque"]).max() / 1000.0
    assert largest <= coarse <= 1.3 * largest

"""Recordings read back by MCAP's own reader: one clock, messages of their schemas, true places."""

import io
import json
from typing import Any

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward, joint_frames
from kinematics.pose import transform as transform_of
from kinematics.trajectory.trajectory import stay
from obstacles.collision.fcl_distance import FclWorld
from obstacles.convex.triangles import piece_triangles
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.exports.export import Place
from planning.exports.program import ProgramPart
from planning.exports.recording import record, record_parts
from planning.proof.certificate import certify
from planning.values.finger_motion import FingerMotion
from tests.planning.exports.test_export import SCENE, UR, rest_to_rest
from tests.planning.sequence import fingers

MOTION = rest_to_rest()


def messages(content: bytes) -> dict[str, list[tuple[float, Any]]]:
    """Times [s] and messages of each topic, every one checked against its schema."""
    found: dict[str, list[tuple[float, Any]]] = {}
    for schema, channel, message in make_reader(io.BytesIO(content)).iter_messages():
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        value, form = json.loads(message.data), json.loads(schema.data)
        assert form["title"] == schema.name
        jsonschema.validate(value, form)
        found.setdefault(channel.topic, []).append((message.log_time * 1e-9, value))
    return found


def transform(value: dict[str, Any], position: str, turn: str) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([value[turn][name] for name in "xyzw"]).as_matrix()
    T[:3, 3] = [value[position][name] for name in "xyz"]
    return T


def drawn(robot: RobotGeometry, topics: dict[str, Any], instant: int, update: int = 0) -> Array:
    """Corners of all triangles of the robot where the frames carry them, in the root frame."""
    frames = {robot.chain.root_link: np.eye(4)}
    for row in topics["/tf"][instant][1]["transforms"]:
        assert row["parent_frame_id"] == robot.chain.root_link
        frames[row["child_frame_id"]] = transform(row, "translation", "rotation")
    corners = []
    for entity in topics["/robot"][update][1]["entities"]:
        (surface,) = entity["triangles"]
        T = frames[entity["frame_id"]] @ transform(surface["pose"], "position", "orientation")
        points = np.array([[point[name] for name in "xyz"] for point in surface["points"]])
        corners.append(points[surface["indices"]] @ T[:3, :3].T + T[:3, 3])
    return np.concatenate(corners)


def corners(robot: RobotGeometry, q: Array) -> Array:
    """Corners of all triangles of the robot at a configuration, in the root frame."""
    carriers = joint_frames(robot.chain, q)
    found = []
    for piece, joint in zip(robot.pieces, robot.joints, strict=True):
        surface = piece_triangles(piece)
        T = np.eye(4) if joint < 0 else carriers[joint]
        found.append(surface.vertices[surface.faces.ravel()] @ T[:3, :3].T + T[:3, 3])
    return np.concatenate(found)


def assert_same(found: Array, wanted: Array) -> None:
    # By link and joint, in place of one piece after the other.
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(wanted, axis=0), atol=2e-6)


@pytest.fixture(scope="module")
def held() -> RobotGeometry:
    crate = Obstacle("crate", Box((0.1, 0.2, 0.06)), np.eye(4))
    return UR.attach(crate, UR.chain.tip_link)


def test_the_arm_stands_where_its_pieces_are(held: RobotGeometry) -> None:
    topics = messages(record(MOTION, held, SCENE, sample_period=0.1))
    for instant in (0, 7, len(topics["/tf"]) - 1):
        time = topics["/tf"][instant][0]
        assert_same(drawn(held, topics, instant), corners(held, MOTION.sample(np.array([time]))[0]))


def test_everything_is_on_one_clock() -> None:
    certificate = certify(MOTION, UR, SCENE)
    topics = messages(record(MOTION, UR, SCENE, certificate, sample_period=0.03))
    times = np.array([time for time, _ in topics["/joint_states"]])
    assert (times[0], times[-1]) == (0.0, MOTION.duration)
    assert np.all(np.diff(times) > 0.0)
    assert [time for time, _ in topics["/tf"]] == times.tolist()
    for time, value in topics["/joint_states"]:
        assert value["timestamp"]["sec"] + 1e-9 * value["timestamp"]["nsec"] == pytest.approx(time)
        for order, name in enumerate(("position", "velocity", "acceleration")):
            row = [joint[name] for joint in value["joints"]]
            np.testing.assert_allclose(row, MOTION.sample(np.array([time]), order)[0], atol=1e-9)
    world = FclWorld(UR, SCENE)
    for time, value in topics["/clearance"]:
        own = world.nearest_points(MOTION.sample(np.array([time]))[0])
        assert value["distance"] == pytest.approx(own.distance, abs=1e-9)
        assert value["distance"] >= certificate.min_clearance - 1e-9
    ((_, told),) = topics["/certificate"]
    assert told["message"].startswith("Proved for every instant, against a scene of 1 obstacle")
    ((_, around),) = topics["/scene"]
    assert [entity["id"] for entity in around["entities"]] == [SCENE.obstacles[0].id]


def test_parts_follow_each_other_with_what_is_held_and_how_fingers_stand() -> None:
    hand = fingers.robot()
    q, names = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]), hand.chain.joint_names
    first, last = {fingers.LEADER: 0.055}, {fingers.LEADER: 0.02}
    closing = FingerMotion(hand.fingers, first, last, 0.4)
    opened, closed = with_fingers(hand, first), with_fingers(hand, last)
    crate = Obstacle("crate", Box((0.02, 0.02, 0.02)), forward(hand.chain, q))
    box = Obstacle("box", Box((0.1, 0.1, 0.1)), transform_of(None, np.array([0.0, 0.9, 0.3])))
    held = closed.attach(Obstacle(crate.id, crate.shape, np.eye(4)), hand.chain.tip_link)
    parts = [
        ProgramPart("0", "close", stay(names, q, 0.4), Place(opened, Scene([box, crate]), 0.0),
                    closing),
        ProgramPart("1", "attach", stay(names, q, 0.001), Place(held, Scene([box]), 0.0)),
        ProgramPart("2", "move", stay(names, q, 0.3), Place(held, Scene([box]), 0.0)),
    ]  # fmt: skip
    topics = messages(record_parts(parts, [None, None, None]))
    times = np.array([time for time, _ in topics["/tf"]])
    assert np.all(np.diff(times) > 0.0)
    assert times[-1] == pytest.approx(0.701)
    updates = topics["/robot"]
    assert [one["deletions"][0]["type"] for _, one in updates[1:]] == [1] * (len(updates) - 1)
    assert len(updates) == 11
    for number, (time, _) in enumerate(updates):
        share = time / 0.4
        at = 0.055 - 0.035 * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        arm = held if number == 10 else with_fingers(hand, {fingers.LEADER: at})
        instant = int(np.searchsorted(times, time - 1e-9))
        assert_same(drawn(arm, topics, instant, number), corners(arm, q))
    around = [(time, [row["id"] for row in one["entities"]]) for time, one in topics["/scene"]]
    assert around == [(0.0, ["box", "crate"]), (pytest.approx(0.4), ["box"])]


def test_equal_motions_make_equal_files_and_odd_periods_are_refused() -> None:
    assert record(MOTION, UR, SCENE) == record(MOTION, UR, SCENE)
    for period in (0.0, -0.1, float("nan"), 1e-6):
        with pytest.raises(InvalidOption, match="sample_period"):
            record(MOTION, UR, SCENE, sample_period=period)

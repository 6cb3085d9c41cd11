"""Recordings read back by MCAP's reader, and position streams read by protobuf and ElementTree."""

import io
import json
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jsonschema
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward, joint_frames
from kinematics.pose import transform as transform_of
from kinematics.trajectory.trajectory import Trajectory, stay
from obstacles.collision.fcl_distance import FclWorld
from obstacles.convex.triangles import piece_triangles
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.exports.export import Export, Place, export
from planning.exports.options import ExportFormat, ExportOptions
from planning.exports.program import ProgramPart
from planning.exports.recording import record, record_parts
from planning.proof.certificate import certify
from planning.values.finger_motion import FingerMotion
from tests.planning.exports.test_export import SCENE, UR, rest_to_rest
from tests.planning.scenes import builtin, pillar
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


STREAMS = [ExportFormat.EGM, ExportFormat.RSI]
STARTS = {"kr6_sixx": [0.0, -1.2, 1.5, 0.0, 0.6, 0.0], "panda": [0, -0.8, 0, -2.3, 0, 1.6, 0.8]}


def egm() -> dict[str, Any]:
    """Messages of the published egm.proto, as far as they are used."""
    double, uint, message = (descriptor_pb2.FieldDescriptorProto.Type.Value(f"TYPE_{name}")
                             for name in ("DOUBLE", "UINT32", "MESSAGE"))  # fmt: skip
    fields = {
        "EgmHeader": [("seqno", 1, uint, ""), ("tm", 2, uint, ""), ("mtype", 3, uint, "")],
        "EgmJoints": [("joints", 1, double, "")],
        "EgmPlanned": [("joints", 1, message, "EgmJoints"),
                       ("externalJoints", 3, message, "EgmJoints")],
        "EgmSensor": [("header", 1, message, "EgmHeader"), ("planned", 2, message, "EgmPlanned")],
        "EgmRobot": [("header", 1, message, "EgmHeader"), ("feedBack", 2, message, "EgmPlanned"),
                     ("mciConvergenceMet", 6, uint, "")],
    }  # fmt: skip
    file = descriptor_pb2.FileDescriptorProto(name="egm.proto", package="egm", syntax="proto2")
    for name, members in fields.items():
        added = file.message_type.add(name=name)
        for field, number, kind, of in members:
            more = {"type_name": f".egm.{of}"} if of else {}
            label = 3 if kind == double else 1
            added.field.add(name=field, number=number, type=kind, label=label, **more)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    get = message_factory.GetMessageClass
    return {name: get(pool.FindMessageTypeByName(f"egm.{name}")) for name in fields}


EGM = egm()


def ask_egm(axes: Array, cycle: int) -> bytes:
    robot = EGM["EgmRobot"](mciConvergenceMet=1)
    robot.header.seqno, robot.header.tm, robot.header.mtype = cycle, 70_000 * cycle, 2
    robot.feedBack.joints.joints.extend(axes[:6])
    robot.feedBack.externalJoints.joints.extend(axes[6:])
    return bytes(robot.SerializeToString())


def read_egm(answer: bytes, start: Array, cycle: int) -> Array:
    sensor = EGM["EgmSensor"].FromString(answer)
    assert sensor.header.seqno == cycle + 1
    assert sensor.header.mtype == 3
    assert len(sensor.planned.joints.joints) == 6
    return np.array([*sensor.planned.joints.joints, *sensor.planned.externalJoints.joints])


def ask_rsi(axes: Array, cycle: int) -> bytes:
    own = " ".join(f'A{k}="{x}"' for k, x in enumerate(axes[:6], 1))
    more = " ".join(f'E{k}="{x}"' for k, x in enumerate(axes[6:], 1))
    text = f'<Rob Type="KUKA"><RIst X="1.0" Y="2.0"/><AIPos {own}/><EIPos {more}/><Delay D="0"/>'
    return f"{text}<IPOC>{400 + 12 * cycle}</IPOC></Rob>".encode()


def read_rsi(answer: bytes, start: Array, cycle: int) -> Array:
    tree = ElementTree.fromstring(answer.decode())
    assert tree.tag == "Sen"
    assert tree.findtext("IPOC") == str(400 + 12 * cycle)
    off = [float(x) for tag in ("AK", "EK") for found in tree.findall(tag)
           for x in found.attrib.values()]  # fmt: skip
    return np.asarray(start + off)


CODECS: dict[ExportFormat, tuple[Callable[[Array, int], bytes],
                                 Callable[[bytes, Array, int], Array]]] = {
    ExportFormat.EGM: (ask_egm, read_egm), ExportFormat.RSI: (ask_rsi, read_rsi)
}  # fmt: skip


@contextmanager
def running(made: Export, folder: Path) -> Iterator[tuple["subprocess.Popen[str]", int]]:
    """The exported program, run by Python, and its port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    file = folder / made.file_name
    file.write_text(made.text)
    command = [sys.executable, "-I", str(file), "--host", "127.0.0.1", "--port", str(port)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        yield process, port


def played(made: Export, form: ExportFormat, at: Array, cycles: int, folder: Path) -> list[Array]:
    """Axes that a controller is sent from where it stands, and that it goes to [degrees]."""
    ask, read = CODECS[form]
    sent: list[Array] = []
    with running(made, folder) as (process, port), \
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:  # fmt: skip
        link.settimeout(0.2)
        while len(sent) < cycles and process.poll() is None:
            message = ask(sent[-1] if sent else at, len(sent))
            link.sendto(message, ("127.0.0.1", port))
            try:
                answer = link.recv(65536)
            except (TimeoutError, ConnectionError):  # not there yet, or it refuses
                continue
            sent.append(read(answer, at, len(sent)))
        code = process.wait(10.0)
        assert process.stderr is not None
        told = process.stderr.read()
        assert code == (0 if sent else 1), told
        assert sent or "not at the start" in told
    return sent


def swing(robot: RobotGeometry, seed: int) -> Trajectory:
    """A quintic from rest to rest."""
    random, start = np.random.default_rng(seed), np.array(STARTS[robot.chain.name])
    step, T = random.uniform(-0.4, 0.4, len(start)), random.uniform(0.5, 1.2)
    rows = [start, 0 * step, 0 * step, 10 * step / T**3, -15 * step / T**4, 6 * step / T**5]
    return Trajectory(robot.chain.joint_names, np.array([0.0, T]), np.stack(rows, -1)[None])


@pytest.mark.parametrize("form", STREAMS)
@pytest.mark.parametrize(("name", "seed"), [("kr6_sixx", 1), ("panda", 2)])
def test_a_controller_is_led_along_the_proved_motion(
    form: ExportFormat, name: str, seed: int, tmp_path: Path
) -> None:
    robot, scene = builtin(name), pillar(-0.7, 0.6)
    motion = swing(robot, seed)
    made = export(motion, robot, scene, ExportOptions(form))
    assert made.proved, made.certificate.violation
    assert made.tolerance is not None
    period = ExportOptions(form).period
    assert made.point_count == round(made.motion.duration / period) + 1
    assert 0.0 <= made.motion.duration - motion.duration < period
    # Off the start by less than the tolerance: it is led there by small steps.
    random = np.random.default_rng(seed)
    off = np.rad2deg(min(made.tolerance, 0.004)) * random.uniform(-0.9, 0.9, robot.chain.n)
    at = np.rad2deg(motion.start) + off
    lead = int(np.ceil(np.abs(off).max() / 0.01))
    sent = np.deg2rad(played(made, form, at, lead + made.point_count + 5, tmp_path))
    assert np.abs(np.diff(sent[: lead + 1], axis=0)).max() <= np.deg2rad(0.0101)
    times = np.arange(made.point_count) * period
    expected = made.motion.sample(times)
    # RSI takes corrections in millionths of a degree from where the arm stood.
    np.testing.assert_allclose(sent[lead : lead + made.point_count], expected, atol=2e-8)
    np.testing.assert_allclose(sent[-5:], np.tile(sent[-6], (5, 1)), atol=1e-12)
    np.testing.assert_allclose(sent[-1], motion.end, atol=2e-8)
    world = FclWorld(robot, scene)
    least = min(world.clearance(q).distance for q in sent[lead::4])
    assert made.certificate.min_clearance <= least + 1e-6


@pytest.mark.parametrize("form", STREAMS)
def test_nothing_is_sent_to_an_arm_that_is_not_at_the_start(
    form: ExportFormat, tmp_path: Path
) -> None:
    robot = builtin("kr6_sixx")
    motion = swing(robot, 3)
    made = export(motion, robot, Scene(()), ExportOptions(form))
    off = np.zeros(6)
    off[2] = np.rad2deg(made.tolerance or 1e-3) * 1.01
    assert not played(made, form, np.rad2deg(motion.start) + off, 5, tmp_path)
    assert not played(made, form, np.rad2deg(motion.start)[:5], 5, tmp_path)


def test_corrections_that_the_controller_has_to_allow_are_told() -> None:
    made = export(swing(builtin("kr6_sixx"), 4), builtin("kr6_sixx"), Scene(()),
                  ExportOptions(ExportFormat.RSI))  # fmt: skip
    (line,) = [line for line in made.text.splitlines() if "AXISCORR" in line]
    rows = np.rad2deg(made.motion.sample(np.linspace(0.0, made.motion.duration, 500)))
    low, high = (rows - rows[0]).min(axis=0), (rows - rows[0]).max(axis=0)
    for k in range(6):
        assert f"A{k + 1} {low[k]:.3f} to {high[k]:.3f}" in line.replace("-0.000", "0.000")


@pytest.mark.parametrize("form", STREAMS)
@pytest.mark.parametrize("period", [0.002, 0.01, 0.02 / 3])
def test_a_period_that_the_controller_has_not_is_refused(form: ExportFormat, period: float) -> None:
    with pytest.raises(InvalidOption, match=f"{form.value} takes a position each"):
        ExportOptions(form, sample_period=period)

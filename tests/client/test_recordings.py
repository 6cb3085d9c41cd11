"""Recordings as people have them: written by other libraries, with what is wrong with them told."""

import json
import re
import sys
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from armwright_client.recordings.recording import Recording, read_recording
from armwright_wire.errors import InvalidArgument
from armwright_wire.robots.identification import LogBody

JOINTS = ("a", "b", "c")
TIMES = 0.01 * np.arange(50)
Q = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3))
TAU = 10.0 * Q[:, ::-1]
MIXED = ("gripper", "c", "a", "b")  # an order of the file's own, with a joint more
State = tuple[float, Sequence[str], np.ndarray, np.ndarray]
START = 1_700_000_000.0


def mixed(values: np.ndarray) -> np.ndarray:
    return np.column_stack([0.0 * values[:, 0], values[:, 2], values[:, 0], values[:, 1]])


def states(names: Sequence[str] = MIXED, efforts: bool = True) -> list[State]:
    rows = (mixed(Q), mixed(TAU)) if names[0] == "gripper" else (Q, TAU)
    none = np.zeros(0)
    return [(t, names, q, tau if efforts else none)
            for t, q, tau in zip(TIMES.tolist(), *rows, strict=True)]  # fmt: skip


def message(store: Any, state: State, stamped: bool = True) -> Any:
    types = store.types
    time = START + state[0] if stamped else 0.0
    sec, fraction = int(time), time % 1.0
    stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=round(1e9 * fraction))
    form = types["std_msgs/msg/Header"]
    fields = {"stamp": stamp, "frame_id": ""}
    header = form(seq=0, **fields) if "seq" in form.__dataclass_fields__ else form(**fields)
    return types["sensor_msgs/msg/JointState"](
        header=header, name=list(state[1]), position=state[2], velocity=np.zeros(0), effort=state[3]
    )


Topics = dict[str, list[State]]


def bag2(path: Path, topics: Topics, storage: Any = StoragePlugin.SQLITE3, **how: Any) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/JointState"
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        for topic, rows in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for row in rows:
                data = store.serialize_cdr(message(store, row, **how), kind)
                writer.write(connection, round(1e9 * (START + row[0])), data)
    return path


def bag2_mcap(path: Path, topics: Topics) -> Path:
    return bag2(path, topics, StoragePlugin.MCAP)


def mcap_of_bag(path: Path, topics: Topics) -> Path:
    return next(bag2_mcap(path, topics).glob("*.mcap"))


def db3_of_bag(path: Path, topics: Topics) -> Path:
    return next(bag2(path, topics).glob("*.db3"))


def bag1(path: Path, topics: Topics) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    kind, path = "sensor_msgs/msg/JointState", path.with_suffix(".bag")
    with Writer1(path) as writer:
        for topic, rows in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for row in rows:
                data = store.serialize_ros1(message(store, row), kind)
                writer.write(connection, round(1e9 * (START + row[0])), data)
    return path


def mcap_in_json(path: Path, topics: Topics) -> Path:
    stream = BytesIO()
    writer = McapWriter(stream)
    writer.start()
    schema = writer.register_schema("foxglove.JointStates", "jsonschema", b"{}")
    for topic, rows in topics.items():
        channel = writer.register_channel(topic, "json", schema)
        for t, names, q, tau in rows:
            joints = [{"name": n, "position": x, "effort": y}
                      for n, x, y in zip(names, q, tau, strict=True)]  # fmt: skip
            stamp = {"sec": int(START + t), "nsec": round(1e9 * (t % 1.0))}
            content = json.dumps({"timestamp": stamp, "joints": joints}).encode()
            writer.add_message(channel, 0, content, 0)
    writer.finish()  # type: ignore[no-untyped-call]
    path = path.with_suffix(".mcap")
    path.write_bytes(stream.getvalue())
    return path


def messages_in_yaml(path: Path, topics: Topics) -> Path:
    documents = [
        {"header": {"stamp": {"sec": int(START), "nanosec": round(1e9 * t)}, "frame_id": ""},
         "name": list(names), "position": q.tolist(), "velocity": [], "effort": tau.tolist()}
        for t, names, q, tau in topics["/joint_states"]
    ]  # fmt: skip
    path = path.with_suffix(".yaml")
    path.write_text(yaml.safe_dump_all(documents, explicit_start=True))
    return path


def trajectory_in_json(path: Path, topics: Topics) -> Path:
    points = [
        {"positions": q.tolist(), "effort": tau.tolist(),
         "time_from_start": {"secs": 3, "nsecs": round(1e9 * t)}}
        for t, _, q, tau in topics["/joint_states"]
    ]  # fmt: skip
    path = path.with_suffix(".json")
    path.write_text(json.dumps({"joint_names": list(MIXED), "points": points}))
    return path


def log_in_json(path: Path, topics: Topics) -> Path:
    path = path.with_suffix(".json")
    log = {"positions": Q.tolist(), "torques": TAU.tolist(), "period": 0.01}
    path.write_text(json.dumps(log))
    return path


WRITERS: tuple[Callable[[Path, Topics], Path], ...] = (
    bag1, bag2, bag2_mcap, mcap_of_bag, db3_of_bag, mcap_in_json, messages_in_yaml,
    trajectory_in_json, log_in_json,
)  # fmt: skip


def same(found: Recording, precision: float = 0.0) -> None:
    assert found.joint_names == JOINTS
    np.testing.assert_allclose(found.times or [], TIMES, atol=1e-6)  # stamps since 1970
    np.testing.assert_allclose(found.positions, Q, atol=precision)
    np.testing.assert_allclose(found.torques or [], TAU, atol=10.0 * precision)


@pytest.mark.parametrize("write", WRITERS, ids=lambda write: write.__name__)
def test_files_of_other_libraries_are_read_by_the_names_of_joints(
    tmp_path: Path, write: Callable[[Path, Topics], Path]
) -> None:
    found = read_recording(write(tmp_path / "log", {"/joint_states": states()}), JOINTS)
    same(found)
    assert not found.notes
    log = LogBody.of(**found.log())
    np.testing.assert_allclose(log.torques or [], TAU)


def csv(path: Path, header: str, *columns: np.ndarray, separator: str = ",") -> Path:
    rows = np.column_stack(columns).tolist()
    lines = [header, *(separator.join(map(repr, row)) for row in rows)]
    path = path / "log.csv"
    path.write_text("\n".join(lines))
    return path


FORMS = {
    "time [s],position.c [rad],position.a [rad],position.b [rad],torque.a [N m],torque.b [Nm],"
    "torque.c [N·m]": (TIMES, Q[:, [2, 0, 1]], TAU),
    "time [ms];position a (deg);position b (deg);position c (deg);effort c [mNm];effort a [mNm];"
    "effort b [mNm]": (1e3 * TIMES, np.degrees(Q), 1e3 * TAU[:, [2, 0, 1]]),
    "__time,/joint_states/a/position,/joint_states/b/position,/joint_states/c/position,"
    "/joint_states/a/effort,/joint_states/b/effort,/joint_states/c/effort": (START + TIMES, Q, TAU),
}


@pytest.mark.parametrize("header", FORMS)
def test_tables_state_their_units(tmp_path: Path, header: str) -> None:
    mark = ";" if ";" in header else ","
    same(read_recording(csv(tmp_path, header, *FORMS[header], separator=mark), JOINTS), 1e-12)


def test_a_logger_of_universal_robots_numbers_its_joints(tmp_path: Path) -> None:
    header = " ".join(["timestamp", *(f"actual_q_{i}" for i in range(3)),
                       *(f"actual_current_{i}" for i in range(3))])  # fmt: skip
    path = csv(tmp_path, header, TIMES, Q, TAU, separator=" ")
    found = read_recording(path, JOINTS)
    log = LogBody.of(**found.log([2.0, 3.0, 4.0]))
    np.testing.assert_allclose(log.currents or [], TAU)
    with pytest.raises(InvalidArgument, match="gains"):
        found.log()


@pytest.mark.parametrize(
    ("header", "columns", "words"),
    [
        ("time [s],position.a [turns]", (TIMES, Q[:, 0]), "'position.a .turns.' has no unit"),
        ("time [h],position.a [rad]", (TIMES, Q[:, 0]), "Units of stamp are s, ms"),
        ("time [s],position.a,position.b,torque.a", (TIMES, Q[:, :2], Q[:, 0]),
         "missing: torques of b"),
        ("time [s],position.a,torque.a,effort.a", (TIMES, Q), "torques stands twice"),
        ("t,u,v", (TIMES, Q[:, :2]), "no column of"),
        ("0.0,0.1", (TIMES, Q[:, 0]), "no column of"),
        ("time [s],position.a,extra", (TIMES, Q[:, 0]), "row 2 has 2 values for 3 columns"),
        ("time [s],position.a,x,y [m],z [m]", (TIMES, Q, Q[:, 0]), "'x' has no unit"),
    ],
)  # fmt: skip
def test_tables_that_can_not_be_understood_are_refused(
    tmp_path: Path, header: str, columns: tuple[np.ndarray, ...], words: str
) -> None:
    with pytest.raises(InvalidArgument, match=words):
        read_recording(csv(tmp_path, header, *columns), ["a"])


def test_positions_in_other_units_are_refused_by_the_limits(tmp_path: Path) -> None:
    path = csv(tmp_path, "time,position.a,position.b", TIMES, np.degrees(Q[:, :2]))
    free = [-np.inf, -2.0], [np.inf, 2.0]
    assert len(read_recording(path, ["a"], limits=([-np.inf], [np.inf])).positions) == 50
    with pytest.raises(InvalidArgument, match=r"positions of b .* beyond its limits -2 and 2"):
        read_recording(path, ["a", "b"], limits=free)


def test_other_joints_are_refused_and_those_there_are_named(tmp_path: Path) -> None:
    path = bag2(tmp_path / "bag", {"/joint_states": states()})
    with pytest.raises(InvalidArgument, match=r"no positions of x, y; .*/joint_states gripper, c"):
        read_recording(path, ["x", "y"])
    assert read_recording(path).joint_names == MIXED
    both = bag2(tmp_path / "both", {"/joint_states": [*states(), *states(JOINTS)]})
    with pytest.raises(InvalidArgument, match=r"gripper \.\.\..*a \.\.\..*names of the joints"):
        read_recording(both)


def test_of_several_robots_one_is_named(tmp_path: Path) -> None:
    left: list[State] = [(t, [f"left/{n}" for n in JOINTS], q, u) for t, _, q, u in states(JOINTS)]
    right: list[State] = [
        (t, [f"right/{n}" for n in JOINTS], 2.0 * q, u) for t, _, q, u in states(JOINTS)
    ]
    one = bag2(tmp_path / "one", {"/joint_states": [*left, *right]})
    with pytest.raises(InvalidArgument, match=r"'left/'.*'right/'"):
        read_recording(one, JOINTS)
    found = read_recording(one, JOINTS, prefix="left/")
    same(found)
    assert found.notes == ("50 messages of other joints are left out",)
    two = bag2(tmp_path / "two", {"/a": states(JOINTS), "/b": states(JOINTS), "/c": left})
    with pytest.raises(InvalidArgument, match=r"topic '/a'.*topic '/b'"):
        read_recording(two, JOINTS)
    same(read_recording(two, JOINTS, topic="/b"))
    alone = read_recording(bag2(tmp_path / "three", {"/c": left}), JOINTS)
    same(alone)
    assert alone.notes == ("joints are called left/a and so on",)


def test_late_and_repeated_rows_are_sorted_and_told(tmp_path: Path) -> None:
    order = [*range(10), 11, 10, *range(12, 50), 49]
    header = f"time [s],{','.join(f'position.{name}' for name in JOINTS)}"
    found = read_recording(csv(tmp_path, header, TIMES[order], Q[order]), JOINTS)
    np.testing.assert_allclose(found.positions, Q)
    assert len(found.notes) == 2
    assert re.fullmatch(r"1 rows came late, by 0.01 s at most: they are sorted", found.notes[0])
    assert "1 rows stand twice" in found.notes[1]


def test_clocks_that_jump_and_stamps_with_two_positions_are_refused(tmp_path: Path) -> None:
    back = np.concatenate([TIMES[:25], TIMES[:25]])
    with pytest.raises(InvalidArgument, match=r"at row 26 times go back by 0.24 s.*part them"):
        read_recording(csv(tmp_path, "time [s],position.a", back, Q[:, 0]), ["a"])
    twice = np.maximum(TIMES, 0.01)
    with pytest.raises(InvalidArgument, match=r"rows 1 and 2 have the time 0.01 s"):
        read_recording(csv(tmp_path, "time [s],position.a", twice, Q[:, 0]), ["a"])
    gap = np.where(np.arange(50) == 7, np.nan, TIMES)
    with pytest.raises(InvalidArgument, match="1 of 50 rows have no time"):
        read_recording(csv(tmp_path, "time [s],position.a", gap, Q[:, 0]), ["a"])


def test_messages_without_stamps_take_the_times_of_recording(tmp_path: Path) -> None:
    path = bag2(tmp_path / "bag", {"/joint_states": states()}, stamped=False)
    found = read_recording(path, JOINTS)
    same(found)
    assert "no stamps" in found.notes[0]


def test_what_is_no_number_is_refused_or_left_out(tmp_path: Path) -> None:
    names = ",".join(f"{kind}.{name}" for kind in ("position", "torque") for name in JOINTS)
    broken = Q.copy()
    broken[[4, 9], 1] = np.nan
    path = csv(tmp_path, f"time [s],{names}", TIMES, broken, TAU)
    with pytest.raises(InvalidArgument, match="not a number for b in row 5, and in 2 of 50"):
        read_recording(path, JOINTS)
    cut = read_recording(path, JOINTS, span=(0.1, 0.3))
    np.testing.assert_allclose(cut.positions, Q[10:31])
    np.testing.assert_allclose(cut.times or [], TIMES[:21], atol=1e-12)
    found = read_recording(csv(tmp_path, f"time [s],{names}", TIMES, TAU, broken), JOINTS)
    assert found.torques is None
    with pytest.raises(InvalidArgument, match=r"neither torques.*not a number for b in row 5"):
        found.log()


def test_efforts_that_are_missing_are_told_where_they_are_needed(tmp_path: Path) -> None:
    rows = [*states()[:40], *states(efforts=False)[40:]]
    found = read_recording(bag2(tmp_path / "bag", {"/joint_states": rows}), JOINTS)
    with pytest.raises(InvalidArgument, match="missing in row 41, and in 10 of 50"):
        found.log()
    none = read_recording(bag2(tmp_path / "none", {"/j": states(efforts=False)}), JOINTS)
    with pytest.raises(InvalidArgument, match="neither torques nor currents"):
        none.log()


def test_measurements_of_a_tip_have_the_joints_of_their_instants(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    bag = tmp_path / "bag"
    kinds = ("sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseStamped")
    types, pose = store.types, "geometry_msgs/msg/"
    with Writer2(bag, version=9) as writer:
        joints, tips = (
            writer.add_connection(name, kind, typestore=store)
            for name, kind in zip(("/joint_states", "/tip"), kinds, strict=True)
        )
        for row in states(JOINTS):
            now = round(1e9 * (START + row[0]))
            state = message(store, row)
            writer.write(joints, now, store.serialize_cdr(state, kinds[0]))
            if row[0] in TIMES[[10, 20]]:
                at = types[pose + "Pose"](
                    position=types[pose + "Point"](x=row[0], y=2.0, z=3.0),
                    orientation=types[pose + "Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
                )
                told = types[kinds[1]](header=state.header, pose=at)
                writer.write(tips, now, store.serialize_cdr(told, kinds[1]))
    found = read_recording(bag, JOINTS, tip="/tip")
    np.testing.assert_allclose(found.positions, Q[[10, 20]], atol=1e-4)
    poses: Any = found.tip["poses"]
    assert [tuple(pose["position"]) for pose in poses] == [(0.1, 2.0, 3.0), (0.2, 2.0, 3.0)]
    assert read_recording(bag, JOINTS).times is not None
    header = "position.a,position.b,position.c,z [mm],x [mm],y [mm]"
    columns = Q, 1e3 * Q[:, [2, 0, 1]]
    table = read_recording(csv(tmp_path, header, *columns), JOINTS)
    assert table.times is None
    np.testing.assert_allclose(np.array(table.tip["positions"], float), Q)
    turns = np.tile([1.0, 0.1, 0.2, 0.3], (50, 1))
    table = read_recording(csv(tmp_path, f"{header},qw,qx,qy,qz", *columns, turns), JOINTS)
    first: Any = table.tip["poses"][0]
    assert first["quaternion_xyzw"] == [0.1, 0.2, 0.3, 1.0]
    for part, words in (("x [m],y [m],qw", "columns are missing"), ("qw,qx,qy", "missing beside q"),
                        ("qw,qx,qy,qz", "no x, y and z")):  # fmt: skip
        path = csv(tmp_path, f"position.a,{part}", Q[:, 0], turns[:, : part.count(",") + 1])
        with pytest.raises(InvalidArgument, match=words):
            read_recording(path, ["a"])


@pytest.mark.parametrize(
    "name", ["log.mcap", "log.bag", "log.json", "log.yaml", "log.xyz", "x.csv"]
)
def test_a_file_that_is_none_is_refused_with_its_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name != "x.csv":
        path.write_bytes(b"[\x00\x01")
    with pytest.raises(InvalidArgument, match=name):
        read_recording(path)


@pytest.mark.parametrize(
    ("library", "write"), [("rosbags", bag2), ("mcap", mcap_in_json), ("yaml", messages_in_yaml)]
)
def test_the_extra_that_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str, write: Any
) -> None:
    path = write(tmp_path / "log", {"/joint_states": states()})
    for name in [one for one in sys.modules if one.split(".")[0] == library]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InvalidArgument, match=rf"{library}.*not installed.*\[recordings\]"):
        read_recording(path)


@pytest.mark.parametrize("seed", range(20))
def test_messages_of_any_order_and_joints_give_the_same_motion(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    store = {name: (q, tau) for name, q, tau in zip(JOINTS, Q.T, TAU.T, strict=True)}
    documents = []
    for k, t in enumerate(TIMES.tolist()):
        names = [*JOINTS, *(f"other{i}" for i in range(rng.integers(3)))]
        rng.shuffle(names)
        rows = [[float(store[name][i][k]) if name in store else 9.0 for name in names]
                for i in range(2)]  # fmt: skip
        stamp = {"sec": 5, "nanosec": round(1e9 * t)}
        message: dict[str, Any] = {
            "header": {"stamp": stamp},
            "name": names,
            "position": rows[0],
            "effort": rows[1],
        }
        documents.append(message)
        if rng.random() < 0.5:  # the same state again, in the order of another publisher
            back = {key: message[key][::-1] for key in ("name", "position", "effort")}
            documents.append(message | back)
        if rng.random() < 0.2:  # a gripper tells its state on the same topic
            documents.append({"header": {"stamp": stamp}, "name": ["grip"], "position": [0.0]})
    for k in np.flatnonzero(rng.random(len(documents) - 1) < 0.2).tolist():
        documents[k : k + 2] = documents[k : k + 2][::-1]
    path = tmp_path / "log.json"
    path.write_text(json.dumps(documents))
    same(read_recording(path, JOINTS))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_files_that_end_early_are_refused(tmp_path: Path, share: float) -> None:
    for write in (bag1, mcap_of_bag, db3_of_bag, mcap_in_json):
        path = write(tmp_path / write.__name__, {"/joint_states": states()})
        data = path.read_bytes()
        path.write_bytes(data[: int(share * len(data))])
        with pytest.raises(InvalidArgument, match=r"can.t be read|no positions"):
            read_recording(path, JOINTS)

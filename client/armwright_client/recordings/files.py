"""Rows of tables, ROS messages, MCAP files and rosbags, as they were recorded.

Bags and MCAP files are read by the libraries rosbags and mcap, which the extra [recordings] names.
"""

import csv
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

from armwright_wire.errors import InvalidArgument

_INSTALL = "pip install rosbags mcap pyyaml, which the extra [recordings] of Armwright names"
HINT = (
    "Give a CSV with a header such as time [s], position.JOINT [rad], torque.JOINT [N m]; "
    "JointTrajectory or JointState as JSON or YAML; an MCAP file; or a rosbag."
)
#: Messages that are read, by the last part of their types' names.
_MESSAGES = ("JointState", "JointStates", "JointTrajectory")
_POSES = ("PoseStamped", "PointStamped", "TransformStamped")
#: Kinds of columns, and the fields that they are.
_KINDS = {
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "torque": "torques",
    "effort": "torques",
    "current": "currents",
}
#: Those that messages have for each joint.
_FIELDS = {kind: _KINDS[kind] for kind in ("position", "velocity", "acceleration", "effort")}
#: Columns that a logger of Universal Robots writes, in its units: these are ours.
_RTDE = {"q": "position", "qd": "velocity", "current": "current"}
#: Columns of an instant and of a measurement of the tip, and the field that they are.
_ALONE = {
    **dict.fromkeys(("time", "__time", "timestamp"), "stamp"),
    **dict.fromkeys("xyz", "point"),
    **dict.fromkeys(("qx", "qy", "qz", "qw"), "quaternion"),
    "distance": "distance",
}
_TURN, _LENGTH = {"rad": 1.0, "deg": pi / 180.0, "°": pi / 180.0}, {"m": 1.0, "mm": 1e-3}
_JOINT = _TURN | _LENGTH
#: Units of each field, and their factors.
_UNITS = {
    "positions": _JOINT,
    "velocities": {f"{unit}/s": factor for unit, factor in _JOINT.items()},
    "accelerations": {f"{unit}/s^2": factor for unit, factor in _JOINT.items()},
    "torques": {"Nm": 1.0, "mNm": 1e-3, "N": 1.0},
    "currents": {"A": 1.0, "mA": 1e-3},
    "stamp": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "point": _LENGTH,
    "distance": _LENGTH,
    "quaternion": {"1": 1.0},
}
_HEADER = re.compile(r"\s*(?P<name>.*?)\s*(?:[\[(](?P<unit>[^\[\]()]*)[\])])?\s*")
_OURS = re.compile(r"(?P<kind>[a-z]+)[. ](?P<joint>.+)")
_PLOTTED = re.compile(r".*/(?P<joint>[^/]+)/(?P<kind>[a-z]+)")
_LOGGED = re.compile(r"actual_(?P<kind>qd?|current)_(?P<joint>\d+)")


class Row(NamedTuple):
    """What was recorded at one instant.

    Args:
        stamp: Time of the measurement [s]; None where there is none.
        received: Time at which it was recorded [s]; None where that is not known.
        names: Names of the joints, or their numbers from 0 on; none of the tip.
        values: Fields such as positions, one value for each joint, or those of the tip.
    """

    stamp: float | None
    received: float | None
    names: tuple[str, ...]
    values: Mapping[str, Sequence[float]]


def read_rows(path: Path) -> dict[str, list[Row]]:
    """The rows of a file by their topic, which is empty where there are no topics.

    Args:
        path: A .csv, .json, .yaml, .mcap, .bag or .db3, or the folder of a rosbag.

    Raises:
        InvalidArgument: The file is not there, is malformed or of another kind, or a library that
            reads it is not installed.
    """
    kind = path.suffix.lower()
    try:
        topics: dict[str, list[Row]] = {}
        read = _of_bag if path.is_dir() else _READERS.get(kind)
        for topic, row in () if read is None else read(path):
            topics.setdefault(topic, []).append(row)
    except ImportError as error:
        raise InvalidArgument(
            f"{path} is read with {error.name}, which is not installed", hint=_INSTALL
        ) from None
    except InvalidArgument:
        raise
    except Exception as error:  # noqa: BLE001  (readers of files raise many)
        cause = " ".join(str(error).split()) or type(error).__name__
        raise InvalidArgument(f"{path} can't be read: {cause}", hint=HINT) from None
    if read is None:
        raise InvalidArgument(f"{path} is no recording that is known", hint=HINT)
    return topics


def _of_table(path: Path) -> Iterator[tuple[str, Row]]:
    lines = [line for line in path.read_text("utf-8-sig").splitlines() if line[:1] != "#"]
    separator = next((mark for mark in ",;\t" if mark in "".join(lines[:1])), " ")
    header, *table = [row for row in csv.reader(lines, delimiter=separator) if row] or [[]]
    columns: dict[str, list[tuple[str, int, float]]] = {}
    for at, text in enumerate(header):
        for field, name, factor in _column(text, path):
            columns.setdefault(field, []).append((name, at, factor))
    if len(columns.keys() - {"stamp"}) == 0:
        raise InvalidArgument(f"{path}: no column of {header[:8]} is known", hint=HINT)
    names = tuple(name for name, _, _ in columns.get("positions", ()))
    for field, given in columns.items():
        own = {name for name, _, _ in given}
        if len(own) < len(given):
            raise InvalidArgument(f"{path}: a column of {field} stands twice", hint=HINT)
        if field in _KINDS.values() and own != set(names):
            lacking = ", ".join(sorted(set(names) ^ own))
            raise InvalidArgument(f"{path}: columns are missing: {field} of {lacking}", hint=HINT)
        if len(given) < {"point": 3, "quaternion": 4}.get(field, 0):
            raise InvalidArgument(f"{path}: columns are missing beside {', '.join(own)}", hint=HINT)
    if "quaternion" in columns and "point" not in columns:
        raise InvalidArgument(f"{path}: a quaternion has no x, y and z", hint=HINT)
    places = (*names, *_ALONE)
    order = {
        field: sorted(given, key=lambda one: places.index(one[0]))
        for field, given in columns.items()
    }
    for number, row in enumerate(table, 2):
        if len(row) != len(header):
            raise InvalidArgument(
                f"{path}: row {number} has {len(row)} values for {len(header)} columns", hint=HINT
            )
        values = {
            field: [factor * float(row[at]) for _, at, factor in given]
            for field, given in order.items()
        }
        stamp = values.pop("stamp", [None])[0]
        yield "", Row(stamp, None, names, values)


def _column(text: str, path: Path) -> Iterator[tuple[str, str, float]]:
    """Field, joint and factor of a column; nothing where it is of no use."""
    parts = _HEADER.fullmatch(text)
    assert parts is not None
    name, unit = parts["name"], parts["unit"]
    found = _LOGGED.fullmatch(name) or _PLOTTED.fullmatch(name) or _OURS.fullmatch(name)
    kind = "" if found is None else _RTDE.get(found["kind"], found["kind"])
    field = _ALONE.get(name) or _KINDS.get(kind)
    if field is None:
        return
    if unit is None:
        # Joints without one are in our units; a tip is as often in millimetres.
        unit = "" if _UNITS[field] is _LENGTH else next(iter(_UNITS[field]))
    factor = _UNITS[field].get(re.sub("[ ·⋅*]", "", unit).replace("²", "^2"))
    if factor is None:
        raise InvalidArgument(
            f"{path}: column {text!r} has no unit that is known",
            hint=f"Units of {field} are {', '.join(_UNITS[field])}.",
        )
    yield field, name if found is None else found["joint"], factor


def _of_documents(path: Path) -> Iterator[tuple[str, Row]]:
    text = path.read_text("utf-8")
    if path.suffix.lower() == ".json":
        value = json.loads(text)
        documents = value if isinstance(value, list) else [value]
    else:
        import yaml  # noqa: PLC0415

        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        documents = [one for one in yaml.load_all(text, loader) if one is not None]
    if not documents or not all(isinstance(one, dict) for one in documents):
        raise InvalidArgument(f"{path} holds no messages", hint=HINT)
    for message in documents:
        for row in rows_of(message, None):
            yield "", row


def _of_mcap(path: Path) -> Iterator[tuple[str, Row]]:
    from mcap.reader import make_reader  # noqa: PLC0415

    stores: dict[int, Any] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if schema is None or not _is_read(schema.name):
                continue
            if channel.message_encoding == "json":
                document = json.loads(message.data)
            elif channel.message_encoding in ("cdr", "ros1"):
                if schema.id not in stores:
                    stores[schema.id] = _typestore(schema.name, schema.data.decode())
                store, name = stores[schema.id]
                read = store.deserialize_cdr if channel.message_encoding == "cdr" else (
                    store.deserialize_ros1)  # fmt: skip
                document = asdict(read(message.data, name))
            else:
                continue
            for row in rows_of(document, 1e-9 * message.log_time):
                yield channel.topic, row


def _typestore(name: str, definition: str) -> tuple[Any, str]:
    """What reads messages of a type, and the name of that type there."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

    full = name if "/msg/" in name else name.replace("/", "/msg/")
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, full))
    return store, full


def _of_bag(path: Path) -> Iterator[tuple[str, Row]]:
    from rosbags.highlevel import AnyReader  # noqa: PLC0415
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        asked = [one for one in reader.connections if _is_read(one.msgtype)]
        for connection, received, data in reader.messages(asked) if asked else ():
            document = asdict(reader.deserialize(data, connection.msgtype))  # type: ignore[call-overload]
            for row in rows_of(document, 1e-9 * received):
                yield connection.topic, row


def _is_read(name: str) -> bool:
    return re.split(r"[/.]", name)[-1] in (*_MESSAGES, *_POSES)


def rows_of(message: Mapping[str, Any], received: float | None) -> Iterator[Row]:
    """The rows of a ROS message, of one of Foxglove, or of a log as the API has it.

    Args:
        message: Its fields.
        received: Time at which it was recorded [s].
    """
    stamp = _seconds(message.get("timestamp") or (message.get("header") or {}).get("stamp"))
    if "points" in message:  # JointTrajectory
        names = tuple(message.get("joint_names") or ())
        kinds = ("positions", "velocities", "accelerations", "effort")
        for point in message["points"]:
            given = {"torques" if kind == "effort" else kind: point.get(kind) for kind in kinds}
            yield Row(_seconds(point["time_from_start"]), None, names, _plain(given))
    elif "joints" in message:  # foxglove.JointStates
        joints = message["joints"]
        given = {field: [joint[kind] for joint in joints if joint.get(kind) is not None]
                 for kind, field in _FIELDS.items()}  # fmt: skip
        yield Row(stamp, received, tuple(joint["name"] for joint in joints), _plain(given))
    elif "name" in message:  # JointState
        given = {field: message.get(kind) for kind, field in _FIELDS.items()}
        yield Row(stamp, received, tuple(message["name"]), _plain(given))
    elif "positions" in message:  # a log of the API
        names = tuple(str(i) for i in range(len(message["positions"][0])))
        period, times = message.get("period"), message.get("times")
        for i, _ in enumerate(message["positions"]):
            at = times[i] if times else period and period * i
            given = {field: message[field][i] for field in _KINDS.values() if message.get(field)}
            yield Row(at, None, names, _plain(given))
    else:
        pose = message.get("pose") or message.get("transform") or {"position": message.get("point")}
        point = pose.get("position") or pose.get("translation")
        turned = pose.get("orientation") or pose.get("rotation")
        if point is None:
            raise InvalidArgument(f"a message has the fields {', '.join(message)}", hint=HINT)
        given = {"point": [point[axis] for axis in "xyz"],
                 "quaternion": turned and [turned[axis] for axis in "xyzw"]}  # fmt: skip
        yield Row(stamp, received, (), _plain(given))


def _plain(given: Mapping[str, Any]) -> dict[str, list[float]]:
    """Fields that are there, as lists of numbers."""
    rows = {key: [float(value) for value in (() if rows is None else rows)]
            for key, rows in given.items()}  # fmt: skip
    return {key: row for key, row in rows.items() if row}


def _seconds(stamp: Any) -> float | None:
    """A stamp of ROS 1 or 2 or of JSON [s]; None where there is none."""
    if stamp is None or isinstance(stamp, (int, float)):
        return stamp
    seconds, rest = (
        next((float(stamp[name]) for name in names if name in stamp), 0.0)
        for names in (("sec", "secs"), ("nanosec", "nsecs", "nsec"))
    )
    return seconds + 1e-9 * rest


_READERS = {
    **dict.fromkeys((".bag", ".db3"), _of_bag),
    ".mcap": _of_mcap,
    **dict.fromkeys((".csv", ".tsv", ".txt"), _of_table),
    **dict.fromkeys((".json", ".yaml", ".yml"), _of_documents),
}
